"""Results that a change of structure must not change: `python benchmarks/golden.py freeze|check [CASE ...]`.

`freeze` calibrates every case and writes rig, verdict, reasons, findings, cameras and clocks to `tests/golden/CASE.json`.
`check` calibrates again and compares: words alike, numbers within 1e-9 of their size. On another kind of processor the last
digits differ (`--tolerance`). Cases whose data are not here are named and left out.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import tomli_w

from command import ONE_THREAD, passerby
from datasets import DATA_SETS, ROOT, folder_of, write_scene

GOLDEN = ROOT / "tests" / "golden"
KEPT = ("verdict", "reasons", "findings", "cameras", "unregistered")
KEPT_FIGURES = ("scale", "clocks", "association", "clock_corrections", "moved", "undetermined", "tree")
TOLERANCE = 1e-9
SMALL = 1e-9  # differences below this count for nothing in numbers near zero: metres, radians, seconds
TIMINGS = ("seconds", "elapsed")

SIMULATED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "given_1": (("--seed", "5"), {}),
    "given_2": (
        ("--seed", "6", "--preset", "construction", "--keypoints", "--box-noise", "0.01", "--identity-swaps", "0.02"),
        {},
    ),
    "trajectory_1": (("--seed", "7", "--unrelated-ids", "--box-noise", "0.01"), {"association": {"mode": "trajectory"}}),
    "trajectory_2": (
        ("--seed", "8", "--unrelated-ids", "--clock-offsets", "0,0.6,-0.4,1.3", "--seconds", "60"),
        {"association": {"mode": "trajectory", "max_offset_s": 3.0}},
    ),
    "appearance_1": (("--seed", "9", "--unrelated-ids", "--embeddings", "distinct"), {"association": {"mode": "appearance"}}),
    "appearance_2": (
        ("--seed", "10", "--unrelated-ids", "--embeddings", "distinct", "--box-noise", "0.01", "--missing", "0.1"),
        {"association": {"mode": "appearance"}},
    ),
    "geopose_1": (("--seed", "11"), {"solver": {"method": "geopose", "reference": "C1"}}),
    "geopose_2": (("--seed", "12", "--box-noise", "0.01"), {"solver": {"method": "geopose", "reference": "C1"}}),
}
"""Options of `passerby simulate`, and tables of the scene file that are changed."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("action", choices=("freeze", "check"))
    parser.add_argument("cases", nargs="*", help="all, where none is named")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help=f"relative difference allowed; {TOLERANCE:g}")
    arguments = parser.parse_args()
    cases = cases_at_hand()
    if unknown := set(arguments.cases) - set(cases):
        parser.error(f"no case {', '.join(sorted(unknown))}: there are {', '.join(cases)}")
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(2) as processes:
        names = arguments.cases or list(cases)
        for name, result in zip(names, processes.map(lambda name: run(cases[name], Path(scratch) / name), names), strict=True):
            path = GOLDEN / f"{name}.json"
            if arguments.action == "freeze":
                GOLDEN.mkdir(parents=True, exist_ok=True)
                path.write_text(json.dumps(result, indent=1) + "\n")
                print(f"{name}: frozen, {result['verdict']}")
                continue
            found = list(differences(json.loads(path.read_text()), result, arguments.tolerance))
            wrong += bool(found)
            print(f"{name}: {'as frozen' if not found else f'{len(found)} differences'}", flush=True)
            for line in found[:12]:
                print(f"  {line}")
    sys.exit(1 if wrong else 0)


def cases_at_hand() -> dict[str, Callable[[Path], Path]]:
    """What makes the scene file of each case in a folder."""
    cases: dict[str, Callable[[Path], Path]] = {"demo": _demo}
    for data in DATA_SETS:
        folder = folder_of(data)
        if folder is None:
            print(f"{data.name}: left out, its data are not here")
        else:
            cases[data.name] = lambda into, data=data, folder=folder: write_scene(data, folder, into)  # type: ignore[misc]
    for name, (options, tables) in SIMULATED.items():
        cases[name] = lambda into, options=options, tables=tables: _simulated(into, options, tables)  # type: ignore[misc]
    return cases


def run(scene_in: Callable[[Path], Path], folder: Path) -> dict[str, Any]:
    """Calibrate one case. Returns what is frozen of it."""
    scene = scene_in(folder / "scene")
    out = folder / "out"
    status = passerby("calibrate", str(scene), "-o", str(out), environment=ONE_THREAD).status
    told = json.loads((out / "calibration.json").read_text())
    rig = out / "rig.toml"
    return {
        "status": status,
        **{key: told[key] for key in KEPT if key in told},
        "figures": {key: told["figures"][key] for key in KEPT_FIGURES if key in told["figures"]},
        "rig": tomllib.loads(rig.read_text()) if rig.is_file() else None,
    }


def differences(frozen: Any, now: Any, tolerance: float, at: str = "") -> Iterator[str]:
    """What was frozen and is now missing or another value; what is new is no difference."""
    if isinstance(frozen, dict) and isinstance(now, dict):
        for key, value in frozen.items():
            if key not in TIMINGS:
                yield from differences(value, now[key], tolerance, f"{at}.{key}") if key in now else (f"{at}.{key}: gone",)
    elif isinstance(frozen, list) and isinstance(now, list) and len(frozen) == len(now):
        for row, (one, other) in enumerate(zip(frozen, now, strict=True)):
            yield from differences(one, other, tolerance, f"{at}[{row}]")
    elif isinstance(frozen, float) and isinstance(now, int | float):
        if not math.isclose(frozen, now, rel_tol=tolerance, abs_tol=SMALL):
            yield f"{at}: {frozen} was frozen, {now} found"
    elif frozen != now:
        yield f"{at}: {frozen!r} was frozen, {now!r} found"


def _demo(into: Path) -> Path:
    """The demonstration's own scene; it is calibrated once more from its videos."""
    passerby("demo", "-o", str(into), environment=ONE_THREAD)
    return next(path for path in sorted(into.rglob("scene.toml")))


def _simulated(into: Path, options: tuple[str, ...], tables: dict[str, Any]) -> Path:
    passerby("simulate", "-o", str(into), *options)
    scene = into / "scene.toml"
    text = tomllib.loads(scene.read_text())
    for name, table in tables.items():
        text[name] = text.get(name, {}) | table
    scene.write_text(tomli_w.dumps(text))
    return scene


if __name__ == "__main__":
    main()
