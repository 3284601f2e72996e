"""Association and solver in turns: whose clock corrections count, and when the turns end."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.initial_association import InitialAssociation
from passerby.calibration import association_loop, association_run, temporal_calibration
from passerby.calibration.association_loop import _alike, _alternate, _starts, solve_with_unknown_identities
from passerby.calibration.association_run import AssociationOptions, AssociationRun
from passerby.common.progress import silent
from passerby.core.cameras import Lens, Rig
from passerby.core.figures import AdjustedFigures, ClockCorrection
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.core.pointing import PointedPerson
from passerby.core.solution import Solution
from support.scenes.people_and_rigs import ring, simulated, without_poses

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

    def __call__(self, instants, guesses, *, passing, refine_time, lenses=None, known=()):
        self.calls.append((passing, refine_time, instants.tolist()))
        verdict = "refused" if len(self.calls) in self.refused else "accepted"
        lacks = (self.truth - instants) * (0.5 if passing else 1.0)
        clocks = {
            name: ClockCorrection(correction_s=float(more), sigma_s=0.0 if n == 0 else self.sigma_s)
            for n, (name, more) in enumerate(zip(RIG.names, lacks, strict=True))
        }
        return Solution("people", RIG, verdict, figures=AdjustedFigures(clocks=clocks if refine_time else {}))


class Run(SimpleNamespace):
    """What the turns ask of a run, for people of known identity; the result of the association is what it is told."""

    rig, cameras = RIG, [SimpleNamespace(clock=Clock(FPS))] * 3

    def rows(self, person, offset_s, solution):
        return []

    def identified(self, rows):
        return None

    def known(self, rows):
        return SimpleNamespace(people=())

    def instants(self, identified, offset_s):
        return np.array(offset_s)

    def association(self, person, offset_s, solution, initial, rounds, sigma_s=None, attached=()):
        return SimpleNamespace(offset_s=offset_s, solution=solution, sigma_s=sigma_s)


def by_identities_found(solver, refine=True):
    initial = InitialAssociation(PERSON, BEGUN.copy(), None)
    return _alternate(Run(), initial, solver, refine=refine, tell=silent)


@pytest.fixture
def by_identities_given(monkeypatch):
    """The same with offsets alone unknown."""
    monkeypatch.setattr(temporal_calibration, "synchronise", lambda rig, cameras, seen, offset_s: np.array(offset_s))
    monkeypatch.setattr(temporal_calibration, "_without", lambda observations, lost: observations)

    def association(rig, observations, cameras, initial, offset_s, solution):
        return SimpleNamespace(offset_s=offset_s, solution=solution)

    monkeypatch.setattr(temporal_calibration, "_association", association)

    def solved(solver):
        initial = InitialAssociation(PERSON, BEGUN.copy(), None)
        return temporal_calibration._refined(RIG, Observations({}), Run.cameras, initial, {}, solver, silent)

    return solved


@pytest.fixture(params=["found", "given"])
def solved(request, by_identities_given):
    return by_identities_found if request.param == "found" else by_identities_given


def test_the_offsets_are_those_that_the_last_solution_has_corrected(solved):
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2)
    solution, association = solved(solver)
    assert solution.verdict == "accepted"
    np.testing.assert_allclose(association.offset_s, solver.truth)
    assert [(passing, refined) for passing, refined, _ in solver.calls] == [(True, True), (False, True)]
    np.testing.assert_allclose(solver.calls[1][2], BEGUN + 0.5 * (solver.truth - BEGUN))


def test_offsets_of_whole_frames_are_taken_so_and_the_rig_is_solved_with_them(solved):
    """A common trigger: 0.3 and -0.1 s at ten frames a second, to 2 ms."""
    solver = Solver([0.0, 0.301, -0.101], sigma_s=0.002)
    solution, association = solved(solver)
    np.testing.assert_allclose(association.offset_s, [0.0, 0.3, -0.1], atol=1e-12)
    passing, refined, given = solver.calls[-1]
    assert (len(solver.calls), passing, refined) == (3, False, False)
    np.testing.assert_allclose(given, [0.0, 0.3, -0.1], atol=1e-12)
    assert solution.verdict == "accepted"


@pytest.mark.parametrize("refused", [1, 2])
def test_a_refused_solution_corrects_no_clock(solved, refused):
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2, refused=(refused,))
    solution, association = solved(solver)
    assert solution.verdict == "refused"
    assert len(solver.calls) == refused
    np.testing.assert_allclose(association.offset_s, BEGUN + (0.5 * (solver.truth - BEGUN) if refused == 2 else 0.0))


def test_clocks_that_are_in_step_are_not_refined():
    solver = Solver([0.0, 0.337, -0.114], sigma_s=0.2)
    _, association = by_identities_found(solver, refine=False)
    assert association.offset_s.tolist() == BEGUN.tolist()
    assert {refined for _, refined, _ in solver.calls} == {False}


@pytest.mark.parametrize(("search_s", "refined"), [(0.0, False), (1.0, True)])
def test_clocks_are_refined_where_they_are_searched(search_s, refined):
    scene, asked = simulated("terrace", 6.0, 5, people=4), []

    def refuses(instants, guesses, *, passing, refine_time, lenses=None, known=()):
        asked.append(refine_time)
        return Solution("people", without_poses(scene.rig), "refused")

    seen = Observations(scene.observations.cameras, clocks={name: Clock(5.0) for name in scene.rig.names})
    options = AssociationOptions("trajectory", search_s)
    solution, _ = solve_with_unknown_identities(scene.rig, seen, options, refuses, np.random.default_rng(0))
    assert solution.verdict == "refused"
    assert asked == [refined]


def test_starts_of_recordings_are_sought_where_offsets_are_not_searched_in_full(monkeypatch):
    monkeypatch.setattr(association_loop, "find_starts", lambda *_: "sought")
    measured = AssociationOptions(measured=("a clap",))
    found = [
        _starts([], search_s, one, {}, silent) for search_s in (0.0, 5.0, 600.0) for one in (AssociationOptions(), measured)
    ]
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
    one, other = _alike(np.array(before), np.array(after)), _alike(np.array(after), np.array(before))
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
    cameras = [
        SimpleNamespace(seen=CameraObservations()),
        SimpleNamespace(seen=seen),
        SimpleNamespace(seen=CameraObservations()),
    ]
    at = {"C2": (425.0, 160.0), "U1": (425.0, 160.0)}
    pointed = tuple(PointedPerson(n, name, 3, pixel, 1.9, 0.01) for n, (name, pixel) in enumerate(at.items(), start=1))
    run = AssociationRun(RIG, cameras, SimpleNamespace(), None, AssociationOptions(pointed=pointed))
    none = np.zeros(0, np.int64)
    known = run.known([(none, none), (np.array([8, 5]), none), (none, none)])
    assert [(one.identity, one.metres) for one in known.people] == [(6, 1.9)]
    assert [(one.code, one.cameras) for one in known.findings] == [("pointed_person_unmatched", ("U1",))]
