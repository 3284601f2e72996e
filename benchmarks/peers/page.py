"""`docs/results/peers.md`: every engine on every case, two side by side; public scenes whose authors state their errors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from datasets import ROOT
from pages.kept import code_digest
from pages.parts import Asked, Part, PartedPage
from pages.records import Found, publish
from peers import public
from peers.cases import Case, all_cases, observed, points_of, quick_cases, write_scene
from peers.runners import PASSERBY, PEERS, Engine, run_engine
from peers.table import Row, costs_table, errors_table, goal_lines, judge, mean_result, summary_table

LANES = 2  # cases side by side, a core each; the engines of one case run in turn
LIMIT_S = 20.0  # a run of more seconds is a failure, for all engines alike
KEPT = ROOT / "build" / "peers"
CODE = ("peers", "lenses")  # folders of the benchmarks that the outcomes depend on, beside the package
ENGINES = "engines"
NOT_MADE = "not run: environment not made, `make bench-peers`"


def run(asked: Asked, scratch: Path, out: Path | None, command: str, *, written: bool = True) -> None:
    """Run the parts that are asked for; two cases of the engines in a quick run."""
    digest = code_digest(*CODE)
    for part in asked.parts or ((ENGINES,) if asked.quick else PARTS):
        found = find_engines(scratch, asked.quick) if part == ENGINES else PUBLIC.find(part, asked)
        publish("peers", part, found, out, command, code=digest, quick=asked.quick, written=written)


def find_engines(scratch: Path, quick: bool) -> Iterator[Found]:
    """The part of the engines after each case."""
    cases = quick_cases() if quick else all_cases()
    rows: list[Row] = []
    missing: list[str] = []
    with ThreadPoolExecutor(LANES) as pool:
        for case, found in zip(cases, pool.map(lambda case: run_case(case, scratch, PEERS), cases), strict=True):
            rows += found
            if not found:
                missing.append(case.name)
            yield tabulate_engines(merged(rows), missing)


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


def tabulate_engines(rows: Sequence[Row], missing: Sequence[str] = (), peers: Sequence[Engine] = PEERS) -> Found:
    """The tables of the rows so far; `missing` names the cases whose data are not at hand."""
    engines = [peer.name for peer in peers if any(peer.name in row.results for row in rows)]
    notes = [f"- {peer.name}: {NOT_MADE}" for peer in peers if peer.interpreter() is None]
    notes += [f"- {name}: not run: data not here" for name in missing]
    versions = sorted({result.version for row in rows for result in row.results.values() if result.version})
    tables = {"Errors": errors_table(rows, engines)} if rows else {}
    if engines:
        tables |= {"Summary": summary_table(rows, engines), "Costs": costs_table(rows, engines)}
        notes.append(goal_lines(rows, engines))
    return Found(tables, [*notes, *([f"Engines: {', '.join(versions)}."] if versions else [])])


PUBLIC = PartedPage("peers", {"public": Part(lambda _: public.cases(), public.work, public.tabulate)}, CODE, KEPT, 1)
PARTS = (ENGINES, *PUBLIC.parts)
