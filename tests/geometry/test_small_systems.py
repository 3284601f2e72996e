"""Many small systems at once against one after the other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.symmetric import solve_symmetric


@given(st.integers(0, 2**32 - 1), st.floats(-4.0, 4.0))
def test_solutions_are_those_of_each_system(seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 1, (50, 3, 3))
    matrix = (root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)) * 10.0**power
    right = rng.normal(0, 1, (50, 3))
    entries = np.array([matrix[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    expected = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    found = solve_symmetric(entries, right.T).T
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
