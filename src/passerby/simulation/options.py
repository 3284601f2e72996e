"""The options of a simulated scene, and the three presets.

An activity has a range for each quantity, and each episode draws its values from the ranges. A preset is a mix of activities in
an area.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from passerby.common.errors import InputError
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.simulation.lenses import LENSES, TYPICAL

MAX_CLOCK_OFFSET_S = 5.0
"""Motion is simulated this long before the first and after the last instant, so that every clock sees moving people."""
EMBEDDINGS = ("none", "distinct", "alike")
MIN_PEOPLE = 4
"""Minimum number of people in each area of a scene with several groups: fewer would test the effect of few people instead."""
Range = tuple[float, float]
ZERO: Range = (0.0, 0.0)


@dataclass(frozen=True)
class SimulationOptions:
    """Options of `simulate`. Raises `InputError` for a value out of range.

    If `cameras`, `people` or `camera_height_m` is None, the preset's value is used.
    """

    preset: str = "terrace"
    """terrace | basketball | construction."""
    seed: int = 0
    cameras: int | None = None
    people: int | None = None
    seconds: float = 40.0
    fps: float = 5.0
    """Instants per second. Five are enough: neighbouring frames of a video add little independent information."""
    camera_height_m: float | None = None
    person_height_mean_m: float = PERSON_HEIGHT_M
    person_height_sd_m: float = PERSON_HEIGHT_SD_M
    occlusion: bool = True
    """People hide each other: no box if over 60 % is hidden; half of the partly hidden people get a box of the visible part."""
    box_noise: float = 0.0
    """Standard deviation of each of a box's four edges, as a fraction of the box height (Gaussian, independent)."""
    corner_noise_px: float = 0.0
    """Uniform noise of plus or minus this many pixels on each coordinate of the two corners (the paper's robustness table)."""
    box_slack: float = 0.0
    """A detector's slack: each edge is moved outwards by this fraction of the box height."""
    missing: float = 0.0
    """Fraction of the boxes (and of their joints) that are dropped at random."""
    false_boxes: float = 0.0
    """Expected number of boxes without a person, as a fraction of the true ones; their identity is -1."""
    identity_swaps: float = 0.0
    """Fraction of the people of each camera and instant whose identities are exchanged among each other."""
    clock_offsets: float | tuple[float, ...] = 0.0
    """Time offsets, seconds. One number: each camera but the first gets a constant offset drawn from plus or minus this number.
    Several: one per camera.

    Frame f of a camera with offset d shows the world at time (f - 1) / fps + d.
    """
    joint_noise_px: float = 0.0
    """Standard deviation of the joints' pixels (Gaussian)."""
    unrelated_ids: bool = False
    """Whether each camera numbers its people on its own: identities are then tracklet numbers, without meaning elsewhere."""
    tracklet_seconds: float = 0.0
    """Mean of the random, exponential lengths of tracklets. They are also cut if a person is not seen for over a second.

    0: one tracklet for each person and camera. Needs `unrelated_ids`.
    """
    embeddings: str = "none"
    """none | distinct (appearance distinguishes people about as well as re-identification) | alike (it does not)."""
    camera_fps: tuple[float, ...] = ()
    """Frames per second of each camera; empty: all have `fps`. If given, the observations hold clocks without offsets."""
    groups: tuple[int, ...] = ()
    """Number of cameras of each group; each group has its own area, without common ground, and its share of the people."""

    lenses: str = TYPICAL
    """typical (common surveillance lenses) | varied (any field of view from 28 to 90 degrees, up to strong distortion) | shared
    (as varied, one for all)."""

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            known = ", ".join(PRESETS)
            raise InputError(
                f"preset {self.preset!r} does not exist: choose one of {known}, or airport for a site of many cameras"
            )
        _check("seed", self.seed, 0, 2**63 - 1)
        _check("cameras", self.n_cameras, 1, 64)
        _check("people", self.n_people, 1, 200)
        _check("fps", self.fps, 0.1, 100.0)
        _check("seconds", self.seconds, 1.0 / self.fps, 3600.0)
        _check("camera_height_m", self.camera_height, 0.3, 50.0)
        _check("person_height_mean_m", self.person_height_mean_m, 0.5, 2.5)
        _check("person_height_sd_m", self.person_height_sd_m, 0.0, 0.15 * self.person_height_mean_m)
        _check("box_noise", self.box_noise, 0.0, 0.5)
        _check("corner_noise_px", self.corner_noise_px, 0.0, 200.0)
        _check("box_slack", self.box_slack, -0.2, 0.5)
        _check("missing", self.missing, 0.0, 1.0)
        _check("false_boxes", self.false_boxes, 0.0, 10.0)
        _check("identity_swaps", self.identity_swaps, 0.0, 1.0)
        _check("joint_noise_px", self.joint_noise_px, 0.0, 200.0)
        if isinstance(self.clock_offsets, int | float):
            _check("clock_offsets", self.clock_offsets, 0.0, MAX_CLOCK_OFFSET_S)
        else:
            object.__setattr__(self, "clock_offsets", tuple(float(offset) for offset in self.clock_offsets))
            self._check_count("clock_offsets", len(self.clock_offsets), "or a single largest offset")
            for offset in self.clock_offsets:
                _check("clock_offsets", offset, -MAX_CLOCK_OFFSET_S, MAX_CLOCK_OFFSET_S)
        if self.lenses not in LENSES:
            raise InputError(f"lenses {self.lenses!r} do not exist: choose one of {', '.join(LENSES)}")
        self._check_tracklets()
        object.__setattr__(self, "camera_fps", tuple(float(fps) for fps in self.camera_fps))
        if self.camera_fps:
            self._check_count("camera_fps", len(self.camera_fps), "or none, where all cameras have the scene's fps")
            for fps in self.camera_fps:
                _check("camera_fps", fps, 0.1, 100.0)
        self._check_groups()

    def _check_count(self, name: str, count: int, otherwise: str) -> None:
        if count != self.n_cameras:
            raise InputError(f"{name} has {count} values for {self.n_cameras} cameras: give one per camera, {otherwise}")

    def _check_tracklets(self) -> None:
        _check("tracklet_seconds", self.tracklet_seconds, 0.0, 3600.0)
        if self.tracklet_seconds > 0 and not self.unrelated_ids:
            raise InputError(
                f"tracklet_seconds = {self.tracklet_seconds:g} would cut identities that are the same in all cameras: "
                "set unrelated_ids, or tracklet_seconds = 0"
            )
        if self.embeddings not in EMBEDDINGS:
            raise InputError(f"embeddings {self.embeddings!r} do not exist: choose one of {', '.join(EMBEDDINGS)}")

    def _check_groups(self) -> None:
        object.__setattr__(self, "groups", tuple(self.groups))
        for count in self.groups:
            _check("groups", count, 1, 64)
            if count != int(count):
                raise InputError(f"groups holds {count}: give whole numbers of cameras")
        object.__setattr__(self, "groups", tuple(int(count) for count in self.groups))
        if self.groups and sum(self.groups) != self.n_cameras:
            raise InputError(
                f"groups = {list(self.groups)} are {sum(self.groups)} cameras, but there are {self.n_cameras}: "
                f"give groups that add up to {self.n_cameras}, or cameras = {sum(self.groups)}"
            )
        if len(self.groups) > 1 and self.n_people < MIN_PEOPLE * len(self.groups):
            raise InputError(
                f"people = {self.n_people} are too few for {len(self.groups)} groups: give {MIN_PEOPLE} or more for each"
            )

    @property
    def scene(self) -> Preset:
        """The preset that these options name."""
        return PRESETS[self.preset]

    @property
    def n_cameras(self) -> int:
        """Number of cameras; by default the preset's."""
        return self.scene.cameras if self.cameras is None else self.cameras

    @property
    def n_people(self) -> int:
        """Number of people; by default the preset's."""
        return self.scene.people if self.people is None else self.people

    @property
    def camera_height(self) -> float:
        """Height of the cameras above the ground, metres; by default the preset's."""
        return self.scene.camera_height_m if self.camera_height_m is None else self.camera_height_m

    @property
    def n_frames(self) -> int:
        """Number of instants, at least one."""
        return max(1, round(self.seconds * self.fps))

    @property
    def frame_rates(self) -> tuple[float, ...]:
        """Frames per second of each camera."""
        return self.camera_fps or (self.fps,) * self.n_cameras

    @property
    def group_sizes(self) -> tuple[int, ...]:
        """Number of cameras of each group; by default one group."""
        return self.groups or (self.n_cameras,)


def _check(name: str, value: float, low: float, high: float) -> None:
    if not np.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name} = {value} is out of range: give a value from {low:g} to {high:g}")


@dataclass(frozen=True)
class Activity:
    """An activity of a person; each pair is the range from which an episode's value is drawn."""

    name: str
    share: float
    """Share of a person's time, relative to the other activities of the preset."""
    seconds: Range
    """Length of an episode, seconds."""
    speed: Range = ZERO
    """Speed along the path, metres per second."""
    crouch: Range = ZERO
    """0: the person stands; 1: squats, with the hips at a fifth of the body height."""
    lean: Range = ZERO
    """Forward lean of the trunk, radians."""
    seat: Range = ZERO
    """0: the hips are above the feet; 1: behind the feet, as on a chair."""
    raised: Range = ZERO
    """0: the right arm hangs; 1: it is stretched overhead."""
    both_arms: bool = False
    """Whether the left arm is raised as well."""
    carry: Range = ZERO
    """1: both arms hold a load in front of the body."""
    jump: Range = ZERO
    """Height of the jumps, metres; one jump about every two seconds."""


@dataclass(frozen=True)
class Preset:
    """Area, cameras and people of a scene."""

    area_m: tuple[float, float]
    """Extent along x and y, metres, centred on the world's origin."""
    cameras: int
    camera_height_m: float
    standoff_m: float
    """Distance of the cameras from the area along x and y, metres."""
    picture: tuple[int, int]
    """(width, height), pixels."""
    people: int
    entering: float
    """Share of the people who enter after the start."""
    activities: tuple[Activity, ...]


_STAND = Activity("stand", 0.15, (1.5, 4.0))
_WALK = Activity("walk", 0.85, (5.0, 15.0), speed=(0.8, 1.6))
PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "terrace": Preset(
            area_m=(7.0, 11.0),
            cameras=4,
            camera_height_m=2.0,
            standoff_m=1.5,
            picture=(720, 576),
            people=7,
            entering=0.3,
            activities=(_WALK, _STAND),
        ),
        "basketball": Preset(
            area_m=(17.5, 22.0),
            cameras=4,
            camera_height_m=2.0,
            standoff_m=2.0,
            picture=(720, 576),
            people=14,
            entering=0.0,
            activities=(
                Activity("run", 0.40, (2.0, 5.0), speed=(2.0, 4.0)),
                Activity("walk", 0.20, (2.0, 6.0), speed=(0.8, 1.6)),
                Activity("stand", 0.10, (1.0, 3.0)),
                Activity("jump", 0.08, (2.0, 4.0), raised=(0.5, 1.0), both_arms=True, jump=(0.25, 0.5)),
                Activity("shoot", 0.10, (2.0, 3.0), raised=(0.8, 1.0), jump=(0.1, 0.35)),
                Activity("crouch", 0.12, (1.5, 4.0), crouch=(0.3, 0.6), lean=(0.2, 0.6)),
            ),
        ),
        "construction": Preset(
            area_m=(22.0, 28.0),
            cameras=4,
            camera_height_m=3.0,
            standoff_m=2.0,
            picture=(1352, 760),
            people=20,
            entering=0.1,
            activities=(
                Activity("stand", 0.20, (2.0, 6.0)),
                Activity("walk", 0.30, (4.0, 12.0), speed=(0.8, 1.5)),
                Activity("carry", 0.15, (4.0, 10.0), speed=(0.7, 1.2), lean=(0.0, 0.15), carry=(0.8, 1.0)),
                Activity("squat", 0.20, (3.0, 10.0), crouch=(0.6, 1.0), lean=(0.4, 0.8)),
                Activity("bend", 0.10, (2.0, 5.0), crouch=(0.1, 0.4), lean=(0.7, 1.2)),
                Activity("sit", 0.05, (5.0, 10.0), crouch=(0.7, 0.85), lean=(0.0, 0.3), seat=(1.0, 1.0)),
            ),
        ),
    }
)
"""The presets by name: terrace (80 m2), basketball (350 m2), construction (600 m2)."""
