"""Findings in words, as `finding_texts.json` pins them; shown first are causes before consequences, three at most."""

import json
import pickle
from pathlib import Path
from typing import Any

import pytest

from passerby.common.errors import EvidenceError
from passerby.core.solution import Solution
from passerby.core.usability import doubt_missing_pose
from passerby.findings.finding import Finding, doubt, notice, refusal
from passerby.findings.ranking import RefusalError, describe_first_reasons, find_cause, findings_of, reasons_of
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


def test_every_code_has_an_example_and_a_maker_and_each_that_stops_a_calibration_a_remedy() -> None:
    assert {row["code"] for row in EXAMPLES} == set(KINDS)
    modules = [path for path in SOURCE.rglob("*.py") if "texts" not in path.parts]
    source = "\n".join(path.read_text(encoding="utf-8") for path in modules)
    assert [code for code in KINDS if f'"{code}"' not in source] == []
    assert [row["code"] for row in EXAMPLES if row["severity"] != "notice" and not row["remedy"]] == []


def test_an_unknown_code_and_a_missing_value_are_errors() -> None:
    lacking = doubt("few_observations", "C1"), doubt("few_observations", agreeing=3)
    for wrong, named in zip((doubt("eaten"), *lacking), ("eaten", "agreeing", "camera"), strict=True):
        with pytest.raises(KeyError, match=named):
            text_of(wrong)


def test_a_sentence_is_the_problem_and_the_remedy() -> None:
    few = doubt("few_observations", "C1", agreeing=3)
    assert text_of(few) == f"{problem_of(few)}: {remedy_of(few)}"
    placed = Finding(few.code, few.severity, few.cameras, {"place": "scene.toml", **few.values})
    assert texts_of([few, placed]) == (text_of(few), f"scene.toml: {text_of(few)}")
    silent = refusal("pair_unregistered", "C1", "C2", fit="never_together")
    assert text_of(silent) == problem_of(silent)
    assert remedy_of(silent)
    # A finding says the same whatever its severity is.
    assert few.says_same(refusal("few_observations", "C1", agreeing=3))
    others = (
        doubt("few_observations", "C2", agreeing=3),
        doubt("few_observations", "C1", agreeing=4),
        notice("few_walkers", "C1"),
    )
    assert not any(few.says_same(other) for other in others)


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


MOVED = doubt("camera_moved", "C1", seconds=63.2, frame=317, metres=0.42, degrees=5.1, left_out="after", sigmas=20.0, shift=0.2)
FEW = doubt("few_observations", "C1", agreeing=12)
OTHER = doubt("few_observations", "C2", agreeing=9)
LENGTHS = doubt("rig_uncertain", what="scale", sigma=14.0, lacks=[], why=None)
ALL = doubt("lens_doubtful", why="implausible", focal={"change": 0.1})


def codes(*findings) -> list[list[tuple[str, tuple[str, ...]]]]:
    return [[(one.code, one.cameras) for one in reason.findings] for reason in reasons_of(findings)]


def test_findings_that_follow_from_a_cause_about_the_same_camera_are_left_out() -> None:
    assert (codes(FEW, MOVED), find_cause(FEW, [FEW, MOVED])) == ([[("camera_moved", ("C1",))]], MOVED)
    assert codes(OTHER, MOVED) == [[("camera_moved", ("C1",))], [("few_observations", ("C2",))]]
    assert codes(FEW, OTHER, ALL) == [[("lens_doubtful", ())]], "a cause about all explains every camera"
    assert codes(FEW, notice("camera_moved", "C1", **MOVED.values)) == [[("few_observations", ("C1",))]], "a notice is no cause"


def test_the_same_of_several_cameras_is_one_sentence() -> None:
    (reason,) = reasons_of([FEW, OTHER])
    assert reason.problem == "camera C1 has only 12 supporting observations (likewise camera C2)"
    unexplained = [doubt("camera_without_pose", name, why=None) for name in ("C1", "C3")]
    (reason,) = reasons_of(unexplained)
    assert reason.problem == "cameras C1 and C3 could not be registered"
    few = [doubt_missing_pose(notice("few_walkers", name)) for name in ("C4", "C5")]
    first, second = reasons_of([*unexplained, *few])
    assert (first, len(second.findings)) == (reason, 2)
    assert second.problem == "camera C4 saw too few people who walk for a second or longer (likewise camera C5)"


def test_a_first_screen_has_three_reasons_and_says_how_many_there_are() -> None:
    many = [LENGTHS, FEW, doubt("boxes_noisy", noise_percent=40.0),
            doubt("pairs_disagree"), doubt("reinitialisation_failed")]  # fmt: skip
    text = describe_first_reasons(many, "the report")
    assert text.count("; ") == 3
    assert text.endswith("; and 2 more: see the report")
