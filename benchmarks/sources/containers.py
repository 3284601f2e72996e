"""One rendered film in twelve containers and codecs, each calibrated as the plain MP4 is."""

from __future__ import annotations

import contextlib
import io
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from passerby.calibration.calibrate import calibrate
from passerby.common.errors import InputError
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from passerby.perception.video import VideoReader, probe
from passerby.simulation import SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from sources.packaging import PACKAGINGS, PLAIN, Packaging, Picture, available, pack

PRESET, SEED, CAMERAS, SECONDS, FPS = "terrace", 800_000, 3, 40.0, 10.0
PERCEPTION = '[perception]\ndetector = "background"\nembedder = "stripes"\nkeypoints = "none"\n'
"""Of a scene file: no networks."""


@dataclass(frozen=True)
class ContainerCase:
    """A packaging of the film in `film`, a folder that `passerby simulate --video` would write."""

    packaging: Packaging
    film: Path


def rendered_film(scenes: Path, cameras: int = CAMERAS, seconds: float = SECONDS, seed: int = SEED) -> Path:
    """The folder of the film; made unless it is there."""
    folder = scenes / f"sources-{PRESET}-{seed}-{cameras}-{seconds:g}-{FPS:g}"
    if not (folder / "scene.toml").is_file():
        options = SimulationOptions(preset=PRESET, seed=seed, cameras=cameras, seconds=seconds, fps=FPS, unrelated_ids=True)
        write_scene(simulate(options), folder, video=RenderOptions())
    return folder


def cases(scenes: Path) -> dict[str, ContainerCase]:
    """By key, the plain film first."""
    film = rendered_film(scenes)
    return {one.key: ContainerCase(one, film) for one in (PLAIN, *PACKAGINGS)}


def work(case: ContainerCase) -> dict[str, Any]:
    """The rig of one packaging against the truth, or what makes it unusable: plain values."""
    out: dict[str, Any] = {"about": {"text": case.packaging.text}, "cpu_s": 0.0, "mm": None, "deg": None, "verdict": None}
    if not available(case.packaging):
        return out | {"unsupported": f"this PyAV has no encoder {case.packaging.encoder}"}
    began = time.process_time()
    truth = read_rig(case.film / "truth.toml")
    with tempfile.TemporaryDirectory() as scratch, contextlib.redirect_stderr(io.StringIO()):
        scene = _scene(case, truth.names, Path(scratch))
        try:
            found = calibrate(scene)
        except InputError as error:
            return out | {"unsupported": str(error)}
    out |= {"cpu_s": time.process_time() - began, "verdict": found.verdict, "registered": len(found.rig.posed())}
    if len(found.rig.posed()) < 2:
        return out
    similar = compare(found.rig.posed(), truth).similarity
    return out | {"mm": similar.mean_position_mm, "deg": similar.mean_orientation_deg}


def _scene(case: ContainerCase, names: tuple[str, ...], folder: Path) -> Path:
    """A scene file of the packed film: no networks, clocks that agree."""
    text = ""
    for name in names:
        lines = packed(case.packaging, case.film, name, folder)
        text += f'[cameras.{name}]\nintrinsics = "{(case.film / "intrinsics.toml").as_posix()}"\n{lines}'
    text += f'{PERCEPTION}[association]\nmode = "combined"\nmax_offset_s = 0\n'
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder / "scene.toml"


def packed(packaging: Packaging, film: Path, name: str, folder: Path) -> str:
    """A camera's rendered film, packed into a folder; its lines in the scene file."""
    video = next(path for path in (film / "videos" / f"{name}.mp4", film / f"{name}.mp4") if path.is_file())
    return pack(packaging, _pictures(video), probe(video).frames or 0, FPS, folder, name)


def _pictures(video: Path) -> Iterator[Picture]:
    for frame in VideoReader(video):
        yield frame.picture
