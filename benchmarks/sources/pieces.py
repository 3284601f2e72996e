"""Films cut into a recorder's pieces, of which some are missing and one is broken, against the whole files."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from sources.recorded_films import BEGIN, calibrated, coded_films, cut, names_of, scene_of

PIECE_S, MISSING = 10.0, 0.05
DRAW = 0  # seed of the draw of the pieces that are lost
FILES, PIECES = "files", "pieces"


def cases(scenes: Path) -> dict[str, tuple[str, Path]]:
    """By key the kind and the films: as they are, then in pieces."""
    film = coded_films(scenes)
    return {kind: (kind, film) for kind in (FILES, PIECES)}


def work(case: tuple[str, Path]) -> dict[str, Any]:
    """The rig against the truth, and whether each gap was reported: plain values."""
    kind, film = case
    names = names_of(film)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if kind == FILES:
            videos = {name: (film / "coded" / f"{name}.mp4").as_posix() for name in names}
            return {"about": {"text": "whole files"}, **calibrated(scene_of(film, videos, folder), film, {})}
        pieces = {
            name: list(cut(film / "coded" / f"{name}.mp4", PIECE_S, Frigate(folder / "recordings", name))) for name in names
        }
        lost = drawn({name: len(paths) for name, paths in pieces.items()}, np.random.default_rng(DRAW))
        lose(pieces, lost)
        scene = scene_of(film, {name: f"recordings/*/*/{name}/*.mp4" for name in names}, folder)
        text = f"{sum(map(len, pieces.values()))} pieces, {len(lost) - 1} missing, 1 broken"
        return {"about": {"text": text}, "lost": [list(one) for one in lost], **calibrated(scene, film, {})}


@dataclass(frozen=True)
class Frigate:
    """The file that Frigate has of a camera's piece, by the second at which it begins: named by the whole second, in UTC."""

    folder: Path
    camera: str
    begin: datetime = BEGIN  # wall time of second 0

    def __call__(self, second: float) -> Path:
        """Where the piece lies."""
        time = self.begin + timedelta(seconds=second)
        return self.folder / f"{time:%Y-%m-%d}" / f"{time:%H}" / self.camera / f"{time:%M.%S}.mp4"


def drawn(counts: dict[str, int], rng: np.random.Generator) -> list[tuple[str, int]]:
    """Camera and number of the pieces that are lost, the broken one last: neither a camera's first piece nor its last."""
    inner = [(name, number) for name, count in counts.items() for number in range(1, count - 1)]
    missing = max(1, round(MISSING * sum(counts.values())))
    return [inner[index] for index in rng.permutation(len(inner))[: missing + 1]]


def lose(pieces: dict[str, list[Path]], lost: list[tuple[str, int]]) -> None:
    """Remove the lost pieces; the last of them is there, but holds nothing that can be read."""
    for name, number in lost:
        pieces[name][number].unlink()
    name, number = lost[-1]
    pieces[name][number].write_bytes(bytes(2000))


def gaps_of(lost: Sequence[Sequence[Any]]) -> dict[str, int]:
    """How many gaps each camera's recording has: neighbouring pieces make one."""
    known = {(name, number) for name, number in lost}
    found: dict[str, int] = {}
    for name, number in sorted(known):
        found[name] = found.get(name, 0) + ((name, number - 1) not in known)
    return found


def reported_once(case: Mapping[str, Any]) -> int:
    """How many of a case's gaps are reported, each once: one finding a camera, with the right number of gaps."""
    found: dict[str, list[int]] = {}
    for name, count, _ in case["gaps"]:
        found.setdefault(name, []).append(count)
    return sum(count for name, count in gaps_of(case["lost"]).items() if found.get(name) == [count])
