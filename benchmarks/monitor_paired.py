"""The monitor over the same seeds by two states of the sources: `python benchmarks/monitor_paired.py run FILE [--seeds N]`,
then `python benchmarks/monitor_paired.py compare BEFORE AFTER`.

`run` takes cases of the reliability benchmark (`reliability.watch`), of each kind one a seed: quiet footage, a camera that is
knocked by 10 cm or by a degree in cheap footage, and either of them in the simulator's. `compare` sets two such files side by
side, case by case.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from reliability import watch

QUIET_S = 1800.0
"""Of quiet footage in each seed."""
FIRST_SEED = 700_000


KINDS = ("quiet", "knock", "simulated")
FIGURES = ("seen", "right", "among", "early", "more", "delay_s", "error_m", "error_deg", "position", "orientation")
"""Of a knock: see `reliability.watch`."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    actions = parser.add_subparsers(dest="action", required=True)
    running = actions.add_parser("run")
    running.add_argument("file", type=Path)
    running.add_argument("--seeds", type=int, default=30)
    running.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    comparing = actions.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    arguments = parser.parse_args()
    if arguments.action == "run":
        arguments.file.write_text(json.dumps(run(arguments.seeds, arguments.kinds), indent=1) + "\n")
    else:
        before, after = (json.loads(path.read_text()) for path in (arguments.before, arguments.after))
        print("\n".join(compared(before, after)))


def run(seeds: int, kinds: Sequence[str] = KINDS) -> list[dict[str, Any]]:
    """What the monitor said of each kind of footage, by the seeds."""
    watch.HOUR_S = QUIET_S
    cases = []
    for number in range(seeds):
        # Knocks by turns are shifts and turns: one of each in the cheap footage.
        numbers = {"quiet": [number], "knock": [2 * number, 2 * number + 1], "simulated": [number]}
        cases += [(kind, case, FIRST_SEED + number) for kind in kinds for case in numbers[kind]]
    return [{"number": case[1], **watch.work(case)} for case in cases]


def compared(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> list[str]:
    """A line for each figure: before, after, and in how many cases it differs."""
    key = [(one["kind"], one["number"]) for one in before]
    if key != [(one["kind"], one["number"]) for one in after]:
        raise SystemExit("the two files are of different cases: run both with the same --seeds and --kinds")
    lines = []
    titles = {("quiet", None): "quiet", ("knock", False): "shift", ("knock", True): "turn"}
    for (kind, turn), title in {
        **titles,
        ("simulated", False): "shift, simulated",
        ("simulated", True): "turn, simulated",
    }.items():
        pairs = [
            (one, other) for one, other in zip(before, after, strict=True) if one["kind"] == kind and one.get("turn") == turn
        ]
        for name in FIGURES if turn is not None else ("alarms", "told", "largest"):
            both = np.array([(a[name], b[name]) for a, b in pairs if name in a and name in b], dtype=np.float64).reshape(-1, 2)
            if not len(both):
                continue
            change = both[:, 1] - both[:, 0]
            lines.append(
                f"{title}: {name}: mean {both[:, 0].mean():.4g} -> {both[:, 1].mean():.4g}, root mean square "
                f"{np.sqrt((both[:, 0] ** 2).mean()):.4g} -> {np.sqrt((both[:, 1] ** 2).mean()):.4g}, {len(both)} cases, "
                f"larger in {np.count_nonzero(change > 1e-9)}, smaller in {np.count_nonzero(change < -1e-9)}"
            )
    return lines


if __name__ == "__main__":
    main()
