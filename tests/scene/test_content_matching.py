"""The map between two cameras' boxes against least squares by the library."""

import numpy as np

from passerby.scene.content_matching import _lines, _quantiles


def test_lines_are_those_of_least_squares_by_the_points_used() -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 1000, (2, 30)), rng.uniform(0, 1000, (2, 30))
    use = (rng.random((2, 30)) < 0.7).astype(float)
    x[1, use[1] > 0] = 250.0  # one place only: any line through the mean does, the library takes the smallest
    slope, intercept = _lines(x, y, use)
    for axis in range(2):
        rows = use[axis] > 0
        design = np.column_stack([x[axis, rows], np.ones(rows.sum())])
        expected = np.linalg.lstsq(design, y[axis, rows], rcond=None)[0]
        np.testing.assert_allclose([slope[axis], intercept[axis]], expected, rtol=1e-9)


def test_quantiles_are_the_librarys() -> None:
    for count in (1, 2, 7, 400):
        values = np.sort(np.random.default_rng(count).normal(0, 100, count))
        np.testing.assert_allclose(_quantiles(values), np.quantile(values, (0.1, 0.5, 0.9)), rtol=1e-12)
