"""Turns about each axis before a whole later recording: `python benchmarks/monitor_axes.py [--turns N]`.

A camera was turned since the rig was calibrated: about the vertical (heading), about the image's horizontal axis (tilt), or
about its viewing direction (roll). The later recording is either some minutes of boxes of people on a terrace, or half a minute
of boxes and joints in a room; nothing moves in it. The rig has the errors of a calibration, and states its sigmas. Each seed is
also watched without any turn. Prints a table.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.monitoring.monitor import watch_footage
from passerby.monitoring.result import MonitoringResult
from passerby.monitoring.watched import WatchOptions
from reliability.footage import Move, calibrated, footage, true_rig
from reliability.room import FPS, RoomOptions, filmed_room, room_rig

FIRST_SEED = 900_000
TURN_DEG = 1.0
AXES = "heading", "tilt", "roll"
SECONDS: Mapping[str, float] = {"boxes": 300.0, "joints": 30.0}  # of the later recording
CAMERAS, PEOPLE, BOX_FPS = 4, 4.0, 2.0
LASTING_S = 1.0  # correlation time of the noise of joints
COLUMNS = "footage", "turn", "degrees", "cases", "reported", "named", "others named", "worst limit deg", "error deg"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--turns", type=int, default=40, help="seeds; each is turned about each axis, and not at all")
    seeds = range(FIRST_SEED, FIRST_SEED + parser.parse_args().turns)
    print(" | ".join(COLUMNS))
    for kind in SECONDS:
        for axis, degrees in (("none", 0.0), *((axis, TURN_DEG) for axis in AXES)):
            print(" | ".join(row(kind, axis, degrees, [work(kind, axis, degrees, seed) for seed in seeds])), flush=True)


def work(kind: str, axis: str, degrees: float, seed: int) -> dict[str, Any]:
    """What the monitor reports of one case, compared with the truth."""
    rng = np.random.default_rng((seed, 9))
    rig = true_rig("terrace", CAMERAS, rng) if kind == "boxes" else room_rig(seed, CAMERAS)
    given = calibrated(rig, rng)
    name = rig.names[int(rng.integers(CAMERAS))]
    x, y, z = np.multiply(degrees, axis_of(rig, name, axis)).tolist()
    move = Move(name, -1.0, turn_deg=(x, y, z))
    pose = rig[name].pose
    assert pose is not None
    if kind == "boxes":
        seen, fps = footage("terrace", rig, SECONDS[kind], PEOPLE, rng, fps=BOX_FPS, moves=(move,)), BOX_FPS
    else:
        options = RoomOptions(seed, SECONDS[kind], lasting_s=LASTING_S, moves={name: (-1.0, move.after(pose))})
        seen, fps = filmed_room(rig, options), FPS
    watching = WatchOptions()
    clocks = {own: Clock(fps) for own in rig.names}
    watched, ground = watch_footage(given, replace(seen, clocks=clocks), watching, known=True)
    found = MonitoringResult(given, watched, watching, ground)
    off = [np.degrees(one.shift[3:]) - np.array(move.turn_deg) for one in found.moves if one.camera == name]
    return {
        "reported": bool(found.moves), "named": bool(degrees) and found.state(name) == "moved",
        "others": sum(found.state(own) == "moved" for own in rig.names if own != name or not degrees),
        "limit_deg": found.whole_limit(name)[1], "off_deg": float(np.linalg.norm(off[0])) if off else None,
    }  # fmt: skip


def axis_of(rig: Rig, name: str, axis: str) -> Floats:
    """(3,) the axis of a turn in the camera's frame; zeros for none."""
    pose = rig[name].pose
    assert pose is not None
    axes = {"heading": pose.R_cw[:, 2], "tilt": np.array([1.0, 0.0, 0.0]), "roll": np.array([0.0, 0.0, 1.0])}
    return axes.get(axis, np.zeros(3))


def row(kind: str, axis: str, degrees: float, cases: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line of the table."""

    def median(key: str) -> str:
        known = [case[key] for case in cases if case[key] is not None]
        return f"{np.median(known):.2f}" if known else "-"

    reported, named = (f"{sum(case[key] for case in cases)} of {len(cases)}" for key in ("reported", "named"))
    others = sum(case["others"] for case in cases)
    return [
        kind, axis, f"{degrees:g}", str(len(cases)), reported, named if degrees else "-", str(others), median("limit_deg"),
        median("off_deg"),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
