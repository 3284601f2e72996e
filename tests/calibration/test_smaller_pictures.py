"""Pictures of another size than the lens is for: tried only where people keep to a part, told only where that fits better."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from passerby.association.result import Association
from passerby.calibration.diagnostics import smaller_pictures
from passerby.calibration.diagnostics.smaller_pictures import doubts_of_smaller_pictures, misfit
from passerby.calibration.run import CalibrationRun
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures, NoiseFigures
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.core.solution import Solution
from passerby.findings.finding import Finding
from passerby.hypotheses.readings import possible_share, smaller
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions

LENS = Lens((800, 600), np.array([[700.0, 0, 400], [0, 710, 300], [0, 0, 1]]), np.zeros(0))


POSE = Pose(np.eye(3), np.zeros(3))


RIG = Rig(tuple(Camera(name, LENS, POSE) for name in ("A", "B", "C")))


SCENE = Scene.model_validate(
    {"scene": {"name": "s"}, "cameras": {name: {"tracks": "t.txt", "intrinsics": "rig.toml"} for name in RIG.names}}
)


def people(share: float, count: int = 200) -> CameraObservations:
    """Boxes that reach just so far into the picture."""
    rng = np.random.default_rng(0)
    ends = rng.uniform(0.5, 1.0, (count, 2)) * share * np.array(LENS.size)
    ends[: count // 10] = share * np.array(LENS.size)
    ltwh = np.column_stack([ends - 40.0, np.full((count, 2), 40.0)])
    return CameraObservations(Boxes(np.arange(count), np.ones(count, dtype=int), ltwh, np.ones(count)))


def solution(rig: Rig, height: float, method: str = "people") -> Solution:
    noise = NoiseFigures(floor_px=1.0, box_px=1.0, centre=0.02, height=height, joint=0.02, broken_edges=0.0)
    return Solution(method, rig, "accepted", figures=AdjustedFigures(noise=noise))


def solving(errors: Mapping[tuple[str, ...], float], lost: bool = False) -> Callable[[Rig], Solution]:
    """Solves to the error of the boxes' heights that goes with the cameras whose pictures are taken as smaller."""

    def solve(rig: Rig) -> Solution:
        assert all(camera.pose is None for camera in rig)
        key = tuple(camera.name for camera in rig if camera.lens.size != LENS.size)
        posed = [replace(camera, pose=POSE) for camera in rig]
        if lost:
            posed[0] = replace(posed[0], pose=None)
        return solution(Rig(tuple(posed)), errors[key])

    return solve


def found_by(
    solve: Callable[[Rig], Solution], seen: Mapping[str, float], method: str = "people", estimated: Rig | None = None
) -> list[Finding]:
    """What is found where other lenses are solved so, and people reach so far into the images of these cameras."""
    observations = Observations({name: people(seen.get(name, 1.0)) for name in RIG.names})
    association = Association(observations, observations, {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smaller_pictures, "solve_scene", lambda run, rig, *_, **__: solve(rig))
        return doubts_of_smaller_pictures(
            CalibrationRun(SCENE, PeopleOptions()), RIG, observations, solution(estimated or RIG, 0.1, method), association
        )


def told(seen: Mapping[str, float], errors: Mapping[tuple[str, ...], float], **named: bool) -> list[tuple[str, object, object]]:
    found = found_by(solving(errors, **named), seen)
    assert all(one.code == "smaller_image_fits" and one.severity == "doubt" for one in found)
    return [(one.cameras[0], one.values["seen_size"], one.values["size"]) for one in found]


def test_a_camera_of_half_the_size_is_reported_where_that_fits_better_and_people_who_keep_to_a_corner_are_not() -> None:
    assert told({"B": 0.5}, {("B",): 0.03}) == [("B", [400, 300], [800, 600])]
    assert told({"B": 0.5}, {("B",): 0.09}) == []
    assert told({"B": 0.5}, {("B",): 0.03}, lost=True) == []


def test_of_several_only_those_are_reported_whose_own_size_makes_a_difference() -> None:
    """A is of half the size; the people of B keep to a quarter of the picture."""
    errors = {("A", "B"): 0.03, ("A",): 0.031, ("B",): 0.09}
    assert told({"A": 0.5, "B": 0.25}, errors) == [("A", [400, 300], [800, 600])]
    errors = {("A", "B"): 0.03, ("A",): 0.08, ("B",): 0.09}
    assert [name for name, *_ in told({"A": 0.5, "B": 0.25}, errors)] == ["A", "B"]


def test_a_focal_length_that_was_corrected_may_be_that_of_a_smaller_image() -> None:
    """The sizes that are tried are of the lens as stated: half the corrected focal length would be a quarter of it."""
    corrected = replace(RIG["B"], lens=replace(LENS, matrix=np.diag([0.5, 0.5, 1.0]) @ LENS.matrix))
    tried = list[Rig]()

    def solve(rig: Rig) -> Solution:
        tried.append(rig)
        return solving({("B",): 0.03})(rig)

    found = found_by(solve, {"B": 0.5}, estimated=replace(RIG, cameras=(RIG["A"], corrected, *list(RIG)[2:])))
    assert [one.cameras for one in found] == [("B",)]
    assert tried[0]["B"].lens.focal == pytest.approx(LENS.focal / 2)


def test_nothing_is_solved_again_without_need() -> None:
    def never(rig: Rig) -> Solution:
        raise AssertionError("solved again")

    assert found_by(never, {}) == []
    assert found_by(never, dict.fromkeys(RIG.names, 0.5), "geopose") == []


@pytest.mark.parametrize(
    ("share", "count", "expected"),
    [(0.5, 500, 0.5), (0.34, 500, 3 / 8), (0.2, 500, 0.25), (0.72, 500, None), (1.0, 500, None), (0.5, 20, None)],
)
def test_the_share_of_the_picture_that_people_keep_to(share: float, count: int, expected: float | None) -> None:
    assert possible_share(people(share, count), LENS.size) == expected


def test_the_smaller_lens_sees_the_same_rays() -> None:
    rays = np.array([[0.1, -0.2, 1.0], [-0.3, 0.2, 1.0]])
    np.testing.assert_allclose(smaller(LENS, 0.5).project_rays(rays), 0.5 * LENS.project_rays(rays))


def test_a_rig_that_lacks_a_camera_or_figures_fits_nothing() -> None:
    assert misfit(solution(RIG, 0.1)) == pytest.approx(0.1)
    assert misfit(solution(Rig((*RIG.cameras[:2], replace(RIG.cameras[2], pose=None))), 0.1)) == np.inf
    assert misfit(Solution("people", RIG, "accepted")) == np.inf
