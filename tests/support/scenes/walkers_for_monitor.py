"""Boxes of a few people who walk about in front of a rig, one of whose cameras may be knocked: for tests of the monitor."""

from dataclasses import replace

import numpy as np

from passerby.core.cameras import Pose, PoseSigma, Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.simulation.lenses import place_cameras

FPS = 2.0
POSITION_SD, TURN_SD_DEG = 0.01, 0.05


def true_rig(cameras=4, seed=0):
    return place_cameras(cameras, (7.0, 11.0), 1.5, 2.2, (720, 576), np.random.default_rng(seed))


def calibrated(rig, seed=1):
    """The rig with small errors, which its sigmas tell."""
    rng = np.random.default_rng(seed)
    turn_sd = np.radians(TURN_SD_DEG)
    covariance = np.diag(np.repeat([POSITION_SD**2, turn_sd**2], 3))
    sigma = PoseSigma(POSITION_SD * 3**0.5, TURN_SD_DEG * 3**0.5, covariance)

    def found(camera):
        turned = exp_rotation(turn_sd * rng.standard_normal(3)) @ camera.pose.R_cw
        return replace(camera, pose=Pose.from_centre(turned, camera.centre + POSITION_SD * rng.standard_normal(3)), sigma=sigma)

    return replace(rig, cameras=tuple(found(camera) for camera in rig))


def knocked(pose, turn_deg=(0, 0, 0), shift_m=(0, 0, 0)):
    return Pose.from_centre(exp_rotation(np.radians(turn_deg)) @ pose.R_cw, pose.centre + np.array(shift_m, dtype=float))


def walkers(rig, seconds=180, people=5, knocks=None, seed=2, ground=lambda xy: np.zeros(len(xy))):
    """Boxes with identities; `knocks`: camera -> (seconds, pose from then on)."""
    rng, n = np.random.default_rng(seed), int(seconds * FPS)
    at = np.arange(n) / FPS
    rows = {name: [] for name in rig.names}
    for person in range(1, people + 1):
        # Round curves of one's own, a metre a second.
        ways = rng.uniform(0.25, 0.5, 2), rng.uniform(0, 2 * np.pi, 2), rng.uniform(0.6, 1.0, 2) * (3.0, 5.0)
        xy = np.column_stack([ways[2][k] * np.sin(ways[0][k] * at + ways[1][k]) for k in (0, 1)])
        height = 1.72 + 0.08 * rng.standard_normal()
        level = ground(xy)
        for camera in rig:
            when, after = (knocks or {}).get(camera.name, (np.inf, camera.pose))
            edges = np.where(
                (at >= when)[:, None], _edges(replace(camera, pose=after), xy, level, height), _edges(camera, xy, level, height)
            )
            tall = edges[:, 3] - edges[:, 1]
            edges = edges + 0.02 * tall[:, None] * (_lasting(rng, n) + 0.5 * rng.standard_normal((n, 4)))
            keep = np.isfinite(edges).all(axis=1) & (edges[:, :2] > 3).all(axis=1)
            keep &= (edges[:, 2:] < np.array(camera.lens.size) - 3).all(axis=1)
            for row in np.flatnonzero(keep):
                left, top, right, bottom = edges[row]
                rows[camera.name].append((row + 1, person, left, top, right - left, bottom - top))
    return Observations({name: CameraObservations(_boxes(found)) for name, found in rows.items()}, FPS)


def _boxes(found):
    table = np.array(found, dtype=float).reshape(-1, 6)
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    return Boxes(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], np.ones(len(table)))


def _lasting(rng, n):
    """(n, 4) of unit variance, alike for some 2 s."""
    out = rng.standard_normal((n, 4))
    for k in range(1, n):
        out[k] = 0.78 * out[k - 1] + 0.626 * out[k]
    return out


def _edges(camera, xy, level, height):
    toward = camera.centre[:2] - xy
    toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    high = camera.project(np.column_stack([xy, level + height]))
    low = camera.project(np.column_stack([xy + 0.08 * height * toward, level]))
    middle, half = (high[:, 0] + low[:, 0]) / 2, 0.18 * (low[:, 1] - high[:, 1])
    return np.column_stack([middle - half, high[:, 1], middle + half, low[:, 1]])


def write_watched(folder, rig, seen, *, known=True, fps=FPS):
    """A rig file and a scene of new footage; returns the paths of both."""
    write_rig(folder / "rig.toml", rig)
    kind = "tracks" if known else "detections"
    lines = [f'[scene]\n{f"fps = {fps:g}" if fps else ""}\n[association]\nmode = "{"given" if known else "trajectory"}"\n']
    for name in seen.cameras:
        boxes = seen[name].boxes
        write_boxes(folder / f"{name}.txt", boxes if known else replace(boxes, identity=np.full(len(boxes), -1)))
        lines.append(f'[cameras.{name}]\nintrinsics = "rig.toml"\n{kind} = "{name}.txt"\n')
    (folder / "scene.toml").write_text("".join(lines))
    return folder / "rig.toml", folder / "scene.toml"


def only(rig, *names):
    return Rig(tuple(camera for camera in rig if camera.name in names))
