"""The monitor with joints in a room: `python benchmarks/monitor_room.py [--seeds N]`.

Two people walk about for 30 s and one sits; four cameras in the corners find boxes (2 % noise) and joints (2 px). The rig has
the errors of a calibration. In each seed nothing has moved, one camera has been turned by a degree or by two, or three of the
four have been turned by 1 to 3 degrees; identities are known or not. Prints a table.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.monitoring.monitor import watch_footage
from passerby.monitoring.result import MonitoringResult
from passerby.monitoring.watched import WatchOptions
from reliability.footage import Move, calibrated, unit
from reliability.room import FPS, RoomOptions, filmed_room, room_rig

FIRST_SEED, SECONDS = 800_000, 30.0
KINDS: Mapping[str, tuple[float, ...]] = {
    "quiet": (), "one by 1 degree": (1.0,), "one by 2 degrees": (2.0,),
    "three of four by 1 to 3 degrees": (np.nan, np.nan, np.nan),
}  # fmt: skip
"""By how much cameras are turned; NaN: drawn from `TURN_DEG`."""
TURN_DEG = 1.0, 3.0
COLUMNS = ("footage", "identities", "seeds", "seen", "turned ones named", "still ones named", "limit deg", "off deg")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=40)
    seeds = range(FIRST_SEED, FIRST_SEED + parser.parse_args().seeds)
    print(" | ".join(COLUMNS))
    for known in (True, False):
        for kind in KINDS:
            print(" | ".join(row(kind, known, [work(kind, seed, known=known) for seed in seeds])), flush=True)


def work(kind: str, seed: int, *, known: bool = True) -> dict[str, Any]:
    """What the monitor says of one case, held against the truth."""
    rng = np.random.default_rng((seed, 9))
    rig = room_rig(seed)
    given = calibrated(rig, rng)
    order = rng.permutation(len(rig))
    drawn = rng.uniform(*TURN_DEG, len(rig))
    turns = {}
    for place, degrees in enumerate(KINDS[kind]):
        x, y, z = ((drawn[place] if np.isnan(degrees) else degrees) * np.array(unit(rng))).tolist()
        name = rig.names[order[place]]
        turns[name] = Move(name, -1.0, turn_deg=(x, y, z))
    options = RoomOptions(
        seed, SECONDS, known=known, moves={name: (-1.0, move.after(_pose(rig, name))) for name, move in turns.items()}
    )  # fmt: skip
    seen = replace(filmed_room(rig, options), clocks={name: Clock(FPS) for name in rig.names})
    watching = WatchOptions()
    watched, ground = watch_footage(given, seen, watching, known=known)
    found = MonitoringResult(given, watched, watching, ground)
    return _compared(found, turns)


def _pose(rig: Rig, name: str) -> Any:
    return rig[name].pose


def _compared(found: MonitoringResult, turns: Mapping[str, Move]) -> dict[str, Any]:
    """What was said against what was done."""
    states = {name: found.state(name) for name in found.names}
    limits = [found.smallest(name)[1] for name in found.names]
    off = [
        float(np.linalg.norm(np.degrees(move.shift[3:]) - np.array(turns[move.camera].turn_deg)))
        for move in found.moves
        if move.camera in turns
    ]
    return {
        "seen": bool(found.moves), "named": [states[name] == "moved" for name in sorted(turns)],
        "accused": [states[name] == "moved" for name in found.names if name not in turns],
        "limits_deg": [value for value in limits if value is not None and np.isfinite(value)], "off_deg": off,
    }  # fmt: skip


def row(kind: str, known: bool, cases: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line of the table."""

    def share(values: Sequence[bool]) -> str:
        return f"{sum(values)} of {len(values)}" if values else "-"

    def middle(values: Sequence[float]) -> str:
        return f"{np.median(values):.2f}" if values else "-"

    return [
        kind, "known" if known else "unknown", str(len(cases)), share([case["seen"] for case in cases]),
        share([one for case in cases for one in case["named"]]), share([one for case in cases for one in case["accused"]]),
        middle([one for case in cases for one in case["limits_deg"]]),
        middle([one for case in cases for one in case["off_deg"]]),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
