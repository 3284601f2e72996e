"""The benchmark of sources: what its page says of outcomes, and that its zones are measured right."""

from __future__ import annotations

import numpy as np
import pytest

import sources_page
from pages.sections import Section, SectionedPage
from passerby.simulation import SimulationOptions, simulate
from sources import zones
from sources.packaging import PACKAGINGS, PLAIN


def outcome(mm: float | None, unsupported: str | None = None) -> dict[str, object]:
    found = {"about": {"text": "a film"}, "cpu_s": 1.0, "verdict": "accepted", "registered": 3, "mm": mm, "deg": 0.1}
    return found if unsupported is None else found | {"unsupported": unsupported}


def goal(*outcomes: dict[str, object]) -> list[str]:
    """Of the plain film's error of 10 mm and these of the first packagings."""
    keys = [PLAIN.key, *(packaging.key for packaging in PACKAGINGS)]
    done = dict(zip(keys, [outcome(10.0), *outcomes], strict=False))
    return sources_page.containers_found("containers", dict.fromkeys(keys), done, "abc").facts["goals"][0]


def test_twelve_packagings_are_compared() -> None:
    assert len(PACKAGINGS) == 12
    assert len({packaging.key for packaging in (PLAIN, *PACKAGINGS)}) == 13


def test_a_packaging_gives_the_rig_of_the_plain_film_or_one_line() -> None:
    assert goal(*[outcome(10.9)] * 11, outcome(None, "no encoder"))[-1] == "aim"
    assert goal(*[outcome(10.9)] * 11, outcome(11.1))[1::3] == ["11 of 12", "**missed**"]
    assert goal(*[outcome(10.9)] * 11, outcome(None))[-1] == "**missed**"
    assert goal(outcome(10.0))[1::3] == ["1 of 12", "2 of 13 run"]


def test_the_page_has_all_goals_also_of_parts_that_are_not_run() -> None:
    page = SectionedPage("sources", sources_page.head, sources_page.HEADINGS, "", timed=False).page(
        [Section(name, heading.title, "not run") for name, heading in sources_page.HEADINGS.items()]
    )
    for part in sources_page.PARTS.values():
        assert f"## {part.heading.title}" in page.text
        for text, *_ in part.goals:
            assert text in page.text


def test_zones_of_the_true_rig_have_their_true_sides() -> None:
    rig = simulate(SimulationOptions(preset="terrace", seconds=2.0, seed=1)).rig
    exact = zones.zone_errors(rig, rig, np.random.default_rng(0))
    assert len(exact) == 4 * zones.ZONES
    assert max(exact) < 1e-6
    larger = zones.zone_errors(rig.moved(np.eye(3), np.zeros(3), 1.1), rig, np.random.default_rng(0))
    # Every length is a tenth longer; corners that come to lie too far away have none.
    assert [value for value in larger if np.isfinite(value)] == pytest.approx([10.0] * sum(np.isfinite(larger)), abs=1e-6)
