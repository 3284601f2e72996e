"""Rigs of many cameras: how they are cut, put together, and what becomes of a corridor of forty cameras."""

import numpy as np
import pytest

from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.evaluation.metrics import compare
from passerby.solver import people, zones
from passerby.solver.evidence import OVERLAPPING_ALL, Evidence, gather_evidence
from passerby.solver.people import PeopleOptions, solve_people
from passerby.solver.zones import CORE_CAMERAS, IN_COMMON, ZONE_CAMERAS, cut_zones, initial_rig_by_zones, restricted
from support.scenes.fits import started
from support.scenes.people_and_rigs import LENS, looking_at, poles, without_poses

COUNT, EVERY_M, REACH_M = 40, 5.0, 13.0


def corridor(count: int = COUNT) -> Rig:
    """Cameras on alternating sides of a corridor along x, which all look a little ahead."""
    spots = [(EVERY_M * k, 4.0 if k % 2 else -4.0, 3.0) for k in range(count)]
    return Rig(tuple(Camera(f"C{k + 1}", LENS, looking_at(at, (at[0] + 5.0, 0.0, 0.9))) for k, at in enumerate(spots)))


def people_in(rig: Rig, rng: np.random.Generator, instants: int = 120, noise: float = 0.01) -> Observations:
    """Twenty people at random places at each instant, each seen by the cameras that are near."""
    n, length = 20, EVERY_M * len(rig) + 5.0
    heights = np.tile(rng.normal(1.75, 0.06, n), instants)
    ground = np.column_stack([rng.uniform(0, length, n * instants), rng.uniform(-3, 3, n * instants)])
    frame, identity = np.repeat(np.arange(1, instants + 1), n), np.tile(np.arange(1, n + 1), instants)
    out = {}
    for camera, ltwh in zip(rig, poles(rig, ground, heights).values(), strict=True):
        ltwh = ltwh + noise * ltwh[:, 3:] * rng.normal(size=ltwh.shape)
        w, h = camera.lens.size
        with np.errstate(invalid="ignore"):
            inside = (ltwh[:, 0] > 1) & (ltwh[:, 1] > 1) & (ltwh[:, 0] + ltwh[:, 2] < w - 1) & (ltwh[:, 1] + ltwh[:, 3] < h - 1)
        seen = inside & (np.linalg.norm(ground - camera.pose.centre[:2], axis=1) < REACH_M)
        boxes = Boxes(frame[seen], identity[seen], ltwh[seen], np.ones(int(seen.sum())))
        out[camera.name] = CameraObservations(boxes, Keypoints.empty())
    return Observations(out)


def chain(count: int, reach: int = 3) -> np.ndarray:
    """What cameras in a row share: the less the farther apart."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.where((apart > 0) & (apart <= reach), 100 * (reach + 1 - apart), 0)


def shuffled_zones(count: int) -> tuple[list[tuple[int, ...]], np.ndarray]:
    """The zones of a row of cameras in any order, and where each camera stands in the row."""
    order = np.random.default_rng(count).permutation(count)
    return cut_zones(chain(count)[np.ix_(order, order)]), order


@pytest.mark.parametrize("count", [31, 400])
def test_zones_cover_all_cameras_and_overlap(count: int) -> None:
    found, _ = shuffled_zones(count)
    assert sorted({c for zone in found for c in zone}) == list(range(count))
    assert max(len(zone) for zone in found) <= ZONE_CAMERAS
    assert len(found) <= 2 * count / CORE_CAMERAS + 2
    joined = {0}
    for _ in found:
        joined |= {k for k in range(len(found)) for j in joined if len({*found[j]} & {*found[k]}) >= IN_COMMON}
    assert joined == set(range(len(found)))
    apart = np.zeros((40, 40), int)
    apart[:20, :20], apart[20:, 20:] = chain(20), chain(20)
    for zone in cut_zones(apart):
        assert max(zone) < 20 or min(zone) >= 20, "cameras that share nothing are zones of their own"


@pytest.mark.parametrize("times", [2, 3])
def test_a_row_of_cameras_is_cut_into_zones_of_equal_length(times: int) -> None:
    """Each has, at most, the cameras in common with neighbours on either side; few that are left over join these."""
    found, order = shuffled_zones(times * CORE_CAMERAS)
    assert len(found) == times
    for zone in found:
        assert CORE_CAMERAS <= len(zone) <= CORE_CAMERAS + 2 * IN_COMMON
        places = order[list(zone)]
        assert places.max() - places.min() == len(zone) - 1
    for left, more in ((1, 0), (2 * IN_COMMON - 1, 0), (2 * IN_COMMON, 1)):
        found, _ = shuffled_zones(times * CORE_CAMERAS + left)
        assert len(found) == times + more
        assert sum(len(zone) >= CORE_CAMERAS for zone in found) == times


@pytest.mark.parametrize(("room", "parts"), [(1, 1), (0, 2)])
def test_a_camera_that_is_left_over_stays_alone_where_its_neighbours_have_no_room(room: int, parts: int) -> None:
    """Each part leaves room for what it will have in common with a neighbour on either side."""
    full = ZONE_CAMERAS - 2 * IN_COMMON - room
    cores = zones._without_small([list(range(full)), [full]], chain(full + 1).astype(float))
    assert len(cores) == parts
    assert sorted(c for core in cores for c in core) == list(range(full + 1))


def test_what_a_zone_knows_is_what_its_cameras_saw() -> None:
    rig, cameras = corridor(14), [3, 4, 5, 6]
    names, blank = [rig.names[c] for c in cameras], without_poses(rig)
    seen = people_in(rig, np.random.default_rng(1), 40)
    zone = restricted(started(blank, seen, PeopleOptions()), cameras)
    alone = Observations({name: seen[name] for name in names})
    expected = gather_evidence(Rig(tuple(blank[name] for name in names)), alone, np.random.default_rng(0))

    def rows(evidence: Evidence) -> list[tuple[int, int, int, float]]:
        s = evidence.sightings
        identity = evidence.identities[evidence.person[s.block]]
        columns = (s.camera, evidence.frame[s.block], identity, s.extent_px)
        return sorted(zip(*(column.tolist() for column in columns), strict=True))

    assert rows(zone.evidence) == rows(expected)
    assert [camera.name for camera in zone.rig] == names
    assert all(h.a < 4 and h.b < 4 for h in zone.hypotheses)
    assert len(zone.knowledge.height_mean) == len(zone.evidence.identities)


def test_evidence_of_large_rigs_is_drawn_overlap_by_overlap() -> None:
    """Of two corridors full of people and a door that few pass, those at the door stay."""
    rig = corridor(OVERLAPPING_ALL + 2)
    seen, last = people_in(rig, np.random.default_rng(2), 60), rig.names[-1]
    door = CameraObservations(seen[last].boxes.take(seen[last].boxes.frame <= 5), seen[last].keypoints)
    given = without_poses(rig), Observations({**seen.cameras, last: door})
    whole = gather_evidence(*given, np.random.default_rng(0))
    drawn = gather_evidence(*given, np.random.default_rng(0), max_sightings=len(whole.sightings) // 4)
    of_last = [int((evidence.sightings.camera == len(rig) - 1).sum()) for evidence in (whole, drawn)]
    assert len(drawn.sightings) <= len(whole.sightings) // 4 + len(rig)
    assert of_last[1] > 0.9 * of_last[0]


@pytest.mark.slow
def test_a_corridor_of_forty_cameras_ends_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = corridor()
    seen = people_in(rig, np.random.default_rng(3))
    used = []

    def noted(*arguments, **named):
        used.append(initial_rig_by_zones(*arguments, **named))
        return used[-1]

    monkeypatch.setattr(people, "initial_rig_by_zones", noted)
    solution = solve_people(without_poses(rig), seen, ScaleCues(), rng=np.random.default_rng(0))
    assert len(used) == 1
    assert len(used[0].zones) > 1
    assert all(len(zone) <= ZONE_CAMERAS for zone in used[0].zones)
    assert len(solution.rig.posed()) == COUNT
    errors = compare(solution.rig.posed(), rig).similarity
    for camera in solution.figures.cameras:
        assert errors.position_mm[camera.name] < 3 * camera.shape_position_sigma_mm < 5000
        assert errors.orientation_deg[camera.name] < 3 * camera.shape_orientation_sigma_deg < 5


@pytest.mark.slow
def test_a_rig_that_no_zone_solves_is_solved_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = corridor(14)
    seen = people_in(rig, np.random.default_rng(4), 60)
    monkeypatch.setattr(people, "ZONE_CAMERAS", 13)
    monkeypatch.setattr(zones, "_solved", lambda job: None)
    solution = solve_people(without_poses(rig), seen, ScaleCues(), rng=np.random.default_rng(0))
    assert len(solution.rig.posed()) == 14


@pytest.mark.slow
def test_the_heading_of_a_seam_is_as_sure_as_people_make_it() -> None:
    """More people, surer headings; each is off by no more than some of its sigmas."""
    rig = corridor(34)
    sigmas = []
    for instants in (60, 240):
        solution = solve_people(
            without_poses(rig), people_in(rig, np.random.default_rng(5), instants), ScaleCues(), rng=np.random.default_rng(0)
        )
        sigmas.append([seam.heading_sigma_deg for seam in solution.figures.seams])
        assert 0 < min(sigmas[-1]) <= max(sigmas[-1]) < 10
    assert np.median(sigmas[1]) < np.median(sigmas[0])
