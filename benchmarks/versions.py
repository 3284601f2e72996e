"""Does Passerby work with each Python, and with the oldest and the newest libraries that it admits?

`python benchmarks/versions.py [--pythons PATH ...] [-o FOLDER]` installs it in an environment of its own for each interpreter,
once as pip chooses and once with the lowest versions of `pyproject.toml`, and runs the quick tests there. A wheel without
extras goes into an empty environment as well, which calibrates a simulated scene. Finished cases are kept in `build/versions`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from command import ONE_THREAD
from datasets import ROOT
from pages.cases import Outcomes, run_cases
from pages.kept import Kept
from pages.records import Found, publish
from pages.tables import table

PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14")
NEWEST, OLDEST, WHEEL = "newest", "oldest", "wheel"
LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "av", "onnxruntime", "pydantic", "plotly")
"""Those whose versions the table names."""
KEPT = ROOT / "build" / "versions"
REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9_.-]+)>=(?P<least>[0-9.]+)")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--pythons", nargs="*", default=PYTHONS, help="interpreters; those that are not here are named")
    parser.add_argument("-o", "--out", type=Path, help="folder of the page; it is printed where none is given")
    arguments = parser.parse_args()
    found = find(arguments.pythons)
    publish("versions", "versions", found, arguments.out, "python benchmarks/versions.py", written=arguments.out is not None)


def lowest(requirements: list[str]) -> list[str]:
    """Constraints for pip: the newest release of each library's lowest version that is admitted, `av==18.*` for `av>=18`."""
    found = (REQUIREMENT.fullmatch(one) for one in requirements)
    return [f"{one['name']}=={one['least']}.*" for one in found if one is not None]


def work(case: tuple[str, str]) -> dict[str, Any]:
    """One interpreter and one end of the versions: what was installed, and how the tests went."""
    python, end = case
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        subprocess.run([python, "-m", "venv", here / "venv"], check=True)
        own = here / "venv" / "bin" / "python"
        failure = _installed(own, end, here)
        told = {"python": python, "version": _output([own, "-V"]).removeprefix("Python "), "end": end}
        if failure:
            return told | {"libraries": {}, "failed": ["installation"], "passed": 0, "skipped": 0, "says": failure[-2000:]}
        names = {
            one.split("==")[0].lower(): one.split("==")[1]
            for one in _output([own, "-m", "pip", "freeze"]).split()
            if "==" in one
        }
        told |= {"libraries": {name: names.get(name, "") for name in LIBRARIES}}
        return told | (_calibrated(own, here) if end == WHEEL else _tested(own, here))


def _installed(own: Path, end: str, here: Path) -> str:
    """What pip says where it fails; empty where it does not."""
    pip = [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if end == WHEEL:
        subprocess.run([own, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", here / "wheel", ROOT], check=True)
        what: list[Any] = [*(here / "wheel").glob("*.whl")]
    else:
        what = ["-e", f"{ROOT}[dev]"]
    if end == OLDEST:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        (here / "lowest.txt").write_text("\n".join(lowest(project["dependencies"])), encoding="utf-8")
        what += ["-c", here / "lowest.txt"]
    done = subprocess.run([*pip, *what], capture_output=True, text=True, check=False)
    return done.stderr or "pip failed" if done.returncode else ""


def _tested(own: Path, here: Path) -> dict[str, Any]:
    """The quick tests, two processes."""
    report = here / "tests.xml"
    subprocess.run(
        [own, "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "-m", "not slow", "--junitxml",
         report, "-p", "no:cacheprovider"],
        cwd=ROOT, env=os.environ | ONE_THREAD, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    cases = [*ElementTree.parse(report).iter("testcase")]
    failed = [
        f"{one.get('classname')}::{one.get('name')}"
        for one in cases
        if one.find("failure") is not None or one.find("error") is not None
    ]
    skipped = sum(one.find("skipped") is not None for one in cases)
    return {"failed": failed, "skipped": skipped, "passed": len(cases) - skipped - len(failed), "says": ""}


def _calibrated(own: Path, here: Path) -> dict[str, Any]:
    """A scene of boxes simulated, calibrated and exported by the command alone, outside the repository."""
    command = own.parent / "passerby"
    steps = (
        ["simulate", "-o", here / "scene", "--preset", "terrace", "--seconds", "20"],
        ["calibrate", here / "scene" / "scene.toml", "-o", here / "out"],
        ["export", here / "out" / "rig.toml", "--format", "opencv", "-o", here / "opencv.yml"],
    )
    for step in steps:
        done = subprocess.run([command, *step], cwd=here, capture_output=True, text=True, check=False)
        if done.returncode:
            return {"failed": [str(step[0])], "skipped": 0, "passed": 0, "says": done.stderr[-2000:]}
    return {"failed": [], "skipped": 0, "passed": len(steps), "says": ""}


def _output(command: list[Any]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def find(pythons: list[str]) -> Iterator[Found]:
    """The table after each Python."""
    there = [found for name in pythons if (found := shutil.which(name)) is not None]
    missing = [name for name in pythons if shutil.which(name) is None]
    cases = {f"{python} {end}": (python, end) for python in there for end in (NEWEST, OLDEST, WHEEL)}
    for done in run_cases(Kept(KEPT, ("versions.py",)), "versions", cases, work, 1):
        yield tabulate(done, missing)


def tabulate(outcomes: Outcomes, missing: list[str]) -> Found:
    """The table of the outcomes of `work` by key."""
    rows = [
        [one["version"], one["end"], *(one["libraries"].get(name, "") or "-" for name in LIBRARIES),
         str(one["passed"]), str(one["skipped"]), ", ".join(one["failed"][:5]) or "none"]
        for one in outcomes.values()
    ]  # fmt: skip
    notes = [f"Not here, and not tried: {', '.join(missing)}."] if missing else []
    return Found({"Versions": table(("Python", "libraries", *LIBRARIES, "passed", "skipped", "failed"), rows)}, notes)


if __name__ == "__main__":
    sys.exit(main())
