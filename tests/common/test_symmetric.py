"""Inverses of large symmetric matrices are those that all eigenvalues give."""

import numpy as np
import pytest

from passerby.common import symmetric
from passerby.common.symmetric import inverse_of, null_vectors, pseudo_inverse

N, SHARE = 60, 1e-10


def matrix(null: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Of eigenvalues from 1e-8 to 1 but for so many null ones, and its eigenvectors, the null ones first."""
    basis = np.linalg.qr(np.random.default_rng(seed).normal(size=(N, N)))[0]
    value = np.geomspace(1e-8, 1.0, N)
    value[:null] = np.geomspace(1e-15, 1e-13, null) if null else []
    M = (basis * value) @ basis.T
    return 0.5 * (M + M.T), basis


@pytest.fixture(autouse=True)
def _as_if_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(symmetric, "FULL_UP_TO", N - 1)


@pytest.mark.parametrize("null", [0, 1, 4, 7, 8, 20])
def test_as_by_all_eigenvalues(null: int) -> None:
    M, basis = matrix(null)
    found = null_vectors(M, SHARE)
    assert found.shape == (N, null)
    np.testing.assert_allclose(found @ found.T, basis[:, :null] @ basis[:, :null].T, atol=1e-6)
    expected = np.linalg.pinv(M, rcond=SHARE, hermitian=True)
    np.testing.assert_allclose(pseudo_inverse(M, SHARE), expected, atol=1e-5 * np.abs(expected).max())


def test_what_is_below_zero_is_null() -> None:
    """However far, and however many there are."""
    M, basis = matrix(0)
    value = np.geomspace(1e-8, 1.0, N) - 1e-3
    kept = value > 0
    expected = (basis[:, kept] / value[kept]) @ basis[:, kept].T
    np.testing.assert_allclose(pseudo_inverse(M - 1e-3 * np.eye(N), SHARE), expected, atol=1e-6 * np.abs(expected).max())


def test_the_same_twice() -> None:
    M, _ = matrix(2)
    assert (pseudo_inverse(M, SHARE) == pseudo_inverse(M, SHARE)).all()


def test_unknowns_have_units() -> None:
    M, _ = matrix(0)
    units = np.geomspace(1e-3, 1e3, N)
    inverse = inverse_of(M * units[:, None] * units) * units[:, None] * units
    np.testing.assert_allclose(inverse @ M, np.eye(N), atol=1e-6)
