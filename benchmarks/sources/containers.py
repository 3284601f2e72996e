"""One rendered film in twelve containers and codecs, each calibrated as the plain MP4 is."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from sources.packaging import PACKAGINGS, PLAIN, Packaging, available
from sources.recorded_films import calibrated, names_of, packed, rendered_film, scene_text


def cases(scenes: Path) -> dict[str, tuple[Packaging, Path]]:
    """By key a packaging and the film that `passerby simulate --video` would write, the plain film first."""
    film = rendered_film(scenes)
    return {one.key: (one, film) for one in (PLAIN, *PACKAGINGS)}


def work(case: tuple[Packaging, Path]) -> dict[str, Any]:
    """The rig of one packaging against the truth, or what makes it unusable: plain values."""
    packaging, film = case
    out: dict[str, Any] = {"about": {"text": packaging.text}, "cpu_s": 0.0, "mm": None, "deg": None, "verdict": None}
    if not available(packaging):
        return out | {"unsupported": f"this PyAV has no encoder {packaging.encoder}"}
    with tempfile.TemporaryDirectory() as scratch:
        scene = Path(scratch) / "scene.toml"
        lines = {name: packed(packaging, film, name, Path(scratch)) for name in names_of(film)}
        scene.write_text(f"{scene_text(film, lines)}max_offset_s = 0\n", encoding="utf-8")
        try:
            return out | calibrated(scene, film, {})
        except InputError as error:
            return out | {"unsupported": str(error)}
