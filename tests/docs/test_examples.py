"""Every example of the documentation does what it says: commands are run, Python is executed, TOML is read."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from passerby.cli.main import run
from passerby.common.errors import EvidenceError
from passerby.interchange.rig_toml import read_rig
from passerby.perception.networks import Description
from passerby.scene.scene import Scene
from support.documentation import ROOT, Block, blocks_of, pages

RUN = ("sh", "console", "python")
TOOLS = frozenset({"ls", "cat", "head", "mkdir", "cp", "mv"})
"""Of other programs only these are run, as they are."""
OTHERS = frozenset({"pip", "make", ".", "python", "mkdocs", "jupyter", "cd", "git"})
"""What installs or opens something: not run."""
FILMED = ["simulate", "-o", "street", "--video"]
"""Minutes long: two cameras that see puppets stand in for it, but where slow tests run. What is seen in their videos is kept
beforehand, and lengths that the page tells are not theirs, so that the calibration may be doubtful."""
README_NOT_RUN = ("passerby reid", "passerby demo", "passerby dataset", "calib.qca.txt", "points.csv")
"""Training needs PyTorch and people, the demonstration is a slow test of its own; data sets, other tools' files and marked
points are not there."""
README_EXAMPLES = (("passerby init", "videos"), ("passerby.calibrate", "scene"), ("", "calibrated"))
"""In which folder a block of the README is run, by a word in it. Two cameras that see puppets for 24 s do not show what their
lenses are, so the intrinsics lie beside the videos."""


class Reader:
    """Somebody who follows a page: a folder, and names that the page's Python has defined."""

    def __init__(self, page: Path, folder: Path, prepared: Callable[[str], Path], verbatim: bool) -> None:
        self.page, self.folder, self.prepared, self.verbatim = page, folder, prepared, verbatim
        self.number, self.names, self.place = 0, {}, folder
        self.enter("empty")

    def enter(self, example: str) -> None:
        """Begin in a fresh copy of a prepared folder."""
        self.number += 1
        self.names = {"__name__": "example"}
        self.place = self.folder / str(self.number)
        shutil.copytree(self.prepared(example), self.place)

    def follow(self, block: Block) -> None:
        """Do what a block says."""
        if "example" in block.told:
            self.enter(block.told["example"])
        if "not run" in block.told:
            assert block.told["not run"].strip()
            return
        with _inside(self.place):
            if block.language in ("sh", "console"):
                self._shell(block)
            elif block.language == "python":
                exec(compile(block.text, f"{self.page}:{block.line}", "exec"), self.names)
            elif block.language == "toml" and "edit" in block.told:
                edit(Path(block.told["edit"]), block.text)

    def _shell(self, block: Block) -> None:
        for number, command in enumerate(block.commands):
            last = number == len(block.commands) - 1
            wanted = {int(block.told.get("exit status", 0))} if last else {0}
            words = shlex.split(command)
            where = f"{self.page.name}:{block.line}: {command}"
            if words[0] in TOOLS:
                subprocess.run(command, shell=True, check=True)
            elif words[0] == "passerby":
                self._passerby(words[1:], wanted, where)
            else:
                assert words[0] in OTHERS, f"{where}: say how it is to be tested"

    def _passerby(self, arguments: list[str], wanted: set[int], where: str) -> None:
        if arguments[:4] == FILMED and not self.verbatim:
            shutil.copytree(self.prepared("street") / "street", "street")
            shutil.copytree(self.prepared("videos") / "out", "out")
            return
        if arguments[0] == "calibrate" and not self.verbatim:
            wanted = {*wanted, EvidenceError.exit_status}
        status = run(arguments)
        assert status in wanted, f"{where}: exit status {status}"


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def edit(path: Path, text: str) -> None:
    """Put settings into a file as readers do: in place of the line that has the key, switched off or not; else at its end."""
    lines, table, added = path.read_text().splitlines(), "", []
    for line in text.splitlines():
        key = line.split("=")[0].strip()
        at = next((n for n, old in enumerate(lines) if re.match(rf"#?{re.escape(key)} *=", old)), None)
        if line.startswith("["):
            table = line
            if line.startswith("[["):
                added.append(line)
        elif line.strip() and not line.startswith("#"):
            if at is None or table.startswith("[["):
                added.append(line)
            else:
                lines[at] = line
    path.write_text("\n".join(lines + added) + "\n")


def _name(page: Path) -> str:
    return page.name


PAGES_WITH_CODE = [page for page in pages() if any(block.language in RUN for block in blocks_of(page))]
PAGES_WITH_TOML = [page for page in pages() if any(block.language == "toml" for block in blocks_of(page))]


def _blocks_to_run(page: Path) -> list[Block]:
    """The README is not the place for comments about tests: what is not run there is listed here."""
    blocks = blocks_of(page)
    if page != ROOT / "README.md":
        return blocks
    found = []
    for block in blocks:
        text = "\n".join(line for line in block.text.splitlines() if not any(word in line for word in README_NOT_RUN))
        example = next(name for word, name in README_EXAMPLES if word in text)
        found.append(Block(block.language, text, block.line, {"example": example}))
    return [block for block in found if block.language in RUN and block.text]


@pytest.mark.parametrize("page", PAGES_WITH_CODE, ids=_name)
def test_examples_run(page: Path, tmp_path: Path, prepared: Callable[[str], Path]) -> None:
    reader = Reader(page, tmp_path, prepared, verbatim=False)
    for block in _blocks_to_run(page):
        reader.follow(block)


@pytest.mark.slow
def test_tutorial_as_it_is_written(tmp_path: Path, prepared: Callable[[str], Path], capfd: pytest.CaptureFixture[str]) -> None:
    """Each command with the very films that it makes; what it prints is what the page shows, but for figures and spaces.

    `make tutorial` writes these lines of the page anew.
    """
    page = ROOT / "docs" / "tutorial.md"
    reader = Reader(page, tmp_path, prepared, verbatim=True)
    text = page.read_text(encoding="utf-8").splitlines()
    for block in blocks_of(page):
        capfd.readouterr()
        reader.follow(block)
        printed: dict[str, list[str]] = {}
        for line in "".join(capfd.readouterr()).splitlines():
            printed.setdefault(_shape(line), []).append(line.rstrip())
        if block.language != "console":
            continue
        for number, line in enumerate(block.text.splitlines(), start=block.line - 1):
            if line.startswith("$ ") or line.strip() in ("", "..."):
                continue
            assert text[number].strip() == line.strip()
            assert printed.get(_shape(line)), f"tutorial.md:{number + 1}: {line!r} is not printed"
            text[number] = printed[_shape(line)].pop(0)
    if os.environ.get("PASSERBY_TUTORIAL") == "write":
        page.write_text("\n".join(text) + "\n", encoding="utf-8")


def _shape(line: str) -> str:
    """A line with its figures and spaces evened out."""
    return " ".join(re.sub(r"-?\d+(\.\d+)?", "0", line).split())


@pytest.mark.parametrize("page", PAGES_WITH_TOML, ids=_name)
def test_toml_is_what_passerby_reads(page: Path, tmp_path: Path) -> None:
    for block in blocks_of(page):
        if block.language == "toml":
            content = tomllib.loads(block.text)
            kind = block.told.get("toml", "scene")
            try:
                READERS[kind](content, block.text, tmp_path)
            except Exception as error:
                pytest.fail(f"{page.name}:{block.line}: {error}")


def _as_scene(content: dict[str, Any], _: str, __: Path) -> None:
    """A part of a scene file, with as many cameras as it takes."""
    cameras = content.setdefault("cameras", {})
    given = content.get("association", {}).get("mode") == "given"
    alike = {key: value for key, value in next(iter(cameras.values()), {}).items() if key != "fps"}
    other = alike or {"intrinsics": "rig.toml", **({"tracks": "t.txt"} if given else {"video": "v.mp4"})}
    grouped = "groups" in content.get("sites", {})
    for name in (*(() if grouped else ("north", "gate")), *sorted(_mentioned(content))):
        if len(cameras) < 2 or name in _mentioned(content):
            cameras.setdefault(name, other)
    if content.get("scale", {}).get("people"):
        content.setdefault("association", {"mode": "given"})
        content["cameras"] = {name: {"intrinsics": "rig.toml", "tracks": "t.txt"} for name in cameras}
    Scene.model_validate(content)


def _mentioned(content: dict[str, Any]) -> set[str]:
    """Cameras that other tables name."""
    scale, solver = content.get("scale", {}), content.get("solver", {})
    found = {solver["reference"]} if "reference" in solver else set()
    found |= {name for one in scale.get("distances", ()) for name in one["between"]}
    found |= {one["camera"] for one in scale.get("camera_heights", ())}
    found |= {name for group in content.get("sites", {}).get("groups", ()) for name in group}
    return found | {name for one in scale.get("lengths", ()) for name in one["points"]}


def _as_rig(_: dict[str, Any], text: str, folder: Path) -> None:
    (folder / "rig.toml").write_text(text)
    assert len(read_rig(folder / "rig.toml"))


def _as_model(content: dict[str, Any], _: str, __: Path) -> None:
    assert content
    Description.model_validate(content)


def _as_training(_: dict[str, Any], text: str, folder: Path) -> None:
    from passerby.training.options import train_options

    (folder / "run.toml").write_text(text)
    train_options("small", folder / "run.toml")


def _as_recording(_: dict[str, Any], text: str, folder: Path) -> None:
    from passerby.recording.settings import read_plan

    (folder / "secrets.env").write_text("CAMERA_USER=a\nCAMERA_PASSWORD=b\n")
    (folder / "cameras.toml").write_text(text)
    assert read_plan(folder / "cameras.toml", {}).streams


def _as_streams(_: dict[str, Any], text: str, folder: Path) -> None:
    from passerby.recording.scene_streams import read_streamed

    (folder / "secrets.env").write_text("CAMERA_USER=a\nCAMERA_PASSWORD=b\n")
    (folder / "scene.toml").write_text(f"{text}\n[cameras.gate]\nvideo = '/dev/video0'\n")
    assert read_streamed(folder / "scene.toml", {}) is not None


READERS: dict[str, Callable[[dict[str, Any], str, Path], None]] = {
    "scene": _as_scene,
    "rig": _as_rig,
    "model": _as_model,
    "training": _as_training,
    "recording": _as_recording,
    "streams": _as_streams,
}
