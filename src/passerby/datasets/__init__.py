"""Published data sets in their own layouts, as scenes with truth; each module of `READERS` has `read(folder) -> Published`.

A module is loaded when its set is read. This package imports `interchange`, `perception` and lower packages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.datasets.published import Published

__all__ = ["READERS", "Reader", "read_published"]


@dataclass(frozen=True)
class Reader:
    """The reader of a data set."""

    module: str
    """Module of this package with a function `read(folder)`."""
    what: str
    """Description of the set in one line."""
    where: str
    """Address of the set."""

    def read(self, folder: Path) -> Published:
        """Read a folder of the set. Raises `InputError` for missing or broken files."""
        published: Published = import_module(f"passerby.datasets.{self.module}").read(folder)
        return published


READERS: Mapping[str, Reader] = {
    "epfl": Reader(
        "epfl",
        "EPFL multi-camera pedestrians (Terrace, Basketball, Laboratory, Campus, Passageway): 3 or 4 cameras, videos",
        "https://www.epfl.ch/labs/cvlab/data/data-pom-index-php/",
    ),
    "pets2009": Reader("pets", "PETS 2009: up to 8 cameras, images at 7 fps", "http://www.cvg.rdg.ac.uk/PETS2009/a.html"),
    "wildtrack": Reader(
        "wildtrack",
        "WILDTRACK: 7 cameras, 400 annotated time steps, images at 2 fps",
        "https://www.epfl.ch/labs/cvlab/data/data-wildtrack/",
    ),
    "multiviewx": Reader(
        "multiviewx", "MultiviewX: 6 synthetic cameras, 400 annotated time steps", "https://github.com/hou-yz/MultiviewX"
    ),
    "panoptic": Reader(
        "panoptic",
        "CMU Panoptic: HD cameras, 3D keypoints of 19",
        "https://github.com/CMU-Perceptual-Computing-Lab/panoptic-toolbox",
    ),
    "shelf": Reader("tum", "TUM Shelf: 5 cameras, 3D keypoints of the people", "https://campar.in.tum.de/Chair/MultiHumanPose"),
    "campus": Reader(
        "tum", "TUM Campus: 3 cameras, 3D keypoints of the people", "https://campar.in.tum.de/Chair/MultiHumanPose"
    ),
    "cmc": Reader(
        "cmc",
        "CMC: 4 cameras in a room, 5 sequences with boxes and 3D positions, 4 fps",
        "https://github.com/researchwork888/Multi-view-3D-multi-object-tracking-dataset",
    ),
}


def read_published(name: str, folder: Path) -> Published:
    """Read a published data set.

    Args:
        name: one of `READERS`.
        folder: folder of its files, as published.

    Raises:
        InputError: for an unknown name, a missing folder, and missing or broken files in it.
    """
    from passerby.common.text import suggest_name

    if name not in READERS:
        raise InputError(f"no data set is called '{name}': {suggest_name(name, list(READERS))}")
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder: give the folder of the files of {name}")
    return READERS[name].read(folder)
