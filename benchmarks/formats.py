"""The section `formats`: what other tools make of Passerby's files, by the tools' own libraries.

Each tool has an environment of its own, `.venv-peer-NAME`; `python benchmarks/formats.py` makes those that are missing.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from datasets import ROOT
from format_tools.rigs import cases_of, read_back
from pages.records import Found
from pages.tables import table
from passerby.interchange.formats import all_formats

HERE = Path(__file__).resolve().parent / "format_tools"
LIMIT_S = 300
HELPERS = ("__init__", "case", "rigs", "run_check")


@dataclass(frozen=True)
class Outcome:
    """What a tool made of a format's files."""

    name: str
    tool: str  # with its version
    lenses: tuple[str, ...]  # the kinds that the format holds
    read_px: float | None = None  # largest difference of what the tool has read; None: see `failure`
    back_px: float | None = None  # the same of what the tool wrote itself and Passerby read; None: it does not write
    failure: str = ""


def checks() -> dict[str, ModuleType]:
    """The modules of `format_tools` by the name of their format, in the registry's order."""
    known = {path.stem for path in HERE.glob("*.py")} - set(HELPERS)
    names = {form.name.replace("-", "_"): form.name for form in all_formats()}
    strange = known - names.keys()
    assert not strange, f"no format is called {', '.join(sorted(strange))}"
    return {name: importlib.import_module(f"format_tools.{stem}") for stem, name in names.items() if stem in known}


def environment(module: ModuleType) -> Path:
    """The folder of a tool's environment."""
    home = Path(os.environ["PASSERBY_PEERS"]) if os.environ.get("PASSERBY_PEERS") else ROOT
    return home / f".venv-peer-{module.ENVIRONMENT}"


def install(module: ModuleType) -> None:
    """Make a tool's environment where it is missing."""
    folder = environment(module)
    if (folder / ".installed").is_file():
        return
    print(f"installing {' '.join(module.PACKAGES)}", file=sys.stderr)
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    if module.NEEDS:
        subprocess.run([*pip, *module.NEEDS], check=True)
    subprocess.run([*pip, *(["--no-deps"] if getattr(module, "WITHOUT", False) else []), *module.PACKAGES], check=True)
    (folder / ".installed").touch()


def outcome(name: str, module: ModuleType, scratch: Path) -> Outcome:
    """Write all cases of a format, have the tool check them, and read what it wrote."""
    cases = list(cases_of(name, scratch))
    lenses = tuple(kind for kind, _, _ in cases)
    python = environment(module) / "bin" / "python"
    if not python.is_file():
        return Outcome(name, module.TOOL, lenses, failure="not run: environment not made, `python benchmarks/formats.py`")
    result = scratch / name / "result.json"
    command = [
        str(python), str(HERE / "run_check.py"), module.__name__.split(".")[-1], str(result),
        *(str(folder) for _, _, folder in cases),
    ]  # fmt: skip
    ended = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    if ended.returncode != 0:
        last = (ended.stderr.strip().splitlines() or ["no word"])[-1]
        return Outcome(name, module.TOOL, lenses, failure=f"failed: {last[:200]}")
    made = json.loads(result.read_text())
    back = [px for _, _, folder in cases if (px := read_back(name, folder)) is not None]
    return Outcome(name, f"{module.TOOL} {made['version']}", lenses, max(made["pixels"]), max(back) if back else None)


def tabulate(outcomes: list[Outcome]) -> Found:
    """The table, and the formats that no tool reads here."""
    head = ("format", "read by", "lenses", "tool against Passerby, px", "written by the tool, read by Passerby, px")
    rows = [
        [one.name, one.tool, ", ".join(one.lenses), one.failure or _pixels(one.read_px), _pixels(one.back_px)]
        for one in outcomes
    ]
    without = [form.name for form in all_formats() if form.write and form.name not in {one.name for one in outcomes}]
    note = f"Written by Passerby, without such a check here: {', '.join(without)}."
    return Found({"Formats": table(head, rows)}, [note] if without else [])


def _pixels(value: float | None) -> str:
    return "" if value is None else f"{value:.0e}" if value else "0"


def run(scratch: Path, quick: bool) -> Found:
    """All formats that have a check; there is no quicker way."""
    return tabulate([outcome(name, module, scratch) for name, module in checks().items()])


def main() -> None:
    """Make the environments."""
    argparse.ArgumentParser(description="Makes the environments of the tools that check formats.").parse_args()
    for module in checks().values():
        install(module)


if __name__ == "__main__":
    main()
