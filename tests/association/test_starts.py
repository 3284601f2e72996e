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
from passerby.association.initial_association import InitialAssociation, associate_by_ground_tracks
from passerby.association.registration_failures import unregistered_cameras
from passerby.association.sampling import STEP_S
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.findings.finding import Finding
from passerby.findings.ranking import RefusalError, findings_of
from passerby.simulation.passing_crowd import CrowdOptions, simulate_crowd

STARTS_S, SECONDS = (0.0, 200.0, 100.0), 500.0


@lru_cache(maxsize=4)
def seen(*, known: bool = False, strangers: tuple[int, ...] = ()) -> list[CameraTracklets]:
    crowd = simulate_crowd(
        CrowdOptions(4, starts_s=STARTS_S, seconds=500.0, per_minute=8.0, identities_known=known, strangers=strangers)
    )
    clocks, rng = crowd.observations.clocks, np.random.default_rng(0)
    return build_tracklets(crowd.rig, crowd.observations, clocks, PERSON_HEIGHT_M, rng, given=True)


def associated(cameras: list[CameraTracklets], searched_s: float, starts: Starts | None) -> InitialAssociation:
    return associate_by_ground_tracks(cameras, Tracklets.of(cameras), searched_s, {}, starts=starts)


def measured(offset_s: float, sigma_s: float = 5.0 / 3.0, by: str = CREATION_TIME) -> list[MeasuredStart]:
    """By default what a file says."""
    return [MeasuredStart(("C1", "C2"), offset_s, sigma_s, by)]


def contradicted(starts: Starts, offset_s: np.ndarray, *, registered: bool = True) -> list[Finding]:
    return contradicted_starts(starts, ["C1", "C2"], offset_s, [True, registered])


def test_starts_are_found_and_pairs_registered_about_them() -> None:
    cameras = seen()
    starts = find_starts(cameras, 600.0)
    np.testing.assert_allclose(starts.offset_s, STARTS_S, atol=0.6)
    assert [one.found_by for one in starts.differences] == ["activity", "activity"]
    apart = starts.notices[0]
    assert (apart.code, apart.cameras) == ("starts_apart", ("C1", "C2", "C3"))
    found = associated(cameras, 600.0, starts)
    assert found.graph.groups == ((0, 1, 2),)
    np.testing.assert_allclose(found.offset_s, STARTS_S, atol=0.05)
    first, second = (region_activity(camera.tracks) for camera in cameras[:2])
    assert find_lag_peaks(first, second, 500, 2000, 1)[0].lag >= 500, "within the bounds of the search"
    assert find_lag_peaks(first, second, 5000, 6000, 1) == (), "where recordings overlap"


def test_known_identities_leave_a_minute_of_lags_unless_people_are_always_there() -> None:
    cameras = seen(known=True)
    earliest, latest = lag_of_visits(cameras[0].tracks, cameras[1].tracks)
    assert earliest * STEP_S < -200.0 < latest * STEP_S
    assert (latest - earliest) * STEP_S <= 90.0
    np.testing.assert_allclose(find_starts(cameras, 600.0, known=True).offset_s, STARTS_S, atol=0.6)
    still = np.ones(800, np.complex128)
    step, tracklet = np.repeat(np.arange(400), 2), np.tile([0, 1], 400)
    few = replace(cameras[0].tracks, step=step, tracklet=tracklet, position=still, velocity=still)
    assert lag_of_visits(few, few) is None


@pytest.mark.slow
def test_a_camera_that_sees_other_people_has_an_unknown_start() -> None:
    cameras = seen(strangers=(2,))
    starts = find_starts(cameras, 600.0)
    assert starts.group.tolist() == [0, 0, 2]
    assert starts.lag_steps(0, 2) is None
    lost = unregistered_cameras(cameras, associated(cameras, 600.0, starts).graph, 600.0, starts=starts)
    assert {name: one.code for name, one in lost.items()} == {"C3": "start_unknown"}
    assert lost["C3"].values == {"searched_s": 600.0, "lags_s": None}


def test_nothing_is_claimed_where_no_two_cameras_share_people() -> None:
    cameras = seen(strangers=(1,))[:2]
    with pytest.raises(RefusalError) as caught:
        associated(cameras, 600.0, find_starts(cameras, 600.0))
    stated = [(one.code, one.severity) for one in findings_of(caught.value)]
    assert stated == [(code, "refusal") for code in ("no_pair_registered", "start_unknown", "start_unknown")]


def test_a_measured_start_is_tried_first_and_people_decide() -> None:
    """A wall clock that is right to a second is taken; one that is far off is passed over, and contradicted."""
    cameras = seen()[:2]
    right = find_starts(cameras, 600.0, [MeasuredStart(("C2", "C1"), -199.0, 1.0, WALL_CLOCK)])
    assert [one.found_by for one in right.differences] == ["wall clock"]
    np.testing.assert_allclose(right.offset_s, STARTS_S[:2], atol=0.6)
    wrong = find_starts(cameras, 600.0, measured(100.0, 1.0, WALL_CLOCK))
    assert [one.found_by for one in wrong.differences] == ["activity"]
    assert contradicted(right, right.offset_s) == contradicted(wrong, wrong.offset_s, registered=False) == []
    (found,) = contradicted(wrong, wrong.offset_s)
    assert (found.code, found.cameras) == ("start_contradicted", ("C2", "C1"))
    assert found.values["people_s"] == pytest.approx(200.0, abs=0.6)


@pytest.mark.parametrize("known", [False, True])
def test_a_files_clock_leads_beyond_the_search_where_people_agree(known: bool) -> None:
    """Offsets up to 5 s are searched; the recordings begin 200 s apart, and the files say 198 s."""
    cameras = seen(known=known)[:2]
    starts = find_starts(cameras, 5.0, measured(198.0), known=known)
    assert starts.lag_steps(0, 1) == pytest.approx(-200.0 / STEP_S, abs=1)
    assert [one.found_by for one in starts.differences] == ["creation time"]
    np.testing.assert_allclose(associated(cameras, 5.0, starts).offset_s, STARTS_S[:2], atol=0.05)


def test_a_files_clock_that_people_contradict_changes_nothing() -> None:
    """Copies have the time of the copying: the search of 5 s about equal clocks goes on as without it."""
    both = zip(seen()[:2], STARTS_S[:2], strict=True)
    cameras = [replace(camera, tracks=shifted(camera.tracks, round(-begin / STEP_S))) for camera, begin in both]
    starts = find_starts(cameras, 5.0, measured(90.0))
    assert (starts.lag_steps(0, 1), starts.far) == (None, False)
    found, plain = (associated(cameras, 5.0, one) for one in (starts, None))
    np.testing.assert_array_equal(found.offset_s, plain.offset_s)
    np.testing.assert_array_equal(found.person, plain.person)
    (finding,) = contradicted(starts, found.offset_s)
    assert finding.values["found_by"] == "creation time"


def test_a_files_clock_may_be_that_of_either_end_and_activity_has_to_agree_where_tracks_fit_nothing_yet() -> None:
    cameras = seen()[:2]
    starts = find_starts(cameras, 5.0, measured(100.0) + measured(199.0))
    assert starts.lag_steps(0, 1) == pytest.approx(-200.0 / STEP_S, abs=1)
    assert contradicted(starts, starts.offset_s) == []
    assert find_starts(cameras, 300.0, measured(199.0), by_tracks=False).lag_steps(0, 1) == -398
    assert find_starts(seen(strangers=(1,))[:2], 300.0, measured(-120.0), by_tracks=False).lag_steps(0, 1) is None


def test_sound_alone_is_taken_where_offsets_are_not_searched_in_full() -> None:
    """Where all offsets can be searched in full, a pair whose start is unknown is searched as ever, and not hours apart."""
    cameras = seen(strangers=(1,))[:2]
    sound = measured(42.0, 0.01, SOUND)
    assert [find_starts(cameras, searched, sound).lag_steps(0, 1) for searched in (600.0, 60.0, 5.0)] == [-84, None, -84]
    assert [Starts(searched, np.zeros(2), np.arange(2)).far for searched in (5.0, 600.0)] == [False, True]


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
