"""Uncertainty of a rig in a world that known places define: the cameras' own errors, and those of the motion into that world.

The sigmas of a calibrated rig hold for its best placement along the ground. They include the errors that all cameras share: the
scale by people's heights, and the vertical. If known places fit the scale or the vertical, the error of that fit replaces the
shared part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, PoseSigma, Rig

UP = np.array([0.0, 0.0, 1.0])
ROUNDS, STEEP = 20, 3.0
"""Number of rounds, and exponent of the weights, of the search for the fixed place of the scale: least squares, reweighted
towards the camera whose covariance has room for the smallest part of the scale error."""
_TINY = 1e-12


def own_covariances(rig: Rig, *, with_scale: bool, tilt: bool) -> dict[str, Floats]:
    """Return the covariance (6, 6) of each camera's pose, as `PoseSigma.covariance` has it, without what a fit will determine.

    The variance of the scale (`with_scale`), and of two turns of the vertical (`tilt`), is removed as far as it fits into the
    covariances of all cameras: no more can be common to them. Cameras without a covariance are left out.
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
    """Set negative eigenvalues of a covariance (6, 6) to 0: removing the whole of a variance leaves rounding errors."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def in_known_world(rig: Rig, fitted: Floats, centre: Floats, *, with_scale: bool, tilt: bool) -> Rig:
    """Return a rig that a fit has moved into its world, with the sigmas that its cameras have there.

    Args:
        rig: after the motion; its sigmas are those before the fit, as `Rig.moved` converts them.
        fitted: (n, n) covariance of the fitted parameters, as `WorldFit.covariance` has it.
        centre: (3,) fixed point of the fitted turns and scale.
        with_scale: whether the scale was fitted.
        tilt: whether the vertical and the heights were fitted.
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
    """Return the derivatives (6, n) of a pose by the unknowns of a fit: turns (one or three), shifts, logarithm of the scale.

    The fixed point of the turns is `centre` (3,). Without `tilt`, the scale changes heights relative to the ground.
    """
    reach = pose.centre - centre
    axes = np.eye(3) if tilt else UP[None]
    turns = [np.concatenate([np.cross(axis, reach), -pose.R_cw @ axis]) for axis in axes]
    shifts = [np.concatenate([axis, np.zeros(3)]) for axis in np.eye(3)[: 3 if tilt else 2]]
    grown = reach if tilt else np.array([*reach[:2], pose.centre[2]])
    scale = [np.concatenate([grown, np.zeros(3)])] if with_scale else []
    return np.column_stack([*turns, *shifts, *scale])


def _without_scale(covariances: Mapping[str, Floats], poses: Mapping[str, Pose]) -> dict[str, Floats]:
    """Remove the scale from the covariances, about the fixed place with which the largest part of it fits into all of them.

    That place is near the middle of the cameras and near the ground: people determine the ground and the scale together.
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
    """Subtract from the covariances the largest variance of one motion that fits into all of them.

    Args:
        covariances: (6, 6) by camera.
        moves: (3,) change of one part of each pose by the motion; the rest follows by its regression on that part.
        part: the rows of that part.
    """
    whole = {}
    for name, covariance in covariances.items():
        whole[name] = covariance[:, part] @ np.linalg.pinv(covariance[part, part]) @ moves[name]
    shares = [float(move @ np.linalg.pinv(covariances[name]) @ move) for name, move in whole.items()]
    variance = 1.0 / max(*shares, _TINY)
    return {name: covariance - variance * np.outer(whole[name], whole[name]) for name, covariance in covariances.items()}
