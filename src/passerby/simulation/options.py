"""What a user may choose about a simulated scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.errors import InputError
from passerby.simulation.presets import PRESETS, Preset

MAX_CLOCK_OFFSET_S = 5.0
"""Motion is simulated this long before the first and after the last instant, so that every clock sees moving people."""


@dataclass(frozen=True)
class SimulationOptions:
    """Options of `simulate`. Raises `InputError` for a value out of range.

    None for `cameras`, `people` or `camera_height_m` takes the preset's.
    """

    preset: str = "terrace"
    """terrace | basketball | construction."""
    seed: int = 0
    cameras: int | None = None
    people: int | None = None
    seconds: float = 40.0
    fps: float = 5.0
    """Instants per second. Five are enough: neighbouring frames of a video add little that is independent."""
    camera_height_m: float | None = None
    person_height_mean_m: float = 1.72
    person_height_sd_m: float = 0.09
    occlusion: bool = True
    """People hide each other: no box where over 60 % is hidden, half of the partly hidden get a box of what is visible."""
    box_noise: float = 0.0
    """Standard deviation of each of a box's four edges, as a fraction of the box height (Gaussian, independent)."""
    corner_noise_px: float = 0.0
    """Uniform noise of plus or minus this many pixels on each coordinate of the two corners (the paper's robustness table)."""
    box_slack: float = 0.0
    """A detector's slack: every edge is moved outwards by this fraction of the box height."""
    missing: float = 0.0
    """Fraction of the boxes (and of the joints that go with them) that are dropped at random."""
    false_boxes: float = 0.0
    """Expected number of boxes without a person, as a fraction of the true ones; their identity is -1."""
    identity_swaps: float = 0.0
    """Fraction of the people of each camera and instant whose identities are exchanged among each other."""
    clock_offsets: float | tuple[float, ...] = 0.0
    """Seconds. A number: each camera but the first gets a constant offset drawn from plus or minus it. Several: one per camera.

    Frame f of a camera with offset d shows the world at time (f - 1) / fps + d.
    """
    joint_noise_px: float = 0.0
    """Standard deviation of the joints' pixels (Gaussian)."""

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise InputError(f"preset {self.preset!r} does not exist: choose one of {', '.join(PRESETS)}")
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
            return
        object.__setattr__(self, "clock_offsets", tuple(float(offset) for offset in self.clock_offsets))
        if len(self.clock_offsets) != self.n_cameras:
            raise InputError(
                f"clock_offsets has {len(self.clock_offsets)} values for {self.n_cameras} cameras: give one per camera, "
                "or a single largest offset"
            )
        for offset in self.clock_offsets:
            _check("clock_offsets", offset, -MAX_CLOCK_OFFSET_S, MAX_CLOCK_OFFSET_S)

    @property
    def scene(self) -> Preset:
        """The preset that these options name."""
        return PRESETS[self.preset]

    @property
    def n_cameras(self) -> int:
        """The number of cameras, the preset's unless given."""
        return self.scene.cameras if self.cameras is None else self.cameras

    @property
    def n_people(self) -> int:
        """The number of people, the preset's unless given."""
        return self.scene.people if self.people is None else self.people

    @property
    def camera_height(self) -> float:
        """Metres above the ground, the preset's unless given."""
        return self.scene.camera_height_m if self.camera_height_m is None else self.camera_height_m

    @property
    def n_frames(self) -> int:
        """The number of instants, at least one."""
        return max(1, round(self.seconds * self.fps))


def _check(name: str, value: float, low: float, high: float) -> None:
    if not np.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name} = {value} is out of range: give a value from {low:g} to {high:g}")
