"""Recordings that begin minutes apart: their starts are found by people's activity, or nothing is claimed."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.clocks.activity import find_lag_peaks, lag_of_visits, region_activity
from passerby.association.clocks.starts import (
    CREATION_TIME,
    SOUND,
    WALL_CLOCK,
    MeasuredStart,
    Starts,
    contradicted_starts,
    find_starts,
    shifted,
)
from passerby.association.initial_association import associate_by_ground_tracks
from passerby.association.registration_failures import unregistered_cameras
from passerby.association.sampling import STEP_S
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.findings.ranking import RefusalError, findings_of
from passerby.simulation.passing_crowd import CrowdOptions, simulate_crowd

STARTS_S, SECONDS = (0.0, 200.0, 100.0), 500.0


@lru_cache(maxsize=4)
def seen(
    seed: int = 4, *, known: bool = False, strangers: tuple[int, ...] = (), seconds: float = SECONDS
) -> list[CameraTracklets]:
    options = CrowdOptions(
        seed, starts_s=STARTS_S, seconds=seconds, per_minute=8.0, identities_known=known, strangers=strangers
    )  # fmt: skip
    crowd = simulate_crowd(options)
    clocks, rng = crowd.observations.clocks, np.random.default_rng(0)
    return build_tracklets(crowd.rig, crowd.observations, clocks, PERSON_HEIGHT_M, rng, given=True)


def test_starts_are_found_and_pairs_registered_about_them() -> None:
    cameras = seen()
    starts = find_starts(cameras, 600.0)
    np.testing.assert_allclose(starts.offset_s, STARTS_S, atol=0.6)
    assert [one.found_by for one in starts.differences] == ["activity", "activity"]
    apart = starts.notices[0]
    assert (apart.code, apart.cameras) == ("starts_apart", ("C1", "C2", "C3"))
    found = associate_by_ground_tracks(cameras, Tracklets.of(cameras), 600.0, {}, starts=starts)
    assert found.graph.groups == ((0, 1, 2),)
    np.testing.assert_allclose(found.offset_s, STARTS_S, atol=0.05)


def test_lags_are_sought_within_their_bounds_and_where_recordings_overlap() -> None:
    first, second = (region_activity(camera.tracks) for camera in seen()[:2])
    assert find_lag_peaks(first, second, 500, 2000, 1)[0].lag >= 500
    assert find_lag_peaks(first, second, 5000, 6000, 1) == ()


def test_known_identities_leave_a_minute_of_lags() -> None:
    cameras = seen(known=True)
    earliest, latest = lag_of_visits(cameras[0].tracks, cameras[1].tracks)
    assert earliest * STEP_S < -200.0 < latest * STEP_S
    assert (latest - earliest) * STEP_S <= 90.0
    np.testing.assert_allclose(find_starts(cameras, 600.0, known=True).offset_s, STARTS_S, atol=0.6)


def test_people_who_are_always_there_tell_no_lag() -> None:
    still = np.ones(800, np.complex128)
    step, tracklet = np.repeat(np.arange(400), 2), np.tile([0, 1], 400)
    few = replace(seen(known=True)[0].tracks, step=step, tracklet=tracklet, position=still, velocity=still)
    assert lag_of_visits(few, few) is None


@pytest.mark.slow
def test_a_camera_that_sees_other_people_has_an_unknown_start() -> None:
    cameras = seen(strangers=(2,))
    starts = find_starts(cameras, 600.0)
    assert starts.group.tolist() == [0, 0, 2]
    assert starts.lag_steps(0, 2) is None
    found = associate_by_ground_tracks(cameras, Tracklets.of(cameras), 600.0, {}, starts=starts)
    assert found.graph is not None
    lost = unregistered_cameras(cameras, found.graph, 600.0, starts=starts)
    assert {name: one.code for name, one in lost.items()} == {"C3": "start_unknown"}
    assert lost["C3"].values == {"searched_s": 600.0, "lags_s": None}


def test_nothing_is_claimed_where_no_two_cameras_share_people() -> None:
    cameras = seen(strangers=(1,))[:2]
    starts = find_starts(cameras, 600.0)
    with pytest.raises(RefusalError) as caught:
        associate_by_ground_tracks(cameras, Tracklets.of(cameras), 600.0, {}, starts=starts)
    told = [(one.code, one.severity) for one in findings_of(caught.value)]
    assert told == [(code, "refusal") for code in ("no_pair_registered", "start_unknown", "start_unknown")]


def test_a_measured_start_is_tried_first_and_people_decide() -> None:
    """A wall clock that is right to a second is taken; one that is an hour off is passed over, and contradicted."""
    cameras = seen()[:2]
    right = find_starts(cameras, 600.0, [MeasuredStart(("C2", "C1"), -199.0, 1.0, WALL_CLOCK)])
    assert [one.found_by for one in right.differences] == ["wall clock"]
    np.testing.assert_allclose(right.offset_s, STARTS_S[:2], atol=0.6)
    wrong = find_starts(cameras, 600.0, [MeasuredStart(("C1", "C2"), 100.0, 1.0, WALL_CLOCK)])
    assert [one.found_by for one in wrong.differences] == ["activity"]
    assert contradicted_starts(right, ["C1", "C2"], right.offset_s, [True, True]) == []
    (found,) = contradicted_starts(wrong, ["C1", "C2"], wrong.offset_s, [True, True])
    assert (found.code, found.cameras) == ("start_contradicted", ("C2", "C1"))
    assert found.values["people_s"] == pytest.approx(200.0, abs=0.6)
    assert contradicted_starts(wrong, ["C1", "C2"], wrong.offset_s, [True, False]) == []


@pytest.mark.parametrize("known", [False, True])
def test_a_files_clock_leads_beyond_the_search_where_people_agree(known: bool) -> None:
    """Offsets up to 5 s are searched; the recordings begin 200 s apart, and the files say 198 s."""
    cameras = seen(known=known)[:2]
    right = [MeasuredStart(("C1", "C2"), 198.0, 5.0 / 3.0, CREATION_TIME)]
    starts = find_starts(cameras, 5.0, right, known=known)
    assert starts.lag_steps(0, 1) == pytest.approx(-200.0 / STEP_S, abs=1)
    assert [one.found_by for one in starts.differences] == ["creation time"]
    found = associate_by_ground_tracks(cameras, Tracklets.of(cameras), 5.0, {}, starts=starts)
    np.testing.assert_allclose(found.offset_s, STARTS_S[:2], atol=0.05)


def test_a_files_clock_that_people_contradict_changes_nothing() -> None:
    """Copies have the time of the copying: the search of 5 s about equal clocks goes on as without it."""
    cameras = [replace(camera, tracks=shifted(camera.tracks, round(-begin / STEP_S))) for camera, begin in
               zip(seen()[:2], STARTS_S[:2], strict=True) if camera.tracks is not None]  # fmt: skip
    wrong = [MeasuredStart(("C1", "C2"), 90.0, 5.0 / 3.0, CREATION_TIME)]
    starts = find_starts(cameras, 5.0, wrong)
    assert starts.lag_steps(0, 1) is None
    assert not starts.far
    found, plain = (associate_by_ground_tracks(cameras, Tracklets.of(cameras), 5.0, {}, starts=one) for one in (starts, None))
    np.testing.assert_array_equal(found.offset_s, plain.offset_s)
    np.testing.assert_array_equal(found.person, plain.person)
    (contradicted,) = contradicted_starts(starts, ["C1", "C2"], found.offset_s, [True, True])
    assert contradicted.values["found_by"] == "creation time"


def test_where_tracks_fit_nothing_yet_activity_has_to_agree_with_a_files_clock() -> None:
    cameras = seen()[:2]
    right, wrong = (MeasuredStart(("C1", "C2"), offset, 5.0 / 3.0, CREATION_TIME) for offset in (199.0, -120.0))
    assert find_starts(cameras, 300.0, [right], by_tracks=False).lag_steps(0, 1) == -398
    strangers = seen(strangers=(1,))[:2]
    assert find_starts(strangers, 300.0, [wrong], by_tracks=False).lag_steps(0, 1) is None


def test_a_creation_time_may_be_that_of_either_end() -> None:
    cameras = seen()[:2]
    both = [MeasuredStart(("C1", "C2"), offset, 5.0 / 3.0, CREATION_TIME) for offset in (100.0, 199.0)]
    starts = find_starts(cameras, 5.0, both)
    assert starts.lag_steps(0, 1) == pytest.approx(-200.0 / STEP_S, abs=1)
    assert contradicted_starts(starts, ["C1", "C2"], starts.offset_s, [True, True]) == []


def test_sound_alone_is_taken_where_offsets_are_not_searched_in_full() -> None:
    """Where all offsets can be searched in full, a pair whose start is unknown is searched as ever, and not hours apart."""
    cameras = seen(strangers=(1,))[:2]
    sound = [MeasuredStart(("C1", "C2"), 42.0, 0.01, SOUND)]
    assert [find_starts(cameras, searched, sound).lag_steps(0, 1) for searched in (600.0, 60.0, 5.0)] == [-84, None, -84]
    assert [Starts(searched, np.zeros(2), np.arange(2)).far for searched in (60.0, 61.0)] == [False, True]


def test_two_lags_that_fit_as_well_are_named() -> None:
    """A crowd that walks the same ways once more, as a film that is shown twice, fits twice."""
    cameras = seen()[:2]
    first = cameras[0].tracks
    long = int(first.step[-1] - first.step[0]) + 200
    again = replace(
        first, step=np.append(first.step, first.step + long), tracklet=np.append(first.tracklet, first.tracklet + 1000),
        position=np.tile(first.position, 2), velocity=np.tile(first.velocity, 2),
    )  # fmt: skip
    starts = find_starts([replace(cameras[0], tracks=again), cameras[1]], 1200.0)
    assert starts.group.tolist() == [0, 1]
    assert sorted(starts.doubts[1].values["lags_s"]) == pytest.approx([200.0, 200.0 + long * STEP_S], abs=0.6)
