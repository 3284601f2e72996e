"""The uncertainty of a rig in a world that known places set: the cameras' own errors, and those of the motion into that world.

The sigmas of a calibrated rig hold for its best placement along the ground, with what all cameras share: the scale by people's
heights, the vertical. Where places fit the scale or the vertical, the shared part is theirs from then on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, PoseSigma, Rig

UP = np.array([0.0, 0.0, 1.0])
ROUNDS, STEEP = 20, 3.0
"""Of the search for the fixed place of the scale: least squares, reweighted towards the camera that holds the least of it."""
_TINY = 1e-12


def own_covariances(rig: Rig, *, with_scale: bool, tilt: bool) -> dict[str, Floats]:
    """By camera, the covariance (6, 6) of its pose as `PoseSigma.covariance` has it, without what a fit will decide.

    Of the scale, and with `tilt` of two turns of the vertical, as much is taken off as fits into the covariances of all
    cameras: no more can be common to them. Cameras without a covariance are left out.
    """
    poses, covariances = dict[str, Pose](), dict[str, Floats]()
    for camera in rig:
        if camera.pose is not None and camera.sigma is not None and camera.sigma.covariance is not None:
            poses[camera.name], covariances[camera.name] = camera.pose, np.array(camera.sigma.covariance)
    if len(poses) < 2 or not (with_scale or tilt):
        return covariances
    own = _without_scale(covariances, poses) if with_scale else covariances
    for axis in np.eye(3)[:2] if tilt else ():
        own = _without(own, {name: -pose.R_cw @ axis for name, pose in poses.items()}, slice(3, 6))
    return {name: _without_rounding(covariance) for name, covariance in own.items()}


def _without_rounding(covariance: Floats) -> Floats:
    """(6, 6) with no variance below 0: taking off just all of one leaves the rounding of both."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def in_known_world(rig: Rig, fitted: Floats, centre: Floats, *, with_scale: bool, tilt: bool) -> Rig:
    """A rig that a fit has moved into its world, with the sigmas that its cameras have there.

    Args:
        rig: after the motion; its sigmas are those of before, as `Rig.moved` makes them.
        fitted: (n, n) covariance of what was fitted, as of `WorldFit`.
        centre: (3,) about which it was.
        with_scale: whether the scale was fitted.
        tilt: whether the vertical and the heights were.
    """
    own = own_covariances(rig, with_scale=with_scale, tilt=tilt)
    cameras = []
    for camera in rig:
        if camera.name in own and camera.pose is not None:
            moves = fit_moves(camera.pose, centre, with_scale=with_scale, tilt=tilt)
            covariance = own[camera.name] + moves @ fitted @ moves.T
            camera = replace(camera, sigma=PoseSigma.from_covariance(covariance))
        cameras.append(camera)
    return replace(rig, cameras=tuple(cameras))


def fit_moves(pose: Pose, centre: Floats, *, with_scale: bool, tilt: bool) -> Floats:
    """(6, n) what the unknowns of a fit do to a pose: turns (about the vertical, or all three), shifts, logarithm of the scale.

    Turns are about `centre` (3,); without `tilt` heights grow with the scale from the ground.
    """
    reach = pose.centre - centre
    axes = np.eye(3) if tilt else UP[None]
    turns = [np.concatenate([np.cross(axis, reach), -pose.R_cw @ axis]) for axis in axes]
    shifts = [np.concatenate([axis, np.zeros(3)]) for axis in np.eye(3)[: 3 if tilt else 2]]
    grown = reach if tilt else np.array([*reach[:2], pose.centre[2]])
    scale = [np.concatenate([grown, np.zeros(3)])] if with_scale else []
    return np.column_stack([*turns, *shifts, *scale])


def _without_scale(covariances: Mapping[str, Floats], poses: Mapping[str, Pose]) -> dict[str, Floats]:
    """The covariances without the scale: about the place at which most of it fits into them.

    That place is near the middle of the cameras and near the ground; what people say of the ground and of the scale hangs
    together.
    """
    centres = np.array([poses[name].centre for name in covariances])
    known = np.array([np.linalg.pinv(covariance[:3, :3]) for covariance in covariances.values()])
    weight = np.ones(len(centres))
    for _ in range(ROUNDS):
        A = weight[:, None, None] * known
        place = np.linalg.lstsq(A.sum(axis=0), np.einsum("cij,cj->i", A, centres), rcond=None)[0]
        against = np.einsum("ci,cij,cj->c", centres - place, known, centres - place)
        weight = (against / max(float(against.max()), _TINY)) ** STEEP
    return _without(covariances, {name: pose.centre - place for name, pose in poses.items()}, slice(0, 3))


def _without(covariances: Mapping[str, Floats], moves: Mapping[str, Floats], part: slice) -> dict[str, Floats]:
    """The covariances less the largest variance of one motion that all of them hold.

    Args:
        covariances: (6, 6) by camera.
        moves: (3,) what the motion does to one part of each pose; the rest follows by its regression on that part.
        part: the rows of that part.
    """
    whole = {}
    for name, covariance in covariances.items():
        whole[name] = covariance[:, part] @ np.linalg.pinv(covariance[part, part]) @ moves[name]
    shares = [float(move @ np.linalg.pinv(covariances[name]) @ move) for name, move in whole.items()]
    variance = 1.0 / max(*shares, _TINY)
    return {name: covariance - variance * np.outer(whole[name], whole[name]) for name, covariance in covariances.items()}
