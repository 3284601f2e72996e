"""Nobody has identities: real and simulated scenes whose people are told by how they move, against given identities."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from accuracy import KEYS, NOT_HERE, complete, figures
from association_runs import Found, RealCase, run_real, run_simulated, simulate, write_real
from command import DOUBTFUL, Calibrated, run_program
from datasets import data_set, folder_of
from pages import records
from pages.parts import run_two
from pages.tables import Table, errors, load, number, reached, table, yes
from paper.goals import PRESETS
from passerby.common.arrays import Floats

Bounds = tuple[float, float]

LARGEST_RATIO, AIM_RATIO = 1.3, 1.05
OFFSET_LIMIT_S, OFFSET_AIM_S = 0.15, 0.03


@dataclass(frozen=True)
class RealResults:
    """All runs of one recording."""

    given: Found  # identities given, the clocks taken as in step
    timed: Found  # identities given, the clocks refined
    found: Found
    shifted: Mapping[RealCase, Found]  # case -> the run with the shifts of its clocks


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


Simulated = dict[str, dict[str, list[Found]]]  # preset -> mode -> results by seed

SEEDS, SHIFTS, GROUP_SEEDS = 10, 3, 3
REAL = {"pets2009": ("detections", (360.0, 0.8)), "wildtrack": ("identities", (30.0, 0.12))}
"""Folder of the boxes, and the acceptable similarity error."""
IDENTITY_LIMITS = (0.97, 0.85)  # acceptable precision and recall on pets2009
GROUPS = (6, 2)
LARGEST_SECONDS, LARGEST_DOUBLING = 20.0, 2.0
MODES = ("given", "trajectory", "combined", "appearance")


def run(scratch: Path, quick: bool) -> records.Found:
    """Ten seeds of each simulated scene, three shifts of each real one's clocks; two and one in a quick run."""
    speed = _speed(scratch / "speed", 1 if quick else 3)
    real = {name: _real(name, scratch / name, range(1 if quick else SHIFTS)) for name in REAL}
    simulated = _simulated(scratch / "simulated", range(2 if quick else SEEDS))
    groups = _groups(scratch / "groups", range(1 if quick else GROUP_SEEDS))
    tables = {"Errors": _real_table(real), "Clocks": _clock_table(real)}
    if real["pets2009"]:
        tables["Own clocks"] = own_clocks(real["pets2009"])
    tables |= {
        "Ratios": _ratios(simulated), "Identities": _identities(real, simulated), "Separate groups": groups,
        "Refusals": _refusals(simulated),
    }  # fmt: skip
    if speed is None:
        return records.Found(tables)
    measured, note = speed
    return records.Found({**tables, "Time": measured}, [note])


def _real(name: str, scratch: Path, seeds: range) -> RealResults | None:
    """A recording as it is, with shifted clocks, and with given identities; None where it is not here."""
    data, (source, _) = data_set(name), REAL[name]
    folder = folder_of(data)
    if folder is None:
        return None
    cases = [
        RealCase(data, "given", "identities"), RealCase(data, "given", "identities", refine_time=True),
        RealCase(data, "trajectory", source), *(RealCase(data, "trajectory", source, seed) for seed in seeds),
    ]  # fmt: skip
    jobs = [partial(run_real, case, folder, scratch / str(number)) for number, case in enumerate(cases)]
    given, timed, found, *shifted = run_two(jobs)
    return RealResults(given, timed, found, dict(zip(cases[3:], shifted, strict=True)))


def _simulated(scratch: Path, seeds: range) -> Simulated:
    """All modes on the same boxes."""

    def solve(preset: str, seed: int) -> dict[str, Found]:
        folder = simulate(scratch / f"{preset}-{seed}", preset, seed)
        return {mode: run_simulated(folder, mode) for mode in MODES}

    results = iter(run_two([partial(solve, preset, seed) for preset in PRESETS for seed in seeds]))
    by_preset = {preset: [next(results) for _ in seeds] for preset in PRESETS}
    return {preset: {mode: [run[mode] for run in runs] for mode in MODES} for preset, runs in by_preset.items()}


def _groups(scratch: Path, seeds: range) -> Table:
    """Cameras in two groups without common ground."""
    options = ("--people", "20", "--cameras", str(sum(GROUPS)), "--groups", ",".join(map(str, GROUPS)))

    def solve(seed: int) -> Found:
        return run_simulated(simulate(scratch / str(seed), "construction", seed, *options), "trajectory")

    rows = []
    for seed, found in zip(seeds, run_two([partial(solve, seed) for seed in seeds]), strict=True):
        run = found.calibrated
        cameras = run.report.get("cameras", [])
        in_rig = [camera["name"] for camera in cameras if camera["registered"]]
        others = [camera["name"] for camera in cameras[GROUPS[0] :]]
        told = bool(others) and any(one["cameras"] == others for one in run.report["diagnostics"])
        right = in_rig == [camera["name"] for camera in cameras[: GROUPS[0]]] and told and run.status == DOUBTFUL
        error = (run.errors or {}).get("similarity", {}).get("mean_position_mm")
        rows.append([str(seed), ", ".join(in_rig), f"{number(error)} mm", yes(told), str(run.status), yes(right)])
    return table(("seed", "registered", "similarity", "the others named", "exit status", "reached"), rows)


def _speed(scratch: Path, repeats: int) -> tuple[Table, str] | None:
    """The registration of all pairs, in a process of its own and in the user's environment."""
    data = data_set("pets2009")
    folder = folder_of(data)
    if folder is None:
        return None
    before = load()
    scene = write_real(RealCase(data, "trajectory", "detections"), folder, scratch)
    program = Path(__file__).with_name("association_speed.py")
    result = json.loads(run_program([str(program), str(scene), "--repeats", str(repeats)]).output)
    once, twice = ({key: float(np.min(times)) for key, times in result[name].items()} for name in ("once", "twice"))
    ratio = twice["registering"] / once["registering"]
    rows = [
        ["registering all pairs", f"{once['registering']:.1f} s", f"under {LARGEST_SECONDS:g} s",
         yes(once["registering"] < LARGEST_SECONDS)],
        ["twice as long", f"{twice['registering']:.1f} s", "", ""],
        ["doubling the recording", f"{ratio:.2f} x", f"at most {LARGEST_DOUBLING:g} x", yes(ratio <= LARGEST_DOUBLING)],
        ["tracking all cameras", f"{once['preparing']:.1f} s", "", ""],
        ["twice as long", f"{twice['preparing']:.1f} s", "", ""],
    ]  # fmt: skip
    note = f"The best of {repeats} in turn; load of the machine (mean of a minute): {before:.1f} before, {load():.1f} after."
    return table(("pets2009", "measured", "goal", "reached"), rows), note


def _real_table(real: dict[str, RealResults | None]) -> Table:
    rows = []
    for name, results in real.items():
        rows += real_rows(name, results, REAL[name][1]) if results else [_not_here(name, REAL_HEAD)]
    return table(REAL_HEAD, rows)


def _clock_table(real: dict[str, RealResults | None]) -> Table:
    rows = []
    for name, results in real.items():
        rows += clock_rows(name, results) if results else [_not_here(name, CLOCK_HEAD)]
    return table(CLOCK_HEAD, rows)


def _not_here(name: str, head: Sequence[str]) -> list[str]:
    return [name, NOT_HERE, *["-"] * (len(head) - 2)]


def _ratios(simulated: Simulated) -> Table:
    rows = []
    for mode, label in (("trajectory", "unrelated ids"), ("combined", "dressed alike")):
        rows += [ratio_row(f"{preset}, {label}", runs["given"], runs[mode]) for preset, runs in simulated.items()]
        every = [[run for runs in simulated.values() for run in runs[which]] for which in ("given", mode)]
        rows.append(ratio_row(f"all three, {label}", *every))
    return table(RATIO_HEAD, rows)


def _identities(real: dict[str, RealResults | None], simulated: Simulated) -> Table:
    rows = []
    for name, results in real.items():
        limits = IDENTITY_LIMITS if name == "pets2009" else None
        if results is None:
            rows.append(_not_here(name, IDENTITY_HEAD))
            continue
        rows.append(identity_row(name, [results.found], limits))
        rows.append(identity_row(f"{name}, clocks shifted", list(results.shifted.values()), limits))
    for preset, runs in simulated.items():
        rows.append(identity_row(f"{preset}, unrelated ids", runs["trajectory"], None))
        rows.append(identity_row(f"{preset}, dressed alike", runs["combined"], None))
    return table(IDENTITY_HEAD, rows)


def _refusals(simulated: Simulated) -> Table:
    rows = []
    for preset, runs in simulated.items():
        calibrated = [run.calibrated for run in runs["appearance"]]
        refused = sum(run.verdict == "refused" and run.status == DOUBTFUL and run.errors is None for run in calibrated)
        rows.append([preset, f"{refused} of {len(calibrated)}", yes(refused == len(calibrated))])
    return table(("preset", "refused", "reached"), rows)
