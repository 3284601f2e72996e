"""Findings as values and in words: `finding_texts.json` pins the sentence and the remedy of an example of every code."""

import json
import pickle
from pathlib import Path
from typing import Any

import pytest

from passerby.common.errors import EvidenceError
from passerby.core.solution import Solution
from passerby.findings.finding import Finding, doubt, notice, refusal
from passerby.findings.ranking import RefusalError, findings_of
from passerby.findings.texts import KINDS, diagnostic, problem_of, remedy_of, text_of, texts_of
from support.scenes.people_and_rigs import ring

EXAMPLES: list[dict[str, Any]] = json.loads((Path(__file__).parent / "finding_texts.json").read_text(encoding="utf-8"))
SOURCE = Path(__file__).resolve().parents[2] / "src" / "passerby"


@pytest.mark.parametrize("row", EXAMPLES, ids=[f"{number}-{row['code']}" for number, row in enumerate(EXAMPLES)])
def test_sentence_and_remedy_are_as_pinned(row: dict[str, Any]) -> None:
    finding = Finding.of_value(row)
    assert json.loads(json.dumps(diagnostic(finding))) == row
    assert finding.severity in KINDS[finding.code].severities
    assert "{" not in row["text"]


def test_every_code_has_an_example_and_a_maker() -> None:
    assert {row["code"] for row in EXAMPLES} == set(KINDS)
    modules = [path for path in SOURCE.rglob("*.py") if "texts" not in path.parts]
    source = "\n".join(path.read_text(encoding="utf-8") for path in modules)
    assert [code for code in KINDS if f'"{code}"' not in source] == []


def test_what_stops_a_calibration_says_what_to_do() -> None:
    lacking = [row["code"] for row in EXAMPLES if row["severity"] != "notice" and not row["remedy"]]
    assert lacking == []


def test_an_unknown_code_and_a_missing_value_are_errors() -> None:
    with pytest.raises(KeyError, match="eaten"):
        text_of(doubt("eaten"))
    with pytest.raises(KeyError, match="agreeing"):
        text_of(doubt("few_observations", "C1"))
    with pytest.raises(KeyError, match="camera"):
        text_of(doubt("few_observations", agreeing=3))


def test_a_sentence_is_the_problem_and_the_remedy() -> None:
    few = doubt("few_observations", "C1", agreeing=3)
    assert text_of(few) == f"{problem_of(few)}: {remedy_of(few)}"
    placed = Finding(few.code, few.severity, few.cameras, {"place": "scene.toml", **few.values})
    assert texts_of([few, placed]) == (text_of(few), f"scene.toml: {text_of(few)}")
    silent = refusal("pair_unregistered", "C1", "C2", fit="never_together")
    assert text_of(silent) == problem_of(silent)
    assert remedy_of(silent)


def test_a_finding_says_the_same_whatever_it_weighs() -> None:
    few = doubt("few_observations", "C1", agreeing=3)
    assert few.says_same(refusal("few_observations", "C1", agreeing=3))
    for other in (
        doubt("few_observations", "C2", agreeing=3),
        doubt("few_observations", "C1", agreeing=4),
        notice("few_walkers", "C1"),
    ):
        assert not few.says_same(other)


def test_a_refusal_carries_its_findings() -> None:
    error = RefusalError([refusal("no_pair_registered"), doubt("few_walkers", "C1")])
    assert [(one.code, one.severity) for one in findings_of(error)] == [
        ("no_pair_registered", "refusal"),
        ("few_walkers", "refusal"),
    ]
    assert str(error) == error.reasons[0] == text_of(error.findings[0])
    assert error.exit_status == 3
    again = pickle.loads(pickle.dumps(error))
    assert (again.findings, again.reasons, str(again)) == (error.findings, error.reasons, str(error))
    (plain,) = findings_of(EvidenceError("too few"))
    assert (plain.code, text_of(plain)) == ("too_little_evidence", "too few")
    solution = Solution("people", ring(2), "refused", findings_of(error))
    assert solution.reasons == error.reasons
