"""What a user may choose about a simulated site."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.errors import InputError
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.simulation.lenses import TYPICAL
from passerby.simulation.options import SimulationOptions

SITES = ("airport",)
"""Presets that are sites."""
LEAST_CAMERAS, MOST_CAMERAS = 8, 1000
PEOPLE_PER_CAMERA = 2
"""Two people a camera: each camera then sees three to five people at a time, as several cameras see each person."""
MOST_PER_CAMERA = 10


@dataclass(frozen=True)
class SiteOptions:
    """Options of `simulate_site`; those that `SimulationOptions` has too mean the same. Raises `InputError` for bad values.

    Identities are always tracklet numbers of each camera's own.
    """

    preset: str = "airport"
    seed: int = 0
    cameras: int = 24
    people: int | None = None
    """`PEOPLE_PER_CAMERA` for each camera unless given."""
    seconds: float = 600.0
    fps: float = 5.0
    camera_height_m: float = 3.5
    person_height_mean_m: float = PERSON_HEIGHT_M
    person_height_sd_m: float = PERSON_HEIGHT_SD_M
    occlusion: bool = True
    box_noise: float = 0.0
    corner_noise_px: float = 0.0
    box_slack: float = 0.0
    missing: float = 0.0
    false_boxes: float = 0.0
    identity_swaps: float = 0.0
    clock_offsets: float = 5.0
    """Each camera but the first gets a constant offset drawn from plus or minus so many seconds."""
    tracklet_seconds: float = 0.0
    embeddings: str = "none"
    lenses: str = TYPICAL

    def __post_init__(self) -> None:
        if self.preset not in SITES:
            raise InputError(f"preset {self.preset!r} is no site: choose one of {', '.join(SITES)}")
        _check_count("cameras", self.cameras, LEAST_CAMERAS, MOST_CAMERAS)
        _check_count("people", self.n_people, self.cameras // 2, MOST_PER_CAMERA * self.cameras)
        if not isinstance(self.clock_offsets, int | float):
            raise InputError("clock_offsets of a site is a single largest offset, not one per camera: give one number")
        if not 2.0 <= self.camera_height_m <= 10.0:
            raise InputError(f"camera_height_m = {self.camera_height_m} is out of range: give a value from 2 to 10")
        _ = self.faults  # Every other option is checked where a scene's are.

    @property
    def n_people(self) -> int:
        """The number of people."""
        return PEOPLE_PER_CAMERA * self.cameras if self.people is None else self.people

    @property
    def n_frames(self) -> int:
        """The number of time steps, at least one."""
        return self.faults.n_frames

    @property
    def faults(self) -> SimulationOptions:
        """The same recording and the same faults as options of a scene."""
        return SimulationOptions(
            seed=self.seed, seconds=self.seconds, fps=self.fps, occlusion=self.occlusion, box_noise=self.box_noise,
            corner_noise_px=self.corner_noise_px, box_slack=self.box_slack, missing=self.missing, false_boxes=self.false_boxes,
            identity_swaps=self.identity_swaps, clock_offsets=self.clock_offsets, unrelated_ids=True,
            tracklet_seconds=self.tracklet_seconds, embeddings=self.embeddings, lenses=self.lenses,
            person_height_mean_m=self.person_height_mean_m, person_height_sd_m=self.person_height_sd_m,
        )  # fmt: skip

    def rng(self, *purpose: int) -> np.random.Generator:
        """The generator of one purpose, and of one camera or person of it: no draw depends on how many others there are."""
        return np.random.default_rng((self.seed, 9, *purpose))


def _check_count(name: str, value: int, low: int, high: int) -> None:
    if value != int(value) or not low <= value <= high:
        raise InputError(f"{name} = {value} is out of range: give a whole number from {low} to {high}")
