"""The focal length of a stretch of time and its sigma, by people whose places are known; moves beside it."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.calibration.diagnostics.pose_change import WINDOW_ROWS
from passerby.calibration.diagnostics.zoom import MOST_PAIRS, _thinned, detect_zoom, zoom_of
from support.scenes.sightings_of_places import MOVED, PEOPLE, POSE, seen


@pytest.mark.parametrize("zoom", [0.7, 1.4])
def test_the_focal_length_is_off_by_its_sigma_at_most(zoom: float) -> None:
    """Of a camera that stays where it is, over samples of the pixels' noise. What lasts may be as large again as what scatters,
    so that errors which only scatter are smaller.
    """
    errors, sigmas = [], []
    for seed in range(24):
        found = zoom_of(seen(POSE, zoom, count=60, seed=seed), POSE, POSE, 0.5)
        assert found is not None
        errors.append(np.log(found.factor / zoom))
        sigmas.append(abs(np.log(found.factor)) / found.sigmas)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) / np.mean(sigmas) < 1.2


@pytest.mark.parametrize("zoom", [0.8, 1.3])
def test_a_camera_that_was_moved_and_zoomed_is_told_with_both(zoom: float) -> None:
    found = zoom_of(seen(MOVED, zoom, noise=0.2), POSE, MOVED, 5.0)
    assert found is not None
    assert found.factor == pytest.approx(zoom, rel=0.03)
    np.testing.assert_allclose(found.pose.centre, MOVED.centre, atol=0.15)


@pytest.mark.parametrize("zoom", [0.97, 1.0, 1.03])
def test_a_camera_that_was_moved_and_hardly_zoomed_does_not_zoom(zoom: float) -> None:
    assert zoom_of(seen(MOVED, zoom, noise=0.05), POSE, MOVED, 5.0) is None


@pytest.mark.parametrize("times", [0.9, 1.5, 2.0, 2.5])
def test_of_many_sightings_even_steps_are_taken_for_the_focal_length(times: float) -> None:
    """What counts are pairs of a sighting and anybody whom it may show."""
    many = seen(POSE, count=int(times * MOST_PAIRS) // PEOPLE, tracklet={})
    few = _thinned(many)
    assert 0.5 * min(len(many.row), MOST_PAIRS) <= len(few.row) <= MOST_PAIRS
    kept = np.flatnonzero(np.isin(many.own.ray[:, 0], few.own.ray[:, 0]))
    assert len(kept) == len(few)
    assert len(set(np.diff(kept))) == 1


def zoomed_from(share: float, factor: float = 1.5, count: int = 200) -> np.ndarray:
    """(count,) of each sighting the focal length, that of the lens for a share of the time."""
    return np.where(np.arange(count) < share * count, 1.0, factor)


@pytest.mark.parametrize(("share", "stated", "at_end", "factor"), [
    (0.7, True, True, 1.5), (0.7, False, True, 1.5), (0.3, True, True, 1.5), (0.3, False, False, 1 / 1.5),
])  # fmt: skip
def test_a_zoom_is_dated_and_belongs_to_the_part_that_the_stated_lens_does_not_hold_for(
    share: float, stated: bool, at_end: bool, factor: float
) -> None:
    """Of a lens that is estimated, the longer part is taken for the rest."""
    change = detect_zoom(seen(POSE, zoomed_from(share), noise=0.3), POSE, 5.0, stated=stated)
    assert change is not None
    assert change.sure
    assert (change.at_start, change.at_end) == (not at_end, at_end)
    # 50 instants.
    assert (change.first, change.last) == ((50 * share, 49) if at_end else (0, 50 * share - 1))
    assert change.zoom == pytest.approx(factor, rel=0.02)
    assert change.metres < 0.1


@pytest.mark.parametrize(("count", "told"), [(2 * WINDOW_ROWS, True), (2 * WINDOW_ROWS - PEOPLE, False)])
def test_a_zoom_takes_enough_sightings_before_and_after(count: int, told: bool) -> None:
    m = seen(POSE, zoomed_from(0.5, 1.8, count), count=count, noise=0.2)
    assert (detect_zoom(m, POSE, 5.0) is not None) == told
