"""Whole calibrations of sites: what they take in processes of their own, and what comes of them."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import read_folder_rig
from passerby.interchange.rig_toml import read_rig
from sites.cases import FIRST_SEED, SiteCase

SHARED_M2 = 5.0
"""Ground that two cameras share, from which they belong into one rig."""
FEWEST_COMMON = 3
"""People in common, from which an overlap is used."""
HALL_SECONDS = 60.0
"""Of the hall that all cameras see: more would only be thinned out."""


@dataclass(frozen=True)
class HallCase:
    """Cameras around one hall, people's identities known."""

    cameras: int
    seed: int = FIRST_SEED

    @property
    def arguments(self) -> list[str]:
        """Of `passerby simulate`."""
        count, seed = str(self.cameras), str(self.seed)
        return ["--preset", "basketball", "--cameras", count, "--seed", seed, "--seconds", f"{HALL_SECONDS:g}"]


def halls(seeds: int) -> dict[str, HallCase]:
    """By key."""
    del seeds
    return {f"{count} cameras": HallCase(count) for count in (8, 32)}


def sites(seeds: int) -> dict[str, SiteCase]:
    """Sites that are calibrated from tracklets, by key."""
    del seeds
    return {f"{count} cameras": SiteCase(count, FIRST_SEED) for count in (25, 100)}


def measure_hall(case: HallCase) -> dict[str, Any]:
    """What a calibration takes, and its errors."""
    return {"cameras": case.cameras, **_calibrated(case.arguments)}


def measure_site(case: SiteCase) -> dict[str, Any]:
    """The same of a site."""
    options = case.options
    arguments = [
        "--preset", options.preset, "--cameras", str(case.cameras), "--seed", str(case.seed), "--seconds",
        f"{options.seconds:g}", "--box-noise", str(options.box_noise), "--missing", str(options.missing),
        "--tracklet-seconds", str(options.tracklet_seconds),
    ]  # fmt: skip
    return {"cameras": case.cameras, **_calibrated(arguments, with_overlaps=True)}


def _calibrated(arguments: Sequence[str], *, with_overlaps: bool = False) -> dict[str, Any]:
    """Simulate, then calibrate; times and memory are of the calibration with all its processes, without the report.

    `with_overlaps`: the share of cameras in their group is that of the simulation's overlaps.
    """
    with tempfile.TemporaryDirectory(prefix="passerby-site-") as folder:
        site, out = Path(folder) / "site", Path(folder) / "out"
        program = [sys.executable, "-m", "passerby"]
        subprocess.run([*program, "simulate", "-o", str(site), *arguments], check=True, stdout=subprocess.DEVNULL)
        began = time.perf_counter()
        command = [*program, "calibrate", str(site / "scene.toml"), "-o", str(out), "--no-report"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if os.waitstatus_to_exitcode(status) not in (0, 3):  # 3: written, but not all of it is accepted
            raise RuntimeError(f"{' '.join(command)} ended with status {status}")
        return {
            "cpu_s": used.ru_utime + used.ru_stime, "wall_s": time.perf_counter() - began,
            "memory_mb": used.ru_maxrss / 1024,
            **outcome_of(out, site / "truth.toml", site / "overlaps.csv" if with_overlaps else None),
        }  # fmt: skip


def outcome_of(out: Path, truth: Path, overlaps: Path | None = None) -> dict[str, Any]:
    """The groups of an output folder, with verdicts and errors of their shape.

    Args:
        out: of `passerby calibrate`.
        truth: rig file with the true poses.
        overlaps: table of the ground that pairs of cameras share; None: the share of cameras in their group is left out.
    """
    main = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    folders = [out, *(out / one["folder"] for one in main.get("groups", ()))]
    true = read_rig(truth)
    groups = [found for folder in folders if (found := _group(folder, true)) is not None]
    moved = sum(one["code"] == "camera_moved" for one in _diagnostics(folders))
    share = {} if overlaps is None else {
        "in_group": share_in_group([group["cameras"] for group in groups], overlaps),
        "used_overlaps": share_of_used_overlaps(folders, overlaps),
    }  # fmt: skip
    return {"registered": sum(len(group["position_mm"]) for group in groups), "groups": groups, "moved": moved, **share}


def share_in_group(rigs: Sequence[Sequence[str]], overlaps: Path) -> float:
    """Share of the cameras that are in one rig with most of those with which pairs that share ground connect them."""
    pairs = _sharing(overlaps)
    label = {name: name for pair in pairs for name in pair}
    for a, b in pairs:
        old, new = label[a], label[b]
        label = {name: new if own == old else own for name, own in label.items()}
    wanted = [{name for name in label if label[name] == one} for one in set(label.values())]
    return sum(max((len(one & set(rig)) for rig in rigs), default=0) for one in wanted) / max(len(label), 1)


def share_of_used_overlaps(folders: Sequence[Path], overlaps: Path) -> float:
    """Share of the pairs of cameras with common ground that have at least `FEWEST_COMMON` people in common in a calibration.

    Args:
        folders: of each group's results.
        overlaps: table of the ground that pairs of cameras share.
    """
    pairs, used = _sharing(overlaps), set[tuple[str, str]]()
    for folder in folders:
        people = {file.stem: set(read_boxes(file).identity.tolist()) - {UNKNOWN} for file in (folder / "tracks").glob("*.txt")}
        used |= {
            (a, b) for a, b in pairs if a in people and b in people and len(people[a] & people[b]) >= FEWEST_COMMON
        }  # fmt: skip
    return len(used) / max(len(pairs), 1)


def _sharing(overlaps: Path) -> list[tuple[str, str]]:
    """The pairs of cameras that share ground."""
    with overlaps.open(encoding="utf-8", newline="") as file:
        return [(row["camera_a"], row["camera_b"]) for row in csv.DictReader(file) if float(row["shared_m2"]) >= SHARED_M2]


def _group(folder: Path, truth: Rig) -> dict[str, Any] | None:
    """The verdict of one group and its errors after a similarity, camera by camera; None without a rig."""
    rig = read_folder_rig(folder).posed()
    if len(rig) < 2:
        return None
    errors = compare(rig, truth).similarity
    return {
        "verdict": json.loads((folder / "calibration.json").read_text(encoding="utf-8"))["verdict"],
        "position_mm": list(errors.position_mm.values()), "orientation_deg": list(errors.orientation_deg.values()),
        "cameras": list(rig.names),
    }  # fmt: skip


def _diagnostics(folders: Sequence[Path]) -> list[Mapping[str, Any]]:
    return [
        one
        for folder in folders
        for one in json.loads((folder / "calibration.json").read_text(encoding="utf-8"))["diagnostics"]
    ]


def errors_of(case: Mapping[str, Any]) -> tuple[float, float]:
    """Medians over all cameras of a case: position, millimetres, and orientation, degrees; NaN where none is registered."""
    columns = ([value for group in case["groups"] for value in group[key]] for key in ("position_mm", "orientation_deg"))
    position, orientation = (float(np.median(values)) if values else float("nan") for values in columns)
    return position, orientation
