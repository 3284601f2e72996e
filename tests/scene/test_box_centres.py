"""Boxes that are given by their centres, and others that lie half outside the images for good reasons."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.observations import Boxes
from passerby.scene.box_centres import doubt_of_centres
from passerby.simulation import SimulationOptions, simulate


@pytest.fixture(scope="module")
def scene():
    return simulate(SimulationOptions(preset="terrace", seed=3, cameras=4, people=6, seconds=30.0, box_noise=0.02))


def boxes_of(scene, *, by_centres=()):
    out = []
    for name in scene.rig.names:
        boxes = scene.observations[name].boxes
        corner, extent = boxes.ltwh[:, :2], boxes.ltwh[:, 2:]
        ltwh = np.concatenate([corner + extent / 2, extent], axis=1) if name in by_centres else boxes.ltwh
        out.append(replace(boxes, ltwh=ltwh))
    return out


def test_ordinary_boxes_have_corners(scene):
    assert doubt_of_centres(scene.rig, boxes_of(scene)) is None


def test_boxes_by_their_centres_are_told(scene):
    found = doubt_of_centres(scene.rig, boxes_of(scene, by_centres=scene.rig.names))
    assert (found.code, found.severity) == ("boxes_by_centres", "doubt")
    assert set(found.cameras) <= set(scene.rig.names)
    assert found.values["beyond"] >= 20


@pytest.mark.parametrize(("name", "told"), [("C1", True), ("C2", False), ("C3", True), ("C4", False)])
def test_one_camera_by_centres_is_told_by_its_name_where_enough_people_are_at_its_borders(scene, name, told):
    """Nobody leaves the second and the fourth camera's image at the right."""
    found = doubt_of_centres(scene.rig, boxes_of(scene, by_centres=(name,)))
    assert (None if found is None else found.cameras) == ((name,) if told else None)


def test_bodies_that_the_border_cuts_off_reach_beyond_both_sides():
    """Boxes of whole bodies, half of them outside, at all borders alike."""
    scene = simulate(SimulationOptions(preset="terrace", seed=3, cameras=1))
    rng = np.random.default_rng(0)
    width, height = scene.rig.cameras[0].lens.size
    centre = rng.uniform((0, 0), (width, height), (2000, 2))
    extent = np.tile([60.0, 150.0], (2000, 1))
    whole = Boxes(
        np.arange(2000), np.ones(2000, dtype=np.int64), np.concatenate([centre - extent / 2, extent], axis=1), np.ones(2000)
    )
    assert doubt_of_centres(scene.rig, [whole]) is None
    right = whole.take((whole.ltwh[:, :2] > 0).all(axis=1))
    assert doubt_of_centres(scene.rig, [right]) is None  # some of those at the right and below go beyond by more than half
    moved = whole.take(((whole.ltwh[:, :2] > 0) & (whole.ltwh[:, :2] + extent < (width, height))).all(axis=1))
    moved = replace(moved, ltwh=moved.ltwh + np.array([30.0, 75.0, 0.0, 0.0]))
    assert doubt_of_centres(scene.rig, [moved]) is not None


def test_nothing_is_said_without_boxes(scene):
    assert doubt_of_centres(scene.rig, [Boxes.empty() for _ in scene.rig]) is None
