"""What `passerby monitor` takes on a site, where all cameras have new footage and where few of them have."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.core.cameras import Camera, Pose, PoseSigma, Rig
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.rig_toml import read_rig, write_rig
from sites.cases import SiteCase, taken

SIZES = (50, 200)
SECONDS = 120.0
NEWS = 0.05  # share of the cameras that have new footage the second time: the first ones, which are neighbours
MOVED, TURN_DEG = 0.05, 2.0  # share of the cameras that were turned since the rig was calibrated, and by how much
POSITION_SD_M, TURN_SD_DEG = 0.01, 0.05  # errors of the rig in each direction, which its sigmas state


def sites(seeds: int) -> dict[str, SiteCase]:
    """Sites that are monitored, by key."""
    del seeds
    return {f"{count} cameras": SiteCase(count, seconds=SECONDS) for count in SIZES}


def measure(case: SiteCase) -> dict[str, Any]:
    """Monitor a site twice: all its cameras, and those with news since."""
    with tempfile.TemporaryDirectory(prefix="passerby-monitoring-") as folder:
        site, out = Path(folder) / "site", Path(folder) / "checked"
        taken("simulate", "-o", str(site), *case.arguments, "--clock-offsets", "0")
        rig, moved = calibrated_before(read_rig(site / "truth.toml"), case.seed)
        write_rig(site / "rig.toml", rig)
        command = ["monitor", str(site / "rig.toml"), str(site / "scene.toml"), "-o", str(out)]
        every = taken(*command)
        told = json.loads((out / "monitor.json").read_text(encoding="utf-8"))
        fresh = rig.names[: round(NEWS * case.cameras)]
        for name in fresh:
            path = site / "tracks" / f"{name}.txt"
            os.utime(path, (path.stat().st_atime, path.stat().st_mtime + 60))
        few = taken(*command)
        again = json.loads((out / "monitor.json").read_text(encoding="utf-8"))
    return {
        "cameras": case.cameras, "minutes": SECONDS / 60, "cpu_s": every["cpu_s"] + few["cpu_s"], "all": every, "few": few,
        "fresh": len(fresh), "read": sum(not one["carried"] for one in again["cameras"]), "thinning": told["thinning"],
        **outcome_of(told, moved),
    }  # fmt: skip


def calibrated_before(truth: Rig, seed: int) -> tuple[Rig, list[str]]:
    """A rig of before some cameras were turned, with errors that its sigmas state, and the names of these cameras.

    The recording is the later one: so the turn is in the rig.
    """
    rng = np.random.default_rng([seed, 40])
    turned = rng.choice(len(truth), round(MOVED * len(truth)), replace=False)
    sd = np.repeat([POSITION_SD_M, np.radians(TURN_SD_DEG)], 3)
    sigma = PoseSigma.from_covariance(np.diag(sd**2))

    def before(number: int, camera: Camera) -> Camera:
        assert camera.pose is not None
        error, axis = sd * rng.standard_normal(6), rng.standard_normal(3)
        if number in turned:
            error[3:] += np.radians(TURN_DEG) * axis / np.linalg.norm(axis)
        pose = Pose.from_centre(exp_rotation(error[3:]) @ camera.pose.R_cw, camera.pose.centre + error[:3])
        return replace(camera, pose=pose, sigma=sigma)

    rig = replace(truth, cameras=tuple(before(number, camera) for number, camera in enumerate(truth)))
    return rig, [truth.names[number] for number in sorted(turned.tolist())]


def outcome_of(told: Mapping[str, Any], moved: Sequence[str]) -> dict[str, Any]:
    """Which cameras were named, beside those that did move."""
    state = {one["name"]: one["state"] for one in told["cameras"]}
    return {
        "moved": len(moved),
        "named": sum(state[name] == "moved" for name in moved),
        "among": sum(state[name] == "one of several moved" for name in moved),
        "silent": sum(state[name] == "cannot tell" for name in moved),
        "falsely": sum(state[name] in ("moved", "one of several moved") for name in state if name not in moved),
        "untested": sum(one == "cannot tell" for one in state.values()),
    }
