"""Trajectories of all people over the ground, from a calibrated rig and boxes with identities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError, InputError
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes, Clock, Observations
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import find_common_time_steps, resample_to_common_steps
from passerby.core.trajectories import Trajectories
from passerby.people.model import Priors
from passerby.people.sightings import Sightings, box_sightings
from passerby.people.trajectories.identity_trajectory import estimate_identity_trajectories
from passerby.people.trajectories.pairwise import pairwise_points

Method = Literal["smoothed", "pairwise"]
_Own = Sequence[tuple[Ints, Floats]]
"""One identity's frames (K,) and boxes (K, 4) in each camera."""

METHODS: tuple[Method, ...] = ("smoothed", "pairwise")
STAGE = "estimating trajectories"
BOXES_AT_ONCE = 50_000
"""Boxes of people that are processed together: smoothing many at once is quicker, and memory stays at some 100 MB."""


@dataclass(frozen=True)
class TrackOptions:
    """Options of tracking. Raises `InputError` for an invalid value."""

    method: Method = "smoothed"
    """smoothed: bodies of upright people from all cameras that agree, or from one camera, smoothed over time; pairwise: the
    paper's mean of the pairwise triangulations of box centres, instant by instant."""
    max_gap_s: float = 2.0
    """Longest gap without an agreeing box that is bridged, seconds. Its instants are marked; after a longer gap a new part
    begins. A person who walks steadily deviates 0.7 m from a straight line in the middle of the gap."""
    person_height_m: float = PERSON_HEIGHT_M
    """Typical standing height, in the rig's metres."""
    foot_shift: float = Priors().foot_shift
    """Distance by which the lowest visible point of a body is nearer to the camera than its axis, as a share of its height."""
    min_instants: int = 3
    """Number of instants with a box below which a part is left out: so few do not determine a trajectory."""

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method {self.method!r} does not exist: choose one of {', '.join(METHODS)}")
        for name, value, low, high in (
            ("max_gap_s", self.max_gap_s, 0.0, 60.0), ("person_height_m", self.person_height_m, 0.5, 2.5),
            ("foot_shift", self.foot_shift, 0.0, 0.3), ("min_instants", self.min_instants, 1, 10**6),
        ):  # fmt: skip
            if not low <= value <= high:
                raise InputError(f"{name} = {value:g} is out of range: give a number from {low:g} to {high:g}")


COLUMNS = ("identity", "frame", "time_s", "xyz", "sigma_m", "cameras", "part")


def trajectories(
    rig: Rig, observations: Observations, clocks: Mapping[str, Clock], options: TrackOptions | None = None, *,
    tell: Progress = silent,
) -> Trajectories:  # fmt: skip
    """Estimate the trajectories of all people over the ground.

    Cameras whose clocks differ are brought to common instants first (`resample_to_common_steps`). Then each identity is
    processed independently. The boxes of an instant and of its neighbours vote for the person's position; boxes that disagree
    (of another or a half hidden person) are left out; a body on the ground is fitted to the others; positions are smoothed.

    Args:
        rig: cameras without a pose are left out.
        observations: boxes with identities that hold across cameras; those without one (-1) are left out.
        clocks: clock of every camera of the rig that has a pose.
        options: see `TrackOptions`.
        tell: called for each person that is done.

    Raises:
        EvidenceError: no camera has a pose, or no box in a posed camera has an identity.
        InputError: a camera without a clock, an identity twice in one frame.
    """
    options = options or TrackOptions()
    posed = rig.posed()
    names = [name for name in posed.names if name in observations.cameras]
    if not names:
        raise EvidenceError("no camera with a pose has boxes: there is nothing to track people by")
    sizes = {name: posed[name].lens.size for name in names}
    watched = Observations({name: observations[name] for name in names}, observations.fps)
    steps = find_common_time_steps(watched, clocks)
    clock = steps.clock
    common = resample_to_common_steps(watched, clocks, sizes=sizes, grid=clock)
    boxes = [_identified(common[name].boxes) for name in names]
    frames = np.unique(np.concatenate([seen.frame for seen in boxes]))
    if not len(frames):
        raise EvidenceError("no box in a camera with a pose has an identity: no person can be tracked")
    cameras = [posed[name] for name in names]
    people = np.unique(np.concatenate([seen.identity for seen in boxes]))
    order = [np.lexsort((seen.frame, seen.identity)) for seen in boxes]
    boxes = [seen.take(rows) for seen, rows in zip(boxes, order, strict=True)]
    found: list[_Person] = []
    tell(STAGE, 0, len(people))
    one = _followed if options.method == "smoothed" else _paired
    for group in _groups(people, boxes):
        own = [[_of_person(seen, int(identity)) for seen in boxes] for identity in group]
        found += one(group, cameras, own, frames, clock, options)
        tell(STAGE, len(found), len(people))
    columns: dict[str, Any] = {name: np.concatenate([person.columns[name] for person in found]) for name in COLUMNS}
    columns["frame"] = steps.frames(columns["frame"])
    joined = Trajectories(**columns, clock=steps.reference)
    return replace(joined, figures=_figures(joined, names, found, options))


def _identified(boxes: Boxes) -> Boxes:
    """Return the boxes with an identity, without embeddings."""
    rows = np.flatnonzero(boxes.identity != UNKNOWN)
    return Boxes(boxes.frame[rows], boxes.identity[rows], boxes.ltwh[rows], boxes.score[rows])


def _of_person(boxes: Boxes, identity: int) -> tuple[Ints, Floats]:
    """Return frames (K,) and boxes (K, 4) of one identity; `boxes` are sorted by identity, then by frame."""
    low, high = np.searchsorted(boxes.identity, [identity, identity + 1])
    return boxes.frame[low:high], boxes.ltwh[low:high]


@dataclass(frozen=True, eq=False)
class _Person:
    """One identity's part of the result."""

    columns: dict[str, NDArray[Any]]
    boxes: Ints
    """(C,) number of its boxes in each camera."""
    used: Ints
    """(C,) number of the boxes that are used."""
    misses: list[Floats]
    """By camera: distances of the rays of used boxes from the body's middle, metres, where two cameras or more agree."""
    fleeting: int
    """Number of parts left out because they have too few instants."""


def _groups(people: Ints, boxes: Sequence[Boxes]) -> list[Ints]:
    """Group people for processing: each group has about `BOXES_AT_ONCE` boxes, and one person at least."""
    count = np.sum([np.diff(np.searchsorted(seen.identity, np.append(people, people[-1] + 1))) for seen in boxes], axis=0)
    number = np.cumsum(count) // BOXES_AT_ONCE
    return np.split(people, np.flatnonzero(np.diff(number)) + 1)


def _followed(
    people: Ints, cameras: Sequence[Camera], own: Sequence[_Own], frames: Ints, clock: Clock, options: TrackOptions
) -> list[_Person]:
    """Track some identities by the smoothed method."""
    seen = [_seen(cameras, identity, boxes, clock) for identity, boxes in zip(people.tolist(), own, strict=True)]
    ways = estimate_identity_trajectories(
        seen, clock.seconds(frames), options.max_gap_s, options.person_height_m, options.foot_shift
    )
    found = []
    for identity, boxes, one, way in zip(people.tolist(), own, seen, ways, strict=True):
        xyz = np.column_stack([way.xy, way.middle])
        columns = _columns(identity, frames[way.row], clock, xyz, way.sigma, way.cameras, way.part)
        columns, fleeting = _without_fleeting(columns, options.min_instants)
        agreeing = np.bincount(one.block[way.accepted], minlength=one.n_blocks)[one.block]
        several = way.accepted & (agreeing > 1)
        misses = [way.miss_m[several & (one.camera == c)] for c in range(len(cameras))]
        used = np.bincount(one.camera[way.accepted], minlength=len(cameras))
        found.append(_Person(columns, np.array([len(frame) for frame, _ in boxes]), used, misses, fleeting))
    return found


def _seen(cameras: Sequence[Camera], identity: int, own: _Own, clock: Clock) -> Sightings:
    """Return one identity's boxes as rays; boxes for which the lens gives no rays are left out."""
    seen = Sightings.joined([
        box_sightings(camera, number, frame, np.full(len(frame), identity), ltwh)
        for number, (camera, (frame, ltwh)) in enumerate(zip(cameras, own, strict=True))
    ])  # fmt: skip
    rows = np.lexsort((seen.camera, seen.step))
    seen = seen.take(rows[seen.known[rows]])
    return replace(seen, block=np.unique(seen.step, return_inverse=True)[1].ravel(), seconds=clock.seconds(seen.step))


def _paired(
    people: Ints, cameras: Sequence[Camera], own: Sequence[_Own], frames: Ints, clock: Clock, options: TrackOptions
) -> list[_Person]:
    """Track some identities by the pairwise method."""
    found = []
    for identity, boxes in zip(people.tolist(), own, strict=True):
        present = np.unique(np.concatenate([frame for frame, _ in boxes]))
        ltwh = np.full((len(present), len(cameras), 4), np.nan)
        for c, (frame, of_camera) in enumerate(boxes):
            ltwh[np.searchsorted(present, frame), c] = of_camera
        point, spread = pairwise_points(cameras, ltwh)
        rows = np.flatnonzero(np.isfinite(point[:, 0]))
        seconds = clock.seconds(present[rows])
        part = np.cumsum(np.diff(seconds, prepend=seconds[:1]) > options.max_gap_s + 1e-9).astype(np.int64)
        seen = np.isfinite(ltwh[:, :, 0]).astype(np.int64)
        number = np.asarray(seen[rows].sum(axis=1), dtype=np.int64)
        columns = _columns(identity, present[rows], clock, point[rows], spread[rows], number, part)
        columns, fleeting = _without_fleeting(columns, options.min_instants)
        nothing: list[Floats] = [np.zeros(0) for _ in cameras]
        found.append(_Person(columns, seen.sum(axis=0), seen[rows].sum(axis=0), nothing, fleeting))
    return found


def _columns(
    identity: int, frame: Ints, clock: Clock, xyz: Floats, sigma: Floats, cameras: Ints, part: Ints
) -> dict[str, NDArray[Any]]:
    """Return the columns of one identity."""
    return {
        "identity": np.full(len(frame), identity, dtype=np.int64), "frame": frame, "time_s": clock.seconds(frame), "xyz": xyz,
        "sigma_m": sigma, "cameras": cameras, "part": part,
    }  # fmt: skip


def _without_fleeting(columns: dict[str, NDArray[Any]], least: int) -> tuple[dict[str, NDArray[Any]], int]:
    """Remove parts seen at too few instants and number the others from 1; return also the number of parts removed."""
    part = columns["part"]
    seen = np.bincount(part, columns["cameras"] > 0, minlength=int(part.max(initial=-1)) + 1)
    long = seen >= least
    kept = {name: values[long[part]] for name, values in columns.items()}
    kept["part"] = np.cumsum(long)[kept["part"]] if len(long) else kept["part"]
    return kept, int(np.count_nonzero(~long))


def _figures(found: Trajectories, names: Sequence[str], people: Sequence[_Person], options: TrackOptions) -> dict[str, Any]:
    """Return the figures of the result that need no ground truth."""
    boxes = np.sum([person.boxes for person in people], axis=0)
    used = np.sum([person.used for person in people], axis=0)
    misses = [np.concatenate([person.misses[c] for person in people]) for c in range(len(names))]
    return {
        "options": asdict(options),
        "people": len(found.people),
        "places": len(found),
        "filled": int(np.count_nonzero(found.cameras == 0)),
        "by_one_camera": int(np.count_nonzero(found.cameras == 1)),
        "fleeting_parts_left_out": sum(person.fleeting for person in people),
        "seconds": float(np.ptp(found.time_s)) if len(found) else 0.0,
        "median_sigma_m": _median(found.sigma_m[np.isfinite(found.sigma_m)]),
        "disagreement_m": _median(np.concatenate(misses)),
        "cameras": [
            {"name": name, "boxes": int(boxes[c]), "used": int(used[c]), "disagreement_m": _median(misses[c])}
            for c, name in enumerate(names)
        ],
        "ways": ways(found),
    }


def ways(found: Trajectories) -> list[dict[str, Any]]:
    """Return time span, parts, sizes and length of each person's trajectory. Its length is summed over steps of a second."""
    out = []
    for identity in found.people:
        rows = np.flatnonzero(found.identity == identity)
        seconds, part = found.time_s[rows], found.part[rows]
        # Steps of less than a second would add up the noise of the positions.
        kept = np.flatnonzero(np.diff(np.floor(seconds) + 1e6 * part, prepend=-1.0, append=np.inf)[:-1] != 0)
        kept = np.unique(np.append(kept, len(rows) - 1))
        step = np.linalg.norm(np.diff(found.xyz[rows[kept], :2], axis=0), axis=1)
        together = np.diff(part[kept]) == 0
        out.append({
            "id": int(identity), "from_s": float(seconds[0]), "to_s": float(seconds[-1]), "parts": int(part[-1]),
            "places": len(rows), "filled": int(np.count_nonzero(found.cameras[rows] == 0)),
            "length_m": float(step[together].sum()), "median_sigma_m": _median(found.sigma_m[rows]),
        })  # fmt: skip
    return out


def _median(values: Floats) -> float | None:
    """Return the median of the finite values; None where there are none."""
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
