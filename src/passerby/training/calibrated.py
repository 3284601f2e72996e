"""What `passerby calibrate` left in its output folder, as far as a network learns from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, Clock
from passerby.interchange.output_folder import RIG_FILE, read_output, scene_of
from passerby.perception.video import probe
from passerby.scene.scene import Scene
from passerby.training.data.one_file import one_file


@dataclass(frozen=True, eq=False)
class CalibratedScene:
    """A calibrated scene: the cameras that have poses, and what they saw."""

    scene: Scene
    rig: Rig
    """The cameras with poses, two or more."""
    boxes: Mapping[str, Boxes]
    """Of each of them, with identities that are the same in all cameras."""
    clocks: Mapping[str, Clock]
    verdict: str
    videos: Mapping[str, Path]
    """Of those of them that have one."""


def read_calibrated(out: Path, scene: Path | None = None) -> CalibratedScene:
    """Read an output folder.

    Args:
        out: the folder.
        scene: its scene file; None: where `calibration.json` says that it lies.

    Raises:
        InputError: something is missing or broken, with its name and its remedy.
        EvidenceError: the calibration was refused, or registered fewer than two cameras.
    """
    found = read_output(out)
    posed = found.rig
    if len(posed) < 2:
        raise EvidenceError(
            f"{out / RIG_FILE}: {len(posed)} of {found.all_cameras} cameras have a pose: identities need two cameras or more"
        )
    loaded = Scene.load(scene or scene_of(out, found.document, "give the new path of the scene file"))
    for camera in posed:
        if camera.name not in loaded.cameras:
            raise InputError(
                f"{loaded.place}: has no [cameras.{camera.name}], which {out / RIG_FILE} has: give the scene file that was "
                "calibrated"
            )
    videos = {
        name: one_file([loaded.resolve(path) for path in table.videos], name)
        for name, table in loaded.cameras.items()
        if table.videos and name in posed.names
    }
    if not videos:
        raise InputError(f"{loaded.place}: no calibrated camera has a video: crops of people are cut from videos")
    clocks = found.clocks or _alike(loaded, posed, videos)
    return CalibratedScene(loaded, posed, found.boxes, clocks, found.verdict, videos)


def _alike(scene: Scene, rig: Rig, videos: Mapping[str, Path]) -> dict[str, Clock]:
    """Clocks of frames that are counted alike, at the rate of the scene or of a video."""
    rates = [scene.fps_of(name) for name in rig.names]
    rate = next((rate for rate in rates if rate), None) or probe(next(iter(videos.values()))).clock_fps
    return {name: Clock(rate) for name in rig.names}
