"""The table of sightings: blocks stay numbered without gaps, and the fits that share its equations agree."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import Observations
from passerby.people.held_cameras import fit_people
from passerby.people.model import Noise, Priors
from passerby.people.sightings import Sightings, box_sightings, gather_sightings, poses_of
from passerby.people.upright_bodies import BodyModel, fit_bodies
from passerby.people.upright_body import linearise_bodies
from support.scenes.people_and_rigs import observe, ring

RIG = ring(4)
PLACES = np.array([[0.5, -0.4], [-1.0, 0.8], [0.2, 1.5]])
HEIGHTS = np.array([1.6, 1.75, 1.9])
STEPS = 5
WHO, WHEN = (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(STEPS), indexing="ij"))
BODY = np.column_stack([PLACES[WHO], np.zeros(len(WHO)), HEIGHTS[WHO]])
"""x, y, ground and height of each person at each time step."""


SEEN = observe(RIG, BODY[:, :2], BODY[:, 3], WHEN, WHO)
BOXES = {name: one.boxes for name, one in SEEN.items()}


@pytest.fixture(scope="module")
def seen() -> Sightings:
    """Poles without any error, in all four cameras at all five seconds."""
    found = gather_sightings(RIG, Observations(SEEN, 1.0))
    assert len(found) == 4 * len(WHO)
    return found


def test_a_block_is_one_person_at_one_time_step(seen: Sightings) -> None:
    assert seen.n_blocks == len(WHO)
    for block in range(seen.n_blocks):
        own = seen.take(seen.block == block)
        assert set(own.identity) == {seen.block_identity[block]}
        assert set(own.seconds) == {seen.block_seconds[block]}
        assert sorted(own.camera) == [0, 1, 2, 3]


def test_parts_number_their_blocks_and_cameras_anew(seen: Sightings) -> None:
    early = seen.between(0.0, float(np.median(seen.seconds)))
    assert 0 < early.n_blocks < seen.n_blocks
    assert (early.seconds < np.median(seen.seconds)).all()
    tall = seen.of_blocks(seen.block_identity == 2)
    others = seen.without(np.array([True, False, False, True]))
    for part, blocks in ((early, early.n_blocks), (tall, STEPS), (others, seen.n_blocks)):
        np.testing.assert_array_equal(np.unique(part.block), np.arange(blocks))
        assert part.n_blocks == blocks == len(part.block_identity)
    assert set(tall.identity) == {2}
    assert set(others.camera) == {1, 2}
    rows = np.flatnonzero(np.isin(seen.camera, [1, 3]))
    part = seen.of_cameras(("C4", "C2"), rows)
    assert part.names == ("C4", "C2")
    np.testing.assert_array_equal(np.array(part.names)[part.camera], np.array(seen.names)[seen.camera[rows]])


def test_exact_sightings_leave_no_residual_at_their_bodies(seen: Sightings) -> None:
    body = np.column_stack([PLACES[seen.identity], np.zeros(len(seen)), HEIGHTS[seen.identity]])
    world = seen.in_world(*poses_of(RIG, seen.names))
    # The middle of a box's edge is not quite the end of a pole: the rays are those of the very ends.
    foot, head = (np.column_stack([body[:, :2], z]) - world.origin for z in (body[:, 2], body[:, 3]))
    world = replace(world, top=_unit(head), bottom=_unit(foot))
    np.testing.assert_allclose(linearise_bodies(world, body, np.zeros((1, 1))).residual, 0.0, atol=1e-6)
    # A body that is moved leaves what the equations say, to first order.
    step = np.array([0.01, -0.008, 0.004, 0.006])
    at = linearise_bodies(world, body, np.zeros((1, 1)))
    moved = linearise_bodies(world, body + step, np.zeros((1, 1))).residual
    expected = -at.by_body @ step
    assert np.abs(moved - expected).max() < 0.02 * np.abs(expected).max()


def test_boxes_become_the_same_rays_by_either_way(seen: Sightings) -> None:
    world = seen.in_world(*poses_of(RIG, seen.names))
    for number, camera in enumerate(RIG):
        boxes = BOXES[camera.name]
        found = box_sightings(camera, number, boxes.frame, boxes.identity, boxes.ltwh)
        own = world.take(world.camera == number)
        order, own_order = (np.lexsort((one.identity, one.step)) for one in (found, own))
        for name in ("top", "bottom", "size", "origin"):
            np.testing.assert_allclose(getattr(found, name)[order], getattr(own, name)[own_order], atol=1e-12)


def test_report_and_monitoring_place_a_body_alike(seen: Sightings) -> None:
    by_monitoring = fit_people(seen, *poses_of(RIG, seen.names), heights=dict(enumerate(HEIGHTS.tolist()))).body
    parts = [Sightings(np.full(len(one), c), one.frame, one.identity, ltwh=one.ltwh) for c, one in enumerate(BOXES.values())]
    model = BodyModel(Noise(), Priors().foot_shift, {}, dict(enumerate(HEIGHTS.tolist())), 1.72)
    bodies, _, agrees = fit_bodies(RIG, Sightings.joined(parts), model)
    assert agrees.all()
    order = np.lexsort((seen.block_seconds, seen.block_identity))
    np.testing.assert_allclose(bodies.xy, by_monitoring[order, :2], atol=0.02)
    np.testing.assert_allclose(bodies.xy, PLACES[bodies.identity], atol=0.1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
