"""People who walk on a plane, as levelled cameras above it see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.association.ground.ground_tracks import GroundTracks, ground_tracks
from passerby.common.arrays import Floats
from passerby.geometry.single_view import Level
from passerby.people.sightings import Sightings

Complexes = NDArray[np.complex128]

UP = np.array([0.0, -np.cos(0.3), -np.sin(0.3)])
"""Of a camera that looks down by 0.3 radians."""


@dataclass(frozen=True)
class Station:
    """A camera: `ground = scale * exp(i turn) * (world - place)`, and its clock shows `time + delay_s`."""

    turn: float = 0.0
    place: complex = 0j
    delay_s: float = 0.0
    scale: float = 1.0
    """Of its metres: how much higher it believes to be than it is."""
    fps: float = 5.0

    def ground(self, world: Complexes | complex) -> Complexes:
        return np.asarray(self.scale * np.exp(1j * self.turn) * (world - self.place))

    def motion_to(self, other: Station) -> tuple[complex, complex, float]:
        """The true turn, shift and lag from this camera's ground to another's."""
        turn = other.scale / self.scale * np.exp(1j * (other.turn - self.turn))
        return complex(turn), complex(other.ground(self.place)), other.delay_s - self.delay_s


@dataclass(frozen=True, eq=False)
class Walker:
    """Straight from point to point."""

    seconds: Floats
    points: Complexes

    def at(self, seconds: Floats) -> Complexes:
        x, y = (np.interp(seconds, self.seconds, part) for part in (self.points.real, self.points.imag))
        return np.asarray(x + 1j * y)


def walkers(n: int, rng: np.random.Generator, seconds: float = 40.0, *, half_m: float = 7.0) -> list[Walker]:
    """People who walk about a square around 0, at one pace each, from ten seconds before to ten after `seconds`."""
    found = []
    for _ in range(n):
        points = rng.uniform(-half_m, half_m, 80) + 1j * rng.uniform(-half_m, half_m, 80)
        arrival = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))]) / rng.uniform(1.0, 1.6) - 10.0
        assert arrival[-1] > seconds + 10.0
        found.append(Walker(arrival, points))
    return found


def standing(n: int, rng: np.random.Generator, *, half_m: float = 7.0) -> list[Walker]:
    """People who stay where they are."""
    places = rng.uniform(-half_m, half_m, n) + 1j * rng.uniform(-half_m, half_m, n)
    return [Walker(np.array([-10.0, 1000.0]), np.array([place, place])) for place in places]


def bodies_at(
    tracklet: Sequence[int] | NDArray[np.int64], seconds: Floats, ground: Complexes, height: float = 4.0
) -> Sightings:
    """People of a camera `height` metres high whose feet are at the given places of its levelled ground."""
    level = Level(UP, height, 0.0)
    rays = np.column_stack([ground.real, ground.imag, np.full(len(ground), -height)]) @ level.R_lc
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    n, none = len(ground), np.zeros(len(ground))
    return Sightings(
        np.zeros(n, np.int64), np.arange(n), np.asarray(tracklet, dtype=np.int64),
        seconds=np.asarray(seconds, dtype=np.float64), top=rays, bottom=rays, top_fraction=none + 1.0, bottom_fraction=none,
    )  # fmt: skip


def seen_by(
    station: Station, people: Sequence[Walker], rng: np.random.Generator, *, seconds: float = 40.0, noise_m: float = 0.1,
    noise_share: float = 0.02, cut_s: float = 1000.0, height: float = 4.0,
) -> GroundTracks:  # fmt: skip
    """Tracks of people in one camera; person p's tracklets are p, p + P, p + 2 P and so on, each `cut_s` long.

    Noise is normal: so many metres, and so much of the distance along the ray.
    """
    times = np.arange(int(seconds * station.fps)) / station.fps
    parts = []
    for number, walker in enumerate(people):
        place = station.ground(walker.at(times))
        place = place * (1.0 + noise_share * rng.standard_normal(len(times)))
        place = place + noise_m * (rng.standard_normal(len(times)) + 1j * rng.standard_normal(len(times)))
        parts.append((number + len(people) * np.floor(times / cut_s).astype(np.int64), times + station.delay_s, place))
    tracklet, shown, ground = (np.concatenate(column) for column in zip(*parts, strict=True))
    return ground_tracks(bodies_at(tracklet, shown, ground, height), Level(UP, height, 0.0))
