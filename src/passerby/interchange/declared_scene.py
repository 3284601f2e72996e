"""The scene file as `calibration.json` keeps it, as far as it is read again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field

from passerby.common.arrays import ABSENT

OPEN_TABLE = ConfigDict(strict=True, allow_inf_nan=False, extra="allow")
"""Of tables of which only some keys are read again; the others are kept as they are."""


@dataclass(frozen=True, kw_only=True)
class DeclaredTimes:
    """`[scene]` of the scene file, as far as it is read again."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    name: str | None = field(default=None, metadata=ABSENT)
    fps: Annotated[float, Field(gt=0)] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredCamera:
    """`[cameras.NAME]`, likewise."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    intrinsics: str | None = field(default=None, metadata=ABSENT)
    video: str | tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """From the scene file's folder; several files, folders or patterns of one recording."""
    video_names: str | None = field(default=None, metadata=ABSENT)
    video_times: str | None = field(default=None, metadata=ABSENT)
    tracks: str | None = field(default=None, metadata=ABSENT)
    detections: str | None = field(default=None, metadata=ABSENT)
    keypoints: str | None = field(default=None, metadata=ABSENT)
    fps: Annotated[float, Field(gt=0)] | None = field(default=None, metadata=ABSENT)
    rotate: int | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredAssociation:
    """`[association]`, likewise."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    mode: str | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredScale:
    """`[scale]`, likewise."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    person_height_m: float | None = field(default=None, metadata=ABSENT)
    person_height_sd_m: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredSites:
    """`[sites]`, likewise."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    groups: tuple[tuple[str, ...], ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredScene:
    """The scene file as it was read, with the values that it leaves out."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    scene: DeclaredTimes = field(default_factory=DeclaredTimes)
    cameras: Mapping[str, DeclaredCamera] = field(default_factory=dict)
    perception: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    association: DeclaredAssociation = field(default_factory=DeclaredAssociation)
    solver: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    scale: DeclaredScale = field(default_factory=DeclaredScale)
    world: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    sites: DeclaredSites | None = field(default=None, metadata=ABSENT)
