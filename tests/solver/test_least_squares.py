"""The optimizer on small problems: against scipy, under outliers, with held unknowns, by full and by sparse tables."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.optimize

from passerby.solver.optimizer import couplings, normal_equations
from passerby.solver.optimizer.least_squares import Cauchy, Family, Layout, NormalEquations, Step, Stopping, Term, minimise
from support.tiers import thinned

TIGHT = Stopping(200, 1e-14)


@dataclass(frozen=True, eq=False)
class State:
    shared: np.ndarray
    groups: np.ndarray
    blocks: np.ndarray


@dataclass(eq=False)
class Curves:
    """Cameras (2 each), one global, groups and blocks of two, joined by a nonlinear function; every level of unknowns is in it.

    Row (camera c, block b of group g): exp(0.3 c0 x) + c1 y + global x y + 0.5 g, and its cube root's friend sin.
    """

    camera: np.ndarray
    block: np.ndarray
    group_of: np.ndarray
    target: np.ndarray
    loss: Cauchy | None = None
    n_cameras: int = 3

    @property
    def layout(self) -> Layout:
        n_groups = int(self.group_of.max()) + 1
        return Layout(self.n_cameras, 2, 1, n_groups, (Family(len(self.group_of), 2, self.group_of),))

    def model(self, state: State) -> np.ndarray:
        c, (x, y), g = state.shared[:-1].reshape(-1, 2)[self.camera], state.blocks[self.block].T, self.groups(state)
        world = state.shared[-1]
        return np.column_stack([np.exp(0.3 * c[:, 0] * x) + c[:, 1] * y + world * x * y + 0.5 * g, np.sin(x + c[:, 0]) + g * y])

    def groups(self, state: State) -> np.ndarray:
        return np.asarray(state.groups[self.group_of[self.block]])

    def terms(self, state: State, *, jacobians: bool) -> list[Term]:
        residual = (self.model(state) - self.target) / 0.1
        priors = self._priors(state)
        if not jacobians:
            return [Term(residual, self.loss), *priors]
        c, (x, y), g = state.shared[:-1].reshape(-1, 2)[self.camera], state.blocks[self.block].T, self.groups(state)
        world, n = state.shared[-1], len(self.camera)
        rise = 0.3 * np.exp(0.3 * c[:, 0] * x)
        turn, zero = np.cos(x + c[:, 0]), np.zeros(n)
        by_camera = np.stack([np.column_stack([rise * x, y]), np.column_stack([turn, zero])], axis=1) / 0.1
        first = np.column_stack([rise * c[:, 0] + world * y, c[:, 1] + world * x])
        by_block = np.stack([first, np.column_stack([turn, g])], axis=1) / 0.1
        by_group = np.column_stack([np.full(n, 0.5), y]) / 0.1
        by_globals = np.stack([(x * y)[:, None], zero[:, None]], axis=1) / 0.1
        return [
            Term(residual, self.loss, camera=self.camera, by_camera=by_camera, block=self.block, by_block=by_block,
                 group=self.group_of[self.block], by_group=by_group, by_globals=by_globals),
            *priors,
        ]  # fmt: skip

    def _priors(self, state: State) -> list[Term]:
        """The groups near 1, a row on several cameras at once, and a weak pull on the blocks."""
        n_shared, count = self.layout.n_shared, len(state.blocks)
        ones = np.zeros((1, 1, n_shared))
        ones[0, 0, :2] = 1.0
        return [
            Term(2.0 * (state.groups - 1)[:, None], group=np.arange(3), by_group=np.full((3, 1), 2.0)),
            Term(np.array([[state.shared[0] + state.shared[1] - 1.5]]), by_shared=ones),
            Term(state.blocks / 3.0, block=np.arange(count), by_block=np.tile(np.eye(2) / 3.0, (count, 1, 1))),
        ]

    def retract(self, state: State, step: Step) -> State:
        return State(state.shared + step.shared, state.groups + step.groups, state.blocks + step.blocks[0])


def curves(seed: int = 0, loss: Cauchy | None = None, noise: float = 0.1) -> tuple[Curves, State, State]:
    """A problem, its truth, and a start beside it."""
    rng = np.random.default_rng(seed)
    n_blocks = 12
    camera, block = (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(n_blocks), indexing="ij"))
    truth = State(rng.uniform(0.5, 1.5, 7), rng.uniform(0.7, 1.3, 3), rng.uniform(-1, 1, (n_blocks, 2)))
    problem = Curves(camera, block, np.sort(np.arange(n_blocks) % 3), np.zeros((len(camera), 2)), loss)
    problem.target = problem.model(truth) + noise * rng.normal(size=(len(camera), 2))
    start = State(*(value + 0.1 * rng.normal(size=value.shape) for value in (truth.shared, truth.groups, truth.blocks)))
    return problem, truth, start


def flat(state: State) -> np.ndarray:
    return np.concatenate([state.shared, state.groups, state.blocks.ravel()])


def unflat(vector: np.ndarray) -> State:
    return State(vector[:7], vector[7:10], vector[10:].reshape(-1, 2))


def all_residuals(problem: Curves, state: State) -> np.ndarray:
    return np.concatenate([term.residual.ravel() for term in problem.terms(state, jacobians=False)])


@thinned(("seed", "held"), [(2, [0, 3, 6]), (0, []), (1, []), (2, [])])
def test_the_minimum_is_where_scipy_ends_and_held_unknowns_stay(seed: int, held: list[int]) -> None:
    problem, _, start = curves(seed)
    free = ~np.isin(np.arange(7), held)
    found = minimise(problem, start, TIGHT, free=free)
    assert found.converged
    np.testing.assert_array_equal(found.state.shared[held], start.shared[held])
    moving = np.concatenate([free, np.ones(3 + 24, dtype=bool)])

    def residuals(vector: np.ndarray) -> np.ndarray:
        whole = flat(start)
        whole[moving] = vector
        return all_residuals(problem, unflat(whole))

    expected = scipy.optimize.least_squares(residuals, flat(start)[moving], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    np.testing.assert_allclose(flat(found.state)[moving], expected.x, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_robust_minimum_is_that_of_scipy_on_the_same_cost(seed: int) -> None:
    """Among outliers: the gradient of the true robust cost vanishes, and no general optimiser goes lower from there."""
    problem, _, start = curves(seed, Cauchy(2.0))
    problem.target[::7] += 3.0
    found = minimise(problem, start, TIGHT)

    def cost(vector: np.ndarray) -> float:
        return sum(term.cost() for term in problem.terms(unflat(vector), jacobians=False))

    assert found.cost == pytest.approx(cost(flat(found.state)), rel=1e-12)
    gradient = scipy.optimize.approx_fprime(flat(found.state), cost, 1e-7)
    assert np.abs(gradient).max() < 2e-3
    further = scipy.optimize.minimize(cost, flat(found.state), method="BFGS")
    assert further.fun > found.cost - 1e-6


@pytest.mark.parametrize("loss", [None, Cauchy(1.0)])
def test_the_cost_never_rises_and_the_same_start_gives_the_same_bits(loss: Cauchy | None) -> None:
    """Whatever the limit of iterations, more of them end no higher, even from a bad start; one has not converged."""
    problem, _, start = curves(4, loss)
    far = State(start.shared + 1.5, start.groups - 1.0, start.blocks * 3)
    found = [minimise(problem, far, Stopping(limit, 1e-12)) for limit in range(1, 25)]
    assert (np.diff([found[0].initial_cost, *(one.cost for one in found)]) <= 0).all()
    assert found[-1].cost < 0.2 * found[0].initial_cost
    assert (found[0].iterations, found[0].converged) == (1, False)
    again = minimise(problem, far, Stopping(24, 1e-12))
    np.testing.assert_array_equal(flat(again.state), flat(found[-1].state))
    assert again.cost == found[-1].cost


@pytest.mark.parametrize("seed", range(5))
def test_one_row_in_five_far_off_is_let_go(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plain, truth, start = curves(seed, noise=0.01)
    wrong = rng.choice(len(plain.camera), len(plain.camera) // 5, replace=False)
    right = np.setdiff1d(np.arange(len(plain.camera)), wrong)
    plain.target[wrong] += rng.choice([-4.0, 4.0], (len(wrong), 2))
    robust = Curves(plain.camera, plain.block, plain.group_of, plain.target, Cauchy(2.0))
    near = unflat(0.5 * (flat(start) + flat(truth)))
    robust_miss, plain_miss = (
        float(np.median(np.abs(problem.model(minimise(problem, near, TIGHT).state) - problem.model(truth))[right]))
        for problem in (robust, plain)
    )
    assert robust_miss < 0.015
    assert plain_miss > 5 * robust_miss


def test_a_freedom_of_gauge_does_not_break_the_descent() -> None:
    """y = a b with a and b both unknown: one direction is not fixed by anything; the product still converges."""

    class Product:
        layout = Layout(1, 2)

        def terms(self, state: np.ndarray, *, jacobians: bool) -> list[Term]:
            residual = np.array([[state[0] * state[1] - 6.0]])
            by = np.array([[[state[1], state[0]]]])
            return [Term(residual, camera=np.array([0]), by_camera=by)] if jacobians else [Term(residual)]

        def retract(self, state: np.ndarray, step: Step) -> np.ndarray:
            return np.asarray(state + step.shared)

    found = minimise(Product(), np.array([1.0, 1.0]), TIGHT)
    assert found.state.prod() == pytest.approx(6.0, abs=1e-6)
    assert np.isfinite(found.state).all()
    assert np.abs(found.state).max() < 20


def test_cauchy_halves_the_weight_at_its_scale() -> None:
    loss = Cauchy(3.0)
    squared = np.linspace(0, 100, 50)
    assert loss.weight(np.array([9.0]))[0] == 0.5
    slope = (loss.cost(squared + 1e-6) - loss.cost(squared - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, 0.5 * loss.weight(squared), rtol=1e-5)


N_CAMERAS, SIZE, N_GLOBALS, N_GROUPS, N_BLOCKS = 20, 3, 2, 9, 200


def random_terms(rng: np.random.Generator) -> tuple[Layout, list[Term]]:
    """A site of cameras in a row, each block seen by two or three neighbours, and rows that see many cameras at once."""
    first = rng.integers(0, N_CAMERAS - 2, N_BLOCKS)
    block, camera = np.repeat(np.arange(N_BLOCKS), 3), (first[:, None] + np.arange(3)).ravel()
    kept = rng.random(len(block)) < 0.8
    order = np.argsort(camera[kept], kind="stable")
    block, camera = block[kept][order], camera[kept][order]
    group = rng.integers(0, N_GROUPS, N_BLOCKS)
    layout = Layout(N_CAMERAS, SIZE, N_GLOBALS, N_GROUPS, (Family(N_BLOCKS, 2, group), Family(4, 3)))
    n = len(block)
    sightings = [
        Term(
            rng.normal(size=(n, k)), Cauchy(3.0), camera=camera, by_camera=rng.normal(size=(n, k, SIZE)), block=block,
            by_block=rng.normal(size=(n, k, 2)), group=group[block], by_group=rng.normal(size=(n, k)),
            by_globals=rng.normal(size=(n, k, N_GLOBALS)),
        )
        for k in (2, 1)
    ]  # fmt: skip
    eye = np.tile(np.eye(3), (4, 1, 1))
    shared = np.zeros((N_CAMERAS, 1, layout.n_shared))
    shared[np.arange(N_CAMERAS), 0, np.arange(N_CAMERAS) * SIZE] = 2.0
    own = np.arange(N_GROUPS)
    priors = [
        Term(np.ones((4, 3)), family=1, block=np.arange(4), by_block=eye),
        Term(np.ones((N_CAMERAS, 1)), by_shared=shared),
        Term(np.ones((1, 1)), by_shared=np.ones((1, 1, layout.n_shared))),
        Term(np.ones((N_GROUPS, 1)), group=own, by_group=np.ones((N_GROUPS, 1))),
    ]
    return layout, [*sightings, *priors]


@pytest.mark.parametrize("worth", [0.0, 1e9])
def test_both_tables_reduce_to_the_same_system_and_step(worth, monkeypatch):
    monkeypatch.setattr(couplings, "DENSE_WORTH", worth)
    layout, terms = random_terms(np.random.default_rng(0))
    sparse = NormalEquations(layout, terms)
    monkeypatch.setattr(normal_equations, "occurs_seldom", lambda *_: False)
    full = NormalEquations(layout, terms)
    assert not isinstance(sparse.cross, np.ndarray)
    assert isinstance(full.cross, np.ndarray)
    np.testing.assert_allclose(sparse.cross.toarray(), full.cross, atol=1e-12)
    for damping in (0.0, 0.1):
        one, other = sparse.reduce(damping), full.reduce(damping)
        np.testing.assert_allclose(one.H, other.H, atol=1e-10)
        np.testing.assert_allclose(one.gradient, other.gradient, atol=1e-10)
    free = np.ones(layout.n_shared, bool)
    a, b = sparse.reduce(0.1).solve(free), full.reduce(0.1).solve(free)
    np.testing.assert_allclose(a.shared, b.shared, atol=1e-10)
    np.testing.assert_allclose(a.groups, b.groups, atol=1e-10)
    for x, y in zip(a.blocks, b.blocks, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-10)
    shared = np.random.default_rng(9).normal(size=layout.n_shared)
    np.testing.assert_allclose(sparse.families[0].W.times(shared), full.families[0].W.times(shared), atol=1e-12)


def test_what_occurs_is_kept_where_few_of_many_cameras_see_a_block():
    two_each = np.repeat(np.arange(100), 2)
    assert couplings.occurs_seldom(10_000, 100, two_each)
    assert not couplings.occurs_seldom(2, 100, two_each)
    assert not couplings.occurs_seldom(10_000, 100, np.repeat(np.arange(100), 5_000))
    assert not couplings.occurs_seldom(1000, 0, np.zeros(0, np.int64))
