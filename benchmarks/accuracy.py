"""Real data sets with given identities: errors, scale, vertical, ground, verdict, time and memory."""

from __future__ import annotations

from pathlib import Path

from command import Calibrated, calibrate
from datasets import DATA_SETS, DataSet, folder_of, write_scene
from pages.records import Found
from pages.tables import errors, number, reached, table

NOT_HERE = "not run: data not here"


def run(scratch: Path, quick: bool) -> Found:
    """Calibrate every data set once, one after the other, in the user's environment."""
    del quick  # it takes seconds
    rows, more = [], []
    for data in DATA_SETS:
        folder = folder_of(data)
        if folder is None:
            rows.append([data.name, NOT_HERE, *["-"] * 5])
            continue
        scene = write_scene(data, folder, scratch / data.name)
        result = calibrate(scene, folder / "rig.toml", scratch / data.name / "out")
        rows.append(_accuracy_row(data, result))
        more.append(_world_row(data, result))
    first = table(("data", "registered", "similarity", "acceptable", "aim", "reached", "metric"), rows)
    second = table(("data", "scale ratio", "stated sigma", "vertical", "ground", "verdict", "wall time", "peak memory"), more)
    return Found({"Errors": first, "World": second})


def _accuracy_row(data: DataSet, result: Calibrated) -> list[str]:
    found = result.errors or {"registered": 0, "similarity": {}, "metric": {}}
    similarity, metric = found["similarity"], found["metric"]
    values = (similarity.get("mean_position_mm"), similarity.get("mean_orientation_deg"))
    complete = found["registered"] == result.cameras
    return [
        data.name,
        f"{found['registered']} of {result.cameras}",
        errors(*values),
        errors(*data.goal.acceptable),
        errors(*data.goal.aim),
        reached(values, data.goal.acceptable, data.goal.aim) if complete else "**missed**",
        errors(metric.get("mean_position_mm"), metric.get("mean_orientation_deg")),
    ]


def _world_row(data: DataSet, result: Calibrated) -> list[str]:
    found = result.errors or {}
    return [
        data.name,
        number(found.get("scale_ratio"), 4),
        number(result.scale_sigma, 4),
        f"{number(found.get('gravity_error_deg'), 2)}°",
        f"{number(found.get('ground_error_mm'))} mm",
        result.verdict,
        f"{result.seconds:.1f} s",
        f"{result.peak_mb:.0f} MB",
    ]
