"""`docs/results/peers.md`: every engine on every case, two side by side; public scenes whose authors state their errors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

from datasets import ROOT
from pages.cases import Outcomes
from pages.commit import commit
from pages.page import Page
from pages.parts import Wanted, finished, grown
from pages.sections import Found, Heading
from peers import public
from peers.cases import (
    BOX_NOISE,
    CONDITIONS,
    INSTANTS,
    JOINT_INSTANTS,
    JOINT_NOISE,
    SEEDS,
    SIMULATED_BOX_NOISE,
    SIMULATED_JOINT_NOISE_PX,
    Case,
    all_cases,
    observed,
    quick_cases,
    write_scene,
)
from peers.judging import LARGEST_DEG, LARGEST_MM, judge, mean_result
from peers.observations import points_of
from peers.runners import PASSERBY, PEERS, Engine, run_engine
from peers.table import Row, costs_table, errors_table, goal_lines, summary_table

LANES = 2
"""Cases side by side, a core each; the engines of one case run in turn."""
LIMIT_S = 20.0
"""A run of more seconds is a failure, for all engines alike."""
KEPT = ROOT / "build" / "peers"
CODE = ("peers", "lenses")
"""Folders of the benchmarks that the outcomes depend on, beside the package."""
ENGINES = "engines"
_TITLE = "# Beside today's peers"
NOT_MADE = "not run: environment not made, `make bench-peers`"


def run(scratch: Path, quick: bool, wanted: Wanted | None = None) -> Iterator[Page]:
    """The page, which grows with every case of the wanted parts; two cases of the engines in a quick run."""
    wanted = wanted or Wanted(KEPT)
    if quick:
        wanted = replace(wanted, parts=(ENGINES,))
    return grown("peers", _TITLE, HEADINGS, partial(_part, scratch=scratch, quick=quick, wanted=wanted), wanted, CODE)


def _part(part: str, scratch: Path, quick: bool, wanted: Wanted) -> Iterator[Found]:
    """A part again and again, as its cases are finished."""
    if part == ENGINES:
        return _run_engines(scratch, quick)
    return finished(part, public.cases(), public.work, _public_found, wanted, CODE)


def _public_found(part: str, cases: Mapping[str, public.PublicCase], done: Outcomes, code: str) -> Found:
    del part
    return Found(public.text_of(cases, done, code))


def _run_engines(scratch: Path, quick: bool) -> Iterator[Found]:
    """All cases; two in a quick run."""
    cases = quick_cases() if quick else all_cases()
    rows: list[Row] = []
    missing: list[str] = []
    with ThreadPoolExecutor(LANES) as pool:
        for case, found in zip(cases, pool.map(lambda case: run_case(case, scratch, PEERS), cases), strict=True):
            rows += found
            if not found:
                missing.append(case.name)
            yield Found(f"{engines_text(merged(rows), missing, quick=quick)}\n\nCode of commit {commit()}.")


def merged(rows: Sequence[Row]) -> list[Row]:
    """The seeds of each data set, condition and kind of points as one row."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault(row.place, []).append(row)
    return [
        Row(*place, {name: mean_result([row.results[name] for row in group]) for name in group[0].results})
        for place, group in groups.items()
    ]


def run_case(case: Case, scratch: Path, peers: Sequence[Engine]) -> list[Row]:
    """Passerby once, then each peer on each kind of points; empty where the data are not at hand."""
    seen = observed(case)
    if seen is None:
        return []
    folder = scratch / re.sub(r"\W+", "-", f"{case.name} {case.seed}")
    ours = judge(run_engine(PASSERBY, write_scene(seen, folder), folder / "passerby.json", LIMIT_S), seen.rig)
    rows = []
    for kind in case.data.kinds:
        source = folder / f"{kind}.npz"
        points_of(seen.rig, seen.cameras, kind).write(source)
        results = {PASSERBY.name: ours}
        for peer in peers:
            if peer.interpreter() is None or (peer.one_person_only and not case.data.one_person):
                continue
            target = folder / f"{kind}-{peer.name}.json"
            results[peer.name] = judge(run_engine(peer, source, target, LIMIT_S), seen.rig)
        rows.append(Row(case.data.name, case.condition, kind, results))
    return rows


def engines_text(
    rows: Sequence[Row], missing: Sequence[str] = (), peers: Sequence[Engine] = PEERS, *, quick: bool = False
) -> str:
    """The tables of the rows so far; `missing` names the cases whose data are not at hand."""
    engines = [peer.name for peer in peers if any(peer.name in row.results for row in rows)]
    absent = [f"- {peer.name}: {NOT_MADE}" for peer in peers if peer.interpreter() is None]
    absent += [f"- {name}: not run: data not here" for name in missing]
    versions = sorted({result.version for row in rows for result in row.results.values() if result.version})
    parts = [
        _QUICK if quick else "",
        "\n".join(absent),
        errors_table(rows, engines) if rows else "",
        _SUMMARY if engines else "",
    ]
    if engines:
        parts += [summary_table(rows, engines), goal_lines(rows, engines), _COSTS, costs_table(rows, engines)]
    parts.append(f"Engines: {', '.join(versions)}." if versions else "")
    return "\n\n".join(part for part in parts if part)


_SHARES = " or ".join(f"{100 * share:g} %" for share in CONDITIONS.values() if share)

_ENGINES = f"""\
Identities are given to all engines: the peers cannot find them. All get the same observations, at most {INSTANTS} instants of
each set ({JOINT_INSTANTS} of joints): Passerby as boxes or joints (default options), its peers as points that two cameras or
more saw: the *centre* of each whole box, its *top+bottom*, or *joints*. Similarity errors, means over all cameras, and over
{SEEDS} seeds of each simulated scene of boxes. *fails*, if only with one seed: a camera is missing, the error is above
{LARGEST_MM / 1000:g} m or {LARGEST_DEG:g}°, the engine breaks, or it needs more than {LIMIT_S:g} s of processor time.

*clean*: as they are; simulated boxes have {100 * SIMULATED_BOX_NOISE:g} % noise, simulated joints
{SIMULATED_JOINT_NOISE_PX:g} px. *noisy*: each edge of a box moved by {100 * BOX_NOISE:g} % of its height, each
joint by {100 * JOINT_NOISE:g} % of its person's. *swaps*: the identities of {_SHARES} of the people of each camera and
instant are exchanged among each other. The true cameras of PETS2009 and of Shelf are themselves no better than some 200 mm
and 36 mm.

The peers' settings. *caliscope*: `calibrate_extrinsics`, people as objects, lenses held. *COLMAP* and *GLOMAP* (pycolmap): a
static camera is one picture with all its points, pairs verified by COLMAP itself, lenses held, undistorted pixels, seed 0,
default thresholds; *COLMAP x3* has three times the thresholds of the image error, 12 px where the default has 4. *humancalib
BA*: its bundle adjustment with the settings of its command line on the joints of one person, from a start by an essential
matrix and PnP, since its own start needs a network that lifts skeletons; it takes one person, so elsewhere there is a dash."""

_QUICK = "This is a quick run: two cases of one scene, one seed."

_SUMMARY = """The peers in one line each. Ratios are Passerby's figure by the peer's, medians; those of the error and of *solve*
over the cases where neither fails, those of *whole* over all, where a peer that was stopped counts with the time limit."""

_COSTS = """Processor seconds of the solver alone (its input read, its modules imported before) and of the whole process, with
the start of Python, and peak memory. One thread each, the engines of a case in turn, two cases side by side on two cores. It
is processor time because that depends little on what else the machine does; with one thread it is the time by the clock."""

_PUBLIC = """16 of the 160 synthetic sports scenes of Yang 2026: golf and kendo, 3 to 10 cameras of 1200 x 1200 pixels on a
hemisphere, one person with 19 joints and a stick of known length in the hands, 50 time steps, joints and stick with noise of
0.1 or 0.5 px. With the stick the authors report 0.016 to 0.020 degrees and about 1 mm; for methods that use people only, 0.22
to 0.27 degrees and 3 to 7 cm.

A row is the mean over its two scenes. *similarity*: position and orientation error after similarity alignment. *metric*:
position error with the scale as it was found, the first camera held. *scale error*: how far the rig's scale is from 1. *with
the stick*: its two ends are a wand (`[[scale.wands]]`). *time*: processor seconds of one calibration, one thread."""

HEADINGS: Mapping[str, Heading] = {
    ENGINES: Heading("The same observations for all engines", _ENGINES),
    "public": Heading("Public scenes with a stick", _PUBLIC),
}
"""Of the parts, in their order on the page."""
