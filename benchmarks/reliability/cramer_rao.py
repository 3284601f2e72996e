"""The Cramer-Rao bound of cameras that see upright people: the least errors that any unbiased estimator can have.

The Fisher information is taken at the truth, of the noise that the simulator states: each edge of a box is off by an
independent Gaussian, a share of the box's height. A box has three numbers: the middle of its width, its top and its bottom; its
width alone shows how wide a person is. The unknowns are all cameras' poses, the ground position of each person at each time
step, and each person's height, about which a prior is known. The person is the solver's: upright, the lowest visible point
nearer to the camera by a known share of the height. The ground positions are eliminated by Schur complements. The gauge is held
as the solver holds it, and the covariance is that after the best similarity, which is how errors are measured. That the noise
itself grows with the person is left out: at 2 % it would add less than 1 % to what a box tells of its height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Pose, Rig
from passerby.geometry.rotations import exp_rotation
from passerby.people.model import GAIT_SHARE, Priors
from passerby.people.upright_body import body_ends
from passerby.solver.gauge import HeldSystem, placement_freedoms, similarity_freedoms
from passerby.solver.people_state import AdjustmentState

POSE = 6
"""Unknowns of a camera: rotation vector in its frame (radians), then centre (metres)."""
PLACE = 2
"""Unknowns of a person at one time step: x, y, metres."""
STEP = 1e-5
"""Of the central differences, metres or radians: their errors are about 1e-9 of a derivative."""


@dataclass(frozen=True, eq=False)
class UprightScene:
    """True cameras and people, and who was seen by which camera. M sightings, N person-instants, P people."""

    rig: Rig
    heights: Floats
    """(P,) metres."""
    places: Floats
    """(N, 2) ground positions, metres."""
    person: Ints
    """(N,) whose each person-instant is."""
    camera: Ints
    """(M,) index of the camera."""
    instant: Ints
    """(M,) the person-instant; no camera sees one twice."""


@dataclass(frozen=True, eq=False)
class Bound:
    """Least covariance of C cameras' errors after similarity alignment."""

    covariance: Floats
    """(6 C, 6 C): centre (metres, world), then rotation vector (radians, camera frame), camera by camera."""

    @property
    def position_mm(self) -> Floats:
        """(C,) least root mean square error of each position."""
        return np.asarray(1000 * np.sqrt(self._squares[:, :3].sum(axis=1)))

    @property
    def orientation_deg(self) -> Floats:
        """(C,) least root mean square error of each orientation."""
        return np.asarray(np.degrees(np.sqrt(self._squares[:, 3:].sum(axis=1))))

    @property
    def _squares(self) -> Floats:
        """(C, 6) variances."""
        return np.asarray(np.diag(self.covariance).reshape(-1, 6))


def model_edges(camera: Camera, places: Floats, heights: Floats) -> Floats:
    """(M, 3) the middle of the width, the top and the bottom of the model's boxes, pixels.

    Args:
        camera: with a pose.
        places: (M, 2) ground positions, metres.
        heights: (M,) metres.
    """
    bodies = np.column_stack([places, np.zeros(len(places)), GAIT_SHARE * heights])
    foot_shift = (Priors().foot_shift * heights)[:, None]
    top, bottom, _, _ = body_ends(np.tile(camera.centre, (len(bodies), 1)), bodies, foot_shift)
    top_px, bottom_px = camera.project(top), camera.project(bottom)
    return np.column_stack([0.5 * (top_px[:, 0] + bottom_px[:, 0]), top_px[:, 1], bottom_px[:, 1]])


def cramer_rao(scene: UprightScene, noise: float, height_sd: float) -> Bound | None:
    """The bound of a scene; None where its boxes leave a pose undetermined.

    Args:
        scene: at the truth.
        noise: standard deviation of each edge of a box, as a share of the box's height.
        height_sd: of the prior of each person's height, metres.
    """
    n_cameras = len(scene.rig)
    rotations = np.array([camera.pose.R_cw for camera in scene.rig if camera.pose is not None])
    centres = np.array([camera.centre for camera in scene.rig])
    none = np.zeros(n_cameras), np.zeros(1), scene.heights, np.zeros((0, 4)), np.zeros((0, 3))
    state = AdjustmentState(rotations, centres, *none)
    information = shared_information(scene, noise, height_sd)
    placement = placement_freedoms(state, len(information), POSE)
    system = HeldSystem.of(information, placement, n_cameras, POSE, np.arange(n_cameras))
    if system.null_vectors().shape[1]:
        return None
    poses = system.inverse()[np.ix_(system.own, system.own)]
    freedoms = similarity_freedoms(state)
    keep = np.eye(len(poses)) - freedoms.moves @ freedoms.along
    return Bound(keep @ poses @ keep.T)


def shared_information(scene: UprightScene, noise: float, height_sd: float) -> Floats:
    """(6 C + P, 6 C + P) Fisher information of poses and heights, the person-instants eliminated; arguments of `cramer_rao`."""
    n_poses = POSE * len(scene.rig)
    n_shared = n_poses + len(scene.heights)
    shared = np.zeros((n_shared, n_shared))
    own = np.zeros((len(scene.places), PLACE, PLACE))
    coupling = np.zeros((len(scene.places), PLACE, n_shared))
    for index, camera in enumerate(scene.rig):
        at = scene.instant[scene.camera == index]
        person = scene.person[at]
        J = _whitened_jacobian(camera, scene.places[at], scene.heights[person], noise)
        by_shared, by_own = J[:, :, [*range(POSE), POSE + PLACE]], J[:, :, POSE : POSE + PLACE]
        poses = np.tile(index * POSE + np.arange(POSE), (len(at), 1))
        columns = np.column_stack([poses, n_poses + person])
        transposed = by_shared.transpose(0, 2, 1), by_own.transpose(0, 2, 1)
        np.add.at(shared, (columns[:, :, None], columns[:, None, :]), transposed[0] @ by_shared)
        own[at] += transposed[1] @ by_own
        coupling[at[:, None, None], np.arange(PLACE)[:, None], columns[:, None, :]] += transposed[1] @ by_shared
    heights = np.arange(n_poses, n_shared)
    shared[heights, heights] += 1 / height_sd**2
    return np.asarray(shared - np.einsum("nis,nit->st", coupling, np.linalg.solve(own, coupling)))


def _whitened_jacobian(camera: Camera, places: Floats, heights: Floats, noise: float) -> Floats:
    """(M, 3, 9) derivatives of `model_edges` by `POSE`, `PLACE` and height, in units of their noise."""

    def edges_at(step: Floats) -> Floats:
        return model_edges(moved(camera, step[:POSE]), places + step[POSE:-1], heights + step[-1])

    steps = STEP * np.eye(POSE + PLACE + 1)
    J = np.stack([(edges_at(step) - edges_at(-step)) / (2 * STEP) for step in steps], axis=2)
    edges = model_edges(camera, places, heights)
    sigma = noise * (edges[:, 2] - edges[:, 1])
    # The middle is the mean of two edges, each with its own noise.
    return np.asarray(J * np.array([np.sqrt(2), 1.0, 1.0])[:, None] / sigma[:, None, None])


def moved(camera: Camera, step: Floats) -> Camera:
    """The camera after a step (6,) of its pose."""
    assert camera.pose is not None
    pose = Pose.from_centre(exp_rotation(step[:3]) @ camera.pose.R_cw, camera.centre + step[3:])
    return Camera(camera.name, camera.lens, pose)
