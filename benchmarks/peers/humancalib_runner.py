"""humancalib's bundle adjustment on the joints of one person.

Its own start needs a network that lifts every skeleton to 3D, which is no part of these observations. The start here is the
usual one instead: the pair of cameras with the most inliers of an essential matrix, then camera after camera by PnP on what is
triangulated. The adjustment is `humancalib.calibration.ba.ba_main` with the settings of its command line; the term for lifted
skeletons has nothing to act on. It takes pinhole cameras, so it gets undistorted pixels.
"""

from __future__ import annotations

import itertools
import logging
from pathlib import Path

import cv2
import humancalib.core as core
import numpy as np
from humancalib.calibration.ba import ba_main
from humancalib.core import OP_BONE
from protocol import Points, Poses, run

CONFIDENCE = 0.5  # humancalib's default: joints below are not used
SEED = 0
MIN_SHARED = 15


def solve(source: Path, option: str) -> Poses:
    """The poses of all cameras, or of none."""
    logging.disable(logging.CRITICAL)
    cv2.setRNGSeed(SEED)
    cv2.setNumThreads(1)
    points = Points.read(source)
    if len(np.unique(points.person)) != 1:
        raise ValueError("humancalib takes one person")
    xy, score = grids(points)
    K = points.matrix
    R, t = start(K, xy, score > CONFIDENCE)
    C, N, J = score.shape
    lifted, no_score = np.zeros((C, N, J, 3)), np.zeros((C, N, J))
    R, t, _, _ = ba_main(
        np.arange(C), K, R, t, xy, score, lifted, no_score, 1.0, 1.0,
        conf_threshold=CONFIDENCE, bone_idx=OP_BONE, img_size=tuple(points.size[0]), jac_mode="analytic",
    )  # fmt: skip
    return {str(name): (R[index], np.ravel(t[index])) for index, name in enumerate(points.names)}


def grids(points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (C, N, J, 2) and scores (C, N, J), camera by instant by joint; score 0 where a joint was not seen."""
    instant = np.unique(points.instant, return_inverse=True)[1].reshape(-1)
    shape = len(points.names), instant.max() + 1, max(int(points.part.max()) + 1, int(OP_BONE.max()) + 1)
    xy, score = np.zeros((*shape, 2)), np.zeros(shape)
    xy[points.camera, instant, points.part] = points.undistorted
    score[points.camera, instant, points.part] = points.score
    return xy, score


def start(K: np.ndarray, xy: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera rotations (C, 3, 3) and translations (C, 3, 1)."""
    C = len(K)
    pixels, visible = xy.reshape(C, -1, 2), seen.reshape(C, -1)
    poses = first_pair(K, pixels, visible)
    while len(poses) < C:
        world = triangulated(K, pixels, visible, poses)
        known = np.isfinite(world).all(axis=1)
        count, camera = max((int((known & visible[c]).sum()), c) for c in range(C) if c not in poses)
        if count < MIN_SHARED:
            raise ValueError(f"camera {camera} shares {count} points with the others: {MIN_SHARED} are needed")
        rows = known & visible[camera]
        done, rvec, tvec, _ = cv2.solvePnPRansac(
            world[rows], pixels[camera][rows], K[camera], None, reprojectionError=20.0, iterationsCount=1000
        )
        if not done:
            raise ValueError(f"PnP of camera {camera} found nothing")
        poses[camera] = cv2.Rodrigues(rvec)[0], tvec.reshape(3, 1)
    return np.array([poses[c][0] for c in range(C)]), np.array([poses[c][1] for c in range(C)])


def first_pair(K: np.ndarray, pixels: np.ndarray, visible: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The two cameras whose essential matrix has the most points in front of both, the first at the origin."""
    best: tuple[int, dict[int, tuple[np.ndarray, np.ndarray]]] = (0, {})
    for a, b in itertools.combinations(range(len(K)), 2):
        rows = visible[a] & visible[b]
        if rows.sum() < MIN_SHARED:
            continue
        rays = [cv2.undistortPoints(pixels[c][rows][:, None], K[c], None)[:, 0] for c in (a, b)]
        threshold = 4.0 / float(np.mean([K[a][0, 0], K[b][0, 0]]))
        E, inliers = cv2.findEssentialMat(*rays, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.9999, threshold=threshold)
        if E is None or E.shape != (3, 3):
            continue
        count, R, t, _ = cv2.recoverPose(E, *rays, np.eye(3), mask=inliers)
        if count > best[0]:
            best = count, {a: (np.eye(3), np.zeros((3, 1))), b: (R, t)}
    if not best[1]:
        raise ValueError("no pair of cameras has an essential matrix")
    return best[1]


def triangulated(
    K: np.ndarray, pixels: np.ndarray, visible: np.ndarray, poses: dict[int, tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """(P, 3) points seen by two placed cameras or more, NaN the others; humancalib's own triangulation."""
    who = sorted(poses)
    P = np.array([K[c] @ np.hstack(poses[c]) for c in who])
    world = np.full((pixels.shape[1], 3), np.nan)
    for row in np.flatnonzero(visible[who].sum(axis=0) >= 2):
        seen = visible[who, row]
        world[row] = core.geometry.triangulate_dlt(pixels[who, row][seen], P[seen])
    return world


if __name__ == "__main__":
    run(solve, "humancalib")
