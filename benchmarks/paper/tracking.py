"""People's ways over the ground, against the truth: a page of tables."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.spread import FAILS, quartiles
from paper.tracking_runs import CAMERAS, FAILED, Case, Job, Outcome, RealOutcome, RealSet, data_folder, run_case, run_set
from paper.wanted import Wanted
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.people.trajectories.trajectories import METHODS
from passerby.simulation import PRESETS

SEEDS, FOUND_SEEDS, QUICK_SEEDS = 3, 2, 1
"""Finding identities takes four times as long as following people who are known."""
KINDS = (("given", False), ("given", True), ("found", False))
"""Identities, and whether a distance is known."""
GOAL_M = 0.15
PAPER_M = (0.26, 0.59)
"""Mean distances from the truth on the paper's three real scenes, the best and the worst (Xu et al., CVPR 2021)."""
REAL = (("pets2009", 7.0), ("wildtrack", 2.0), ("multiviewx", 2.0))
"""Folders of the data, and the frame rates that their publishers tell."""


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """Three scenes of three kinds, then the real sets that are at hand; one seed and few kinds in a quick run."""
    seeds = wanted.seeds or (QUICK_SEEDS if wanted.quick else SEEDS)
    found_seeds = wanted.seeds or min(seeds, FOUND_SEEDS)
    cases = [
        Case(preset, seed, *kind)
        for preset in PRESETS
        for kind in KINDS
        for seed in range(found_seeds if kind[0] == "found" else seeds)
    ]
    if wanted.quick:
        cases = [case for case in cases if (case.identities == "given" or case.preset == "terrace") and not case.tape]
    jobs = [Job(case, wanted.kept) for case in cases]
    outcomes = dict(zip(cases, side_by_side(run_case, jobs, executor, tell, "tracking"), strict=True))
    sets = [] if wanted.quick else [RealSet(name, fps, data_folder(wanted.data, name)) for name, fps in REAL]
    real = side_by_side(run_set, sets, executor, tell, "tracking, real data sets")
    tables = {
        "Identities given": _table(outcomes, "given"), "One length measured": _table(outcomes, "given", tape=True),
        "Identities found": _table(outcomes, "found"), "Within the goal": _goals(outcomes), "Sigmas": _sigma_table(outcomes),
    }  # fmt: skip
    if real:
        tables["Real data sets"] = _real_table(real)
    return Found(tables, run=f"{seeds} seeds, {found_seeds} where identities are found")


HEAD = (
    "scene", "method", "by a similarity", "by the reference camera", "true cameras", "scale error", "covered", "failed",
)  # fmt: skip


def _table(outcomes: dict[Case, Outcome], identities: str, *, tape: bool = False) -> Table:
    """A row for each preset and method; medians over the seeds, the worst in brackets."""
    rows = []
    for preset in PRESETS:
        of = [one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, identities, tape)]
        if not of:
            rows.append([preset, "*not run* in a quick run", *[""] * (len(HEAD) - 2)])
            continue
        failed = sum(one.mean_m["smoothed similarity"] == FAILED for one in of)
        for method in METHODS:
            cells = [_cell([one.mean_m[f"{method} {cameras}"] for one in of]) for cameras in CAMERAS]
            scale = quartiles([one.scale_error for one in of])[1]
            covered = f"{number(100 * float(np.median([one.covered for one in of])))} %"
            tail = [_percent(scale), covered if method == "smoothed" else "", f"{failed} of {len(of)}"]
            rows.append([preset, method, *cells, *tail])
    return table(HEAD, rows)


def _cell(values: Sequence[float]) -> str:
    """The median, and the worst in brackets where there are several."""
    middle = quartiles(values)[1]
    told = FAILS if middle == FAILED else f"{number(middle, 3)} m"
    if len(values) == 1:
        return told
    return f"{told} ({FAILS if max(values) == FAILED else number(max(values), 3)})"


def _percent(share: float) -> str:
    return FAILS if share == FAILED else f"{number(100 * share)} %"


def _goals(outcomes: dict[Case, Outcome]) -> Table:
    """Whether every seed is within the goal and below the paper's best, by the default method."""
    rows = []
    for preset in PRESETS:
        for identities, tape in KINDS:
            of = [
                one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, identities, tape)
            ]
            if not of:
                continue
            for cameras, name in (("similarity", "similarity"), ("metric", "reference camera")):
                scale = "people and a tape" if tape else "people"
                worst = max(one.mean_m[f"smoothed {cameras}"] for one in of)
                told = FAILS if worst == FAILED else f"{number(worst, 3)} m"
                rows.append([preset, identities, scale, name, told, yes(worst <= GOAL_M), yes(worst < PAPER_M[0])])
    below = f"below the paper's {PAPER_M[0]} m"
    head = ("scene", "identities", "scale by", "placed by", "worst seed", f"within {GOAL_M} m", below)
    return table(head, rows)


def _sigma_table(outcomes: dict[Case, Outcome]) -> Table:
    """How honest the sigmas are, and what one camera alone is good for."""
    rows = []
    for preset in PRESETS:
        of = [one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, "given", False)]
        share = [one.sigma_share for one in of]
        alone = [one.one_camera_m for one in of if one.one_camera_m != FAILED]
        rows.append([
            preset, f"{number(100 * min(share), 0)} to {number(100 * max(share), 0)} %",
            f"{number(float(np.median(alone)), 3)} m" if alone else "none",
        ])  # fmt: skip
    return table(("scene", "places within their sigma", "places seen by one camera, distance"), rows)


def _real_table(sets: Sequence[RealOutcome]) -> Table:
    """A row for each real set and method."""
    head = (
        "data set", "method", "by a similarity", "by the reference camera", "true cameras", "scale error",
        "disagreement of the cameras",
    )  # fmt: skip
    rows = []
    for one in sets:
        apart = "" if one.disagreement_m is None else f"{number(one.disagreement_m, 3)} m"
        if one.outcome is None:
            rows.append([one.name, f"*not run*: {one.why}", "", "", "", "", apart])
            continue
        for method in METHODS:
            cells = [_cell([one.outcome.mean_m[f"{method} {cameras}"]]) for cameras in CAMERAS]
            rows.append([one.name, method, *cells, _percent(one.outcome.scale_error), apart if method == "smoothed" else ""])
    return table(head, rows)
