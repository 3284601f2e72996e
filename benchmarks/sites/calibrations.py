"""Whole calibrations of sites: what they take in processes of their own, and what comes of them."""

from __future__ import annotations

import csv
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import read_folder_rig
from passerby.interchange.rig_toml import read_rig
from sites.cases import SiteCase, taken

SHARED_M2 = 5.0  # ground that two cameras share, from which they belong into one rig
FEWEST_COMMON = 3  # people in common, from which an overlap is used
HALL_SECONDS = 60.0  # of the hall that all cameras see: more would only be thinned out


def halls(seeds: int) -> dict[str, SiteCase]:
    """Cameras around one hall, people's identities known, by key."""
    del seeds
    return {f"{count} cameras": SiteCase(count) for count in (8, 32)}


def sites(seeds: int) -> dict[str, SiteCase]:
    """Sites that are calibrated from tracklets, by key."""
    del seeds
    return {f"{count} cameras": SiteCase(count) for count in (25, 100)}


def measure_hall(case: SiteCase) -> dict[str, Any]:
    """What a calibration takes, and its errors."""
    options = ("--preset", "basketball", "--cameras", str(case.cameras), "--seed", str(case.seed))
    return {"cameras": case.cameras, **_calibrated([*options, "--seconds", f"{HALL_SECONDS:g}"])}


def measure_site(case: SiteCase) -> dict[str, Any]:
    """The same of a site, and the share of cameras in their group and of overlaps that are used."""
    return {"cameras": case.cameras, **_calibrated(case.arguments, with_overlaps=True)}


def _calibrated(arguments: Sequence[str], *, with_overlaps: bool = False) -> dict[str, Any]:
    """Simulate, then calibrate without the report."""
    with tempfile.TemporaryDirectory(prefix="passerby-site-") as folder:
        site, out = Path(folder) / "site", Path(folder) / "out"
        taken("simulate", "-o", str(site), *arguments)
        spent = taken("calibrate", str(site / "scene.toml"), "-o", str(out), "--no-report")
        return spent | outcome_of(out, site / "truth.toml", site / "overlaps.csv" if with_overlaps else None)


def outcome_of(out: Path, truth: Path, overlaps: Path | None = None) -> dict[str, Any]:
    """The groups of an output folder, with verdicts and errors of their shape, and what is said of a table of overlaps."""
    folders = [out, *(out / one["folder"] for one in _document(out).get("groups", ()))]
    true = read_rig(truth)
    groups = [found for folder in folders if (found := _group(folder, true)) is not None]
    moved = sum(one["code"] == "camera_moved" for folder in folders for one in _document(folder)["diagnostics"])
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
    """Share of the pairs of cameras with common ground that have at least `FEWEST_COMMON` people in common in a calibration."""
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
        "verdict": _document(folder)["verdict"],
        "position_mm": list(errors.position_mm.values()), "orientation_deg": list(errors.orientation_deg.values()),
        "cameras": list(rig.names),
    }  # fmt: skip


def _document(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    return found


def errors_of(case: Mapping[str, Any]) -> tuple[float, float]:
    """Medians over all cameras of a case: position, millimetres, and orientation, degrees; NaN where none is registered."""
    columns = ([value for group in case["groups"] for value in group[key]] for key in ("position_mm", "orientation_deg"))
    position, orientation = (float(np.median(values)) if values else float("nan") for values in columns)
    return position, orientation
