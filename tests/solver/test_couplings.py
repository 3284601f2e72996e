"""Tables by what occurs give what full tables give."""

import numpy as np
import pytest

from passerby.solver.optimizer import couplings, normal_equations
from passerby.solver.optimizer.couplings import FULL_UP_TO, occurs_seldom
from passerby.solver.optimizer.least_squares import Cauchy, Family, Layout, NormalEquations, Term

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
    assert occurs_seldom(2 * FULL_UP_TO, 100, two_each)
    assert not occurs_seldom(FULL_UP_TO, 100, two_each)
    assert not occurs_seldom(2 * FULL_UP_TO, 100, np.repeat(np.arange(100), FULL_UP_TO))
    assert not occurs_seldom(1000, 0, np.zeros(0, np.int64))
