"""Real data sets and the demonstration, their lenses withheld."""

from __future__ import annotations

import json
import tempfile
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w

from association_runs import RealCase, write_real
from command import ONE_THREAD, passerby
from datasets import data_set, folder_of, write_scene
from lenses.outcomes import off_centre_deg, outcome, timed_outcome
from passerby.calibration.calibrate import calibrate
from passerby.interchange.rig_toml import read_rig

DEMO = "demo"


@dataclass(frozen=True)
class RecordedCase:
    """A real set with its identities given, or unrelated in each camera."""

    name: str
    identities_known: bool = True

    @property
    def key(self) -> str:
        """A name within its part."""
        return f"{self.name}, identities {'known' if self.identities_known else 'unrelated'}"


CASES = (
    RecordedCase("wildtrack"),
    RecordedCase("wildtrack", identities_known=False),
    RecordedCase("pets2009"),
    RecordedCase("shelf"),
    RecordedCase("pose2sim_single"),
    RecordedCase("multiviewx"),
)


def cases() -> dict[str, RecordedCase]:
    """By key, those whose data are here."""
    return {case.key: case for case in CASES if folder_of(data_set(case.name)) is not None}


def work(case: RecordedCase) -> dict[str, Any]:
    """The set calibrated with the true lenses, then with none."""
    data = data_set(case.name)
    folder = folder_of(data)
    assert folder is not None
    truth = read_rig(folder / "rig.toml")
    with tempfile.TemporaryDirectory(prefix="passerby-bench-") as scratch:
        into = Path(scratch) / "scene"
        if case.identities_known:
            scene = write_scene(data, folder, into)
        else:
            scene = write_real(RealCase(data, "trajectory", data.source), folder, into)
        without = without_lenses(scene)
        return {
            "cameras": len(truth),
            "withheld": list(truth.names),
            "off_centre_deg": off_centre_deg(truth, truth.names),
            "known": timed_outcome(partial(calibrate, scene), truth),
            "estimated": timed_outcome(partial(calibrate, without), truth, truth.names),
        }


def without_lenses(scene: Path) -> Path:
    """A scene file beside another one that states the image sizes instead of the intrinsics."""
    content = tomllib.loads(scene.read_text())
    for name, table in content["cameras"].items():
        table["image_size"] = list(read_rig(scene.parent / table.pop("intrinsics"))[name].lens.size)
    path = scene.with_name("without-intrinsics.toml")
    path.write_text(tomli_w.dumps(content))
    return path


def work_demo(_: str) -> dict[str, Any]:
    """`passerby demo`, with and without `--no-intrinsics`; its time is that of all its processes, the filming included."""
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="passerby-bench-") as scratch:
        for name, options in (("known", ()), ("estimated", ("--no-intrinsics",))):
            folder = Path(scratch) / name
            run = passerby("demo", "-o", str(folder), *options, environment=ONE_THREAD)
            truth = read_rig(folder / "scene" / "truth.toml")
            result = json.loads((folder / "out" / "calibration.json").read_text())
            codes = [entry["code"] for entry in result["diagnostics"] if entry["severity"] != "notice"]
            found[name] = outcome(read_rig(folder / "out" / "rig.toml"), truth, truth.names if options else ()) | {
                "verdict": result["verdict"], "codes": codes, "cpu_s": run.cpu_seconds,
            }  # fmt: skip
    off_centre = off_centre_deg(truth, truth.names)
    return {"cameras": len(truth), "withheld": list(truth.names), "off_centre_deg": off_centre, **found}
