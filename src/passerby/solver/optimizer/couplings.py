"""Products of the shared unknowns with blocks and groups in the normal equations, as full or sparse tables.

Where every block is seen by most cameras, a full table is the fastest. On a large site, each block is seen by two or three of
hundreds of cameras. Then only pairs that occur are kept: time and memory grow with the number of observations, not with the
square of the number of cameras.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import group_sums

Cross = Floats | scipy.sparse.csr_array
"""Full or sparse table (n_shared, n_groups) of the products of shared unknowns with groups."""

FULL_UP_TO = 12
"""Number of cameras up to which tables are always full."""
WORTH = 60.0
"""Ratio of the multiplications of a full table to those of a sparse one, above which the sparse one is used: multiplications
of large matrices run so much faster. Both take equal time at 32 cameras of which four see each block; at 50 cameras and three
(a ratio of 280) the sparse table takes 0.4 of the time."""


def occurs_seldom(n_cameras: int, blocks: int, seen: Ints) -> bool:
    """Return whether sparse tables are faster than full ones.

    Args:
        n_cameras: number of cameras.
        blocks: number of blocks.
        seen: (M,) the block of each observation.
    """
    if n_cameras <= FULL_UP_TO or not len(seen):
        return False
    views = np.bincount(seen, minlength=blocks).astype(np.float64)
    return bool(WORTH * float((views**2).sum()) < float(blocks) * n_cameras**2)


DENSE_WORTH = 20.0
"""The same ratio for a product of two sparse tables: below it, full ones are used (their multiplications run some 30 times as
fast)."""


class Coupling(Protocol):
    """The table W (N, d, n_shared) of the products of N blocks of d unknowns with the shared unknowns."""

    def add(self, block: Ints, camera: Ints, values: Floats) -> None:
        """Add `values` (M, d, camera_size) of observations of a block by a camera; each pair at most once in a call."""

    def add_globals(self, block: Ints, values: Floats) -> None:
        """Add `values` (M, d, n_globals) of blocks with the globals."""

    def times(self, shared: Floats) -> Floats:
        """Return W x (N, d) for x (n_shared,)."""

    def whitened(self, inverse_root: Floats) -> Coupling:
        """Return Y = L^-1 W, where `inverse_root` (N, d, d) is L^-1."""

    def gram(self) -> Floats:
        """Return W^T W (n_shared, n_shared)."""

    def transposed_times(self, blocks: Floats) -> Floats:
        """Return W^T z (n_shared,) for z (N, d)."""

    def by_group(self, blocks: Floats, group: Ints, n_groups: int) -> Cross:
        """Return the sums (n_shared, n_groups) of y^T W over the blocks of each group, for y (N, d)."""


class FullCoupling:
    """A full table, with an entry for every camera and block."""

    def __init__(self, count: int, size: int, n_cameras: int, camera_size: int, n_globals: int) -> None:
        self._shape = count, size, n_cameras, camera_size
        self._of_cameras: Floats | None = np.zeros((count * n_cameras, size * camera_size))
        self._of_globals = np.zeros((count, size, n_globals))
        self._table: Floats | None = None

    @property
    def table(self) -> Floats:
        """(N, d, n_shared) the whole table; no values can be added after its first use."""
        if self._table is None:
            assert self._of_cameras is not None
            count, size, n, p = self._shape
            flat = self._of_cameras.reshape(count, n, size, p).transpose(0, 2, 1, 3).reshape(count, size, n * p)
            self._table = np.concatenate([flat, self._of_globals], axis=2) if self._of_globals.shape[2] else flat
            self._of_cameras = None
        return self._table

    @classmethod
    def _of(cls, table: Floats) -> FullCoupling:
        out = cls(0, 0, 0, 0, 0)
        out._table = table
        return out

    def add(self, block: Ints, camera: Ints, values: Floats) -> None:
        """See `Coupling`."""
        assert self._of_cameras is not None
        self._of_cameras[block * self._shape[2] + camera] += values.reshape(len(block), -1)

    def add_globals(self, block: Ints, values: Floats) -> None:
        """See `Coupling`."""
        count, size = self._shape[:2]
        self._of_globals += group_sums(block, values.reshape(len(block), -1), count).reshape(count, size, -1)

    def times(self, shared: Floats) -> Floats:
        """See `Coupling`."""
        return np.asarray(self.table @ shared)

    def whitened(self, inverse_root: Floats) -> FullCoupling:
        """See `Coupling`."""
        return self._of(inverse_root @ self.table)

    def gram(self) -> Floats:
        """See `Coupling`."""
        flat = self._flat()
        return np.asarray(flat.T @ flat)

    def transposed_times(self, blocks: Floats) -> Floats:
        """See `Coupling`."""
        return np.asarray(self._flat().T @ blocks.ravel())

    def by_group(self, blocks: Floats, group: Ints, n_groups: int) -> Floats:
        """See `Coupling`."""
        return group_sums(group, (blocks[:, None, :] @ self.table)[:, 0], n_groups).T

    def _flat(self) -> Floats:
        return self.table.reshape(self.table.shape[0] * self.table.shape[1], self.table.shape[2])


class SparseCoupling:
    """A sparse table of the (block, camera) pairs that occur, with a full table for the globals."""

    def __init__(self, count: int, size: int, n_cameras: int, camera_size: int, n_globals: int) -> None:
        self._shape = count, size, n_cameras, camera_size
        self._pairs: list[Ints] = []
        self._values: list[Floats] = []
        self._of_globals = np.zeros((count, size, n_globals))
        self._settled: tuple[Ints, Ints, Floats] | None = None

    def entries(self) -> tuple[Ints, Ints, Floats]:
        """Return the pairs that occur, by block, then camera: blocks (E,), cameras (E,) and values (E, d, camera_size)."""
        if self._settled is None:
            _, size, n, p = self._shape
            pairs = np.concatenate(self._pairs) if self._pairs else np.zeros(0, np.int64)
            values = np.concatenate(self._values) if self._values else np.zeros((0, size * p))
            places, number = np.unique(pairs, return_inverse=True)
            table = group_sums(number.ravel(), values, len(places)).reshape(len(places), size, p)
            self._settled = places // n, places % n, table
            self._pairs, self._values = [], []
        return self._settled

    def add(self, block: Ints, camera: Ints, values: Floats) -> None:
        """See `Coupling`."""
        self._pairs.append(block * self._shape[2] + camera)
        self._values.append(values.reshape(len(block), -1))

    def add_globals(self, block: Ints, values: Floats) -> None:
        """See `Coupling`."""
        count, size = self._shape[:2]
        self._of_globals += group_sums(block, values.reshape(len(block), -1), count).reshape(count, size, -1)

    def times(self, shared: Floats) -> Floats:
        """See `Coupling`."""
        block, camera, table = self.entries()
        count, _, n, p = self._shape
        own = shared[: n * p].reshape(n, p)[camera]
        return np.asarray(group_sums(block, (table @ own[:, :, None])[:, :, 0], count) + self._of_globals @ shared[n * p :])

    def whitened(self, inverse_root: Floats) -> SparseCoupling:
        """See `Coupling`."""
        block, camera, table = self.entries()
        out = SparseCoupling(*self._shape, 0)
        out._of_globals = inverse_root @ self._of_globals
        out._settled = block, camera, inverse_root[block] @ table
        return out

    def gram(self) -> Floats:
        """See `Coupling`."""
        block, camera, table = self.entries()
        count, size, n, p = self._shape
        g = self._of_globals.shape[2]
        out = np.zeros((n * p + g, n * p + g))
        places, sums = self._camera_pairs()
        of_cameras = out[: n * p, : n * p].reshape(n, p, n, p)
        of_cameras[places // n, :, places % n, :] = sums
        if g:
            beside = table.transpose(0, 2, 1) @ self._of_globals[block]
            out[: n * p, n * p :] = group_sums(camera, beside, n).reshape(n * p, g)
            out[n * p :, : n * p] = out[: n * p, n * p :].T
            flat = self._of_globals.reshape(count * size, g)
            out[n * p :, n * p :] = flat.T @ flat
        return out

    def _camera_pairs(self) -> tuple[Ints, Floats]:
        """Compute W^T W for pairs of cameras with a common block: (K,) first * C + second, and (K, p, p) products."""
        block, camera, table = self.entries()
        _, size, n, p = self._shape
        first = np.flatnonzero(np.diff(block, prepend=-1))
        views = np.diff(first, append=len(block))
        keys, products = [], []
        for count in np.unique(views).tolist():
            rows = first[views == count][:, None] + np.arange(count)
            of_blocks = table[rows].transpose(0, 2, 1, 3).reshape(len(rows), size, count * p)
            gram = (of_blocks.transpose(0, 2, 1) @ of_blocks).reshape(len(rows), count, p, count, p).transpose(0, 1, 3, 2, 4)
            pair = camera[rows][:, :, None] * n + camera[rows][:, None, :]
            keys.append(pair.ravel())
            products.append(gram.reshape(-1, p, p))
        if not keys:
            return np.zeros(0, np.int64), np.zeros((0, p, p))
        places, number = np.unique(np.concatenate(keys), return_inverse=True)
        return places, group_sums(number.ravel(), np.concatenate(products), len(places))

    def transposed_times(self, blocks: Floats) -> Floats:
        """See `Coupling`."""
        block, camera, table = self.entries()
        _, _, n, _ = self._shape
        own = group_sums(camera, (table.transpose(0, 2, 1) @ blocks[block][:, :, None])[:, :, 0], n)
        of_globals = np.einsum("ndg,nd->g", self._of_globals, blocks)
        return np.concatenate([own.ravel(), of_globals])

    def by_group(self, blocks: Floats, group: Ints, n_groups: int) -> scipy.sparse.csr_array:
        """See `Coupling`."""
        block, camera, table = self.entries()
        _, _, n, p = self._shape
        own = (table.transpose(0, 2, 1) @ blocks[block][:, :, None])[:, :, 0]
        rows = camera[:, None] * p + np.arange(p)
        parts = [(own, rows, np.broadcast_to(group[block][:, None], rows.shape))]
        g = self._of_globals.shape[2]
        if g:
            of_globals = group_sums(group, np.einsum("ndg,nd->ng", self._of_globals, blocks), n_groups)
            rows = np.broadcast_to(n * p + np.arange(g), of_globals.shape)
            parts.append((of_globals, rows, np.broadcast_to(np.arange(n_groups)[:, None], of_globals.shape)))
        return sparse_sum(parts, (n * p + g, n_groups))


def subtract_product(H: Floats, scaled: scipy.sparse.csr_array, cross: scipy.sparse.csr_array) -> None:
    """Subtract scaled @ cross^T from H, where both are (n_shared, n_groups) with the same non-zero entries."""
    each = np.bincount(cross.indices, minlength=cross.shape[1]).astype(np.float64)
    if DENSE_WORTH * float((each**2).sum()) > float(cross.shape[1]) * len(H) ** 2:  # most cameras see most people
        H -= scaled.toarray() @ cross.toarray().T
        return
    among = scipy.sparse.coo_array(scaled @ cross.T)
    H[among.row, among.col] -= among.data


def sparse_sum(parts: list[tuple[Floats, NDArray[Any], NDArray[Any]]], shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """Build a matrix by summing values at (row, column); each part has three arrays of one shape: values, rows, columns."""
    value, row, column = (np.concatenate([part[k].ravel() for part in parts]) if parts else np.zeros(0) for k in range(3))
    placed = (row.astype(np.int64), column.astype(np.int64))
    return scipy.sparse.csr_array(scipy.sparse.coo_array((value, placed), shape=shape))
