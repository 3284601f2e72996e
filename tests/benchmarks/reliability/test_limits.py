"""Limits of the verdict are those of the page that says where they come from."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np

Bench = Callable[[str], ModuleType]
PAGE = Path(__file__).resolve().parents[3] / "docs" / "results" / "limits.md"
STATED = re.compile(r"`?(?P<name>[A-Z_]+)`? in\s`(?:passerby/)?(?P<module>[a-z_/]+)\.py`(?:: | is )(?P<values>[\d., ]*\d)")
MEASURED = {
    "HARMFUL_SHARE", "LEAST_ODDS", "POPULATION_BIAS", "AMBIGUOUS", "STEEP_DEG", "STEEP_SIGMAS",
    "SIGMAS", "LEAST_S", "SPOILING_S", "HARMFUL_S", "HARMFUL_RATE", "BOXES_MISLEAD", "UNUSUAL_SIGMAS",
    "DOUBT_POWER", "USABLE_M", "USUAL_EFFECT", "USUAL_COUNTS",
}  # fmt: skip


def test_the_page_states_the_limits_in_force_and_the_run_they_were_measured_by() -> None:
    text = PAGE.read_text(encoding="utf-8")
    stated = {one["name"]: one for one in STATED.finditer(text)}
    assert set(stated) == MEASURED
    for name, one in stated.items():
        module = importlib.import_module(f"passerby.{one['module'].replace('/', '.')}")
        in_force = np.atleast_1d(getattr(module, name)).tolist()
        assert [float(value) for value in one["values"].split(",")] == in_force, name
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert len(parts) > 5
    for part in parts:
        assert re.search(r"Code of commit `[0-9a-f]{10}`, 20|Not run", part), part.partition("\n")[0]


def test_a_move_is_found_and_nobody_moves_where_nobody_does(bench: Bench) -> None:
    moves = bench("reliability.move_figures")
    wanted = moves.cases(1)
    kinds = {case.kind for case in wanted.values()}
    assert len(kinds) == 2 + len(moves.TURNS_DEG) + len(moves.SHIFTS_M) + len(moves.ZOOMS)
    still = next(case for case in wanted.values() if case.kind == moves.STILL)
    turned = next(case for case in wanted.values() if case.pan_deg == 4.0)
    assert moves.measure(still)["changes"] == []
    (found,) = (one for one in moves.measure(turned)["changes"] if one["moved"])
    assert found["kind"] == "moved"
    assert found["log_odds"] > moves.LOG_ODDS
