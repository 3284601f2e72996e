"""`docs/results/sites.md`: sites of many cameras, beside the goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from datasets import ROOT
from goals import goal_row
from pages.cases import Outcomes
from pages.parts import Cases, Part, PartedPage, found_of
from pages.records import Found
from pages.tables import number, reached, table
from sites import calibrations, clusters, corridors, monitoring, small
from sites import cases as site_cases

CODE = ("sites", "peers")  # folders of the benchmarks that the outcomes depend on, beside the package
KEPT = ROOT / "build" / "sites"
SEEDS = 5  # of sites of 100 cameras by positions

MOST = site_cases.COUNTS[-1]


def tabulate_simulation(cases: Cases, done: Outcomes) -> Found:
    """Time and memory of the simulation, and what they mean for a thousand cameras."""
    rows = [
        [str(case["cameras"]), f"{case['boxes']:,}", f"{case['cpu_s']:.0f} s", f"{case['memory_mb']:.0f} MB"]
        for case in done.values()
    ]
    notes = []
    if len(done) == len(cases):
        small, large = done.values()
        time_s, memory_mb = (_at_thousand(small, large, key) for key in ("cpu_s", "memory_mb"))
        rows.append(["1000 (extrapolated)", "", f"{time_s:.0f} s", f"{memory_mb:.0f} MB"])
        notes = [f"Four times the cameras take {number(large['cpu_s'] / small['cpu_s'], 2)} times the processor time."]
    head = ("cameras", "boxes", "processor time", "largest memory")
    return found_of(cases, done, {"Result": table(head, rows)}, notes=notes)


def _at_thousand(small: Mapping[str, Any], large: Mapping[str, Any], key: str) -> float:
    """The straight line through two sizes, at a thousand cameras."""
    slope = (large[key] - small[key]) / (large["cameras"] - small["cameras"])
    return float(large[key] + slope * (1000 - large["cameras"]))


def tabulate_candidates(cases: Cases, done: Outcomes) -> Found:
    """Recall against candidates per camera."""
    rows = []
    for (cameras, boxes), some in _kinds(done).items():
        share = [_percent(some, count) for count in site_cases.COUNTS]
        search = max(case["search_s"] for case in some)
        fewest, most = min(case["degree"][0] for case in some), max(case["degree"][2] for case in some)
        mean = float(np.mean([case["degree"][1] for case in some]))
        overlaps = sum(case["overlaps"] for case in some)
        rows.append([
            str(cameras), "boxes" if boxes else "positions", str(len(some)),
            f"{overlaps} ({fewest} to {most}, mean {mean:.1f})", *share,
            f"{search:.1f} s", f"{max(case['memory_mb'] for case in some):.0f} MB",
        ])  # fmt: skip
    goals = []
    for text, kind in (("100 cameras, of boxes", (100, True)), ("1,000 cameras, of positions", (1000, False))):
        goal = f"candidates at {text}: recall of true overlaps", "98 % at 12", "99.5 % at 8"
        if (own := _kinds(done).get(kind)) is None:
            goals.append([goal[0], "not run", *goal[1:], ""])
            continue
        value, at_eight = (float(np.mean([case["recall"].get(count, 0.0) for case in own])) for count in (str(MOST), "8"))
        # The aim is eight candidates with 99.5 %: reached only where that many do.
        verdict = "aim" if at_eight >= 0.995 else reached([-value], [-0.98], [-2.0])
        goals.append([goal[0], f"{100 * value:.1f} % at {MOST}", *goal[1:], verdict])
    seconds = own[0]["search_s"] if (own := _kinds(done).get((1000, False))) else None
    text = "candidates at 1,000 cameras: processor time"
    goals.append(goal_row(text, ("300 s", "60 s"), seconds and f"{seconds:.0f} s", [seconds], [300.0], [60.0]))
    columns = (
        "cameras", "from", "sites", "overlaps (of a camera)", *(f"at {count}" for count in site_cases.COUNTS), "search",
        "memory",
    )  # fmt: skip
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def _kinds(done: Outcomes) -> dict[tuple[int, bool], list[dict[str, Any]]]:
    kinds: dict[tuple[int, bool], list[dict[str, Any]]] = {}
    for case in done.values():
        kinds.setdefault((case["about"]["cameras"], case["about"]["boxes"]), []).append(case)
    return kinds


def _percent(some: Sequence[Mapping[str, Any]], count: int) -> str:
    values = [case["recall"][str(count)] for case in some if str(count) in case["recall"]]
    return f"{100 * float(np.mean(values)):.1f} %" if values else "-"


_COLUMNS = (
    "cameras", "with a pose", "rigs (verdicts)", "reported as moved", "position, median", "orientation, median",
    "processor time", "time", "largest process",
)  # fmt: skip


def tabulate_halls(cases: Cases, done: Outcomes) -> Found:
    """What 32 cameras around one hall take, against 8."""
    ratio = _growth(done, 8, 32)
    text = "32 cameras around one hall: processor time, times that of 8"
    goals = [goal_row(text, ("4.5 x", "4 x"), ratio and f"{ratio:.1f} x", [ratio], [4.5], [4.0])]
    return found_of(cases, done, {"Result": table(_COLUMNS, [_calibration_row(case) for case in done.values()])}, goals)


def tabulate_sites(cases: Cases, done: Outcomes) -> Found:
    """What sites take from tracklets, and what comes of them."""
    large = {case["cameras"]: case for case in done.values()}.get(100)
    share, used, largest, took, said = None, None, None, [], [None] * 4
    if large is not None:
        share, used = large["in_group"], large["used_overlaps"]
        largest = float(np.mean(max((group["position_mm"] for group in large["groups"]), key=len)))
        took = [large["wall_s"] / 60, large["memory_mb"] / 1024]
        said = [f"{100 * share:.0f} %", f"{largest:.0f} mm", f"{took[0]:.0f} min, {took[1]:.1f} GB", f"{100 * used:.1f} %"]
    ratio, pairs = _growth(done, 25, 100), "100 cameras: pairs that share ground, with people in common in a rig"
    goals = [
        goal_row("100 cameras: cameras in the rig of those with which they share ground", ("96 %", "99 %"), said[0],
                 [-(share or 0)], [-0.96], [-0.99]),
        goal_row("100 cameras: mean position error in the largest rig", ("350 mm", "200 mm"), said[1], [largest], [350.0],
                 [200.0]),
        goal_row("100 cameras from tracklets, two cores: time and memory", ("15 min, 6 GB", "8 min, 3 GB"), said[2], took,
                 [15.0, 6.0], [8.0, 3.0]),
        goal_row("growth of processor time from 25 to 100 cameras", ("5 x", "4.2 x"), ratio and f"{ratio:.1f} x", [ratio],
                 [5.0], [4.2]),
        goal_row(pairs, ("98 %", "99.5 %"), said[3], [-(used or 0)], [-0.98], [-0.995]),
    ]  # fmt: skip
    rows = [
        [
            *_calibration_row(case),
            f"{100 * case['in_group']:.0f} %",
            f"{max(max(one['position_mm']) for one in case['groups']):.0f} mm",
        ]
        for case in done.values()
    ]
    return found_of(cases, done, {"Result": table((*_COLUMNS, "in their group", "largest error"), rows)}, goals)


def tabulate_zones(cases: Cases, done: Outcomes) -> Found:
    """What corridors take that are solved by zones, and how sure they are."""
    ratio = least = None
    took: list[float] = []
    rows = [
        [
            str(case["cameras"]), str(case["zones"]), str(case["registered"]), case["verdict"], f"{case['position_mm']:.0f} mm",
            f"{case['orientation_deg']:.2f}°", f"{case['of_zones_mm']:.0f} / {case['alone_mm']:.0f} mm",
            f"{100 * case['within_2']:.0f} %", f"{case['cpu_s']:.0f} s", f"{case['memory_mb']:.0f} MB",
        ]
        for case in done.values()
    ]  # fmt: skip
    if done:
        ratio = max(case["of_zones_mm"] / case["alone_mm"] for case in done.values())
        least = min(case["within_2"] for case in done.values())
    if len(done) == len(cases) and len(done) > 1:
        *_, small, large = done.values()
        cpu_s, memory_mb = (_power_at_thousand(small, large, key) for key in ("cpu_s", "memory_mb"))
        took = [cpu_s / 60, memory_mb / 1024]
        rows.append(["1000 (extrapolated)", *[""] * 7, f"{cpu_s:.0f} s", f"{memory_mb:.0f} MB"])
    goals = [
        goal_row("1,000 cameras in one group, extrapolated: zones and adjustment, memory", ("10 min, 16 GB", "3 min, 8 GB"),
                 f"{took[0]:.0f} min, {took[1]:.1f} GB" if took else None, took, [10.0, 16.0], [3.0, 8.0]),
        goal_row("camera errors within their zone, times those of the zone alone", ("1.2 x", "1.0 x"),
                 ratio and f"{ratio:.2f} x", [ratio], [1.2], [1.0]),
        goal_row("cameras 100 m apart or more: distance errors within 2 of their sigmas", ("90 %", "95 %"),
                 None if least is None else f"{100 * least:.0f} %", [-(least or 0)], [-0.9], [-0.95]),
    ]  # fmt: skip
    columns = (
        "cameras", "zones", "with a pose", "verdict", "position, median", "orientation, median",
        "position within the zone, in the whole / alone", "within 2 sigmas, 100 m apart", "processor time", "memory",
    )  # fmt: skip
    return found_of(cases, done, {"Result": table(columns, rows)}, goals)


def _power_at_thousand(small: Mapping[str, Any], large: Mapping[str, Any], key: str) -> float:
    """The power law through two sizes, at a thousand cameras."""
    power = np.log(large[key] / small[key]) / np.log(large["cameras"] / small["cameras"])
    return float(large[key] * (1000 / large["cameras"]) ** power)


GOALS_SMALL = (
    ("PETS2009 with identities: processor time, times that of before", 0.5, 0.3),
    ("solve, times that of COLMAP's incremental mapper", 1.2, 0.8),
)


def tabulate_small(cases: Cases, done: Outcomes) -> Found:
    """What PETS2009 takes, against the version before sites, and what the solver takes, against COLMAP's."""
    earlier, raced = [], []
    ratios: list[float | None] = [None, None]
    for case in done.values():
        if "ratio" in case:
            ratios[1] = case["ratio"]
            raced.append([
                str(case["rows"]), str(case["neither_fails"]), str(case["ours_fail"]), str(case["theirs_fail"]),
                f"{case['ours_s']:.1f} s", f"{case['theirs_s']:.1f} s", f"{case['ratio']:.2f}", f"{case['whole_ratio']:.2f}",
            ])  # fmt: skip
            continue
        ratios[0] = case["now"] / case["earlier"]
        earlier.append([
            "PETS2009, identities given", case["about"]["against"][:10], f"{case['earlier']:.1f} s", f"{case['now']:.1f} s",
            f"{ratios[0]:.2f}", f"{case['apart_mm']:.3g} mm", f"{case['apart_deg']:.2g}°",
        ])  # fmt: skip
    goals = [
        goal_row(text, (f"{acceptable} x", f"{aim} x"), ratio and f"{ratio:.2f} x", [ratio], [acceptable], [aim])
        for (text, acceptable, aim), ratio in zip(GOALS_SMALL, ratios, strict=True)
    ]
    heads = {
        "Earlier version": (
            "data", "earlier version", "its processor time", "now", "ratio", "rigs apart, position", "orientation",
        ),
        "COLMAP": (
            "cases", "neither fails", "Passerby fails", "COLMAP fails", "solves of Passerby", "of COLMAP", "ratio, median",
            "whole processes",
        ),
    }  # fmt: skip
    rows = {"Earlier version": earlier, "COLMAP": raced}
    tables = {caption: table(heads[caption], rows[caption]) for caption in rows if rows[caption]}
    return found_of(cases, done, tables, goals)


def tabulate_clusters(cases: Cases, done: Outcomes) -> Found:
    """What a cluster with dying workers takes, and whether its files are those of one process."""
    goal = ["the same bytes as one process", "not run", "all", "all", ""]
    rows = [
        [
            str(case["cameras"]), *(f"{case['took_s'][way]:.0f} s" for way in ("one", "pool", "cluster")), str(case["killed"]),
            str(case["files"]), ", ".join(case["differing"]) or "none",
        ]
        for case in done.values()
    ]  # fmt: skip
    if done:
        differing, files = sum(len(case["differing"]) for case in done.values()), sum(case["files"] for case in done.values())
        goal[1] = f"all of {files} files" if not differing else f"{differing} of {files} files differ"
        goal[-1] = "no" if differing else "aim"
    columns = (
        "cameras", "one process", "a process for each core", "on the cluster", "workers killed", "files", "that differ",
    )  # fmt: skip
    return found_of(cases, done, {"Result": table(columns, rows)}, [goal])


def tabulate_monitoring(cases: Cases, done: Outcomes) -> Found:
    """What monitoring takes for each camera and minute, where all have news and where few have."""
    rows = []
    for case in done.values():
        for kind, news in (("all", case["cameras"]), ("few", case["fresh"])):
            spent = case[kind]
            rows.append([
                str(case["cameras"]), str(news), f"{spent['cpu_s']:.0f} s", _each(spent["cpu_s"], case, case["cameras"]),
                _each(spent["cpu_s"], case, news), f"{spent['memory_mb']:.0f} MB",
            ])  # fmt: skip
    by_size = {case["cameras"]: case for case in done.values()}
    few, large = (by_size.get(size) for size in monitoring.SIZES)
    each = large and large["all"]["cpu_s"] / (large["cameras"] * large["minutes"])
    ratio = large and large["few"]["cpu_s"] / large["all"]["cpu_s"]
    goals = [
        goal_row("200 monitored cameras, all with news: processor time for a camera and minute", ("1 s", "0.5 s"),
                 each and f"{each:.2f} s", [each], [1.0], [0.5]),
        goal_row("5 % of 200 cameras with news: processor time, times that of all", ("0.15 x", "0.06 x"),
                 ratio and f"{ratio:.2f} x", [ratio], [0.15], [0.06]),
    ]  # fmt: skip
    if few is not None and large is not None:
        for kind, share in (("all", 1.0), ("few", monitoring.NEWS)):
            ends = [{"cameras": case["cameras"], **case[kind]} for case in (few, large)]
            cpu_s, memory_mb = (_at_thousand(*ends, key) for key in ("cpu_s", "memory_mb"))
            rows.append([
                "1000 (extrapolated)", f"{1000 * share:.0f}", f"{cpu_s:.0f} s", _each(cpu_s, large, 1000),
                _each(cpu_s, large, 1000 * share), f"{memory_mb:.0f} MB",
            ])  # fmt: skip
    columns = ("cameras", "with news", "processor time", "for a camera and minute", "of those with news", "largest process")
    found = [
        [
            str(case["cameras"]), str(case["moved"]), str(case["named"]), str(case["among"]), str(case["silent"]),
            str(case["falsely"]), str(case["untested"]), "no" if not _is_thinned(case) else "yes",
        ]
        for case in done.values()
    ]  # fmt: skip
    found_columns = (
        "cameras", "turned", "named", "named among others", "cannot tell", "others named", "cannot tell, of all", "thinned",
    )  # fmt: skip
    tables = {"Result": table(columns, rows), "Named": table(found_columns, found)}
    return found_of(cases, done, tables, goals)


def _each(cpu_s: float, case: Mapping[str, Any], cameras: float) -> str:
    return f"{cpu_s / (cameras * case['minutes']):.2g} s"


def _is_thinned(case: Mapping[str, Any]) -> bool:
    return bool(case["thinning"]["every_s"] > 0 or case["thinning"]["one_window_in"] > 1)


def _growth(done: Outcomes, small: int, large: int) -> float | None:
    """How many times the processor time of the smaller case the larger takes; None where one was not run."""
    took = {case["cameras"]: float(case["cpu_s"]) for case in done.values()}
    return took[large] / took[small] if small in took and large in took else None


def _calibration_row(case: Mapping[str, Any]) -> list[str]:
    position, orientation = calibrations.errors_of(case)
    verdicts = [group["verdict"] for group in case["groups"]]
    counted = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in dict.fromkeys(verdicts))
    return [
        str(case["cameras"]), str(case["registered"]), f"{len(verdicts)} ({counted})", str(case["moved"]),
        f"{position:.0f} mm", f"{orientation:.2f}°", f"{case['cpu_s']:.0f} s", f"{case['wall_s']:.0f} s",
        f"{case['memory_mb']:.0f} MB",
    ]  # fmt: skip


PAGE = PartedPage(
    "sites",
    {
        "simulation": Part(site_cases.simulations, site_cases.measure_simulation, tabulate_simulation),
        "candidates": Part(site_cases.candidate_cases, site_cases.measure_candidates, tabulate_candidates),
        "linear": Part(calibrations.halls, calibrations.measure_hall, tabulate_halls),
        "hundred": Part(calibrations.sites, calibrations.measure_site, tabulate_sites),
        "monitoring": Part(monitoring.sites, monitoring.measure, tabulate_monitoring),
        "thousand": Part(corridors.corridors, corridors.measure, tabulate_zones),
        "cluster": Part(clusters.cases, clusters.measure, tabulate_clusters),
        "small": Part(small.cases, small.measure, tabulate_small),
    },
    CODE, KEPT, SEEDS,
)  # fmt: skip
