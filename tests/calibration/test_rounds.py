"""Association and solver in turns: whose clock corrections count, and when the turns end."""

from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.initial_association import InitialAssociation
from passerby.association.result import Association
from passerby.calibration import association_run, association_start, calibrate, known_identities
from passerby.calibration.association_run import AssociationOptions, AssociationRun, share_of_same_pairs
from passerby.calibration.association_start import AssociationStart, _find_starts
from passerby.calibration.run import CalibrationRun
from passerby.common.progress import silent
from passerby.core.cameras import Lens, Rig
from passerby.core.figures import AdjustedFigures, ClockCorrection
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.core.pointing import PointedPerson
from passerby.core.solution import Solution
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import ring, without_poses

RIG = ring(3)
FPS = 10.0
BEGUN = np.array([0.0, 0.2, 0.0])
"""Offsets to begin with, seconds."""
PERSON = np.array([0, 0, 1, 1])
"""Of each tracklet."""


class Solver:
    """Finds a share of what the offsets lack, and all of it at last; what it is given as instants are the offsets."""

    def __init__(self, truth, sigma_s, refused=()):
        self.truth, self.sigma_s, self.refused = np.array(truth), sigma_s, refused
        self.calls = []

    def __call__(self, run, rig, instants, rng, *, guesses=(), known=(), passing=False, refine_time=False, lenses=None):
        self.calls.append((passing, refine_time, instants.tolist()))
        verdict = "refused" if len(self.calls) in self.refused else "accepted"
        lacks = (self.truth - instants) * (0.5 if passing else 1.0)
        clocks = {
            name: ClockCorrection(correction_s=float(more), sigma_s=0.0 if n == 0 else self.sigma_s)
            for n, (name, more) in enumerate(zip(RIG.names, lacks, strict=True))
        }
        return Solution("people", RIG, verdict, figures=AdjustedFigures(clocks=clocks if refine_time else {}))


class State(SimpleNamespace):
    """The association of three cameras, for people of known identity."""

    rig, cameras = RIG, [SimpleNamespace(clock=Clock(FPS))] * 3

    def rows(self, person, offset_s, solution):
        return []

    def identified(self, rows):
        return None

    def known(self, rows):
        return SimpleNamespace(people=())

    def instants(self, identified, offset_s):
        return np.array(offset_s)

    def identify_by_rig(self, person, offset_s, solution, initial, attached, **rest):
        return person, len(RIG)

    def association(self, person, offset_s, solution, initial, rounds, sigma_s=None, attached=()):
        return SimpleNamespace(offset_s=offset_s, solution=solution, sigma_s=sigma_s)


def scene_of(mode, max_offset_s):
    """A scene of three cameras, of which files are never read."""
    cameras = {name: {"tracks": f"{name}.txt", "intrinsics": "rig.toml"} for name in RIG.names}
    association = {"mode": mode, "max_offset_s": max_offset_s}
    return Scene.model_validate({"scene": {"name": "s", "fps": FPS}, "cameras": cameras, "association": association})


def begun(*_):
    return AssociationStart(State(), InitialAssociation(PERSON, BEGUN.copy(), None))


def estimated(monkeypatch, mode, solver, search_s=1.0):
    """The estimate with this solver, the first association being `BEGUN`."""
    graph = SimpleNamespace(groups=[[0, 1, 2]], edges=[])
    monkeypatch.setattr(calibrate, "start_association", begun)
    monkeypatch.setattr(calibrate, "solve_scene", solver)
    stand_ins = {
        "solve_scene": solver,
        "build_tracklets": lambda rig, *_, **__: [SimpleNamespace(name=name, clock=Clock(FPS)) for name in rig.names],
        "_begin": lambda *_: InitialAssociation(PERSON, BEGUN.copy(), graph),
        "unregistered_cameras": lambda *_, **__: {},
        "synchronise": lambda rig, cameras, seen, offset_s: np.array(offset_s),
        "_association": lambda rig, seen, *_: Association(seen, seen, {}, dict(enumerate(_[2]))),
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(known_identities, name, stand_in)
    seen = Observations({name: CameraObservations() for name in RIG.names}, clocks=dict.fromkeys(RIG.names, Clock(FPS)))
    inputs = SceneInputs(without_poses(RIG), seen, ())
    found = calibrate.estimate_rig(CalibrationRun(scene_of(mode, search_s), PeopleOptions()), inputs)
    association = found.association
    offset_s = list(association.sigma_s.values()) if mode == "given" else association.offset_s
    return found.solution, np.array(offset_s)


@pytest.fixture(params=["trajectory", "given"])
def solved(request, monkeypatch):
    return lambda solver: estimated(monkeypatch, request.param, solver)


def test_the_offsets_are_those_that_the_last_solution_has_corrected(solved):
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2)
    solution, offset_s = solved(solver)
    assert solution.verdict == "accepted"
    np.testing.assert_allclose(offset_s, solver.truth)
    assert [(passing, refined) for passing, refined, _ in solver.calls] == [(True, True), (False, True)]
    np.testing.assert_allclose(solver.calls[1][2], BEGUN + 0.5 * (solver.truth - BEGUN))


def test_offsets_of_whole_frames_are_taken_so_and_the_rig_is_solved_with_them(solved):
    """A common trigger: 0.3 and -0.1 s at ten frames a second, to 2 ms."""
    solver = Solver([0.0, 0.301, -0.101], sigma_s=0.002)
    solution, offset_s = solved(solver)
    np.testing.assert_allclose(offset_s, [0.0, 0.3, -0.1], atol=1e-12)
    passing, refined, given = solver.calls[-1]
    assert (len(solver.calls), passing, refined) == (3, False, False)
    np.testing.assert_allclose(given, [0.0, 0.3, -0.1], atol=1e-12)
    assert solution.verdict == "accepted"


@pytest.mark.parametrize("refused", [1, 2])
def test_a_refused_solution_corrects_no_clock(solved, refused):
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2, refused=(refused,))
    solution, offset_s = solved(solver)
    assert solution.verdict == "refused"
    assert len(solver.calls) == refused
    np.testing.assert_allclose(offset_s, BEGUN + (0.5 * (solver.truth - BEGUN) if refused == 2 else 0.0))


def test_clocks_that_agree_are_not_refined(monkeypatch):
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2)
    _, offset_s = estimated(monkeypatch, "trajectory", solver, search_s=0.0)
    assert offset_s.tolist() == BEGUN.tolist()
    assert {refined for _, refined, _ in solver.calls} == {False}


def test_starts_of_recordings_are_sought_where_offsets_are_not_searched_in_full(monkeypatch):
    monkeypatch.setattr(association_start, "find_starts", lambda *_: "sought")
    measured = AssociationOptions(measured=("a clap",))
    options = (AssociationOptions(), measured)
    found = [_find_starts([], search_s, one, {}, silent) for search_s in (0.0, 5.0, 600.0) for one in options]
    assert found == [None, None, None, "sought", "sought", "sought"]


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [
        ([0, 0, 1, 1], [5, 5, 3, 3], 1.0),
        ([0, 0, 0, 0], [0, 1, 2, 3], 0.0),
        ([0, 0, 1, 1], [0, 0, 0, 0], 2 / 6),
        ([0, 0, 0, 1], [0, 0, 1, 1], 1 / 4),
    ],
)
def test_groupings_are_as_alike_as_the_pairs_that_both_have_of_those_that_either_has(before, after, share):
    one, other = share_of_same_pairs(np.array(before), np.array(after)), share_of_same_pairs(np.array(after), np.array(before))
    assert one == other == pytest.approx(share)


def test_a_lens_that_was_found_is_that_of_a_registered_camera_alone(monkeypatch):
    """And only where it was not known before."""
    monkeypatch.setattr(association_run, "with_lenses_of", lambda cameras, rig, height_m: [])
    unknown, found = Lens.unknown((1280, 720)), Lens.unknown((1280, 720), focal_px=900.0)
    poses = [camera.pose for camera in RIG]
    before = Rig(tuple(c if n == 2 else type(c)(c.name, unknown) for n, c in enumerate(RIG)))
    solved = Rig(tuple(type(c)(c.name, found, None if n == 1 else poses[n]) for n, c in enumerate(RIG)))
    run = AssociationRun(before, [], SimpleNamespace(), None, AssociationOptions()).with_lenses(solved)
    assert [camera.lens.focal for camera in run.rig] == [900.0, unknown.focal, RIG["C3"].lens.focal]
    assert [camera.lens.uncalibrated for camera in run.rig] == [True, True, False]


def test_heights_are_those_of_the_people_at_the_pixels_by_the_identities_that_are_written():
    """People are numbered from 0 within, and from 1 in what is written; a camera may be one of another group."""
    ltwh = np.array([[100.0, 100.0, 50.0, 120.0], [400.0, 100.0, 50.0, 120.0]])
    seen = CameraObservations(Boxes(np.array([3, 3]), np.array([0, 1]), ltwh, np.ones(2)))
    cameras = [SimpleNamespace(seen=one) for one in (CameraObservations(), seen, CameraObservations())]
    at = {"C2": (425.0, 160.0), "U1": (425.0, 160.0)}
    pointed = tuple(PointedPerson(n, name, 3, pixel, 1.9, 0.01) for n, (name, pixel) in enumerate(at.items(), start=1))
    run = AssociationRun(RIG, cameras, SimpleNamespace(), None, AssociationOptions(pointed=pointed))
    none = np.zeros(0, np.int64)
    known = run.known([(none, none), (np.array([8, 5]), none), (none, none)])
    assert [(one.identity, one.metres) for one in known.people] == [(6, 1.9)]
    assert [(one.code, one.cameras) for one in known.findings] == [("pointed_person_unmatched", ("U1",))]
