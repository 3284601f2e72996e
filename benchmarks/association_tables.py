"""The rows of the tables about identities that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from association_runs import Found, RealCase
from command import Calibrated
from pages.tables import Table, errors, number, reached, table
from passerby.common.arrays import Floats
from simulations import complete, figures

Bounds = tuple[float, float]

LARGEST_RATIO, AIM_RATIO = 1.3, 1.05
OFFSET_LIMIT_S, OFFSET_AIM_S = 0.15, 0.03
KEYS = ("mean_position_mm", "mean_orientation_deg")


@dataclass(frozen=True)
class RealResults:
    """All runs of one recording."""

    given: Found
    """Identities given, the clocks taken as in step."""
    timed: Found
    """Identities given, the clocks refined."""
    found: Found
    shifted: Mapping[RealCase, Found]
    """Case -> the run with the shifts of its clocks."""


def similarity(runs: Sequence[Found]) -> Floats:
    """(runs, 2) mm and degrees; infinite where a camera is missing."""
    calibrated = [run.calibrated for run in runs]
    return np.column_stack([figures(calibrated, "similarity", key) for key in KEYS])


def registered(runs: Sequence[Found]) -> str:
    """The cameras of one run, or how many runs have all of theirs."""
    if len(runs) == 1:
        return f"{_registered(runs[0].calibrated)} of {runs[0].calibrated.cameras}"
    return f"all in {sum(complete(run.calibrated) for run in runs)} of {len(runs)}"


def _registered(run: Calibrated) -> int:
    return int(run.errors["registered"]) if run.errors else 0


def real_rows(name: str, results: RealResults, acceptable: Bounds) -> list[list[str]]:
    """As it is, and with shifted clocks."""
    given = similarity([results.given])[0]
    rows = []
    for label, runs in ((name, [results.found]), (f"{name}, clocks shifted", list(results.shifted.values()))):
        each = similarity(runs)
        worst, aim = each.max(axis=0), AIM_RATIO * given
        rows.append(
            [label, str(len(runs)), registered(runs), errors(*each.mean(axis=0)), errors(*worst), errors(*given),
             errors(*acceptable), errors(*aim), reached(worst.tolist(), acceptable, aim.tolist()),
             f"{np.mean([run.calibrated.seconds for run in runs]):.0f} s"]
        )  # fmt: skip
    return rows


REAL_HEAD = (
    "data", "seeds", "registered", "similarity", "worst seed", "identities given", "acceptable", "aim", "reached", "wall time",
)  # fmt: skip


def offsets(run: Found) -> Floats | None:
    """(cameras,) found offsets of the clocks, seconds; None where a camera has none."""
    found = [camera["time_offset_s"] for camera in run.calibrated.report.get("cameras", [])]
    return np.array(found) if found and None not in found and complete(run.calibrated) else None


def clock_rows(name: str, results: RealResults) -> list[list[str]]:
    """Offsets found against those injected, and beyond the run without shifts."""
    plain, misses = offsets(results.found), []
    for case, run in results.shifted.items():
        found = offsets(run)
        names = tuple(camera["name"] for camera in run.calibrated.report.get("cameras", []))
        if found is None or plain is None:
            misses.append(np.full((2, run.calibrated.cameras), np.inf))
            continue
        injected = np.array([-case.shifts(names)[camera] / (case.data.fps or 1.0) for camera in names])
        injected -= injected[0]
        misses.append(np.array([found - injected, found - plain - injected]))
    rows = []
    for label, miss in zip((name, f"{name}, beyond the run without shifts"), np.abs(misses).swapaxes(0, 1), strict=True):
        largest = float(miss.max())
        rows.append(
            [label, str(len(misses)), f"{largest:.3f} s", f"{miss[:, 1:].mean():.3f} s", f"{OFFSET_LIMIT_S} s",
             f"{OFFSET_AIM_S} s", reached([largest], [OFFSET_LIMIT_S], [OFFSET_AIM_S])]
        )  # fmt: skip
    return rows


CLOCK_HEAD = ("data", "seeds", "largest error", "mean error", "acceptable", "aim", "reached")


def own_clocks(results: RealResults) -> Table:
    """The offsets of a recording that nobody shifted: by found identities, and by given ones with the clocks refined."""
    cameras = results.found.calibrated.report.get("cameras", [])
    names = [camera["name"] for camera in cameras]
    found = {camera["name"]: camera["time_offset_s"] for camera in cameras}
    clocks = results.timed.calibrated.report.get("figures", {}).get("clocks", {})
    given = {name: clocks.get(name, {}).get("correction_s") for name in names}
    sigma = {name: clocks.get(name, {}).get("sigma_s") for name in names}
    rows = [
        [label, *(number(offset[name], 3) for name in names)]
        for label, offset in (("identities found", found), ("identities given", given), ("its sigma", sigma))
    ]
    return table(("offset, s", *names), rows)


def ratio_row(label: str, given: Sequence[Found], found: Sequence[Found]) -> list[str]:
    """Errors without identities over those with them, the same boxes, seed by seed."""
    before, after = similarity(given), similarity(found)
    ratio = after / before
    of_means = after.mean(axis=0) / before.mean(axis=0)
    within = ratio <= LARGEST_RATIO
    every = bool(within.all())
    verdict = "aim" if every and (of_means <= AIM_RATIO).all() else "acceptable" if every else "**missed**"
    return [
        label, registered(found), errors(*before.mean(axis=0)), errors(*after.mean(axis=0)),
        f"{of_means[0]:.2f} {of_means[1]:.2f}", f"{ratio[:, 0].max():.2f} {ratio[:, 1].max():.2f}",
        f"{within[:, 0].sum()} {within[:, 1].sum()}", f"{within.all(axis=1).sum()} of {len(within)}", verdict,
    ]  # fmt: skip


RATIO_HEAD = (
    "scenes", "registered", "identities given", "found", "ratio mm °", "worst mm °", "seeds within 1.3 mm °", "both", "reached",
)  # fmt: skip


def identity_row(label: str, runs: Sequence[Found], acceptable: Bounds | None) -> list[str]:
    """Precision and recall, mean and worst; a run without any counts as zero."""
    scores = np.array(
        [
            (0.0, 0.0) if run.identities is None else (run.identities.precision or 0.0, run.identities.recall or 0.0)
            for run in runs
        ]
    )
    worst = scores.min(axis=0)
    cells = [f"{precision:.3f} {recall:.3f}" for precision, recall in (scores.mean(axis=0), worst)]
    if acceptable is None:
        return [label, str(len(runs)), *cells, "", ""]
    met = "yes" if (worst >= acceptable).all() else "**missed**"
    return [label, str(len(runs)), *cells, f"{acceptable[0]:.2f} {acceptable[1]:.2f}", met]


IDENTITY_HEAD = ("data", "seeds", "precision recall", "worst", "acceptable", "reached")
