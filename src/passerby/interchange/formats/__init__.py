"""Formats of other tools, one module each, loaded on demand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from importlib import import_module
from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text, suggest_name
from passerby.core.cameras import Rig
from passerby.interchange.formats.format import Export, Format, Given, Losses, People, sample_file
from passerby.interchange.storage.atomic import write_bytes
from passerby.interchange.storage.transaction import folder_lock, transaction

__all__ = [
    "Export",
    "Format",
    "Given",
    "Losses",
    "People",
    "all_formats",
    "export",
    "find_format",
    "read_people_as",
    "read_rig_as",
    "recognise_format",
]

MODULES: Mapping[str, str] = {
    "colmap": "colmap",
    "colmap-bin": "colmap",
    "opencv": "opencv_yaml",
    "freemocap": "freemocap",
    "anipose": "toml_rigs",
    "pose2sim": "toml_rigs",
    "caliscope": "toml_rigs",
    "easymocap": "easymocap",
    "kalibr": "kalibr",
    "ros": "ros",
    "nerfstudio": "nerfstudio",
    "mv3dt": "nvidia",
    "amc": "nvidia",
    "frigate": "frigate",
    "homography": "homography",
    "ply": "ply",
    "gltf": "gltf",
    "glb": "gltf",
    "rerun": "rerun",
    "krt-json": "krt_json",
    "panoptic": "krt_json",
    "tsai": "tsai",
    "qualisys": "qualisys",
    "vicon": "vicon",
    "motive": "motive",
    "opencap": "opencap",
    "biocv": "biocv",
    "calibio": "calibio",
    "openpose": "openpose",
    "alphapose": "alphapose",
    "coco": "coco",
}
"""Name of a format -> its module here. The module has `FORMAT`, or for several formats `FORMATS`, a mapping by name."""
FARTHEST_M = 1e12
"""Largest permitted translation of a camera. A damaged exponent in a file makes it larger, infinite or NaN."""


def find_format(name: str) -> Format:
    """Return the format of a name. Raises `InputError` for an unknown name, with the most similar one."""
    if name not in MODULES:
        raise InputError(f"no format is called '{name}': {suggest_name(name, list(MODULES))} (`passerby formats` lists them)")
    module = import_module(f"{__name__}.{MODULES[name]}")
    found = module.FORMATS[name] if hasattr(module, "FORMATS") else module.FORMAT
    assert isinstance(found, Format), name
    return found


def all_formats() -> Iterator[Format]:
    """Generate all formats, in the order of `MODULES`."""
    return map(find_format, MODULES)


def recognise_format(path: str | Path) -> Format | None:
    """Return the format that recognises a calibration file by its name and content; None where no format does.

    The file is not checked further: faults inside it raise an `InputError` in `read_rig_as`. So does a kind of file that is
    recognised, but cannot be read; its message states what to export instead.

    Args:
        path: a file. Formats that keep one rig in several files recognise the file that holds the intrinsics, and their
            reader reads the whole rig from that path.
    """
    sample = sample_file(Path(path))
    if sample is None:
        return None
    return next((form for form in all_formats() if form.recognises is not None and form.recognises(sample)), None)


def export(rig: Export, name: str, target: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write a rig for another tool. If this fails, nothing is written.

    Args:
        rig: the rig, its name and people's trajectories.
        name: name of the format.
        target: the file or folder to write; files of other kinds in a folder stay.
        lossy: whether to write the rig even if the format cannot hold everything.

    Returns:
        The losses, one sentence each.

    Raises:
        InputError: unknown format, one that is only read, a loss that is not allowed, or a target that cannot be written.
    """
    form, path, losses = find_format(name), Path(target), Losses()
    if form.write is None:
        raise InputError(f"format {name} is only read, not written: {_others(writes=True)}")
    one = form.write_one if path.suffix.lower() in form.suffixes and not path.is_dir() else None
    if form.target == "folder" and one is None and path.is_file():
        raise InputError(f"{path}: is a file, but format {name} is a folder: name another place")
    if form.target == "file" and path.is_dir():
        raise InputError(f"{path}: is a folder, but format {name} is one file: name it, as in {path / _example(form)}")
    files = form.write(rig, losses) if one is None else {"": one(rig, losses)}
    if not lossy:
        losses.forbid(str(path), name)
    if form.target == "folder" and one is None:
        _refuse_others(path, files.keys() - form.companions, name)
        with folder_lock(path, "passerby export"), transaction(path) as new:
            for below, content in files.items():
                write_bytes(new / below, content)
        return losses.told
    for below, content in files.items():
        write_bytes(path / below if below else path, content)
    return losses.told


def _refuse_others(folder: Path, files: Set[str], name: str) -> None:
    """Raise `InputError` where readers would take other files in the folder for a part of this rig."""
    places = {((folder / below).parent, Path(below).suffix) for below in files if Path(below).suffix}
    for parent, suffix in sorted(places):
        ours = {(folder / below).name for below in files}
        others = sorted(path.name for path in parent.glob(f"*{suffix}") if path.name not in ours) if parent.is_dir() else []
        if others:
            raise InputError(
                f"{parent / others[0]}: would be taken for a part of the rig that is written beside it in format {name}: "
                f"delete the other {suffix} files there ({len(others)}), or choose another folder"
            )


def read_rig_as(name: str, path: str | Path, given: Given | None = None, *, lossy: bool = False) -> tuple[Rig, tuple[str, ...]]:
    """Read a rig, or lenses, of another tool.

    Returns:
        The rig, and the losses, one sentence each.

    Raises:
        InputError: unknown format, one that holds no cameras, a damaged file, or a loss that is not allowed.
    """
    form, given = find_format(name), given or Given()
    if form.read is None:
        raise InputError(f"format {name} holds no cameras that can be read: {_others(reads=True)}")
    rig = form.read(_existing(Path(path), form), given)
    _refuse_lost(path, rig)
    if not lossy:
        given.losses.forbid(str(path), name)
    return rig, given.losses.told


def _refuse_lost(path: str | Path, rig: Rig) -> None:
    """Raise `InputError` for a camera whose translation is not finite, or `FARTHEST_M` or more."""
    for camera in rig:
        if camera.pose is not None and not np.abs(camera.pose.t_cw).max() < FARTHEST_M:
            translation = shortened(camera.pose.t_cw.tolist())
            raise InputError(
                f"{path}: camera {shortened_text(camera.name)}: the translation of its pose is {translation} m: correct "
                "its pose, or the unit"
            )


def read_people_as(name: str, path: str | Path, given: Given | None = None) -> People:
    """Read the people that another tool found in one camera. Raises `InputError`."""
    form = find_format(name)
    if form.read_people is None:
        raise InputError(f"format {name} holds no people: {', '.join(f.name for f in all_formats() if f.read_people)} do")
    return form.read_people(_existing(Path(path), form), given or Given())


def _existing(path: Path, form: Format) -> Path:
    if not path.exists():
        raise InputError(f"{path}: no such {form.target}: give what {' or '.join(form.tools)} wrote")
    return path


def _example(form: Format) -> str:
    return f"rig{form.suffixes[0] if form.suffixes else ''}"


def _others(*, reads: bool = False, writes: bool = False) -> str:
    """Return a text that lists the formats that can be read, or written."""
    found = [form.name for form in all_formats() if (reads and form.read) or (writes and form.write)]
    return f"choose one of {', '.join(found)}"
