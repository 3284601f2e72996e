"""Robust nonlinear least squares for camera rigs: Levenberg-Marquardt on a twice reduced system.

The unknowns have three levels. *Shared* unknowns are few and dense: the cameras' parameters, then the globals. *Groups* are
scalars, one per person (a body height). *Blocks* are small vectors, one per person-instant or 3D point, in one or more
families. A residual row depends on at most one camera, one block, that block's group, and the globals. The blocks are therefore
eliminated first (a batched Schur complement), then the groups (the remaining system among them is diagonal). The system that
remains has only the shared unknowns. See Triggs et al., *Bundle Adjustment: A Modern Synthesis* (2000), section 6.

The robust loss is handled by iteratively reweighted least squares; a step is accepted by the true robust cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from passerby.solver.optimizer.normal_equations import Cauchy, Family, Layout, Loss, NormalEquations, Reduced, Step, Term

__all__ = [
    "Cauchy", "Family", "Layout", "Loss", "NormalEquations", "Problem", "Reduced", "Result", "Step", "Stopping", "Term",
    "minimise",
]  # fmt: skip


State = TypeVar("State")


class Problem(Protocol[State]):
    """Interface of a problem that the solver can minimise."""

    @property
    def layout(self) -> Layout:
        """Sizes of the three levels of unknowns."""
        ...

    def terms(self, state: State, *, jacobians: bool) -> Sequence[Term]:
        """Return the residuals at a state, with their Jacobians on request."""
        ...

    def retract(self, state: State, step: Step) -> State:
        """Return the state moved by a step."""
        ...


@dataclass(frozen=True)
class Stopping:
    """Stopping rule: converged after two steps in a row that lower the cost by less than the share `tolerance`."""

    max_iterations: int = 100
    tolerance: float = 1e-8
    initial_damping: float = 1e-4


@dataclass(frozen=True, eq=False)
class Result(Generic[State]):
    """Final state of the solver, its cost, and the number of iterations."""

    state: State
    cost: float
    initial_cost: float
    iterations: int
    converged: bool
    normal: NormalEquations
    """Normal equations at the final state, undamped."""


def minimise(
    problem: Problem[State], state: State, stopping: Stopping | None = None, *, free: NDArray[np.bool_] | None = None
) -> Result[State]:
    """Minimise by Levenberg-Marquardt with Nielsen's damping rule (Madsen, Nielsen, Tingleff, *Methods for Non-Linear Least
    Squares*, 2004).

    Args:
        problem: residuals, Jacobians and the retraction.
        state: start of the descent.
        stopping: iteration limit and tolerance.
        free: (n_shared,) mask of the shared unknowns that may move; all by default. Gauge freedoms may be free: the damping
            keeps the system regular.
    """
    stopping = stopping or Stopping()
    layout = problem.layout
    free = np.ones(layout.n_shared, dtype=bool) if free is None else free
    normal = NormalEquations(layout, terms := problem.terms(state, jacobians=True))
    cost = initial = sum(term.cost() for term in terms)
    damping, growth, converged, iteration, small = stopping.initial_damping, 2.0, False, 0, 0
    for iteration in range(1, stopping.max_iterations + 1):  # noqa: B007
        try:
            step = normal.reduce(damping).solve(free)
        except np.linalg.LinAlgError:
            damping, growth = damping * growth, growth * 2
            continue
        candidate = problem.retract(state, step)
        # Most steps are accepted. Computing the Jacobians of the candidate immediately costs less than its residuals twice.
        terms = problem.terms(candidate, jacobians=True)
        new_cost = sum(term.cost() for term in terms)
        predicted = _predicted_decrease(normal, step)
        if np.isfinite(new_cost) and new_cost < cost:
            gain = (cost - new_cost) / max(predicted, 1e-300)
            small = small + 1 if (cost - new_cost) <= stopping.tolerance * cost else 0
            converged = small >= 2
            state, cost = candidate, new_cost
            damping = max(damping * max(0.1, 1 - (2 * gain - 1) ** 3), 1e-12)
            growth = 2.0
            normal = NormalEquations(layout, terms)
        else:
            converged = predicted <= stopping.tolerance * 0.1 * cost
            damping, growth = damping * growth, growth * 2
        if converged or damping > 1e12:
            break
    return Result(state, cost, initial, iteration, converged, normal)


def _predicted_decrease(normal: NormalEquations, step: Step) -> float:
    """Return the decrease of the quadratic model, -(g.d + d.H d / 2), from the undamped equations."""
    shared, groups = step.shared, step.groups
    linear = normal.gradient @ shared + normal.group_gradient @ groups
    quadratic = shared @ normal.H @ shared + 2 * shared @ normal.cross @ groups + groups @ (normal.G * groups)
    for family, block in zip(normal.families, step.blocks, strict=True):
        linear += float(np.sum(family.gradient * block))
        right = (family.V @ block[:, :, None])[:, :, 0] + 2 * family.W.times(shared)
        if family.group is not None:
            right = right + 2 * family.w * groups[family.group][:, None]
        quadratic += float(np.sum(block * right))
    return float(-(linear + 0.5 * quadratic))
