"""The hostile cases, by name: people, cameras and recordings that would make a wrong rig look right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from reliability import blind_cameras, blind_files, blind_people, blind_scene, later_cameras, later_people
from reliability.hostile_cameras import CAMERAS
from reliability.hostile_files import FILES
from reliability.hostile_pairs import PAIRS
from reliability.hostile_people import PEOPLE
from reliability.judging import judge
from reliability.staging import HandedIn

HOSTILE: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType({**PEOPLE, **CAMERAS, **FILES})
"""Name -> what it is, and its builder by seed."""
BLIND: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType(
    {**blind_people.CASES, **blind_cameras.CASES, **blind_files.CASES, **blind_scene.CASES}
)
"""Written from the documentation alone, after the limits of the verdict were set."""
LATER: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType({**later_people.CASES, **later_cameras.CASES})
"""Written from the documentation alone, after rules were added with `BLIND` in view."""
EVERY: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType({**HOSTILE, **PAIRS, **BLIND, **LATER})
"""All of them; limits of the verdict are set by `HOSTILE` alone, and by ordinary scenes."""


def work(case: tuple[str, int]) -> dict[str, Any]:
    """One hostile case of a seed: its verdict, and how wrong its rig is."""
    name, seed = case
    return judge(EVERY[name][1](seed))
