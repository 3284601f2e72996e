"""What tracks score by chance, and registrations that are clear of it."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.association.graph import view_graph
from passerby.association.ground.chance import make_surrogates
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.registration import BELIEVED_SHARE, register_pair
from passerby.association.sampling import STEP_S
from support.scenes.walkers_on_plane import Station, seen_by, walkers

A, B = Station(0.4, -12.0 - 3.0j), Station(2.2, 4.0 + 11.0j)


def half_missed(tracks: GroundTracks, rng: np.random.Generator) -> GroundTracks:
    """The tracks of a detector that loses everybody for three seconds again and again, more often than not."""
    stretch = ((tracks.step * STEP_S + 20.0) // 3.0).astype(np.int64)
    kept = rng.uniform(size=(1000, 100))[tracks.tracklet, stretch] < 0.35
    tracklet = 100 * tracks.tracklet + stretch
    return replace(
        tracks, step=tracks.step[kept], tracklet=tracklet[kept], position=tracks.position[kept], velocity=tracks.velocity[kept]
    )


@pytest.mark.parametrize("seed", range(3))
def test_half_of_the_people_missed_is_still_clear_of_chance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = walkers(8, rng)
    found = register_pair(0, 1, *(half_missed(seen_by(station, people, rng), rng) for station in (A, B)), 5.0)
    best = found.candidates[0]
    assert best.share < BELIEVED_SHARE, "else the share alone would do"
    assert found.clear_of_chance
    turn, shift, _ = A.motion_to(B)
    middle = A.ground(0j)
    assert abs(best.turn * middle + best.shift - turn * middle - shift) < 1.0
    assert view_graph([found], 2).edges[0].used


@pytest.mark.parametrize("seed", range(6))
def test_strangers_are_not_clear_of_chance(seed: int) -> None:
    rng = np.random.default_rng(10 + seed)
    found = register_pair(
        0, 1, *(half_missed(seen_by(station, walkers(8, rng), rng), rng) for station in (A, B)), 5.0
    )  # fmt: skip
    assert not found.clear_of_chance
    assert not view_graph([found], 2).edges[0].used


def test_chance_is_not_asked_where_the_share_says_enough() -> None:
    rng = np.random.default_rng(2)
    people = walkers(6, rng)
    found = register_pair(0, 1, seen_by(A, people, rng), seen_by(B, people, rng), 5.0)
    assert found.candidates[0].share > BELIEVED_SHARE
    assert found.by_chance is None


def test_surrogates_keep_all_but_the_time() -> None:
    rng = np.random.default_rng(3)
    tracks = seen_by(A, walkers(4, rng), rng)
    backwards, late = make_surrogates(tracks, 5.0)
    for other in (backwards, late):
        assert np.array_equal(np.sort_complex(other.position), np.sort_complex(tracks.position))
        assert np.allclose(np.sort(np.abs(other.velocity)), np.sort(np.abs(tracks.velocity)))
        assert (other.step.min(), other.step.max()) == (tracks.step.min(), tracks.step.max())
        assert (np.diff(other.step) >= 0).all()
    first = tracks.step == tracks.step.min()
    assert set(backwards.position[backwards.step == tracks.step.max()]) == set(tracks.position[first])
    # A short recording has no time half of it late.
    short = seen_by(A, walkers(4, rng, 15.0), rng, seconds=15.0)
    assert [len(list(make_surrogates(short, lag_s))) for lag_s in (5.0, 0.0)] == [1, 2]
