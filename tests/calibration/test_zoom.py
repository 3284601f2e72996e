"""Cameras that zoom while they film: found, dated, measured, named; and cameras that move, which do not zoom."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import passerby
from passerby.calibration.calibration import Calibration
from passerby.core.cameras import Lens
from passerby.evaluation.metrics import compare
from passerby.findings.texts import remedy_of
from passerby.hypotheses.camera_path import CameraPath, residuals_along
from passerby.hypotheses.changes import FoundChange, PoseChange, step_of, suspect_change
from passerby.hypotheses.correspondences import Correspondences, match_people
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Disturbance, Move, Zoom, film_disturbed, gradual_zoom, rig_after

OPTIONS = SimulationOptions(seconds=24.0, people=6, box_noise=0.02, missing=0.1, seed=3900)
BODY_M = 1.72


@cache
def filmed(disturbances: tuple[Disturbance, ...], options: SimulationOptions = OPTIONS) -> SimulatedScene:
    return simulate(options, film_disturbed(options, disturbances))


def matched(scene: SimulatedScene, name: str, *, given: bool = True) -> Correspondences:
    """What a camera saw with the people that the others see, by the true rig."""
    middles, c = identified_body_centres(scene.rig, scene.observations), scene.rig.names.index(name)
    own = middles[c]
    if not given:
        own = replace(own, identity=17 - own.identity)  # tracklets that mean nothing elsewhere
    return match_people(own, triangulate_people(scene.rig, middles, BODY_M, excluding=c), BODY_M, given=given)


def compared(m: Correspondences, scene: SimulatedScene, name: str) -> FoundChange | None:
    """What changed, by the true rig."""
    pose = scene.rig[name].pose
    assert pose is not None
    suspect = suspect_change(m, pose, 5.0, len(scene.rig))
    return None if suspect is None else suspect.compared()


def found(scene: SimulatedScene, name: str, *, given: bool = True, stated: bool = True) -> PoseChange | None:
    """The zoom that is found."""
    m = matched(scene, name, given=given)
    change = compared(m, scene, name)
    return None if change is None or change.kind not in ("zoomed", "zoomed_and_moved") else step_of(m, change, stated=stated)


@pytest.mark.slow
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("factor", [0.8, 1.1, 2.0])
def test_a_zoom_is_dated_and_measured(factor, given):
    change = found(filmed((Zoom("C2", 15.0, factor),)), "C2", given=given)
    assert change is not None
    assert change.at_end
    assert abs((change.first - 1) / 5.0 - 15.0) < 1.0
    assert change.zoom == pytest.approx(factor, rel=0.04)
    assert change.metres < 0.5


@pytest.mark.slow
def test_the_stretch_of_a_stated_lens_is_the_part_that_it_does_not_hold_for():
    """However long that is; of a lens that is estimated, the longer part stays."""
    scene = filmed((Zoom("C2", 8.0, 1.3),))
    stated, estimated = (found(scene, "C2", stated=one) for one in (True, False))
    assert stated is not None
    assert estimated is not None
    assert (stated.at_end, estimated.at_start) == (True, True)
    assert stated.zoom == pytest.approx(1.3, rel=0.04)
    assert estimated.zoom == pytest.approx(1 / 1.3, rel=0.04)


@pytest.mark.slow
@pytest.mark.parametrize(
    "move", [Move("C2", 12.0, turn_deg=(1.0, 3.0, 0.0), shift_m=(0.2, 0.0, 0.0)), Move("C2", 12.0, shift_m=(0.7, 0.7, -0.3))]
)
def test_a_move_is_no_zoom(move):
    assert found(filmed((move,)), "C2") is None


def test_a_zoomed_path_sees_what_the_zoomed_lens_sees():
    """Exactly so for a lens without distortion."""
    scene = filmed(())
    m, pose = matched(scene, "C2"), scene.rig["C2"].pose
    assert pose is not None
    lens = replace(scene.rig["C2"].lens, distortions=np.zeros(0))
    matrix = np.array(lens.matrix)
    matrix[:2, :2] *= 1.3
    there, pixels = replace(lens, matrix=matrix), lens.project_rays(m.own.middle)
    ray = there.bearings(pixels)
    by_path, by_lens = (
        residuals_along(replace(m, own=replace(m.own, middle=rays, middle_tangent=one.tangents(rays))), path).found.residual
        for rays, one, path in ((m.own.middle, lens, CameraPath(pose, float(np.log(1.3)))), (ray, there, CameraPath(pose)))
    )
    near = np.abs(by_lens).max(axis=0) < 20.0
    assert near.sum() > 20
    np.testing.assert_allclose(by_path[:, near], by_lens[:, near], atol=1e-6)


@pytest.mark.slow
def test_a_gradual_zoom_takes_its_time():
    scene = filmed(())
    steps = gradual_zoom("C2", 4.0, 8.0, 1.5)
    after = rig_after(scene.rig, steps[:1])["C2"].lens.focal
    assert (steps[0].from_s, steps[-1].from_s, steps[-1].factor) == (4.0, pytest.approx(7.8), pytest.approx(1.5))
    assert after / scene.rig["C2"].lens.focal == pytest.approx(1.5 ** (1 / 20))


def calibrated(scene: SimulatedScene, *, known: bool = True) -> Calibration:
    lenses = {camera.name: camera.lens if known else Lens.unknown(camera.lens.size) for camera in scene.rig}
    mode = "combined" if scene.options.unrelated_ids else "given"
    return passerby.calibrate_observations(
        lenses, {name: scene.observations[name].boxes for name in scene.rig.names}, fps=scene.options.fps,
        association={"mode": mode, "max_offset_s": 0.0},
    )  # fmt: skip


LONGER = replace(OPTIONS, seconds=40.0)
UNRELATED = replace(LONGER, unrelated_ids=True, tracklet_seconds=10.0)


@pytest.mark.slow
@pytest.mark.parametrize("options", [LONGER, UNRELATED], ids=["given", "found"])
def test_a_zoom_is_named_and_what_was_seen_with_it_left_out(options):
    scene = filmed((Zoom("C2", 24.0, 1.3),), options)
    calibration = calibrated(scene)
    assert calibration.verdict == "doubtful"
    (finding,) = [one for one in calibration.diagnostics if one.code == "camera_moved"]
    assert (finding.code, finding.cameras, finding.values["left_out"]) == ("camera_moved", ("C2",), "after")
    assert finding.values["factor"] == pytest.approx(1.3, rel=0.04)
    assert finding.values["seconds"][0] == pytest.approx(24.0, abs=1.0)
    assert "until_s = 23" in remedy_of(finding)
    (figures,) = calibration.figures.moved
    assert figures.zoom == finding.values["factor"]
    assert compare(calibration.rig, scene.rig).similarity.mean_position_mm < 40


@pytest.mark.slow
def test_a_zoom_of_an_unknown_lens_is_named():
    calibration = calibrated(filmed((Zoom("C2", 24.0, 1.3),), LONGER), known=False)
    assert calibration.verdict == "doubtful"
    (finding,) = [one for one in calibration.diagnostics if one.code == "camera_moved" and one.cameras == ("C2",)]
    assert finding.values["factor"] is not None
