"""The measurement of stated lenses in small: a wrong one is named, right ones beside a mirrored camera are not."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import pytest

Bench = Callable[[str], ModuleType]
SEED = 31


@pytest.mark.parametrize("name", ["focal 0.2", "cropped 0.12"])
def test_a_wrong_lens_is_named(bench: Bench, name: str) -> None:
    result = bench("reliability.lenses").wrong_lens((name, SEED))
    assert result["right"]
    assert result["only"]
    assert not result["accepted"]


@pytest.mark.parametrize(("seed", "spoilt"), [(30, ""), (33, "mirrored")])
def test_right_lenses_are_not_named(bench: Bench, seed: int, spoilt: str) -> None:
    result = bench("reliability.lenses").right_lenses(seed)
    assert result["spoilt"] == spoilt
    assert result["named"] == []


def test_right_lenses_are_not_named_where_identities_are_found(bench: Bench) -> None:
    # A scene in which other things are noticed: what is not of lenses is not counted.
    result = bench("reliability.lenses").right_lenses_found(38)
    assert result["spoilt"] == "mirrored"
    assert result["named"] == []


def test_the_section_counts_what_was_accused_and_what_was_named(bench: Bench) -> None:
    lenses = bench("reliability.lenses")
    right = {"1": {"spoilt": "", "named": []}, "2": {"spoilt": "", "named": [["focal", "C1"]]}}
    wrong = {"focal 0.2 1": {"right": True, "only": True, "named": [["focal", "C1"]], "accepted": False}}
    accused, named = lenses._lines(right, wrong)
    assert (accused.seen, accused.reached) == ("1 (50.00 %)", False)
    assert (named.seen, named.reached) == ("100.0 %", True)
    assert "one focal length off by 20 %" in str(lenses._tables(right, {}, wrong)["Wrong lenses"])
