"""`passerby init`: writes a scene file for a folder, and lists the tasks that remain before a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.text import not_a_file
from passerby.core.cameras import Camera, Lens, Rig
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import key, relative
from passerby.perception.video_probe import fit_of_size, probe
from passerby.scene.start.folders import FoundCamera, Probe, survey
from passerby.scene.start.lenses import CameraLens, find_lenses
from passerby.scene.start.scene_text import SceneCamera, scene_text

SCENE_FILE = "scene.toml"
INTRINSICS = "intrinsics"


@dataclass(frozen=True, eq=False)
class StartedCamera:
    """One camera, with the state of its lens."""

    found: FoundCamera
    lens: CameraLens | None
    state: str
    """A few words about the lens, for a table."""


@dataclass(frozen=True, eq=False)
class Started:
    """The files that were written, and the notes for the user."""

    scene: Path
    cameras: tuple[StartedCamera, ...]
    written: tuple[Path, ...]
    notes: tuple[str, ...]
    """Notes of what was left out or assumed, or is unusual, one line each."""
    to_do: tuple[str, ...]
    """Tasks of the user before a calibration, one line each."""

    @property
    def unreadable(self) -> tuple[str, ...]:
        """Names of the cameras with a video that cannot be read."""
        return tuple(camera.found.name for camera in self.cameras if camera.found.fault is not None)


def start(folder: Path, scene: Path | None = None, force: bool = False, probe: Probe = probe) -> Started:
    """Write a scene file for a folder of videos, and a rig file beside it if intrinsics are in another format.

    Args:
        folder: The folder of the videos, see `passerby.scene.start.folders`; `passerby.scene.start.lenses` describes where
            calibration files are searched.
        scene: The scene file; None: `scene.toml` in the folder.
        force: Whether an earlier scene file is replaced. No other file is ever replaced.
        probe: Reads the metadata of a video.

    Raises:
        InputError: the folder does not exist, it has fewer than two cameras, the scene file exists already, or it cannot be
            written.
    """
    why = not_a_file(str(folder))
    if why is not None:
        raise InputError(f"what is given for a folder {why}: init needs the folder that these files lie in")
    path = folder / SCENE_FILE if scene is None else scene
    _check_free(path, force)
    found = survey(folder, probe)
    notes = list(found.notes)
    lenses = find_lenses(folder, found.cameras, notes, besides=path)
    lenses = _name_as_in_rig(found.cameras, lenses, notes)
    places, written = _write_intrinsics(found.cameras, lenses, path)
    same = _find_same_devices(found.cameras, places)
    cameras, texts, to_do = [], [], []
    for camera in found.cameras:
        lens = lenses.get(camera.name)
        state, remarks, must = _state(camera, lens, places.get(camera.name), path)
        cameras.append(StartedCamera(camera, lens, state))
        fps = _assume_fps(camera, found.cameras)
        texts.append(SceneCamera(camera, places.get(camera.name), remarks, fps, same.get(camera.name)))
        to_do += [must] if must else []
        if camera.recording is not None and camera.recording.unknown_rate:
            to_do.append(
                f"camera {camera.name}: replace IMAGES PER SECOND by the rate that its images' numbers count, in {path}"
            )
    unknown = [camera.name for camera in found.cameras if camera.name not in places and camera.fault is None]
    if unknown:
        notes.append(
            f"no intrinsics for {', '.join(unknown)}: focal length, principal point and distortion will be estimated together "
            f"with the rig; a field of view from a data sheet (hfov_deg in {path}) or a calibration with a pattern makes the "
            "rig more accurate"
        )
    if found.span is not None:
        notes.append(f"proposed: from {found.span.first} until {found.span.last}: {found.span.why} (from and until in {path})")
    if same:
        notes.append(
            f"the metadata of {', '.join(same)} state the same device as those of {', '.join(dict.fromkeys(same.values()))}: "
            f"cameras of one model can share their unknown lens; delete the # before lens in {path} if they do"
        )
    assumed = [text for text in texts if text.fps is not None]
    if assumed:
        notes.append(
            f"assumed: {assumed[0].fps:g} frames per second, as the video's, for {', '.join(text.name for text in assumed)}, "
            f"which have none: correct it in {path}"
        )
    write_text(path, scene_text(folder.resolve().name or "scene", texts, path, found.span))
    return Started(path, tuple(cameras), (path, *written), tuple(notes), tuple(to_do))


def _assume_fps(camera: FoundCamera, cameras: Sequence[FoundCamera]) -> float | None:
    """Return the frame rate of another camera's video for a camera without one: a scene with some rates needs all of them.

    None for a camera with a video, or if no video states a rate.
    """
    if camera.video is not None:
        return None
    return next((other.info.average_fps for other in cameras if other.info is not None), None)


def _find_same_devices(cameras: Sequence[FoundCamera], places: Mapping[str, Path]) -> dict[str, str]:
    """Find, for each camera without intrinsics, another one whose video has the same size, device and focal length.

    It is a camera with intrinsics, or else the first.
    """
    first: dict[tuple[object, ...], str] = {}
    out = {}
    for camera in sorted(cameras, key=lambda camera: camera.name not in places):
        info = camera.info
        if info is None or info.camera.device is None:
            continue
        other = first.setdefault((info.size, info.camera), camera.name)
        if other != camera.name and camera.name not in places:
            out[camera.name] = other
    return out


def _check_free(path: Path, force: bool) -> None:
    """Raise `InputError` if a scene file may not be written to this path."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder: name the scene file with -o, as {path / SCENE_FILE}")
    if not path.exists():
        return
    if not force:
        raise InputError(f"{path}: is there already: choose another name with -o, or replace it with --force")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        text = ""
    if "[cameras." not in text:
        raise InputError(f"{path}: is not a scene file, and is not replaced: choose another name with -o")


def _name_as_in_rig(cameras: Sequence[FoundCamera], lenses: dict[str, CameraLens], notes: list[str]) -> dict[str, CameraLens]:
    """Give the cameras the names of their tables, so that the rig file needs no change; return the lenses by these names."""
    names = {camera.name for camera in cameras}
    renamed: dict[str, CameraLens] = {}
    for camera in cameras:
        lens = lenses.get(camera.name)
        if lens is None:
            continue
        table = lens.table
        if table is not None and table != camera.name:
            if table in names:
                notes.append(f"not used: {lens.source}: table [{table}] fits {camera.name}, but another camera has this name")
                continue
            notes.append(f"camera {camera.name} is called {table}, as in {lens.source}")
            names = names - {camera.name} | {table}
            camera.name = table
        renamed[camera.name] = lens
    return renamed


def _write_intrinsics(
    cameras: Sequence[FoundCamera], lenses: dict[str, CameraLens], scene: Path
) -> tuple[dict[str, Path], list[Path]]:
    """Write one rig file for the intrinsics of other formats; return the rig file of each camera, and the written files."""
    places = {name: lens.source for name, lens in lenses.items() if lens.table is not None}
    written: list[Path] = []
    copied = [camera for camera in cameras if camera.name not in places and _lens_of(camera, lenses) is not None]
    if copied:
        sources = sorted({relative(lenses[camera.name].source, scene) for camera in copied})
        rig = Rig(tuple(Camera(camera.name, lens) for camera in copied if (lens := _lens_of(camera, lenses)) is not None))
        written.append(_find_free_name(scene))
        write_rig(written[-1], Rig(rig.cameras, metadata={"source": ", ".join(sources)}))
        places |= {camera.name: written[-1] for camera in copied}
    return places, written


def _lens_of(camera: FoundCamera, lenses: dict[str, CameraLens]) -> Lens | None:
    """Return a camera's lens; None if it has none."""
    found = lenses.get(camera.name)
    return None if found is None else found.lens


def _find_free_name(scene: Path) -> Path:
    """Return the first of intrinsics.toml, intrinsics-2.toml, ... beside the scene file that does not exist."""
    number = 1
    while True:
        path = scene.parent / (f"{INTRINSICS}.toml" if number == 1 else f"{INTRINSICS}-{number}.toml")
        if not path.exists() and path.name != scene.name:
            return path
        number += 1


def _state(
    camera: FoundCamera, lens: CameraLens | None, place: Path | None, scene: Path
) -> tuple[str, tuple[str, ...], str]:  # fmt: skip
    """Return the state of a camera's lens for the table, remarks for the scene file, and the user's task or ""."""
    if camera.fault is not None:
        must = f"{camera.fault}; or delete [cameras.{key(camera.name)}]"
        return "UNREADABLE", (f"TO DO: {must}.",), f"camera {camera.name}: {must} in {scene}"
    if lens is None:
        if camera.info is not None:
            return "estimated" if camera.info.camera.focal_35mm is None else "metadata", (), ""
        must = "replace WIDTH and HEIGHT by the size of the images in which its people were detected"
        return "SIZE MISSING", (f"TO DO: {must}.",), f"camera {camera.name}: {must}, in {scene}"
    if lens.lens is None:
        return "INCOMPLETE", (f"TO DO: {lens.fault}",), f"camera {camera.name}: {lens.fault}"
    remarks: tuple[str, ...] = () if lens.table is not None else (f"Its intrinsics are from {lens.source}.",)
    if lens.assumed_size:
        remarks += ("ASSUMED: that file does not say for which image size it is valid; the size of the video is written.",)
    if camera.info is not None:
        try:
            fit = fit_of_size(camera.info.size, lens.lens.size, camera.info.rotation)
        except InputError as error:
            return "WRONG SIZE", (*remarks, f"TO DO: {error}"), f"camera {camera.name}: {error} (intrinsics in {place})"
        if fit == "cropped":
            size = "{} x {}".format(*lens.lens.size)
            remarks += (f"The intrinsics are for {size}: the video shows that image without its last columns or rows.",)
    return ("size assumed" if lens.assumed_size else "found"), remarks, ""
