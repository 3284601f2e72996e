"""The benchmark of sites: what its page says of outcomes, and that recall is that of the true overlaps."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sites_page
from passerby.association.candidates import stated_candidates
from passerby.geometry.rotations import log_rotation
from passerby.simulation.sites import SiteOptions, simulate_site
from sites import calibrations, cases, corridors, monitoring

OVERLAPS = "camera_a,camera_b,shared_m2\nA,B,40\nB,C,5\nC,D,4.9\nD,E,9\n"


def seen(found: Any, *columns: int) -> list[list[str]]:
    """Some columns of the goals of a part: 1, what was measured; -1, the verdict."""
    return [[goal[column] for column in columns] for goal in found.goals]


@pytest.mark.parametrize(
    ("cameras", "boxes", "recall", "search_s", "goal", "said"),
    [
        (100, True, {"8": 0.97, "12": 0.981}, 2.0, 0, ["98.1 % at 12", "acceptable"]),
        (100, True, {"8": 0.996, "12": 0.999}, 2.0, 0, ["99.9 % at 12", "aim"]),
        (100, True, {"8": 0.97, "12": 0.979}, 2.0, 0, ["97.9 % at 12", "**missed**"]),
        (100, False, {"8": 1.0, "12": 1.0}, 2.0, 0, ["not run", ""]),  # positions are no boxes
        (1000, False, {"12": 0.99}, 200.0, 2, ["200 s", "acceptable"]),
        (1000, False, {"12": 0.99}, 400.0, 2, ["400 s", "**missed**"]),
    ],
)
def test_recall_is_acceptable_at_twelve_the_aim_at_eight_and_takes_little_time(
    cameras: int, boxes: bool, recall: dict[str, float], search_s: float, goal: int, said: list[str]
):
    case = {
        "about": {"cameras": cameras, "boxes": boxes}, "cpu_s": 60.0, "search_s": search_s, "memory_mb": 200.0, "overlaps": 200,
        "degree": [2, 4.0, 6], "recall": recall, "tried": 600,
    }  # fmt: skip
    found = sites_page.tabulate_candidates({"a": case}, {"a": case})
    assert seen(found, 1, -1)[goal] == said
    assert found.goals[0][2:4] == ["98 % at 12", "99.5 % at 8"]


def test_a_thousand_cameras_are_extrapolated_and_marked_so():
    done = {str(n): {"cameras": n, "cpu_s": float(n), "memory_mb": 100.0 + n, "boxes": 10 * n} for n in (25, 100)}
    text = sites_page.tabulate_simulation(done, done).text
    assert re.search(r"\| 1000 \(extrapolated\) \| +\| 1000 s +\| 1100 MB", text)
    assert "extrapolated" not in sites_page.tabulate_simulation({**done, "more": None}, done).text


def test_recall_is_the_share_of_true_pairs():
    assert cases.recall(stated_candidates("abcd", ("abc",)), [(0, 1), (1, 2), (2, 3), (0, 3)]) == 0.5


def test_tracks_of_true_positions_are_of_the_people_whom_both_cameras_see():
    """By the true clocks and poses, the same people are at the same places."""
    site = simulate_site(SiteOptions(cameras=8, seed=805, seconds=60.0))
    (a, b), _ = max(site.shared_m2.items(), key=lambda item: item[1])
    tracks = cases.true_tracks(site, 0.0)

    def world(index: int) -> dict[tuple[int, int], complex]:
        own, camera = tracks[index], site.rig.cameras[index]
        forward = complex(*camera.pose.R_cw[2, :2])
        place = own.position / 1j * forward / abs(forward) + complex(*site.plan.mounts[index].ground)
        late = round(float(site.clock_offsets_s[index]) / 0.5)
        keys = zip((own.step + late).tolist(), own.tracklet.tolist(), strict=True)
        return dict(zip(keys, place.tolist(), strict=True))

    first, second = world(a), world(b)
    common = first.keys() & second.keys()
    assert len(common) > 50
    assert np.median([abs(first[key] - second[key]) for key in common]) == pytest.approx(0.6, abs=0.5)


def calibrated(cameras: int, cpu_s: float) -> dict[str, object]:
    groups = [
        {"verdict": "doubtful", "position_mm": [10.0, 30.0, 20.0], "orientation_deg": [0.1, 0.1, 0.4]},
        {"verdict": "accepted", "position_mm": [50.0, 40.0], "orientation_deg": [0.2, 0.3]},
    ]
    return {
        "cameras": cameras, "cpu_s": cpu_s, "wall_s": 600.0, "memory_mb": 2048.0, "registered": 5, "moved": 0,
        "groups": groups, "in_group": 0.97, "used_overlaps": 0.989,
    }  # fmt: skip


def test_growth_of_time_is_stated_only_where_both_sizes_are_run_and_errors_are_medians_of_all_groups():
    small, large = {"a": calibrated(8, 10.0)}, {"b": calibrated(32, 44.0)}
    assert seen(sites_page.tabulate_halls({}, small), 1, -1) == [["not run", ""]]
    assert seen(sites_page.tabulate_halls({}, small | large), 1, -1) == [["4.4 x", "acceptable"]]
    found = sites_page.tabulate_sites({}, {"a": calibrated(25, 300.0), "b": calibrated(100, 1600.0)})
    assert seen(found, 1, -1) == [
        ["97 %", "acceptable"], ["20 mm", "aim"], ["10 min, 2.0 GB", "acceptable"], ["5.3 x", "**missed**"],
        ["98.9 %", "acceptable"],
    ]  # fmt: skip
    assert "2 (1 doubtful, 1 accepted)" in found.text
    assert "50 mm" in found.text
    assert [goal[1] for goal in sites_page.tabulate_sites({}, {}).goals] == ["not run"] * 5
    assert calibrations.errors_of(calibrated(25, 1.0)) == (30.0, 0.2)
    assert all(np.isnan(calibrations.errors_of({"groups": []})))


@pytest.mark.parametrize(
    ("rigs", "share"),
    [
        ([["A", "B", "C"], ["D", "E"]], 1.0),
        ([["A", "B"], ["C", "D", "E"]], 0.8),
        ([["A"], ["D"]], 0.4),
        ([], 0.0),
    ],
)
def test_cameras_count_in_the_rig_of_most_of_those_with_which_they_share_ground(
    tmp_path: Path, rigs: list[list[str]], share: float
):
    (tmp_path / "overlaps.csv").write_text(OVERLAPS)
    assert calibrations.share_in_group(rigs, tmp_path / "overlaps.csv") == pytest.approx(share)


def test_an_overlap_is_used_where_both_cameras_of_a_group_have_people_in_common(tmp_path: Path):
    """Not where the same number is that of another group's person, and not by boxes of no person."""
    (tmp_path / "overlaps.csv").write_text(OVERLAPS)
    people = {"A": (1, 2, 3, 4), "B": (2, 3, 4), "C": (4, -1, -1, -1), "D": (1, 2, 3), "E": (1, 2, 3)}
    for names, share in (("ABC DE", 2 / 3), ("AB D E", 1 / 3)):
        folders = [tmp_path / names / str(number) for number in range(len(names.split()))]
        for folder, group in zip(folders, names.split(), strict=True):
            (folder / "tracks").mkdir(parents=True)
            for name in group:
                rows = [f"{frame},{identity},0,0,10,20,1\n" for frame, identity in enumerate(people[name], start=1)]
                (folder / "tracks" / f"{name}.txt").write_text("".join(rows))
        assert calibrations.share_of_used_overlaps(folders, tmp_path / "overlaps.csv") == pytest.approx(share)


@pytest.mark.parametrize(
    ("now", "said"), [(5.0, ["0.25 x", "aim"]), (9.9, ["0.49 x", "acceptable"]), (10.1, ["0.51 x", "**missed**"])]
)
def test_processor_time_is_held_against_that_of_the_earlier_version(now: float, said: list[str]):
    about = {"about": {"against": "abc"}, "cpu_s": 80.0, "apart_mm": 1e-6, "apart_deg": 0.0}
    done = {"a": about | {"earlier": 20.0, "now": now}}
    assert seen(sites_page.tabulate_small(done, done), 1, -1) == [said, ["not run", ""]]
    assert seen(sites_page.tabulate_small({}, {}), 1) == [["not run"], ["not run"]]


def test_the_solver_is_held_against_that_of_colmap():
    race = {"cpu_s": 9.0, "rows": 5, "neither_fails": 4, "ours_fail": 0, "theirs_fail": 1, "ratio": 0.9, "whole_ratio": 0.5,
            "ours_s": 3.0, "theirs_s": 6.0}  # fmt: skip
    found = sites_page.tabulate_small({"a": race}, {"a": race})
    assert seen(found, 1, -1) == [["not run", ""], ["0.90 x", "acceptable"]]
    assert found.tables["COLMAP"].rows == [["5", "4", "0", "1", "3.0 s", "6.0 s", "0.90", "0.50"]]


def corridor(cameras: int, cpu_s: float, within_2: float = 0.96, of_zones_mm: float = 110.0) -> dict[str, Any]:
    return {
        "cameras": cameras, "cpu_s": cpu_s, "wall_s": cpu_s, "memory_mb": 10.0 * cameras, "registered": cameras,
        "verdict": "accepted", "zones": 4, "position_mm": 300.0, "orientation_deg": 0.3, "far": 100, "within_2": within_2,
        "of_zones_mm": of_zones_mm, "alone_mm": 100.0,
    }  # fmt: skip


def test_the_worst_corridor_decides_about_zones_which_are_extrapolated_by_a_power_law():
    wanted = {"a": None, "b": None}
    found = sites_page.tabulate_zones(wanted, {"a": corridor(125, 10.0), "b": corridor(250, 40.0, 0.91)})
    assert seen(found, 1, -1) == [["11 min, 9.8 GB", "**missed**"], ["1.10 x", "acceptable"], ["91 %", "acceptable"]]
    assert "1000 (extrapolated)" in found.text
    one = sites_page.tabulate_zones(wanted, {"a": corridor(125, 10.0)})
    assert one.goals[0][1] == "not run"
    assert "extrapolated" not in one.text


@pytest.mark.slow
def test_a_corridor_is_solved_in_zones_that_are_as_good_as_alone():
    found = corridors.measure((40, 7))
    assert found["registered"] == 40
    assert found["zones"] > 1
    assert found["far"] > 0
    assert found["of_zones_mm"] < 1.5 * found["alone_mm"]
    assert found["within_2"] > 0.8


def test_files_that_differ_on_a_cluster_are_counted():
    case = {"cameras": 25, "took_s": {"one": 9.0, "pool": 5.0, "cluster": 6.0}, "killed": 3, "files": 40, "differing": []}
    assert seen(sites_page.tabulate_clusters({}, {"a": case}), 1, -1) == [["all of 40 files", "aim"]]
    worse = sites_page.tabulate_clusters({}, {"a": case | {"differing": ["rig.toml"]}})
    assert seen(worse, 1, -1) == [["1 of 40 files differ", "no"]]
    assert seen(sites_page.tabulate_clusters({}, {}), 1) == [["not run"]]


def monitored(cameras: int, every_s: float, few_s: float) -> dict[str, object]:
    return {
        "cameras": cameras, "minutes": 2.0, "cpu_s": every_s + few_s, "fresh": cameras // 20, "read": cameras // 20,
        "all": {"cpu_s": every_s, "wall_s": 1.0, "memory_mb": 100.0 + cameras},
        "few": {"cpu_s": few_s, "wall_s": 1.0, "memory_mb": 100.0},
        "thinning": {"every_s": 0.4, "one_window_in": 1, "predicted_s": 0.4},
        "moved": 3, "named": 2, "among": 0, "silent": 1, "falsely": 0, "untested": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("every_s", "few_s", "reached"), [(199.0, 10.0, "aim"), (399.0, 40.0, "acceptable"), (401.0, 62.0, "**missed**")]
)
def test_goals_of_monitoring_are_of_two_hundred_cameras(every_s: float, few_s: float, reached: str):
    done = {"50 cameras": monitored(50, 50.0, 3.0), "200 cameras": monitored(200, every_s, few_s)}
    assert seen(sites_page.tabulate_monitoring(done, done), -1) == [[reached], [reached]]
    small = {"50 cameras": done["50 cameras"]}
    assert seen(sites_page.tabulate_monitoring(small, small), 1) == [["not run"], ["not run"]]


def test_monitoring_of_a_thousand_cameras_is_extrapolated_once_both_sizes_are_there():
    done = {"50 cameras": monitored(50, 50.0, 3.0), "200 cameras": monitored(200, 200.0, 9.0)}
    rows = [row for row in sites_page.tabulate_monitoring(done, done).tables["Result"].rows if "extrapolated" in row[0]]
    assert rows[0][1:] == ["1000", "1000 s", "0.5 s", "0.5 s", "1100 MB"]
    assert rows[1][1:4] == ["50", "41 s", "0.021 s"]
    assert "extrapolated" not in sites_page.tabulate_monitoring(done, {"200 cameras": done["200 cameras"]}).text


def test_the_rig_of_before_is_turned_where_it_says_so():
    truth = simulate_site(SiteOptions(cameras=40, seed=1, seconds=10)).rig
    rig, moved = monitoring.calibrated_before(truth, 1)
    turns = {
        new.name: np.degrees(np.linalg.norm(log_rotation(new.pose.R_cw @ old.pose.R_cw.T)))
        for old, new in zip(truth, rig, strict=True)
    }
    assert len(moved) == 2
    assert all((turns[name] > 1.5) == (name in moved) for name in turns)
    again, same = monitoring.calibrated_before(truth, 1)
    assert same == moved
    assert np.array_equal(again["C7"].pose.R_cw, rig["C7"].pose.R_cw)


def test_cameras_are_counted_by_what_was_said_of_them():
    states = ["moved", "steady", "cannot tell", "one of several moved", "moved", "steady"]
    told = {"cameras": [{"name": f"C{number}", "state": state} for number, state in enumerate(states, start=1)]}
    assert monitoring.outcome_of(told, ["C1", "C2", "C3", "C4"]) == {
        "moved": 4, "named": 1, "among": 1, "silent": 1, "falsely": 1, "untested": 1,
    }  # fmt: skip
