"""Simulated conditions: what is done to the scenes, what becomes of them, and what is kept of a run that was stopped."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import combinations
from multiprocessing import get_context

import numpy as np
import pytest

from pages import kept as kept_module
from pages.kept import Kept
from paper import conditions
from paper.conditions import Condition, run_conditions, thinned
from passerby.common.errors import InputError
from passerby.common.progress import silent
from passerby.core.overlap import count_shared_observations, person_instants
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.scene import FAULTS, film
from passerby.solver.geopose.correspondences import whole_boxes

SMALL = SimulationOptions(seconds=8.0, people=4, cameras=3, box_noise=0.02)


@pytest.fixture(scope="module")
def filmed():
    return film(SMALL)


@pytest.fixture(scope="module")
def scene(filmed):
    return simulate(SMALL, filmed)


def boxes_of(scene):
    seen = [scene.observations[name] for name in scene.rig.names]
    return [np.column_stack([one.boxes.frame, one.boxes.identity, one.boxes.ltwh]) for one in seen] + [
        one.keypoints.xy for one in seen
    ]


def test_a_scene_filmed_for_others_is_the_same_bit_for_bit(filmed):
    faulty = replace(SMALL, box_noise=0.0, corner_noise_px=3.0, missing=0.2, identity_swaps=0.3, joint_noise_px=1.0)
    alone, shared = simulate(faulty), simulate(faulty, filmed)
    assert all(map(np.array_equal, boxes_of(alone), boxes_of(shared)))
    assert np.array_equal(alone.joints3d, shared.joints3d, equal_nan=True)
    assert not np.array_equal(boxes_of(alone)[0], boxes_of(simulate(SMALL, filmed))[0])
    assert set(FAULTS) < set(SimulationOptions.__dataclass_fields__)


@pytest.mark.parametrize("change", [{"seed": 1}, {"people": 5}, {"preset": "basketball"}, {"clock_offsets": 0.1}, {"fps": 4.0}])
def test_another_scenes_views_are_refused(filmed, change):
    with pytest.raises(InputError, match="another scene"):
        simulate(replace(SMALL, **change), filmed)


@pytest.mark.parametrize("n", [1, 5, 17])
def test_each_camera_shares_so_many_with_the_reference_and_no_two_more(scene, n):
    thin = thinned(scene, n, np.random.default_rng(1))
    shared = count_shared_observations(thin.observations)
    reference, *others = scene.rig.names
    assert [shared[reference][name].sightings for name in others] == [n] * len(others)
    assert all(shared[a][b].sightings <= n for a, b in combinations(others, 2))
    assert all(len(thin.observations[name].boxes) == len(thin.observations[name].keypoints) == n for name in others)
    for camera in scene.rig:
        boxes = thin.observations[camera.name].boxes
        assert whole_boxes(boxes, camera.lens).all()
        assert len(thin.true_identities[camera.name]) == len(boxes)


def test_fewer_are_a_part_of_more(scene):
    few, more = (thinned(scene, n, np.random.default_rng(1)) for n in (6, 20))
    for name in scene.rig.names:
        a, b = ({tuple(row) for row in person_instants(thin.observations[name]).tolist()} for thin in (few, more))
        assert a < b
    other = thinned(scene, 6, np.random.default_rng(2))
    assert not np.array_equal(boxes_of(other)[1], boxes_of(few)[1])
    with pytest.raises(InputError, match=r"camera C\d shares \d+ person-instants with camera C1, 5000 are wanted"):
        thinned(scene, 5000, np.random.default_rng(1))


def test_outcomes_are_the_same_in_processes_and_whatever_they_are_run_with():
    asked = [*(Condition(SMALL, method) for method in ("people", "geopose")), Condition(SMALL, shared=5)]
    alone = run_conditions(asked, None, silent, "test")
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert run_conditions(asked[::-1], pool, silent, "test") == alone
    *well, outcome = (alone[one] for one in asked)
    assert not any(one.failed for one in well)
    assert all(0 < one.similarity_mm < 200 and one.clock_ms == 0 for one in well)
    assert len(set(well)) == 2
    assert outcome.failed, "too little evidence"
    assert outcome.verdict == "refused"
    assert "8 observations" in outcome.reason
    assert outcome.similarity_mm == outcome.metric_deg == outcome.scale_error == float("inf")


def test_clocks_are_judged():
    """Offsets that are not searched for are corrected by people all the same, one clock after the other."""
    found, agreed = (Condition(replace(SMALL, seconds=12.0, clock_offsets=(0.0, 0.4, -0.5)), search_s=s) for s in (2.0, 0.0))
    outcomes = run_conditions([found, agreed], None, silent, "test")
    assert outcomes[agreed].clock_ms < 60.0
    assert outcomes[found].clock_ms < 40.0


def test_a_stopped_run_goes_on_where_it_was(tmp_path, monkeypatch):
    asked = [Condition(SMALL), Condition(SMALL, shared=5)]
    real, worked = conditions.outcome_of, []

    def stopped(condition, filmed):
        if worked:
            raise KeyboardInterrupt
        worked.append(condition)
        return real(condition, filmed)

    monkeypatch.setattr(conditions, "outcome_of", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_conditions(asked, None, silent, "test", tmp_path)
    monkeypatch.setattr(conditions, "outcome_of", lambda condition, filmed: worked.append(condition) or real(condition, filmed))
    outcomes = run_conditions(asked, None, silent, "test", tmp_path)
    assert worked == asked
    monkeypatch.setattr(conditions, "outcome_of", None)
    assert run_conditions(asked, None, silent, "test", tmp_path) == outcomes
    monkeypatch.setattr(conditions, "outcome_of", real)
    assert run_conditions(asked, None, silent, "test") == outcomes


def test_what_other_code_has_kept_is_not_believed(tmp_path, monkeypatch):
    kept = Kept(tmp_path)
    kept.put("a", {"mm": float("inf")})
    assert Kept(tmp_path).get("a") == {"mm": float("inf")}
    assert kept.get("b") is None
    monkeypatch.setattr(kept_module, "code_digest", lambda *_: "other")
    assert Kept(tmp_path).get("a") is None
    assert Kept(None).get("a") is None
