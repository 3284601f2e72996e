"""Walkers who are too fast are not as tall as they are taken to be; runners, strollers and bystanders say nothing."""

from dataclasses import replace

import numpy as np
import pytest

import passerby
from passerby.calibration.diagnostics.walking_speed import ScaleBasis, doubts_of_heights, doubts_of_pace, paces, scale_basis
from passerby.core.figures import CueFigures
from passerby.findings.texts import remedy_of
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

FPS = 5.0


def ways(speeds: list[float], *, seconds: int = 30, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Frames with identities, and places, of people who walk straight on."""
    frames = np.arange(1, int(seconds * FPS) + 1)
    keys, places = [], []
    for person, speed in enumerate(speeds):
        keys.append(np.column_stack([frames, np.full(len(frames), person)]))
        along = scale * speed * frames / FPS
        places.append(np.column_stack([along, np.full(len(frames), 2.0 * person), np.full(len(frames), 0.9)]))
    order = np.random.default_rng(0).permutation(len(speeds) * len(frames))
    return np.concatenate(keys)[order], np.concatenate(places)[order]


def test_paces_are_metres_per_second() -> None:
    pace = paces(*ways([1.2]), FPS)
    assert len(pace) == 145
    assert pace == pytest.approx(1.2)


def test_who_is_missing_a_second_later_has_no_pace() -> None:
    keys, places = ways([1.2, 0.9])
    early = keys[:, 0] <= 5
    assert len(paces(keys[early], places[early], FPS)) == 0


def test_children_taken_for_adults_are_told() -> None:
    speeds = [0.9, 1.0, 1.1, 1.2]
    assert doubts_of_pace(*ways(speeds), FPS) == []
    (told,) = doubts_of_pace(*ways(speeds, scale=1.72 / 1.1), FPS)
    assert (told.code, told.values["heights"]) == ("people_walk_fast", "taken")
    assert told.values["speed"] == pytest.approx(1.6, abs=0.05)
    assert "person_height_m" in remedy_of(told)


def test_people_who_run_and_walk_say_nothing() -> None:
    assert doubts_of_pace(*ways([0.9, 1.2, 2.5, 3.0, 3.5]), FPS) == []


@pytest.mark.parametrize(
    ("running", "basis", "told"),
    [(3.5, "taken", False), (4.5, "taken", True), (4.5, "stated", True), (4.5, "measured", False), (5.0, "measured", True)],
)
def test_runners_are_doubted_later_where_a_length_was_measured(running: float, basis: ScaleBasis, told: bool) -> None:
    """Some walk and most run, so that the paces are not those of walkers."""
    found = doubts_of_pace(*ways([0.9, 1.2, 2.0, running, running, running]), FPS, basis)
    assert [one.code for one in found] == ["people_run_fast"] * told
    if told:
        assert found[0].values["speed"] == pytest.approx(running)


def test_people_who_stand_and_recordings_without_a_rate_say_nothing() -> None:
    assert doubts_of_pace(*ways([0.1, 0.0, 0.2]), FPS) == []
    assert doubts_of_pace(*ways([2.0, 2.1]), None) == []


def test_a_stated_height_is_held_against_the_pace_and_a_measured_length_is_not() -> None:
    hurried = ways([1.4, 1.5, 1.6, 1.7])
    (told,) = doubts_of_pace(*hurried, FPS, "stated")
    assert (told.code, told.values["heights"]) == ("people_walk_fast", "stated")
    assert told.values["speed"] == pytest.approx(1.55, abs=0.1)
    assert doubts_of_pace(*hurried, FPS, "measured") == []
    assert doubts_of_pace(*ways([2.5, 2.8, 3.0, 3.5]), FPS, "measured") == []


@pytest.mark.parametrize("basis", ["taken", "stated", "measured"])
def test_nobody_runs_so_fast(basis: str) -> None:
    mixed = [0.9, 1.2, 2.5, 3.0, 3.5]
    assert doubts_of_pace(*ways(mixed), FPS, basis) == []
    (told,) = doubts_of_pace(*ways(mixed, scale=1.96), FPS, basis)
    assert told.code == "people_run_fast"
    assert told.values["speed"] == pytest.approx(5.9, abs=0.05)


def test_a_few_who_are_far_too_fast_show_in_the_upper_quarter() -> None:
    """Most stroll or carry something, so that the median is still one of walkers."""
    speeds = [0.75, 0.8, 0.85, 0.87, 0.88, 1.05, 1.1, 1.15]
    assert doubts_of_pace(*ways(speeds), FPS) == []
    (told,) = doubts_of_pace(*ways(speeds, scale=1.5), FPS, "stated")
    assert told.code == "people_walk_fast"
    assert told.values["speed"] == pytest.approx(1.6, abs=0.1)
    assert doubts_of_pace(*ways(speeds, scale=1.5), FPS, "measured") == []


@pytest.mark.parametrize("basis", ["taken", "stated"])
def test_where_people_run_somebody_walks(basis: str) -> None:
    court = [0.9, 1.0, 1.2, 2.4, 2.7, 2.8]
    assert doubts_of_pace(*ways(court), FPS, basis) == []
    (told,) = doubts_of_pace(*ways(court, scale=1.45), FPS, basis)
    assert (told.code, told.values["heights"]) == ("nobody_walks_slowly", basis)
    assert told.values["speed"] == pytest.approx(1.3, abs=0.1)
    assert doubts_of_pace(*ways(court, scale=1.45), FPS, "measured") == []


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "basketball", "construction"])
def test_a_stated_mean_height_is_no_reason_to_believe_half_hidden_people(preset: str) -> None:
    """A counter hides the lower third of everybody from all cameras: the rig is too large by half, and all angles fit."""
    simulated = simulate(SimulationOptions(preset=preset, seed=4000, seconds=20.0, box_noise=0.02, missing=0.1))

    def calibrated(shown: float) -> passerby.Calibration:
        boxes = {}
        for name in simulated.rig.names:
            own = simulated.observations[name].boxes
            boxes[name] = replace(own, ltwh=own.ltwh * np.array([1.0, 1.0, 1.0, shown]))
        scale = {"person_height_m": 1.72, "person_height_mean_sd_m": 0.03}
        return passerby.calibrate_observations(simulated.rig, boxes, fps=5.0, association={"mode": "given"}, scale=scale)

    assert calibrated(1.0).verdict == "accepted"
    hidden = calibrated(0.65)
    assert hidden.verdict == "doubtful"
    assert {one.code for one in hidden.doubts} & {"people_walk_fast", "people_run_fast", "nobody_walks_slowly"}


def test_places_that_another_person_has_spoilt_make_nobody_run() -> None:
    keys, places = ways([0.9, 1.0, 1.1, 1.2] * 3)
    rng = np.random.default_rng(1)
    spoilt = rng.random(len(places)) < 0.2
    places[spoilt, :2] += rng.uniform(-15, 15, (spoilt.sum(), 2))
    assert np.quantile(paces(keys, places, FPS), 0.75) > 5
    assert np.quantile(paces(keys, places, FPS, steady=True), 0.75) < 2
    assert doubts_of_pace(keys, places, FPS) == []


def test_steady_paces_are_metres_per_second() -> None:
    pace = paces(*ways([1.2]), FPS, steady=True)
    assert len(pace) == 140
    assert pace == pytest.approx(1.2)


def test_what_the_scale_rests_on() -> None:
    def cue(kind: str, share: float) -> CueFigures:
        return CueFigures(cue="a cue", kind=kind, stated_m=1.7, measured_m=1.7, sd_m=0.1, residual_sigmas=0.0, share=share)

    heights, person, camera = "population", "person", "camera_height"
    assert scale_basis([cue(heights, 0.3), cue(person, 0.1), cue(camera, 0.6)], said=True) == "measured"
    assert scale_basis([cue(heights, 0.3), cue(person, 0.7)], said=True) == "stated"
    assert scale_basis([cue(heights, 0.9), cue(camera, 0.1)], said=False) == "taken"
    assert scale_basis([], said=False) == "taken"


def test_known_places_do_not_make_giants() -> None:
    assert doubts_of_heights({"1": 1.6, "2": 1.8}, 1.0, 1.72) == []
    (told,) = doubts_of_heights({"1": 1.6, "2": 1.8}, 1.75, 1.72)
    assert told.code == "people_too_tall"
    assert told.values == {"metres": pytest.approx(2.975), "expected_m": 1.72}
    assert doubts_of_heights({}, 3.0, 1.72) == []


def made(preset: str) -> SimulatedScene:
    return simulate(SimulationOptions(preset=preset, seconds=30.0, people=6, box_noise=0.02, seed=1))


def calibrated(scene: SimulatedScene, share: float, **tables: object) -> passerby.Calibration:
    """From boxes that show so much of each person, from the head down."""
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    boxes = {name: replace(one, ltwh=one.ltwh * (1, 1, 1, share)) for name, one in boxes.items()}
    lenses = {camera.name: camera.lens for camera in scene.rig}
    return passerby.calibrate_observations(lenses, boxes, fps=5.0, association={"mode": "given"}, **tables)


@pytest.mark.system
@pytest.mark.parametrize("said", [{"person_height_m": 1.72}, {"person_height_sd_m": 0.09}, {"person_height_mean_sd_m": 0.02}])
def test_boxes_of_half_height_are_told_whatever_is_written_under_scale(said: dict[str, float]) -> None:
    scene = made("terrace")
    found = calibrated(scene, 0.5, scale=said)
    assert found.verdict == "doubtful"
    assert "people_walk_fast" in [doubt.code for doubt in found.doubts]
    assert calibrated(scene, 1.0, scale=said).verdict == "accepted"


@pytest.mark.system
def test_half_height_is_told_on_a_court_and_people_who_run_are_not_accused() -> None:
    scene = made("basketball")
    found = calibrated(scene, 0.5, scale={"person_height_m": 1.72})
    assert "people_run_fast" in [doubt.code for doubt in found.doubts]
    assert calibrated(scene, 1.0, scale={"person_height_m": 1.72}).verdict == "accepted"


@pytest.mark.system
def test_a_length_that_makes_people_giants_is_told() -> None:
    scene = made("terrace")
    metres = float(np.linalg.norm(scene.rig["C1"].pose.centre - scene.rig["C3"].pose.centre))
    right = {"distances": [{"between": ["C1", "C3"], "metres": metres}]}
    wrong = {"distances": [{"between": ["C1", "C3"], "metres": 1.75 * metres}]}
    assert calibrated(scene, 1.0, scale=right).verdict == "accepted"
    found = calibrated(scene, 1.0, scale=wrong)
    assert found.verdict == "doubtful"
    (told,) = [doubt.values["cues"] for doubt in found.doubts if doubt.code == "scale_cues_disagree"]
    assert told == ["distance C1 to C3", "population of 6"]


@pytest.mark.slow
@pytest.mark.system
def test_camera_positions_that_make_people_giants_are_told(tmp_path) -> None:
    scene = made("terrace")
    for factor, verdict in ((1.0, "accepted"), (1.75, "doubtful")):
        rows = [f"{camera.name},{','.join(str(factor * x) for x in camera.pose.centre)}" for camera in scene.rig]
        path = tmp_path / f"places{factor}.csv"
        path.write_text("camera,x,y,z\n" + "\n".join(rows) + "\n")
        found = calibrated(scene, 1.0, world={"positions": str(path), "scale": True})
        assert found.verdict == verdict, found.reasons
        assert ("people_too_tall" in [doubt.code for doubt in found.doubts]) == (factor > 1), found.reasons
