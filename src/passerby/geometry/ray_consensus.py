"""Selection of the sightings of one point that agree: every pair of rays proposes a point, and the other rays vote.

Identities are sometimes wrong: some sightings of a person at an instant may show another person. All pairs of all blocks are
tried at once. There are few cameras, so that no random sampling is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.geometry.groups import expanded_ranges, least_of_groups
from passerby.geometry.triangulation import hold_depth, triangulate

# Largest distance of the two rows of a pair within a block: it bounds the number of points that a block of many cameras
# proposes. Pairs of neighbouring rows are tried first.
_MAX_OFFSETS = 7
# Largest number of rows of a block, evenly spaced, that are the first row of a pair. With all rows, the time would grow with
# the square of the number of cameras that see one person. In a block of up to so many cameras, all rows are first rows.
_MAX_FIRST = 12
_ALL_NEAR = 0.5
"""Share of the tolerance. Sightings that are all this near to one point are within the tolerance of each other. Where two
people stand side by side and share an identity, all sightings may be within the full tolerance of the place between them."""
STEP = 500_000
"""Number of votes, or of pairs of a sighting and a point, that are processed at once; it bounds the memory."""


@dataclass(frozen=True, eq=False)
class Consensus:
    """The points that most sightings agree on."""

    points: Floats
    """(N, 3) world, metres; NaN for a block without agreement."""
    inlier: Bools
    """(M,) sightings that agree with their block's point."""


def vote_points(
    camera: Ints, block: Ints, bearing: Floats, tangent: Floats, tolerance_px: Floats, n_blocks: int, R: Floats, centre: Floats,
    *, height: tuple[float, float] | None = None,
) -> Consensus:  # fmt: skip
    """Find the point of each block, and the sightings that agree with it.

    Args:
        camera: (M,) camera index.
        block: (M,) block of each sighting; a camera occurs at most once in a block.
        bearing: (M, 3) unit rays, camera frame.
        tangent: (M, 2, 3) from `Lens.tangents`.
        tolerance_px: (M,) residual in pixels below which a sighting agrees with a point.
        n_blocks: number of blocks N.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        height: expected height of the points above the ground and its tolerance, metres; None where the height is not used.
    """
    translation = -np.einsum("cij,cj->ci", R, centre)
    # Where all sightings of a block are near their common point, no vote is needed.
    best = triangulate(camera, block, bearing, R, translation, n_blocks)
    inlier = _agree(best, block, _Lines.of(camera, bearing, tangent, R, centre), _ALL_NEAR * tolerance_px)
    count = np.bincount(block, minlength=n_blocks)
    rest = np.flatnonzero(((np.bincount(block[inlier], minlength=n_blocks) < count) | (count < 2))[block])
    if len(rest):
        c, b, tolerance = camera[rest], block[rest], tolerance_px[rest]
        lines = _Lines.of(c, bearing[rest], tangent[rest], R, centre)
        voted = _choose_points(c, b, bearing[rest], lines, tolerance, n_blocks, R, centre, height)
        inlier[rest] = _agree(voted, b, lines, tolerance)
        agreed = np.bincount(b[inlier[rest]], minlength=n_blocks) >= 2
        inlier[rest] &= agreed[b]
        chosen = rest[inlier[rest]]
        refined = triangulate(camera[chosen], block[chosen], bearing[chosen], R, translation, n_blocks)
        voted[~agreed] = np.nan
        anew = np.unique(b)
        best[anew] = np.where(np.isfinite(refined[anew]), refined[anew], voted[anew])
    return Consensus(best, inlier)


def _agree(points: Floats, block: Ints, lines: _Lines, tolerance_px: Floats) -> Bools:
    """Return whether each sighting (M,) agrees with the point of its block (N, 3); False where the block has no point."""
    known = np.isfinite(points[block]).all(axis=1)
    agrees = np.zeros(len(block), dtype=bool)
    of_axis, rows = np.ascontiguousarray(points.T), np.flatnonzero(known)
    near = np.sqrt(lines.squares(of_axis, block[rows], rows)) < tolerance_px[rows]
    agrees[rows] = near & (lines.depths(of_axis, block[rows], rows) > 0)
    return agrees


def _choose_points(
    camera: Ints, block: Ints, bearing: Floats, lines: _Lines, tolerance_px: Floats, n_blocks: int, R: Floats, centre: Floats,
    height: tuple[float, float] | None,
) -> Floats:  # fmt: skip
    """Return for each block the point (N, 3) that a pair of its rays proposes and that has the lowest robust cost.

    NaN for a block without a proposal. The arguments are those of `vote_points`.
    """
    order = np.argsort(block, kind="stable")
    cam, blk = camera[order], block[order]
    ray = np.einsum("mji,mj->mi", R[cam], bearing[order])
    count = np.bincount(blk, minlength=n_blocks)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    first, second = _pairs(blk, int(count.max(initial=0)))
    point = _midpoints(centre[cam[first]], ray[first], centre[cam[second]], ray[second])
    sound = np.isfinite(point).all(axis=1)
    first, second, point = first[sound], second[sound], point[sound]
    cost = _votes(point, blk[first], lines.take(order), tolerance_px[order], start, count)
    if height is not None:
        cost = cost + 0.5 * np.log1p(((point[:, 2] - height[0]) / height[1]) ** 2)
    best = np.full((n_blocks, 3), np.nan)
    winner = least_of_groups(blk[first], cost)
    best[blk[first[winner]]] = point[winner]
    return best


def reassign_outliers(
    consensus: Consensus, camera: Ints, block: Ints, instant: Ints, block_instant: Ints, bearing: Floats, tangent: Floats,
    tolerance_px: Floats, R: Floats, centre: Floats,
) -> Ints:  # fmt: skip
    """Assign each sighting that disagrees with its block to the block of the same instant with which it agrees.

    Where two people's identities were exchanged in one camera, both sightings are good and only their identities are wrong. A
    block takes one sighting per camera; the best fits are assigned first.

    Args:
        consensus: result of `vote_points` on the same sightings.
        camera: (M,) camera index.
        block: (M,) block of each sighting by its stated identity.
        instant: (M,) instant of each sighting.
        block_instant: (N,) instant of each block.
        bearing: (M, 3) unit rays, camera frame.
        tangent: (M, 2, 3) from `Lens.tangents`.
        tolerance_px: (M,) largest residual of a fit, pixels.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.

    Returns:
        (M,) block of each sighting, -1 where no block fits.
    """
    out = np.where(consensus.inlier, block, -1)
    lost = np.flatnonzero(~consensus.inlier)
    n_cameras = len(R)
    taken = np.zeros(len(block_instant) * n_cameras, dtype=bool)
    taken[block[consensus.inlier] * n_cameras + camera[consensus.inlier]] = True
    fitting = []
    for which, candidate, miss_px in misses_by_instant(
        consensus.points, block_instant, camera[lost], instant[lost], bearing[lost], tangent[lost], R, centre
    ):
        row = lost[which]
        miss = miss_px / tolerance_px[row]
        fits = (miss < 1.0) & ~taken[candidate * n_cameras + camera[row]]
        fitting.append((row[fits], candidate[fits], miss[fits]))
    if not fitting:
        return np.asarray(out)
    row, candidate, miss = (np.concatenate(column) for column in zip(*fitting, strict=True))
    for k in np.argsort(miss, kind="stable"):
        seat = candidate[k] * n_cameras + camera[row[k]]
        if out[row[k]] < 0 and not taken[seat]:
            out[row[k]] = candidate[k]
            taken[seat] = True
    return np.asarray(out)


def misses_by_instant(
    points: Floats,
    point_instant: Ints,
    camera: Ints,
    instant: Ints,
    bearing: Floats,
    tangent: Floats,
    R: Floats,
    centre: Floats,
) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Compute the distance in pixels of each sighting from every point of its instant, in parts of about `STEP` pairs.

    All pairs of a large site at once would take gigabytes.

    Args:
        points: (N, 3) world, metres; NaN where there is no point.
        point_instant: (N,) instant of each point.
        camera: (M,) camera index of each sighting.
        instant: (M,) instant of each sighting.
        bearing: (M, 3) unit rays, camera frame.
        tangent: (M, 2, 3) from `Lens.tangents`.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.

    Yields:
        (K,) sightings in ascending order, all pairs of a sighting in the same part; (K,) points; (K,) distances in pixels.
    """
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    by_instant = known[np.argsort(point_instant[known], kind="stable")]
    ascending = point_instant[by_instant]
    first = np.searchsorted(ascending, instant)
    count = np.searchsorted(ascending, instant, side="right") - first
    lines, of_axis = _Lines.of(camera, bearing, tangent, R, centre), np.ascontiguousarray(points.T)
    cuts = np.searchsorted(np.cumsum(count), np.arange(STEP, int(count.sum()), STEP))
    for part in np.split(np.arange(len(instant)), cuts):
        owner, place = expanded_ranges(first[part], count[part])
        if len(owner):
            sighting, point = part[owner], by_instant[place]
            yield sighting, point, np.sqrt(lines.squares(of_axis, point, sighting))


def _pairs(block: Ints, most: int) -> tuple[Ints, Ints]:
    """Return the pairs of rows (K,), (K,) within blocks; rows are sorted by block, and `most` is the largest block's size."""
    start = np.searchsorted(block, block)
    count = np.searchsorted(block, block, side="right") - start
    begins = (np.arange(len(block)) - start) % -(-count // _MAX_FIRST) == 0
    first, second = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for offset in range(1, min(most, _MAX_OFFSETS + 1)):
        same = np.flatnonzero((block[offset:] == block[:-offset]) & begins[:-offset])
        first.append(same)
        second.append(same + offset)
    return np.concatenate(first), np.concatenate(second)


def _midpoints(c1: Floats, d1: Floats, c2: Floats, d2: Floats) -> Floats:
    """Return the midpoints (K, 3) of the shortest segments between rays; NaN for parallel rays or a point behind a camera."""
    apart = c2 - c1
    cosine = np.einsum("ki,ki->k", d1, d2)
    along1, along2 = np.einsum("ki,ki->k", d1, apart), np.einsum("ki,ki->k", d2, apart)
    sine2 = 1 - cosine**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (along1 - cosine * along2) / sine2
        u = (cosine * along1 - along2) / sine2
    point = 0.5 * (c1 + s[:, None] * d1 + c2 + u[:, None] * d2)
    point[~((s > 0) & (u > 0) & (sine2 > 1e-8))] = np.nan
    return np.asarray(point)


@dataclass(frozen=True, eq=False)
class _Lines:
    """M sightings as lines in the world frame, stored by component: comparing points with them needs no rotation."""

    ray: Floats
    """(3, M) unit rays, world frame."""
    tangent: Floats
    """(2, 3, M) maps to pixels, world frame."""
    centre: Floats
    """(3, M) camera centres, metres."""

    @classmethod
    def of(cls, camera: Ints, bearing: Floats, tangent: Floats, R: Floats, centre: Floats) -> _Lines:
        """Build the lines of sightings; the arguments are those of `vote_points`."""
        turn = R.transpose(1, 2, 0)[:, :, camera]
        rows = bearing.T, tangent[:, 0].T, tangent[:, 1].T
        ray, across, down = (row[0] * turn[0] + row[1] * turn[1] + row[2] * turn[2] for row in rows)
        return cls(ray, np.array([across, down]), centre.T[:, camera])

    def take(self, rows: Ints) -> _Lines:
        """Return the lines of these rows, in this order."""
        return _Lines(self.ray[:, rows], self.tangent[:, :, rows], self.centre[:, rows])

    def depths(self, point: Floats, of_point: Ints, rows: Ints) -> Floats:
        """Return the depths (K,) of points along rays, metres; the arguments are those of `squares`."""
        return _dot([axis[rows] for axis in self.ray], [point[k][of_point] - self.centre[k][rows] for k in range(3)])

    def squares(self, point: Floats, of_point: Ints, rows: Ints) -> Floats:
        """Return the squared distances (K,) in pixels of points `of_point` (K,) of `point` (3, N) from lines `rows` (K,)."""
        d = [point[k][of_point] - self.centre[k][rows] for k in range(3)]
        ray = [self.ray[k][rows] for k in range(3)]
        across, down = ([axis[k][rows] for k in range(3)] for axis in self.tangent)
        depth = hold_depth(_dot(ray, d), _dot(d, d))
        return np.asarray((_dot(across, d) ** 2 + _dot(down, d) ** 2) / depth**2)


def _dot(a: Sequence[Floats], b: Sequence[Floats]) -> Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _votes(point: Floats, block: Ints, lines: _Lines, tolerance: Floats, start: Ints, count: Ints) -> Floats:
    """Return the robust cost (K,) of each proposed point, summed over all sightings of its block."""
    proposal, rows = expanded_ranges(start[block], count[block])
    cost, of_axis, scale = np.zeros(len(point)), np.ascontiguousarray(point.T), 4.0 / tolerance**2
    for begin in range(0, len(rows), STEP):
        part = slice(begin, begin + STEP)
        r = rows[part]
        cost += np.bincount(proposal[part], np.log1p(lines.squares(of_axis, proposal[part], r) * scale[r]), len(point))
    return cost
