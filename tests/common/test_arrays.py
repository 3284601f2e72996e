"""Tables of columns, and inverses of large symmetric matrices, which are those that all eigenvalues give."""

from dataclasses import dataclass

import numpy as np
import pytest

from passerby.common import symmetric
from passerby.common.arrays import Columns, Floats, Ints
from passerby.common.symmetric import inverse_of, null_vectors, pseudo_inverse


@dataclass(frozen=True, eq=False)
class Table(Columns):
    number: Ints
    place: Floats
    speed: Floats | None = None


FULL = Table(np.arange(4), np.arange(8.0).reshape(4, 2), np.arange(4) / 2)


@dataclass(frozen=True, eq=False)
class Named(Columns):
    number: Ints
    names: tuple[str, ...] = ()


def test_rows_are_taken_and_joined_in_all_columns_alike():
    taken = FULL.take(np.array([3, 1]))
    assert (taken.number.tolist(), taken.place.tolist(), taken.speed.tolist()) == ([3, 1], [[6, 7], [2, 3]], [1.5, 0.5])
    assert (FULL.take(FULL.number > 2).number.tolist(), FULL.take(slice(1, 3)).number.tolist()) == ([3], [1, 2])
    assert Table(FULL.number, FULL.place).take(np.array([0])).speed is None
    joined = Table.joined([FULL.take(slice(0, 1)), FULL.take(slice(2, 4))])
    assert (joined.number.tolist(), joined.speed.tolist()) == ([0, 2, 3], [0, 1, 1.5])
    assert Table.joined([FULL, Table(FULL.number, FULL.place)]).speed is None
    table = Named(np.array([1, 0, 1]), ("a", "b"))  # a tuple is shared by all rows
    assert (table.take(np.array([0])).names, Named.joined([table, table]).names) == (("a", "b"), ("a", "b"))
    assert len(Named.joined([table, table]).number) == 6


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
    assert (pseudo_inverse(M, SHARE) == pseudo_inverse(M, SHARE)).all()


def test_eigenvalues_below_zero_are_null_and_unknowns_have_units() -> None:
    """However far below, and however many there are."""
    M, basis = matrix(0)
    value = np.geomspace(1e-8, 1.0, N) - 1e-3
    kept = value > 0
    expected = (basis[:, kept] / value[kept]) @ basis[:, kept].T
    np.testing.assert_allclose(pseudo_inverse(M - 1e-3 * np.eye(N), SHARE), expected, atol=1e-6 * np.abs(expected).max())
    units = np.geomspace(1e-3, 1e3, N)
    inverse = inverse_of(M * units[:, None] * units) * units[:, None] * units
    np.testing.assert_allclose(inverse @ M, np.eye(N), atol=1e-6)
