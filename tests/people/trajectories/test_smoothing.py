"""The smoother against a dense solution of the same problem, its blocks, its gaps."""

import numpy as np
import pytest

from passerby.people.trajectories import smoothing
from passerby.people.trajectories.smoothing import START_SPEED, smooth


def walk(count=60, step=0.2, seed=0):
    rng = np.random.default_rng(seed)
    seconds = np.cumsum(rng.uniform(0.5, 1.5, count) * step)
    true = np.column_stack([seconds, np.sin(seconds)])
    root = rng.normal(size=(count, 2, 2)) * 0.2
    covariance = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(2)
    seen = true + np.array([rng.multivariate_normal(np.zeros(2), S) for S in covariance])
    return seconds, true, seen, covariance


def dense(seconds, place, covariance, acceleration):
    """Mean and covariance of the same Gaussian problem, written down as one system of all states."""
    n = len(seconds)
    information, pull = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    information[2:4, 2:4] += np.eye(2) / START_SPEED**2
    for k in range(n):
        if np.isfinite(place[k, 0]):
            W = np.linalg.inv(covariance[k])
            information[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] += W
            pull[4 * k : 4 * k + 2] += W @ place[k]
        if k == 0:
            continue
        h = seconds[k] - seconds[k - 1]
        block = np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        Q = acceleration * np.kron(block, np.eye(2))
        F = np.eye(4)
        F[0, 2] = F[1, 3] = h
        J = np.concatenate([-F, np.eye(4)], axis=1)
        rows = slice(4 * k - 4, 4 * k + 4)
        information[rows, rows] += J.T @ np.linalg.inv(Q) @ J
    spread = np.linalg.inv(information)
    mean = (spread @ pull).reshape(n, 4)
    return mean[:, :2], np.array([spread[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] for k in range(n)])


def test_it_solves_the_whole_problem_part_by_part():
    """With a gap, in which people are between and less sure; parts know nothing of each other."""
    seconds, _, seen, covariance = walk()
    seen[30:37] = np.nan
    part = (np.arange(len(seconds)) >= 20).astype(int)
    place, spread = smooth(seconds, seen, covariance, part)
    for rows in (slice(20), slice(20, None)):
        want, want_spread = dense(seconds[rows], seen[rows], covariance[rows], smoothing.ACCELERATION)
        # The start is held to within 100 m here, not at all there.
        assert np.abs(place[rows] - want).max() < 1e-4
        assert np.abs(spread[rows] / want_spread - 1)[:, [0, 1], [0, 1]].max() < 1e-3


def test_blocks_change_nothing(monkeypatch):
    seconds, _, seen, covariance = walk(700)
    one = np.zeros(len(seconds), int)
    whole = smooth(seconds, seen, covariance, one)
    monkeypatch.setattr(smoothing, "BLOCK", 90)
    monkeypatch.setattr(smoothing, "CELLS", 400)
    cut = smooth(seconds, seen, covariance, one)
    assert np.abs(cut[0] - whole[0]).max() < 1e-5
    assert np.abs(cut[1] - whole[1]).max() < 1e-5


def test_it_is_nearer_than_the_measurements_and_its_covariance_is_honest():
    off, sigmas2, raw = [], [], []
    for seed in range(12):
        seconds, true, seen, covariance = walk(seed=seed)
        place, spread = smooth(seconds, seen, covariance, np.zeros(len(seconds), int))
        d = place - true
        off.append(d)
        raw.append(seen - true)
        sigmas2.append(np.einsum("ni,nij,nj->n", d, np.linalg.inv(spread), d))
    assert np.square(off).mean() < 0.4 * np.square(raw).mean()
    # Two degrees of freedom each; a sine of 1 m/s^2 is about as wild as the model takes people to be.
    assert 1.0 < np.mean(sigmas2) < 3.0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_places(count):
    seconds = np.arange(count) * 0.2
    place, covariance = np.ones((count, 2)), np.tile(0.01 * np.eye(2), (count, 1, 1))
    out, spread = smooth(seconds, place, covariance, np.zeros(count, int))
    assert np.allclose(out, 1.0, atol=1e-4)
    assert spread.shape == (count, 2, 2)
