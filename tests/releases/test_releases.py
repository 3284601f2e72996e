"""Files that earlier releases wrote are read, and give what they gave; those of a later one are an error that says so."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest

import passerby
from passerby.cli.main import run
from releases.kinds import KINDS, set_version
from support.documentation import DOCS

HERE = Path(__file__).parent
RELEASES = sorted(
    (path.parent for path in HERE.glob("*/expected.json")), key=lambda path: [int(number) for number in path.name.split(".")]
)
STATED = {name: kind for name, kind in KINDS.items() if kind.version}
KEPT = {
    "stages": ("filmed/scene.toml", "filmed/out", "filmed/out/perception"),
    "tracklets": ("scene/unknown.toml", "kept", "kept/association"),
}
"""Scene, output folder, and the folder in it."""
FILES = [(path, name) for path in RELEASES for name in json.loads((path / "expected.json").read_text())]
WITH_VERSIONS = [(path, name) for path, name in FILES if name in STATED]


def within(stored, found):
    """Whether all that was stored is found again; there may be more keys."""
    if isinstance(stored, dict):
        return isinstance(found, dict) and all(key in found and within(value, found[key]) for key, value in stored.items())
    if isinstance(stored, list):
        return isinstance(found, list) and len(stored) == len(found) and all(map(within, stored, found))
    return stored == found if not isinstance(stored, float) else found == pytest.approx(stored, rel=1e-9, abs=1e-12)


def without_versions(value):
    if not isinstance(value, dict):
        return value
    return {key: without_versions(item) for key, item in value.items() if key != "format_version"}


def plain(value):
    return json.loads(json.dumps(value))


def copied(release, folder):
    return Path(shutil.copytree(release, folder / "release"))


def contents(folder):
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(params=RELEASES, ids=lambda path: path.name)
def release(request, tmp_path):
    return copied(request.param, tmp_path)


def each(files):
    return pytest.mark.parametrize(("path", "name"), files, ids=lambda value: value if isinstance(value, str) else value.name)


def test_the_latest_release_has_all_kinds_and_all_that_the_documentation_names():
    stored = json.loads((RELEASES[-1] / "expected.json").read_text())
    assert stored.keys() == KINDS.keys()
    assert all(stored.values())
    section = (DOCS / "output.md").read_text().split("## Files of other versions")[1].split("\n## ")[0]
    rows = [line.split("|")[1].strip() for line in section.splitlines() if line.startswith("|")][2:]
    assert sorted(rows) == sorted([*(kind.documented for kind in KINDS.values()), "`checkpoint.pt`"])


@each(FILES)
def test_every_file_is_read_as_it_was(path, name, tmp_path):
    stored = json.loads((path / "expected.json").read_text())[name]
    folder, kind = copied(path, tmp_path), KINDS[name]
    assert kind.files(folder) == sorted(stored)
    for file, values in stored.items():
        found = plain(kind.read(folder / file))
        assert within(values, found), f"{file}: {found}"


@each(WITH_VERSIONS)
def test_without_a_version_it_is_read_all_the_same(path, name, tmp_path):
    release, kind = copied(path, tmp_path), STATED[name]
    line = re.escape(kind.version.split("\n")[-1]).replace(re.escape("{}"), r"\d+") + ",?\n"
    found = 0
    for file, values in json.loads((release / "expected.json").read_text())[name].items():
        text, count = re.subn(line, "", (release / file).read_text())
        found += count
        (release / file).write_text(text)
        assert within(without_versions(values), plain(kind.read(release / file))), file
    assert found, "it was stated"


@each(WITH_VERSIONS)
def test_of_a_later_version_it_is_one_clear_error(path, name, tmp_path, capsys):
    release, kind = copied(path, tmp_path), STATED[name]
    assert kind.command is not None
    for file in kind.files(release):
        path = release / file
        before = path.read_bytes()
        set_version(path, kind, 2)
        later, written = path.read_bytes(), contents(release)
        capsys.readouterr()
        assert run(kind.command(release, path)) == 2, file
        errors = capsys.readouterr().err.strip().splitlines()
        assert len(errors) == 1, errors
        assert errors[0].startswith("error: ")
        assert path.name in errors[0]
        assert errors[0].endswith("_version is 2, of a later Passerby; this one reads up to 1: install a later one")
        assert path.read_bytes() == later
        assert {key: value for key, value in contents(release).items() if key in written} == written, "nothing is lost"
        path.write_bytes(before)


def test_lenses_of_a_later_version(release, capsys):
    set_version(release / "scene" / "intrinsics.toml", KINDS["rig"], 2)
    assert run(["check", str(release / "scene" / "scene.toml")]) == 2
    assert "intrinsics.toml: [metadata] format_version is 2, of a later Passerby" in "".join(capsys.readouterr())


def calibrated(scene, out):
    """Whether a run in this process had something to make again, as it says."""
    again = []

    def progress(stage, done=0, total=0, *, part=""):
        pass

    progress.note = lambda text: again.append("made again" in text)
    passerby.calibrate(scene, progress=progress, keep=out)
    return any(again)


OF_OTHERS = {
    "stages": ("passerby.perception.watching._versions", lambda: {"numpy": "0.1"}),
    "tracklets": ("passerby.calibration.kept_tracklets._code", lambda: "other code"),
}


@pytest.mark.slow
@pytest.mark.parametrize("other", [False, True], ids=["these libraries", "other libraries"])
@pytest.mark.parametrize("name", KEPT)
def test_what_was_kept_is_taken_or_made_again(release, name, other, monkeypatch):
    """Its key has the code or the libraries' versions in it: unless all are the same, it is made again, and that is said."""
    if other:
        monkeypatch.setattr(*OF_OTHERS[name])
    scene, out, shelf = (release / part for part in KEPT[name])
    before = contents(shelf)
    again = calibrated(scene, out)
    after = contents(shelf)
    taken = before.keys() <= after.keys() and not after.keys() - before.keys()
    assert again is not taken
    assert not (other and taken)
    assert taken is False or after == before
    assert KINDS[name].files(release), "there are results for the next run"
    assert not calibrated(scene, out), "which takes them"
    assert contents(shelf) == after


def test_the_command_says_what_is_made_again(release, capsys):
    out = release / "filmed" / "out"
    for folder in (out / "perception").glob("*/people-*"):
        folder.rename(folder.with_name("people-0123456789abcdef0123"))
    assert run(["calibrate", str(release / "filmed" / "scene.toml"), "-o", str(out), "--no-report"]) in (0, 3)
    said = "perception: what was kept is of other videos, options or versions, and was made again: C1\n"
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_its_scene_is_calibrated_as_it_was(release):
    before, truth = passerby.read_rig(release / "out" / "rig.toml"), passerby.read_rig(release / "scene" / "truth.toml")
    found = passerby.calibrate(release / "scene" / "scene.toml")
    assert found.verdict == before.verdict == "accepted"
    now = passerby.evaluate(found.rig, truth).similarity.mean_position_mm
    then = passerby.evaluate(before, truth).similarity.mean_position_mm
    assert now < 1.5 * then + 10


@pytest.mark.slow
def test_its_output_folder_is_read_by_every_command(release, tmp_path):
    out = str(release / "out")
    assert run(["report", out, "-o", str(tmp_path / "report.html")]) == 0
    assert run(["track", out]) == 0
    assert run(["export", out, "--format", "opencv", "-o", str(tmp_path / "opencv")]) == 0
    assert run(["align", out, "--camera", "C2", "-o", str(tmp_path / "aligned.toml")]) == 0
    folder = passerby.read_calibration(release / "out")
    assert folder.verdict == "accepted"
    assert len(folder.rig) == 4
