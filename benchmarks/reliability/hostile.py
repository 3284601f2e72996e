"""The hostile cases, by name: people, cameras and recordings that would make a wrong rig look right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from reliability.hostile_cameras import CAMERAS
from reliability.hostile_files import FILES
from reliability.hostile_pairs import PAIRS
from reliability.hostile_people import PEOPLE
from reliability.judging import judge
from reliability.staging import HandedIn

HOSTILE: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType({**PEOPLE, **CAMERAS, **FILES})
"""Name -> what it is, and its builder by seed."""
EVERY: Mapping[str, tuple[str, Callable[[int], HandedIn]]] = MappingProxyType({**HOSTILE, **PAIRS})
"""Those and pairs of faults, which limits of the verdict are not set by."""


def work(case: tuple[str, int]) -> dict[str, Any]:
    """One hostile case of a seed: its verdict, and how wrong its rig is."""
    name, seed = case
    return judge(EVERY[name][1](seed))
