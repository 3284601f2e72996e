"""Comparison of two rigs of the same cameras by people: the rig that places people more consistently, and the difference.

For each rig, each camera's people are compared with their places by the other cameras (`one_against_others`). Residuals of one
person are correlated over time, so the recording is divided into stretches. The difference of the two rigs is computed for each
camera and stretch; its sigma is computed from the differences between stretches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import Observations
from passerby.core.synchronisation import USUAL_FPS
from passerby.evaluation.metrics import place
from passerby.people.one_against_others import CameraDisagreements, disagreements

STRETCH_S = 10.0
FEWEST = 20
"""Minimum number of sightings in a camera and stretch, for a median."""
FEWEST_STRETCHES = 4
"""Minimum number of stretches, for a sigma."""
SURE_SIGMAS = 2.0
"""A difference is significant above this number of sigmas."""

Better = Literal["first", "second", "neither"]


@dataclass(frozen=True, kw_only=True)
class RigOnPeople:
    """Consistency of one rig on the people of a recording."""

    median_px: float | None
    """Median distance of people, in all cameras, from the projections of their places by the other cameras. None: behind the
    camera; likewise for the other fields."""
    p90_px: float | None
    ground_50_m: float | None
    """Median distance on the ground between a person's place by one camera and that by the other cameras, metres."""
    ground_90_m: float | None


@dataclass(frozen=True, kw_only=True)
class CameraOnPeople:
    """Median distances of the people in one camera with each rig, and the number of sightings."""

    first_px: float | None
    second_px: float | None
    sightings: int


@dataclass(frozen=True, kw_only=True)
class PeopleComparison:
    """Comparison of two rigs on the same people."""

    first: RigOnPeople
    second: RigOnPeople
    cameras: Mapping[str, CameraOnPeople]
    difference_px: float
    """Median residual of the second rig minus that of the first, mean over stretches: above 0 if the first is better."""
    sigma_px: float | None
    """One sigma of the difference; None for fewer than `FEWEST_STRETCHES`."""
    stretches: int
    better: Better
    """The rig that is better by more than `SURE_SIGMAS`."""

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain values for JSON."""
        return asdict(self)


def compare_on_people(
    first: Rig, second: Rig, instants: Observations, person_height_m: float, *, shape: bool = False
) -> PeopleComparison:
    """Compare two rigs of the same cameras on the people of a recording that was used for neither of them.

    Args:
        first: first rig; metres, z up, ground at z = 0.
        second: second rig, likewise. Cameras with a pose in only one of the two are left out.
        instants: people at common time steps, with the same identities in all cameras.
        person_height_m: typical standing height.
        shape: first move the second rig onto the first by the best similarity, so that its frame and scale do not count.

    Raises:
        InputError: fewer than two cameras in common.
        EvidenceError: too few people that two of the cameras see.
    """
    shared = [name for name in first.posed().names if name in second.posed().names and name in instants.cameras]
    if len(shared) < 2:
        few = "one camera" if shared else "no camera"
        raise InputError(f"the rigs and the people have {few} in common that both rigs have a pose of: two are needed, by name")
    one, two = (Rig(tuple(rig[name] for name in shared)) for rig in (first, second))
    if shape:
        found = place([_pose(camera) for camera in two], [_pose(camera) for camera in one])
        if found is None:
            raise InputError("the cameras that both rigs have fix no similarity: compare the rigs without --shape")
        two = two.moved(found.rotation, found.translation, found.scale)
    fps = instants.fps or USUAL_FPS
    sides = [disagreements(rig, instants, person_height_m) for rig in (one, two)]
    medians: list[tuple[float, float]] = []
    stretch: list[int] = []
    for name in shared:
        numbers = [np.asarray(side[name].step // (STRETCH_S * fps)).astype(np.int64) for side in sides]
        for number in np.unique(np.concatenate(numbers)):
            values = [side[name].pixels[of == number] for side, of in zip(sides, numbers, strict=True)]
            if min(map(len, values)) >= FEWEST:
                medians.append((_find_percentile(values[0], 50) or np.inf, _find_percentile(values[1], 50) or np.inf))
                stretch.append(int(number))
    if not medians:
        raise EvidenceError(
            f"the recording has too few people whom two cameras see at once: {FEWEST} are needed in {STRETCH_S:g} s of a camera"
        )
    difference, sigma, count = _difference(np.array(medians), np.array(stretch))
    cameras = {
        name: CameraOnPeople(
            first_px=_find_percentile(sides[0][name].pixels, 50), second_px=_find_percentile(sides[1][name].pixels, 50),
            sightings=len(sides[0][name]),
        )
        for name in shared
        if len(sides[0][name]) and len(sides[1][name])
    }  # fmt: skip
    sure = sigma is not None and abs(difference) > SURE_SIGMAS * sigma
    better: Better = ("first" if difference > 0 else "second") if sure else "neither"
    return PeopleComparison(
        first=_compare_on_people(sides[0]), second=_compare_on_people(sides[1]), cameras=cameras, difference_px=difference,
        sigma_px=sigma, stretches=count, better=better,
    )  # fmt: skip


def _difference(medians: Floats, stretch: Ints) -> tuple[float, float | None, int]:
    """Compute the mean difference over the stretches, its sigma, and the number of stretches.

    Args:
        medians: (K, 2) medians of both rigs, pixels.
        stretch: (K,) stretch of each row; the mean over the cameras of a stretch counts as one value.
    """
    largest = float(np.max(medians, initial=1.0, where=np.isfinite(medians)))
    gain = np.diff(np.minimum(medians, 10 * largest), axis=1)[:, 0]
    _, group = np.unique(stretch, return_inverse=True)
    means = np.bincount(group, gain) / np.bincount(group)
    count = len(means)
    sigma = float(means.std(ddof=1) / np.sqrt(count)) if count >= FEWEST_STRETCHES else None
    return float(means.mean()), sigma, count


def _compare_on_people(side: Mapping[str, CameraDisagreements]) -> RigOnPeople:
    every = CameraDisagreements.joined(list(side.values()))
    return RigOnPeople(
        median_px=_find_percentile(every.pixels, 50), p90_px=_find_percentile(every.pixels, 90),
        ground_50_m=_find_percentile(every.metres, 50),
        ground_90_m=_find_percentile(every.metres, 90),
    )  # fmt: skip


def _find_percentile(values: Floats, percent: float) -> float | None:
    """Compute a percentile of the values; None if it is infinite."""
    found = float(np.percentile(values, percent, method="inverted_cdf"))
    return found if np.isfinite(found) else None


def _pose(camera: Camera) -> Pose:
    assert camera.pose is not None
    return camera.pose
