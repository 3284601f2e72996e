"""Rigs against the registrations of their pairs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.scale_cues import ScaleCues
from passerby.geometry.two_view import PairHypothesis
from passerby.solver import initialisation
from passerby.solver.initialisation import Initialisation, InitialRig, select_initial_rig
from passerby.solver.people import PeopleOptions
from passerby.solver.pose_graph import spanning_trees
from passerby.solver.registrations import contradicted, doubts_about_registrations
from support.scenes.people_and_rigs import part, simulated, without_poses

CENTRES = np.array([[0.0, 0.0, 3.0], [20.0, 0.0, 3.0], [20.0, 15.0, 3.0]])
TURNS = np.array([np.eye(3), Rotation.from_euler("z", 80, degrees=True).as_matrix(), np.diag([-1.0, -1.0, 1.0])])


def registration(R: Floats, centre: Floats, a: int, b: int, route: str = "tracks") -> PairHypothesis:
    """How two cameras of a rig stand to each other."""
    return PairHypothesis(a, b, R[b] @ R[a].T, R[b] @ (centre[a] - centre[b]), route, 30, 30)


ALL = [registration(TURNS, CENTRES, a, b) for a, b in ((0, 1), (1, 2), (0, 2))]


@pytest.mark.parametrize("scale", [1.5, 0.6])
def test_a_rig_keeps_its_own_registrations_whatever_its_scale(scale: float) -> None:
    """The metre of the rig may rest on something else than that of the registrations."""
    assert contradicted(ALL, TURNS, scale * CENTRES) == []


@pytest.mark.parametrize(("degrees", "against"), [(15.0, 0), (40.0, 2)])
def test_a_camera_that_is_turned_contradicts_its_registrations(degrees: float, against: int) -> None:
    """A few degrees are what a registration is off by."""
    turned = TURNS.copy()
    turned[2] = Rotation.from_euler("z", degrees, degrees=True).as_matrix() @ turned[2]
    found = contradicted(ALL, turned, CENTRES)
    assert {(h.a, h.b) for h in found} <= {(1, 2), (0, 2)}
    assert len(found) == against


MOVED = CENTRES + [[0, 0, 0], [0, 0, 0], [12.0, -12.0, 0]]
"""The third camera ten metres off, of twenty."""


def test_only_registrations_by_tracks_count() -> None:
    """What identities say is judged by how many agree."""
    assert contradicted([replace(h, route="ground") for h in ALL], TURNS, MOVED) == []


def test_a_registration_by_a_first_guess_of_a_lens_contradicts_nothing() -> None:
    """The rig's own lens may be another one, and by it the registration would be another one."""
    lens = Lens((800, 600), np.array([[700.0, 0, 400], [0, 700, 300], [0, 0, 1]]), np.zeros(0))
    for guessed, pairs in (((), [("A", "C"), ("B", "C")]), (("A",), [("B", "C")]), (("C",), [])):
        rig = Rig(tuple(Camera(name, replace(lens, uncalibrated=name in guessed)) for name in "ABC"))
        found = doubts_about_registrations(rig, ALL, TURNS, MOVED)
        assert sorted(one.cameras for one in found) == pairs


def first_guess(monkeypatch: pytest.MonkeyPatch, *against: int) -> InitialRig:
    """Of a terrace, of which every tree is descended, and they contradict so many registrations each, one after the other."""
    truth = simulated("terrace", seconds=6.0)
    options, rng = PeopleOptions(coarse_people=100), np.random.default_rng(0)
    start = Initialisation.prepare(without_poses(truth.rig), part(truth.observations), ScaleCues(), options, rng)
    left = list(against)
    monkeypatch.setattr(initialisation, "_leads_to", lambda *_: False)
    monkeypatch.setattr(initialisation, "contradicted", lambda *_: ALL[: left.pop(0) if left else 0])
    return select_initial_rig(start, options, np.random.default_rng(1))


@pytest.mark.slow
def test_of_rigs_that_about_as_many_agree_with_the_one_is_chosen_that_keeps_the_registrations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The trees of a terrace all lead to one rig, and the first one would be chosen otherwise."""
    usual = first_guess(monkeypatch)
    assert len(usual.candidates) > 1
    against = [2 if tried.tree == usual.tree else 0 for tried in usual.candidates]
    chosen = first_guess(monkeypatch, *against)
    assert chosen.tree != usual.tree
    assert [tried.contradicted for tried in chosen.candidates] == against
    assert min(tried.agreeing for tried in chosen.candidates) > 0.9 * usual.agreeing


@pytest.mark.slow
def test_a_rig_that_few_agree_with_is_not_chosen_for_the_registrations_it_keeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong registration must not decide against all that is seen."""
    usual = first_guess(monkeypatch)
    spoilt = next(tried.tree for tried in usual.candidates if tried.tree != usual.tree)

    def trees(*given: Any) -> list[tuple[str, list[PairHypothesis]]]:
        return [
            (name, [replace(h, t_ba=-h.t_ba) for h in tree] if name == spoilt else tree)
            for name, tree in spanning_trees(*given)
        ]

    monkeypatch.setattr(initialisation, "spanning_trees", trees)
    chosen = first_guess(monkeypatch, *[0 if tried.tree == spoilt else 3 for tried in usual.candidates])
    few = next(tried for tried in chosen.candidates if tried.tree == spoilt)
    assert few.contradicted == 0
    assert few.agreeing < 0.5 * chosen.agreeing
    assert chosen.tree != spoilt
