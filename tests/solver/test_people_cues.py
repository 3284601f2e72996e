"""Walking speed and body width as estimates of the scale, and as parties of the one test of scale cues."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.figures import CueFigures
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.findings.finding import Finding
from passerby.findings.texts import remedy_of, texts_of
from passerby.simulation import SimulationOptions, simulate
from passerby.solver.cue_agreement import check_cue_consistency
from passerby.solver.people_cues import body_widths, people_cues, scale_by_walking, walking_speeds
from support.scenes.people_and_rigs import looking_at

FPS = 5.0
COURT = [0.9, 1.0, 1.1, 2.4, 2.7, 3.0, 3.2]
WALKERS = [0.9, 1.0, 1.1, 1.2, 1.3, 1.0]


def paths(speeds: list[float], *, seconds: int = 30, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Frames with identities, and places, of people who walk straight on."""
    frames = np.arange(1, int(seconds * FPS) + 1)
    keys, places = [], []
    for person, speed in enumerate(speeds):
        keys.append(np.column_stack([frames, np.full(len(frames), person)]))
        along = scale * speed * frames / FPS
        places.append(np.column_stack([along, np.full(len(frames), 2.0 * person), np.full(len(frames), 0.9)]))
    order = np.random.default_rng(0).permutation(len(speeds) * len(frames))
    return np.concatenate(keys)[order].astype(float), np.concatenate(places)[order]


def by_walking(speeds: list[float], scale: float = 1.0, seconds: int = 30) -> tuple[float, float]:
    return scale_by_walking(walking_speeds(*paths(speeds, scale=scale, seconds=seconds), FPS), 10 * FPS)


def test_speeds_are_metres_per_second_of_people_in_motion() -> None:
    """Nothing is known of people who stand, or without a frame rate, or of a moment."""
    speeds = walking_speeds(*paths([1.2, 0.1, 0.9]), FPS)
    assert [len(own) for own in speeds] == [140, 140]
    assert [float(np.median(own)) for own in speeds] == pytest.approx([1.2, 0.9])
    nothing = (paths([0.1, 0.0, 0.2]), FPS), (paths([2.0, 2.1]), None), (paths([1.2], seconds=2), FPS)
    for seen, fps in (*nothing, ((np.zeros((0, 2)), np.zeros((0, 3))), FPS)):
        assert walking_speeds(*seen, fps) == []


def test_places_that_another_person_has_spoilt_make_no_person_fast() -> None:
    keys, places = paths(WALKERS * 2)
    rng = np.random.default_rng(1)
    spoilt = rng.random(len(places)) < 0.2
    places[spoilt, :2] += rng.uniform(-15, 15, (spoilt.sum(), 2))
    log_scale, sigma = scale_by_walking(walking_speeds(keys, places, FPS), 10 * FPS)
    assert abs(log_scale) < sigma < 0.25


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_walkers_give_the_scale_to_a_sixth_and_few_people_say_less(scale: float) -> None:
    log_scale, sigma = by_walking(WALKERS, scale)
    assert log_scale + np.log(scale) == pytest.approx(0, abs=0.1)
    assert 0.12 < sigma < 0.2
    assert by_walking([1.0])[1] > 1.4 * by_walking(WALKERS)[1]


@pytest.mark.parametrize(
    ("speeds", "seconds"),
    [(COURT, 30), ([0.7, 0.8, 0.7], 30), ([1.5, 1.6, 1.4, 1.6], 30), ([2.2, 2.6], 6), ([1.8, 2.4, 3.0, 3.4], 6)],
)
def test_the_speeds_that_people_can_have_contradict_no_scale(speeds: list[float], seconds: int) -> None:
    """A few may all run for a few seconds."""
    log_scale, sigma = by_walking(speeds, seconds=seconds)
    assert abs(log_scale) < 3 * sigma


LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), np.zeros(4))
SPOTS = ((-9.0, -8.0, 3.1), (9.0, -7.0, 2.7))
RIG = Rig(tuple(Camera(f"C{n}", LENS, looking_at(spot, (0.0, 0.0, 0.9))) for n, spot in enumerate(SPOTS, start=1)))


def boxed(cameras: Rig, places: np.ndarray, width_m: float, identity: int = 1) -> Observations:
    """A box of this width about each place (N, 3), frame by frame."""
    found = {}
    for camera in cameras:
        across = np.cross(places - camera.centre, [0.0, 0.0, 1.0])
        across *= width_m / 2 / np.linalg.norm(across, axis=1)[:, None]
        one, other = camera.project(places - across), camera.project(places + across)
        left, px = np.minimum(one[:, 0], other[:, 0]), np.abs(one[:, 0] - other[:, 0])
        ltwh = np.column_stack([left, (one[:, 1] + other[:, 1]) / 2 - 1.5 * px, px, 3 * px])
        boxes = Boxes(np.arange(1, len(places) + 1), np.full(len(places), identity), ltwh, np.ones(len(places)))
        found[camera.name] = CameraObservations(boxes, Keypoints.empty())
    return Observations(found)


def placed(count: int = 50) -> tuple[np.ndarray, np.ndarray]:
    places = np.column_stack([np.random.default_rng(0).uniform(-2, 2, (count, 2)), np.full(count, 0.9)])
    return np.column_stack([np.arange(1, count + 1), np.ones(count)]), places


@pytest.mark.parametrize(("width_m", "log_scale"), [(0.6, 0.0), (1.2, -np.log(2)), (0.3, np.log(2))])
def test_widths_are_in_metres_at_the_people_and_estimates_of_the_scale(width_m: float, log_scale: float) -> None:
    keys, places = placed()
    (widths,) = body_widths(RIG, boxed(RIG, places, width_m), keys, places)
    assert len(widths) == 2 * len(places)
    np.testing.assert_allclose(widths, width_m, rtol=0.01)
    (cue,) = people_cues(RIG, boxed(RIG, places, width_m))
    assert (cue.kind, cue.share) == ("body_width", 0.0)
    assert np.log(cue.own_scale) == pytest.approx(log_scale, abs=0.03)
    assert cue.measured_m == pytest.approx(width_m, rel=0.03)


def test_boxes_at_the_border_and_of_people_that_were_not_placed_have_no_width() -> None:
    keys, places = placed()
    wide = boxed(RIG, places, 1.2)
    cut = Observations({
        name: CameraObservations(replace(own.boxes, ltwh=own.boxes.ltwh * [0, 1, 1, 1])) for name, own in wide.cameras.items()
    })  # fmt: skip
    assert body_widths(RIG, wide, np.zeros((0, 2)), np.zeros((0, 3))) == []
    for seen in (boxed(RIG, places, 1.2, identity=7), cut):
        assert body_widths(RIG, seen, keys, places) == []


TRUTH = simulate(SimulationOptions(seed=861, seconds=60.0, people=6, box_noise=0.02))
"""A terrace on which everybody walks."""
HEIGHTS = CueFigures(
    cue="population of 6", kind="population", count=6, stated_m=1.72, measured_m=1.72, sd_m=0.08, residual_sigmas=0.0,
    share=1.0, own_scale=1.0, own_sigma=0.045,
)  # fmt: skip


def contradictions(scale: float = 1.0, fps: float = 1.0, *more: CueFigures) -> list[Finding]:
    """With heights that agree with a rig, everything `scale` times as large as it is, at `fps` times the frame rate."""
    larger = TRUTH.rig.moved(np.eye(3), np.zeros(3), scale)
    seen = replace(TRUTH.observations, fps=fps * TRUTH.options.fps)
    return check_cue_consistency([HEIGHTS, *more, *people_cues(larger, seen)])[1]


def length(factor: float) -> CueFigures:
    """Another cue, by which the rig would be so many times as large."""
    return replace(HEIGHTS, cue="length 1", kind="length", count=None, own_scale=factor, own_sigma=0.01)


def test_people_agree_with_their_own_heights_and_a_length_under_which_they_are_giants_or_dwarfs_is_named() -> None:
    assert contradictions() == []
    assert contradictions(1.0, 1.0, length(1.02)) == []
    for factor in (1.75, 0.5):
        (found,) = contradictions(1.0, 1.0, length(factor))
        assert (found.code, found.severity, found.values["cues"]) == ("scale_cues_disagree", "doubt", ["length 1"])


@pytest.mark.parametrize("scale", [1.7, 2.2])
def test_heights_that_walking_speed_and_width_both_contradict_are_named(scale: float) -> None:
    """As if boxes showed the upper half of each person."""
    (found,) = contradictions(scale)
    assert "population" in found.values["kinds"]
    assert "head to feet" in remedy_of(found)


@pytest.mark.parametrize("fps", [0.4, 3.0])
def test_a_wrong_frame_rate_is_named_as_the_cause(fps: float) -> None:
    (found,) = contradictions(1.0, fps)
    assert "walking_speed" in found.values["kinds"]
    assert "frame rate, which may be wrong" in texts_of([found])[0]
