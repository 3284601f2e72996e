"""Folders that examples of the documentation are run in, each made once and copied; and the maker of the pages of reference."""

from __future__ import annotations

import fcntl
import importlib.util
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from passerby.cli.main import run
from passerby.common.progress import silent
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from support.documentation import DOCS
from support.scenes.puppet_videos import film, puppets

Folders = Callable[[str], Path]


@pytest.fixture(scope="module", autouse=True)
def _without_network() -> Iterator[None]:
    """Nothing is fetched, and no model of this computer is found: the same everywhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PASSERBY_OFFLINE", "1")
        patch.delenv("PASSERBY_MODELS", raising=False)
        patch.setenv("XDG_CACHE_HOME", "/nonexistent")
        yield


@pytest.fixture(scope="session")
def reference() -> ModuleType:
    """`docs/make_reference.py`."""
    spec = importlib.util.spec_from_file_location("make_reference", DOCS / "make_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_reference"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """The folder of this name, made by the first test process that asks for it."""
    common = tmp_path_factory.getbasetemp()
    common = (common.parent if common.name.startswith("popen-") else common) / "documentation"
    common.mkdir(exist_ok=True)

    def folder(name: str) -> Path:
        with (common / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            target, making = common / name, common / f"{name}.making"
            if not target.is_dir():
                shutil.rmtree(making, ignore_errors=True)
                making.mkdir()
                MAKERS[name](making, folder)
                making.rename(target)
        return target

    return folder


def _street(folder: Path, _: Folders) -> None:
    """`street/`, as `passerby simulate -o street --video` writes it, but of puppets, which are quick to film and to watch."""
    made = puppets(24.0, 3.0, 2, 5)
    film(made, folder / "street")
    (folder / "street" / "videos").mkdir()
    for video in (folder / "street").glob("*.mp4"):
        video.rename(folder / "street" / "videos" / video.name)
    (folder / "street" / "rig.toml").rename(folder / "street" / "intrinsics.toml")


def _videos(folder: Path, folders: Folders) -> None:
    """`videos/` with videos and lenses, `truth.toml`, and in `out/perception` what is seen in the videos."""
    street = folders("street") / "street"
    shutil.copytree(street / "videos", folder / "videos")
    shutil.copy(street / "intrinsics.toml", folder / "videos" / "intrinsics.toml")
    shutil.copy(street / "truth.toml", folder / "truth.toml")
    shutil.copytree(folder / "videos", folder / "v")
    assert run(["init", str(folder / "v")]) == 0
    read_inputs(Scene.load(folder / "v" / "scene.toml"), SceneVideoProcessor(folder / "out", None, silent))
    shutil.rmtree(folder / "v")


def _scene(folder: Path, _: Folders) -> None:
    """A scene of boxes whose identities are to be found, in the folder itself, with its truth."""
    options = ["--seconds", "12", "--unrelated-ids", "--cameras", "3", "--people", "5"]
    assert run(["simulate", "-o", str(folder / "scene"), *options]) == 0
    for path in (folder / "scene").iterdir():
        path.rename(folder / path.name)
    (folder / "scene").rmdir()


def _calibrated(folder: Path, folders: Folders) -> None:
    """The same with `out/`, its calibration."""
    shutil.copytree(folders("scene"), folder, dirs_exist_ok=True)
    assert run(["calibrate", str(folder / "scene.toml"), "-o", str(folder / "out")]) == 0


def _empty(_: Path, __: Folders) -> None:
    """Nothing."""


MAKERS: dict[str, Callable[[Path, Folders], None]] = {
    "empty": _empty,
    "street": _street,
    "videos": _videos,
    "scene": _scene,
    "calibrated": _calibrated,
}
