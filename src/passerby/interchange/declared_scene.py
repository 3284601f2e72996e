"""The scene file as `calibration.json` stores it. Only keys that are read again are declared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from pydantic import ConfigDict, Field

from passerby.common.arrays import ABSENT

OPEN_TABLE = ConfigDict(strict=True, allow_inf_nan=False, extra="allow")
"""Configuration of tables of which only some keys are declared; the other keys are kept unchanged."""


@dataclass(frozen=True, kw_only=True)
class DeclaredTimes:
    """Table `[scene]` of the scene file."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    name: str | None = field(default=None, metadata=ABSENT)
    fps: Annotated[float, Field(gt=0)] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredCamera:
    """Table `[cameras.NAME]` of the scene file."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    intrinsics: str | None = field(default=None, metadata=ABSENT)
    video: str | tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """Path relative to the scene file's folder, or several files, folders or patterns of one recording."""
    video_names: str | None = field(default=None, metadata=ABSENT)
    video_times: str | None = field(default=None, metadata=ABSENT)
    tracks: str | None = field(default=None, metadata=ABSENT)
    detections: str | None = field(default=None, metadata=ABSENT)
    keypoints: str | None = field(default=None, metadata=ABSENT)
    fps: Annotated[float, Field(gt=0)] | None = field(default=None, metadata=ABSENT)
    rotate: int | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredAssociation:
    """Table `[association]` of the scene file."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    mode: str | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredScale:
    """Table `[scale]` of the scene file."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    person_height_m: float | None = field(default=None, metadata=ABSENT)
    person_height_sd_m: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredSites:
    """Table `[sites]` of the scene file."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    groups: tuple[tuple[str, ...], ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class DeclaredScene:
    """The scene file as it was read, with defaults for the values that it omits."""

    __pydantic_config__: ClassVar[ConfigDict] = OPEN_TABLE
    scene: DeclaredTimes = field(default_factory=DeclaredTimes)
    cameras: Mapping[str, DeclaredCamera] = field(default_factory=dict)
    perception: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    association: DeclaredAssociation = field(default_factory=DeclaredAssociation)
    solver: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    scale: DeclaredScale = field(default_factory=DeclaredScale)
    world: Mapping[str, Any] | None = field(default=None, metadata=ABSENT)
    sites: DeclaredSites | None = field(default=None, metadata=ABSENT)
