"""Test of many cameras: each is tested in a small rig with the cameras that saw most of its people.

A window of all cameras at once takes time and memory in proportion to the square of their number. But people give evidence on a
camera only together with the other cameras that saw them. So each camera is tested in its own small rig, with its partners, by
all bodies that it saw. The results for the partners are not used: they have their own small rigs.

If a partner has moved, a small rig may not show which of the two it was; the partner's other partners do. Cameras that may
have moved are therefore tested again without those partners that have significantly moved, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Ints
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.geometry.groups import expanded_ranges
from passerby.monitoring.evidence import MotionTest
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from passerby.monitoring.watching import joints_are_shared, watch, watch_adjusted
from passerby.monitoring.windows import STAGE
from passerby.people.ground import fit_ground
from passerby.people.sightings import Sightings

MOST_PARTNERS = 7
"""Largest number of partners of a camera: those that saw most of its people. With eight cameras all explanations of a window
can be tried."""
ROUNDS = 4
"""Largest number of times that cameras are tested again without partners that moved."""


@dataclass(frozen=True, eq=False)
class Site:
    """Cameras that chains of neighbours connect, and their observations."""

    rig: Rig
    observations: Observations
    """People with identities over these cameras, at common time steps."""
    seen: Sightings
    """The same people as rays."""
    height_m: float
    """Approximate height of the ground, metres."""


@dataclass(frozen=True, eq=False)
class _Job:
    """The test of a camera with its partners."""

    camera: str
    rig: Rig
    seen: Sightings
    observations: Observations
    """Observations of these cameras; empty without joints."""
    height_m: float
    options: WatchOptions
    span: tuple[float, float]


def watch_neighbourhoods(
    sites: Sequence[Site], names: tuple[str, ...], options: WatchOptions, span: tuple[float, float], *, tell: Progress,
    executor: Executor | None = None,
) -> Watched:  # fmt: skip
    """Test each camera with its partners.

    Args:
        sites: sets of connected cameras; no camera is in two of them.
        names: names of all cameras, including those without a neighbour, which are not tested.
        options: see `WatchOptions`.
        span: begin of the first window and end of the last one, seconds.
        tell: called with the number of cameras that are done.
        executor: processes cameras in parallel; the result does not depend on it.
    """
    of_camera = {name: bodies for site in sites for name, bodies in _bodies_by_camera(site).items()}
    without: dict[str, frozenset[str]] = dict.fromkeys(of_camera, frozenset())
    found = _watch_rigs(of_camera, without, options, span, executor, tell)
    for _ in range(ROUNDS):
        moved = {name for name, watched in found.items() if any(m.camera == name and not m.others for m in watched.moves)}
        wanted = {
            name: frozenset(moved & set(of_camera[name].partners))
            for name, watched in found.items()
            if without[name] or _claims(watched, name)
        }
        again = {name: gone for name, gone in wanted.items() if gone != without[name]}
        if not again:
            break
        without |= again
        found |= _watch_rigs(of_camera, again, options, span, executor, tell)
    return _join_results(found, names, span)


@dataclass(frozen=True, eq=False)
class _Bodies:
    """The sightings of one camera's people."""

    site: Site
    rows: Ints
    """Rows of the site's sightings, by all cameras, of the bodies that the camera saw."""
    partners: tuple[str, ...]
    """The other cameras that saw any of them, those that saw most first."""

    def job(self, name: str, without: Collection[str], options: WatchOptions, span: tuple[float, float]) -> _Job | None:
        """Return the job of the camera with its partners, except for some; None if no partner is left."""
        partners = [one for one in self.partners if one not in without][:MOST_PARTNERS]
        if not partners:
            return None
        site = self.site
        names = tuple(one for one in site.seen.names if one == name or one in partners)
        inside = np.isin(site.seen.names, names)
        seen = site.seen.of_cameras(names, self.rows[inside[site.seen.camera[self.rows]]])
        own = {one: site.observations[one] for one in names}
        observations = replace(
            site.observations, cameras=own if any(len(one.keypoints) for one in own.values()) else {},
            clocks={one: site.observations.clocks[one] for one in names},
        )  # fmt: skip
        rig = Rig(tuple(site.rig[one] for one in names))
        return _Job(name, rig, seen, observations, site.height_m, options, span)


def _bodies_by_camera(site: Site) -> dict[str, _Bodies]:
    """Find the sightings that give evidence on each camera: those of bodies that it and another camera saw."""
    seen = site.seen
    count = np.bincount(seen.block, minlength=seen.n_blocks)
    first = np.cumsum(count) - count
    by_camera = np.argsort(seen.camera, kind="stable")
    ends = np.searchsorted(seen.camera[by_camera], np.arange(len(seen.names) + 1))
    found = {}
    for number, name in enumerate(seen.names):
        groups = seen.block[by_camera[ends[number] : ends[number + 1]]]
        groups = groups[count[groups] > 1]
        _, rows = expanded_ranges(first[groups], count[groups])
        common = np.bincount(seen.camera[rows], minlength=len(seen.names))
        partners = [k for k in np.argsort(-common, kind="stable").tolist() if common[k] and k != number]
        found[name] = _Bodies(site, rows, tuple(seen.names[k] for k in partners))
    return found


def _watch_rigs(
    of_camera: Mapping[str, _Bodies], without: Mapping[str, Collection[str]], options: WatchOptions,
    span: tuple[float, float], executor: Executor | None, tell: Progress,
) -> dict[str, Watched]:  # fmt: skip
    """Test the small rigs of some cameras."""
    jobs = {name: of_camera[name].job(name, gone, options, span) for name, gone in without.items()}
    able = [job for job in jobs.values() if job is not None]
    done = dict(zip([job.camera for job in able], side_by_side(_watch, able, executor, tell, STAGE), strict=True))
    return {name: done.get(name) or Watched((name,), (), (), *span) for name in jobs}


def _watch(job: _Job) -> Watched:
    """Test one small rig, and keep the tests of its own camera."""
    ground = fit_ground(job.rig, job.seen, job.height_m)
    if joints_are_shared(job.observations):
        found = watch_adjusted(job.rig, job.observations, job.seen, job.options, ground=ground, span=job.span)
    else:
        found = watch(job.rig, job.seen, job.options, ground=ground, span=job.span)
    own = found.names.index(job.camera)

    def of_own(windows: Sequence[Window]) -> tuple[Window, ...]:
        return tuple(replace(one, tests=tuple(test for test in one.tests if test.camera == own)) for one in windows)

    return replace(found, windows=of_own(found.windows), whole=of_own(found.whole))


def _claims(watched: Watched, name: str) -> list[Move]:
    """Return the moves in a camera's small rig that are, or may be, moves of this camera."""
    return [move for move in watched.moves if move.camera == name or name in move.others]


def _join_results(found: Mapping[str, Watched], names: tuple[str, ...], span: tuple[float, float]) -> Watched:
    """Join the results of all small rigs, each for its own camera."""
    known = [(number, name) for number, name in enumerate(names) if name in found]
    moves = [_attribute_move(move, name) for _, name in known for move in _claims(found[name], name)]
    moves.sort(key=lambda move: (move.noticed_s, move.pose is None, names.index(move.camera)))
    return Watched(
        names, tuple(_drop_repeated(moves)), _side_by_side([(number, found[name].windows) for number, name in known]), *span,
        by_joints=any(one.by_joints for one in found.values()),
        whole=_side_by_side([(number, found[name].whole) for number, name in known]),
    )  # fmt: skip


def _side_by_side(of_camera: Sequence[tuple[int, Sequence[Window]]]) -> tuple[Window, ...]:
    """Join the windows of cameras with these numbers: those of the same times become one."""
    tests: dict[tuple[float, float], list[MotionTest]] = {}
    for number, windows in of_camera:
        for one in windows:
            own = tests.setdefault((one.until_s, one.from_s), [])
            own += [replace(test, camera=number) for test in one.tests]
    return tuple(Window(from_s, until_s, tuple(tests[until_s, from_s])) for until_s, from_s in sorted(tests))


def _attribute_move(move: Move, name: str) -> Move:
    """Return a move as one of the camera `name`; if another camera may have moved instead, its size is unknown."""
    if move.camera == name:
        return move
    others = (move.camera, *(one for one in move.others if one != name))
    unknown = np.full(6, np.nan), np.full((6, 6), np.nan)
    return replace(move, camera=name, others=others, shift=unknown[0], covariance=unknown[1], pose=None, sigma=None)


def _drop_repeated(moves: Sequence[Move]) -> list[Move]:
    """Keep only the first of several ambiguous moves that name the same cameras."""
    kept, told = [], set[frozenset[str]]()
    for move in moves:
        who = frozenset((move.camera, *move.others))
        if move.others and who in told:
            continue
        told.add(who)
        kept.append(move)
    return kept
