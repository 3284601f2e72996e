"""The benchmark of sites: what its page says of outcomes, and that recall is that of the true overlaps."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import sites_page
from pages.render import TEMPLATES, render
from passerby.association.candidates import stated_candidates
from passerby.simulation.sites import SiteOptions, simulate_site
from sites import calibrations, cases, corridors
from sites.true_tracks import true_tracks


def outcome(cameras: int, boxes: bool, at_eight: float, at_twelve: float, search_s: float = 2.0) -> dict[str, object]:
    return {
        "about": {"cameras": cameras, "boxes": boxes}, "cpu_s": 60.0, "search_s": search_s, "memory_mb": 200.0, "overlaps": 200,
        "degree": [2, 4.0, 6], "recall": {"8": at_eight, "12": at_twelve}, "tried": 600,
    }  # fmt: skip


def goals(*outcomes: dict[str, object]) -> list[list[str]]:
    done = {str(number): case for number, case in enumerate(outcomes)}
    return sites_page.tabulate_candidates(done, done).goals


def test_recall_is_acceptable_at_twelve_and_the_aim_at_eight():
    assert goals(outcome(100, True, 0.97, 0.981))[0][-1] == "acceptable"
    assert goals(outcome(100, True, 0.996, 0.999))[0][-1] == "aim"
    assert goals(outcome(100, True, 0.97, 0.979))[0][-1] == "**missed**"
    # Positions are no boxes.
    assert goals(outcome(100, False, 1.0, 1.0))[0][1:] == ["not run", "98 % at 12", "99.5 % at 8", ""]


def test_the_time_of_a_thousand_cameras_has_a_goal():
    assert goals(outcome(1000, False, 0.0, 0.99, 200.0))[2][-1] == "acceptable"
    assert goals(outcome(1000, False, 0.0, 0.99, 400.0))[2][-1] == "**missed**"


def test_a_thousand_cameras_are_extrapolated_and_marked_so():
    done = {
        str(n): {"cameras": n, "cpu_s": float(n), "memory_mb": 100.0 + n, "boxes": 10 * n} for n in (25, 100)
    }  # fmt: skip
    text = sites_page.tabulate_simulation(done, done).text
    assert re.search(r"\| 1000 \(extrapolated\) \| +\| 1000 s +\| 1100 MB", text)
    assert "extrapolated" not in sites_page.tabulate_simulation({**done, "more": None}, done).text


def test_the_page_has_all_parts() -> None:
    template = (TEMPLATES / "sites.md").read_text()
    assert all(f"{{{{ {part}" in template for part in sites_page.PAGE.parts)
    assert "Not run" not in render("sites")


def test_recall_is_the_share_of_true_pairs():
    candidates = stated_candidates("abcd", ("abc",))
    assert cases.recall(candidates, [(0, 1), (1, 2), (2, 3), (0, 3)]) == 0.5


def test_tracks_of_true_positions_are_of_the_people_whom_both_cameras_see():
    """By the true clocks and poses, the same people are at the same places."""
    site = simulate_site(SiteOptions(cameras=8, seed=805, seconds=60.0))
    (a, b), _ = max(site.shared_m2.items(), key=lambda item: item[1])
    tracks = true_tracks(site, 0.0)

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


def calibrated(cameras: int, cpu_s: float, wall_s: float = 600.0) -> dict[str, object]:
    groups = [
        {"verdict": "doubtful", "position_mm": [10.0, 30.0, 20.0], "orientation_deg": [0.1, 0.1, 0.4]},
        {"verdict": "accepted", "position_mm": [50.0, 40.0], "orientation_deg": [0.2, 0.3]},
    ]
    return {
        "cameras": cameras, "cpu_s": cpu_s, "wall_s": wall_s, "memory_mb": 2048.0, "registered": 5, "moved": 0,
        "groups": groups, "in_group": 0.97, "used_overlaps": 0.989,
    }  # fmt: skip


def test_growth_of_time_is_judged_only_where_both_sizes_are_run():
    small, large = calibrated(8, 10.0), calibrated(32, 44.0)
    goals_of = {len(cases_): sites_page.tabulate_halls({}, dict(enumerate(map(dict, cases_)))).goals
                for cases_ in ([small], [small, large])}  # fmt: skip
    assert goals_of[1][0][1] == "not run"
    assert goals_of[2][0][1::3] == ["4.4 x", "acceptable"]
    found = sites_page.tabulate_sites({}, {"a": calibrated(25, 300.0), "b": calibrated(100, 1600.0)})
    assert [goal[1] for goal in found.goals] == ["97 %", "20 mm", "10 min, 2.0 GB", "5.3 x", "98.9 %"]
    assert [goal[-1] for goal in found.goals] == ["acceptable", "aim", "acceptable", "**missed**", "acceptable"]
    assert "2 (1 doubtful, 1 accepted)" in found.text
    assert "50 mm" in found.text


def test_cameras_count_in_the_rig_of_most_of_those_with_which_they_share_ground(tmp_path):
    overlaps = tmp_path / "overlaps.csv"
    overlaps.write_text("camera_a,camera_b,shared_m2\nA,B,40\nB,C,5\nC,D,4.9\nD,E,9\n")
    for rigs, share in (
        ([["A", "B", "C"], ["D", "E"]], 1.0),
        ([["A", "B"], ["C", "D", "E"]], 0.8),
        ([["A"], ["D"]], 0.4),
        ([], 0.0),
    ):
        assert calibrations.share_in_group(rigs, overlaps) == pytest.approx(share)


def test_an_overlap_is_used_where_both_cameras_of_a_group_have_people_in_common(tmp_path):
    """Not where the same number is that of another group's person, and not by boxes of no person."""
    overlaps = tmp_path / "overlaps.csv"
    overlaps.write_text("camera_a,camera_b,shared_m2\nA,B,40\nB,C,5\nC,D,4.9\nD,E,9\n")
    people = {"A": (1, 2, 3, 4), "B": (2, 3, 4), "C": (4, -1, -1, -1), "D": (1, 2, 3), "E": (1, 2, 3)}
    for names, share in (("ABC DE", 2 / 3), ("AB D E", 1 / 3)):
        folders = [tmp_path / names / str(number) for number in range(len(names.split()))]
        for folder, group in zip(folders, names.split(), strict=True):
            (folder / "tracks").mkdir(parents=True)
            for name in group:
                rows = [f"{frame},{identity},0,0,10,20,1\n" for frame, identity in enumerate(people[name], start=1)]
                (folder / "tracks" / f"{name}.txt").write_text("".join(rows))
        assert calibrations.share_of_used_overlaps(folders, overlaps) == pytest.approx(share)


def test_errors_are_medians_over_the_cameras_of_all_groups():
    assert calibrations.errors_of(calibrated(25, 1.0)) == (30.0, 0.2)
    assert all(np.isnan(calibrations.errors_of({"groups": []})))


@pytest.mark.parametrize(
    ("now", "said"), [(5.0, ["0.25 x", "aim"]), (9.9, ["0.49 x", "acceptable"]), (10.1, ["0.51 x", "**missed**"])]
)
def test_processor_time_is_held_against_that_of_the_earlier_version(now: float, said: list[str]):
    case = {
        "about": {"against": "abc"}, "cpu_s": 80.0, "earlier": 20.0, "now": now, "apart_mm": 1e-6, "apart_deg": 0.0,
    }  # fmt: skip
    pets, colmap = sites_page.tabulate_small({"a": case}, {"a": case}).goals
    assert pets[1::3] == said
    assert colmap[1::3] == ["not run", ""]


def test_without_the_data_the_goals_of_small_scenes_are_not_run():
    assert [goal[1] for goal in sites_page.tabulate_small({}, {}).goals] == ["not run", "not run"]


def corridor(cameras: int, cpu_s: float, within_2: float = 0.96, of_zones_mm: float = 110.0) -> dict[str, Any]:
    return {
        "cameras": cameras, "cpu_s": cpu_s, "wall_s": cpu_s, "memory_mb": 10.0 * cameras, "registered": cameras,
        "verdict": "accepted", "zones": 4, "position_mm": 300.0, "orientation_deg": 0.3, "far": 100, "within_2": within_2,
        "of_zones_mm": of_zones_mm, "alone_mm": 100.0,
    }  # fmt: skip


def test_zones_are_judged_by_the_worst_corridor_and_extrapolated_by_a_power_law():
    wanted = {"a": None, "b": None}
    found = sites_page.tabulate_zones(wanted, {"a": corridor(125, 10.0), "b": corridor(250, 40.0, 0.91)})
    goals = found.goals
    assert [goal[1] for goal in goals] == ["11 min, 9.8 GB", "1.10 x", "91 %"]
    assert [goal[-1] for goal in goals] == ["**missed**", "acceptable", "acceptable"]
    assert "1000 (extrapolated)" in found.text
    one = sites_page.tabulate_zones(wanted, {"a": corridor(125, 10.0)})
    assert one.goals[0][1] == "not run"
    assert "extrapolated" not in one.text


@pytest.mark.slow
def test_a_corridor_is_solved_in_zones_that_are_as_good_as_alone():
    found = corridors.measure(corridors.CorridorCase(40, seed=7))
    assert found["registered"] == 40
    assert found["zones"] > 1
    assert found["far"] > 0
    assert found["of_zones_mm"] < 1.5 * found["alone_mm"]
    assert found["within_2"] > 0.8
