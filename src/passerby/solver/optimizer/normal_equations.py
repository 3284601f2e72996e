"""Normal equations in three levels of unknowns, and their reduction to the shared ones (see `least_squares`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import cauchy_weights, group_sums
from passerby.solver.optimizer.couplings import (
    Coupling,
    Cross,
    FullCoupling,
    SparseCoupling,
    occurs_seldom,
    sparse_sum,
    subtract_product,
)

_TINY = 1e-12


class Loss(Protocol):
    """Interface of a robust loss; `Cauchy` is one."""

    def cost(self, squared: Floats) -> Floats:
        """Return half the robust cost (M,) of squared norms (M,)."""
        ...

    def weight(self, squared: Floats) -> Floats:
        """Return the weights (M,) of squared norms (M,) for iteratively reweighted least squares."""
        ...


@dataclass(frozen=True)
class Cauchy:
    """The Cauchy loss on whitened residuals: a row at `scale` sigmas has half its weight, far outliers have nearly none."""

    scale: float | Floats
    """Scale in sigmas: one value for all rows, or (M,)."""

    def cost(self, squared: Floats) -> Floats:
        """Return half the robust cost (M,) of squared norms (M,)."""
        c2 = self.scale**2
        return np.asarray(0.5 * c2 * np.log1p(squared / c2))

    def weight(self, squared: Floats) -> Floats:
        """Return the weights (M,) of squared norms (M,) for iteratively reweighted least squares."""
        return np.asarray(cauchy_weights(squared / self.scale**2))


@dataclass(frozen=True, eq=False)
class Family:
    """A family of `count` blocks of `size` unknowns; `group` (count,) is each block's group, None without groups."""

    count: int
    size: int
    group: Ints | None = None


@dataclass(frozen=True, eq=False)
class Layout:
    """Sizes of the three levels of unknowns."""

    n_cameras: int
    camera_size: int
    n_globals: int = 0
    n_groups: int = 0
    families: tuple[Family, ...] = ()

    @property
    def n_shared(self) -> int:
        """Number of shared unknowns: the cameras' first, then the globals."""
        return self.n_cameras * self.camera_size + self.n_globals


@dataclass(frozen=True, eq=False)
class Term:
    """M rows of k whitened residuals, with their Jacobians by each level of unknowns; None for a level without influence.

    Within one term, a (block, camera) pair occurs at most once.
    """

    residual: Floats
    """(M, k) whitened residuals."""
    loss: Loss | None = None
    camera: Ints | None = None
    """(M,) camera of each row, sorted in ascending order."""
    by_camera: Floats | None = None
    """(M, k, camera_size) derivatives by the row's camera."""
    family: int = 0
    block: Ints | None = None
    """(M,) block of each row in its family."""
    by_block: Floats | None = None
    """(M, k, d) derivatives by the row's block."""
    group: Ints | None = None
    """(M,) group of each row; for rows with a block, the group of that block."""
    by_group: Floats | None = None
    """(M, k) derivatives by the row's group."""
    by_globals: Floats | None = None
    """(M, k, n_globals) derivatives by the globals."""
    by_shared: Floats | None = None
    """(M, k, n_shared) derivatives by all shared unknowns, for the few rows that depend on several cameras at once."""

    def cost(self) -> float:
        """Return the term's robust cost."""
        squared = np.einsum("mk,mk->m", self.residual, self.residual)
        return float(np.sum(self.loss.cost(squared) if self.loss else 0.5 * squared))


@dataclass(frozen=True, eq=False)
class Step:
    """An increment of all unknowns."""

    shared: Floats
    groups: Floats
    blocks: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class _FamilyNormal:
    """Normal equations of one family: V (N, d, d), W (N, d, n_shared), w (N, d) with its group, and the gradient (N, d)."""

    V: Floats
    W: Coupling
    w: Floats
    gradient: Floats
    group: Ints | None


def _occurs_seldom(layout: Layout, terms: Sequence[Term]) -> bool:
    """Return whether sparse tables are faster than full ones, judged by the largest family."""
    if not layout.families:
        return False
    largest = int(np.argmax([family.count for family in layout.families]))
    seen = [term.block for term in terms if term.family == largest and term.block is not None and term.by_camera is not None]
    return bool(seen) and occurs_seldom(layout.n_cameras, layout.families[largest].count, max(seen, key=len))


class NormalEquations:
    """Gauss-Newton normal equations in the three levels of unknowns, and their reduction."""

    def __init__(self, layout: Layout, terms: Sequence[Term]) -> None:
        self.layout = layout
        s = layout.n_shared
        self.H = np.zeros((s, s))
        self.gradient = np.zeros(s)
        self.G = np.zeros(layout.n_groups)
        self.group_gradient = np.zeros(layout.n_groups)
        self._seldom = _occurs_seldom(layout, terms)
        self._cross = np.zeros((0 if self._seldom else s, layout.n_groups))
        self._cross_parts: list[tuple[Floats, Ints, Ints]] = []
        kind = SparseCoupling if self._seldom else FullCoupling
        sizes = layout.n_cameras, layout.camera_size, layout.n_globals
        self._W: list[Coupling] = [kind(f.count, f.size, *sizes) for f in layout.families]
        self._V = [np.zeros((f.count, f.size, f.size)) for f in layout.families]
        self._w = [np.zeros((f.count, f.size)) for f in layout.families]
        self._g = [np.zeros((f.count, f.size)) for f in layout.families]
        for term in terms:
            if len(term.residual):
                self._add(term)
        self.cross: Cross = sparse_sum(self._cross_parts, (s, layout.n_groups)) if self._seldom else self._cross
        self.families = tuple(
            _FamilyNormal(V, W, w, g, f.group)
            for V, W, w, g, f in zip(self._V, self._W, self._w, self._g, layout.families, strict=True)
        )

    def _add(self, term: Term) -> None:
        residual = term.residual
        root = np.ones(len(residual))
        if term.loss is not None:
            root = np.sqrt(term.loss.weight(np.einsum("mk,mk->m", residual, residual)))
        r = residual * root[:, None]
        n_cameras = self.layout.n_cameras * self.layout.camera_size
        g = slice(n_cameras, self.layout.n_shared)
        J_c = None if term.by_camera is None else term.by_camera * root[:, None, None]
        J_b = None if term.by_block is None else term.by_block * root[:, None, None]
        J_p = None if term.by_group is None else term.by_group * root[:, None]
        J_g = None if term.by_globals is None else term.by_globals * root[:, None, None]
        if J_c is not None and term.camera is not None:
            self._add_cameras(term.camera, J_c, J_g, J_p, term.group, r)
        if J_g is not None:
            flat = J_g.reshape(-1, J_g.shape[2])
            self.H[g, g] += flat.T @ flat
            self.gradient[g] += flat.T @ r.ravel()
            if J_p is not None and term.group is not None:
                self._add_cross(np.arange(g.start, g.stop), term.group, np.einsum("mkg,mk->mg", J_g, J_p))
        if J_p is not None and term.group is not None:
            n = self.layout.n_groups
            self.G += np.bincount(term.group, np.einsum("mk,mk->m", J_p, J_p), n)
            self.group_gradient += np.bincount(term.group, np.einsum("mk,mk->m", J_p, r), n)
        if term.by_shared is not None:
            flat = (term.by_shared * root[:, None, None]).reshape(-1, self.layout.n_shared)
            self._add_gram(flat)
            self.gradient += flat.T @ r.ravel()
        if J_b is not None and term.block is not None:
            self._add_blocks(term, J_b, J_c, J_p, J_g, r)

    def _add_cameras(
        self, camera: Ints, J_c: Floats, J_g: Floats | None, J_p: Floats | None, group: Ints | None, r: Floats
    ) -> None:
        p = self.layout.camera_size
        g = slice(self.layout.n_cameras * p, self.layout.n_shared)
        bounds = np.searchsorted(camera, np.arange(self.layout.n_cameras + 1))
        for c in range(self.layout.n_cameras):
            rows = slice(bounds[c], bounds[c + 1])
            if bounds[c] == bounds[c + 1]:
                continue
            own = slice(c * p, (c + 1) * p)
            for component in range(r.shape[1]):  # makes no copy for any order of the axes in memory
                flat = J_c[rows, component]
                self.H[own, own] += flat.T @ flat
                self.gradient[own] += flat.T @ r[rows, component]
            if J_g is not None:
                cross = J_c[rows].reshape(-1, p).T @ J_g[rows].reshape(-1, J_g.shape[2])
                self.H[own, g] += cross
                self.H[g, own] += cross.T
            if J_p is not None and group is not None:
                self._add_cross(np.arange(c * p, (c + 1) * p), group[rows], np.einsum("mkp,mk->mp", J_c[rows], J_p[rows]))

    def _add_cross(self, shared: Ints, group: Ints, product: Floats) -> None:
        """Add the products `product` (M, k) of k shared unknowns with the group of each row."""
        if self._seldom:
            rows = np.broadcast_to(shared, product.shape)
            self._cross_parts.append((product, rows, np.broadcast_to(group[:, None], product.shape)))
            return
        for column, unknown in enumerate(shared.tolist()):
            self._cross[unknown] += np.bincount(group, product[:, column], self.layout.n_groups)

    def _add_gram(self, flat: Floats) -> None:
        """Add J^T J of rows J (M, n_shared)."""
        if self._seldom:  # the rows of priors are nearly all zeros
            sparse = scipy.sparse.csr_array(flat)
            product = scipy.sparse.coo_array(sparse.T @ sparse)
            self.H[product.row, product.col] += product.data
        else:
            self.H += flat.T @ flat

    def _add_blocks(
        self, term: Term, J_b: Floats, J_c: Floats | None, J_p: Floats | None, J_g: Floats | None, r: Floats
    ) -> None:
        assert term.block is not None
        family = self.layout.families[term.family]
        d, n = family.size, family.count
        J_bt = J_b.transpose(0, 2, 1)
        V, g = self._V[term.family], self._g[term.family]
        B, residual = np.ascontiguousarray(J_b.transpose(1, 2, 0)), np.ascontiguousarray(r.T)
        for i in range(d):  # component by component, since sums over blocks take columns
            g[:, i] += np.bincount(term.block, (B[:, i] * residual).sum(axis=0), n)
            for j in range(i, d):
                entry = np.bincount(term.block, (B[:, i] * B[:, j]).sum(axis=0), n)
                V[:, i, j] += entry
                if j > i:
                    V[:, j, i] += entry
        if J_p is not None:
            self._w[term.family] += group_sums(term.block, (J_bt @ J_p[:, :, None])[:, :, 0], n)
        if J_c is not None and term.camera is not None:
            self._W[term.family].add(term.block, term.camera, J_bt @ J_c)
        if J_g is not None:
            self._W[term.family].add_globals(term.block, J_bt @ J_g)

    def reduce(self, damping: float = 0.0) -> Reduced:
        """Eliminate the blocks and groups; `damping` is the share of each diagonal that is added to it (Marquardt)."""
        H = self.H + damping * np.diag(np.maximum(np.diag(self.H), _TINY))
        gradient = self.gradient.copy()
        cross, G, group_gradient = self.cross.copy(), self.G * (1.0 + damping) + _TINY, self.group_gradient.copy()
        eliminated = []
        for normal in self.families:
            d = normal.V.shape[1]
            diagonal = np.einsum("ndd->nd", normal.V)
            V = normal.V + (damping * diagonal + _TINY + 1e-14 * diagonal)[:, :, None] * np.eye(d)
            inverse_root = np.linalg.inv(np.linalg.cholesky(V))
            Y = normal.W.whitened(inverse_root)
            z = (inverse_root @ normal.gradient[:, :, None])[:, :, 0]
            H -= Y.gram()
            gradient -= Y.transposed_times(z)
            y = np.zeros_like(z)
            if normal.group is not None:
                y = (inverse_root @ normal.w[:, :, None])[:, :, 0]
                n_groups = len(G)
                cross = cross - Y.by_group(y, normal.group, n_groups)
                G -= np.bincount(normal.group, np.einsum("nd,nd->n", y, y), n_groups)
                group_gradient -= np.bincount(normal.group, np.einsum("nd,nd->n", y, z), n_groups)
            eliminated.append((inverse_root, Y, y, z, normal.group))
        G = np.maximum(G, _TINY)
        scaled: Cross
        if isinstance(cross, np.ndarray):
            scaled = cross / G
            H -= scaled @ cross.T
        else:
            scaled = scipy.sparse.csr_array(cross * (1.0 / G))
            subtract_product(H, scaled, cross)
        gradient -= scaled @ group_gradient
        return Reduced(0.5 * (H + H.T), gradient, cross, G, group_gradient, eliminated)


class Reduced:
    """The reduced system of the shared unknowns, and the back-substitution to all unknowns."""

    def __init__(
        self, H: Floats, gradient: Floats, cross: Cross, G: Floats, group_gradient: Floats,
        eliminated: list[tuple[Floats, Coupling, Floats, Floats, Ints | None]],
    ) -> None:  # fmt: skip
        self.H = H
        self.gradient = gradient
        self._cross, self._G, self._group_gradient = cross, G, group_gradient
        self._eliminated = eliminated

    def solve(self, free: NDArray[np.bool_]) -> Step:
        """Solve the system for a step; shared unknowns outside `free` are held. Raises `LinAlgError` if it is singular."""
        shared = np.zeros(len(self.gradient))
        H = self.H[np.ix_(free, free)]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(H), _TINY))
        factor = scipy.linalg.cho_factor(H * scale[:, None] * scale, lower=True, check_finite=False)
        shared[free] = -scale * scipy.linalg.cho_solve(factor, scale * self.gradient[free], check_finite=False)
        groups = -(self._group_gradient + self._cross.T @ shared) / self._G
        blocks = []
        for inverse_root, Y, y, z, group in self._eliminated:
            right = z + Y.times(shared)
            if group is not None:
                right = right + y * groups[group][:, None]
            blocks.append(-(inverse_root.transpose(0, 2, 1) @ right[:, :, None])[:, :, 0])
        return Step(shared, groups, tuple(blocks))
