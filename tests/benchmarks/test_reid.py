"""The benchmark's figures: identities against true boxes of other shapes, and the tables of recorded results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import command
import reid
import reid_runs
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import write_boxes


@pytest.fixture
def truth() -> dict[str, Boxes]:
    """Two people before two cameras, ten frames."""
    frame, identity = np.repeat(np.arange(1, 11), 2), np.tile([1, 2], 10)
    ltwh = np.column_stack([100.0 * identity, np.full(20, 50.0), np.full(20, 40.0), np.full(20, 100.0)])
    boxes = Boxes(frame, identity, ltwh, np.ones(20))
    return {"A": boxes, "B": boxes}


def written(folder: Path, found: dict[str, Boxes]) -> Path:
    """An output folder with these tracks."""
    for name, boxes in found.items():
        write_boxes(folder / "tracks" / f"{name}.txt", boxes)
    return folder


def test_identities_are_judged_by_the_true_boxes_that_theirs_overlap(truth: dict[str, Boxes], tmp_path: Path) -> None:
    """Boxes a few pixels off count; from frame 6 on one camera has the two people exchanged; one box shows nobody."""
    seen = replace(truth["A"], ltwh=truth["A"].ltwh + (3.0, -4.0, 2.0, 5.0), identity=truth["A"].identity + 10)
    swapped = replace(seen, identity=np.where(seen.frame > 5, 23 - seen.identity, seen.identity))
    elsewhere = Boxes(np.array([3]), np.array([30]), np.array([[500.0, 50.0, 40.0, 100.0]]), np.ones(1))
    a = Boxes(*(np.concatenate([getattr(seen, k), getattr(elsewhere, k)]) for k in ("frame", "identity", "ltwh", "score")))
    found = reid_runs.identities(written(tmp_path, {"A": a, "B": swapped}), truth)
    assert (found.precision, found.recall) == (0.5, 0.5)
    assert found.pairs_true == 20
    nobody = reid_runs.identities(tmp_path / "none", truth)
    assert (nobody.precision, nobody.recall) == (None, 0.0)


def test_the_tables_tell_recorded_results(truth: dict[str, Boxes], tmp_path: Path) -> None:
    """Goals that are reached and missed, refused runs, and means over the seeds that have any."""
    shares = {"rank_1": 0.85, "rank_5": 0.9, "map": 0.7}
    poor = {"plain": {**shares, "rank_1": 0.25}, "centred": {**shares, "rank_1": 0.3}}
    good = {"plain": shares, "centred": {**shares, "rank_1": 0.95}}
    real = {"pictures": 1000, "same_ranking": True, "largest_difference": 1e-7}
    trained = reid_runs.Trained(tmp_path, tmp_path / "net.onnx", 62, 992, 120, 600.0, 1.5, {"real": real})
    told = reid.crops_tables(trained, {"stripes": poor, "small": good}, {"network_ms": 6.0, "embedder_ms": 7.0})
    assert cells(told, "rank-1 within 20 minutes") == ["85.0 % in 10.0 min", "80 %", "yes"]
    assert cells(told, "ONNX file: a crop on one core") == ["6.00 ms", "5 ms", "**no**"]
    assert cells(told, "small ")[:2] == ["85.0", "90.0"]
    assert "198" in cells(told, "small ", last=True)
    crowd = reid.crowd_tables({"stripes": {"alike": poor}, "small": {"alike": good}})
    assert cells(crowd, "small") == ["85.0 (70.0)"]
    assert cells(crowd, "small", last=True) == ["95.0 (70.0)"]

    right = reid_runs.identities(written(tmp_path / "right", truth), truth)
    none = reid_runs.identities(tmp_path / "none", truth)

    def half(retrieval: Any, appearance: Any, verdict: str, agreement: Any) -> Any:
        run = command.Calibrated(verdict, None, None, 4, 0, {}, 10.0, 100.0)
        return reid_runs.Half(
            retrieval, appearance, dict.fromkeys(reid_runs.MODES, run), dict.fromkeys(reid_runs.MODES, agreement)
        )

    before = half(poor, reid_runs.LooksScore(100, 40, 0, 6), "refused", none)
    after = half(good, reid_runs.LooksScore(100, 90, 6, 6), "accepted", right)
    recorded = [
        reid_runs.Team(seed, dict.fromkeys(("first", "second"), before), dict.fromkeys(("first", "second"), now),
                  reid_runs.Tuned({"people": 8, "crops": 400}, 60.0))
        for seed, now in ((0, after), (1, before))
    ]  # fmt: skip
    text = reid.team_tables(recorded)
    assert cells(text, "first half: precision of the looks alone") == ["40.0 %", "65.0 %", "1 of 2"]
    assert cells(text, "second half: precision in mode appearance") == ["none found", "100.0 % (in 1)", "1 of 2"]
    assert cells(text, "second half: recall in mode combined") == ["0.0 %", "50.0 %", "1 of 2"]
    assert cells(text, "first half, seed 0")[:6] == ["start", "25.0", "30.0", "40.0", "0 of 6", "refused"]


def cells(tables: dict[str, Any], label: str, last: bool = False) -> list[str]:
    """The cells of the first, or last, row of that label, but the label."""
    rows = [row for one in tables.values() for row in one.rows if f"{row[0]} ".startswith(label)]
    return rows[-1 if last else 0][1:]
