"""The table of sightings, and what it tells of bodies: which fits agree, who stands, where up is, where no one is."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations
from passerby.core.pose import Pose
from passerby.geometry.rotations import direction_angle, exp_rotation
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.people.held_cameras import fit_people
from passerby.people.level import level_from_people, levelled_people
from passerby.people.model import Noise, Priors
from passerby.people.one_against_others import disagreements
from passerby.people.sightings import Sightings, box_sightings, gather_sightings, poses_of, upright_sightings
from passerby.people.standing import standing_instants, standing_share
from passerby.people.upright_bodies import BodyModel, fit_bodies
from passerby.people.upright_body import linearise_bodies
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.body import pose_joints
from passerby.simulation.observe import observe_camera
from support.scenes.people_and_rigs import observe, ring, simulated

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


def test_a_block_is_one_person_at_one_time_step_and_parts_number_their_blocks_and_cameras_anew(seen: Sightings) -> None:
    assert seen.n_blocks == len(WHO)
    for block in range(seen.n_blocks):
        own = seen.take(seen.block == block)
        assert set(own.identity) == {seen.block_identity[block]}
        assert set(own.seconds) == {seen.block_seconds[block]}
        assert sorted(own.camera) == [0, 1, 2, 3]
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
    head, foot = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (head, foot))
    world = replace(world, top=head, bottom=foot)
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


@pytest.mark.parametrize("seeing", [0, 1])
def test_no_one_is_where_no_other_camera_sees_anyone(seeing: int) -> None:
    scene = simulate(SimulationOptions(seconds=4.0))
    empty = CameraObservations(Boxes.empty(), Keypoints.empty())
    names = scene.rig.names
    some = Observations({name: scene.observations[name] if c < seeing else empty for c, name in enumerate(names)})
    centres = identified_body_centres(scene.rig, some)
    assert len(triangulate_people(scene.rig, centres, 1.72, excluding=0)) == 0
    assert all(len(one) == 0 for one in disagreements(scene.rig, some, 1.72).values())


def shares(rng: np.random.Generator, share: float, count: int, spread: float = 0.02) -> np.ndarray:
    return share + spread * rng.normal(size=count)


@pytest.mark.parametrize(("crouching", "reaching"), [(0.0, 0.0), (0.6, 0.0), (0.0, 0.1)])
def test_standing_is_the_highest_frequent_height(crouching: float, reaching: float) -> None:
    """Even of somebody who crouches most of the time (the mean would be 17 % off), or reaches up now and then."""
    rng = np.random.default_rng(0)
    down, arms = int(400 * crouching), int(400 * reaching)
    ratio = np.concatenate([shares(rng, 0.97, 400 - down - arms), rng.uniform(0.55, 0.8, down), shares(rng, 1.17, arms)])
    assert standing_share(ratio) == pytest.approx(0.97, abs=0.015)


def test_each_person_stands_by_their_own_height_and_one_seen_a_few_times_by_that_of_all() -> None:
    """A small person who stands and a tall one who bends look alike to a common height. To reach up is not to stand."""
    rng = np.random.default_rng(2)
    parts = [(1.55, 60), (1.9, 40), (1.9 * 0.815, 20), (1.9 * 1.2, 10)]
    extent = np.concatenate([share * shares(rng, 1, count, 0.008) for share, count in parts])
    found = standing_instants(extent, np.full(130, 1.72), np.repeat([0, 1], [60, 70]))
    assert found[:60].mean() > 0.95
    assert found[60:100].mean() > 0.95
    assert found[100:120].mean() < 0.05
    assert found[120:].mean() < 0.05
    extent = 1.72 * np.concatenate([shares(np.random.default_rng(4), 0.95, 200, 0.01), [0.95, 0.7]])
    person = np.concatenate([np.zeros(200, int), [1, 1]])
    assert standing_instants(extent, np.full(202, 1.72), person)[-2:].tolist() == [1, 0]
    assert standing_instants(np.array([1.72, 1.0]), np.full(2, 1.72), np.zeros(2, int)).tolist() == [1, 0]
    assert len(standing_instants(np.zeros(0), np.zeros(0), np.zeros(0, int))) == 0
    assert standing_share(np.array([1.0])) == pytest.approx(1.0, abs=0.005)
    assert np.isfinite(standing_share(np.array([5.0, 7.0])))


UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def filmed():
    return simulated("basketball", seconds=24.0)


def rolled(scene, name, degrees):
    """A camera of a scene, rolled about its viewing direction, with tight boxes of the people in its image."""
    camera = scene.rig[name]
    turn = exp_rotation(np.array([0.0, 0.0, np.deg2rad(degrees)]))
    camera = Camera(name, camera.lens, Pose(turn @ camera.pose.R_cw, turn @ camera.pose.t_cw))
    state, present = scene.motion.at((scene.frames - 1) / scene.options.fps)
    heights = np.array([scene.heights[one] for one in scene.identities.tolist()])
    view = observe_camera(camera, pose_joints(state, heights), heights, present, occlusion=False)
    time, who = np.nonzero((view.inside > 0.99) & ~view.clipped.any(axis=-1))
    corners = view.box[time, who]
    ltwh = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    return camera, Boxes(time + 1, np.full(len(time), -1), ltwh, np.ones(len(time)))


@pytest.mark.parametrize("degrees", [-45, 18, 45])
def test_the_vertical_of_a_rolled_camera_is_found(filmed, degrees):
    camera, boxes = rolled(filmed, "C2", degrees)
    bodies, level = levelled_people(
        CameraObservations(boxes), camera.lens, Clock(5.0), filmed.options.person_height_mean_m, np.random.default_rng(0)
    )
    assert np.rad2deg(direction_angle(level.up, camera.pose.R_cw @ UP)) < 4.0
    assert level.height == pytest.approx(camera.pose.centre[2], rel=0.15)
    feet = bodies.bottom @ level.R_lc.T
    assert (feet[:, 2] < 0).all()


def test_an_upright_camera_is_levelled_as_by_its_boxes_alone_and_too_few_people_have_no_level(filmed):
    camera, boxes = rolled(filmed, "C2", 0)
    seen, clock = CameraObservations(boxes), Clock(5.0)
    _, level = levelled_people(seen, camera.lens, clock, 1.72, np.random.default_rng(3))
    plain = level_from_people(upright_sightings(seen, camera.lens, clock), 1.72, np.random.default_rng(3))
    assert (level.up == plain.up).all()
    assert level.height == plain.height
    few = CameraObservations(rolled(filmed, "C2", 25)[1].take(np.arange(5)))
    assert levelled_people(few, camera.lens, clock, 1.72, np.random.default_rng(0))[1] is None
