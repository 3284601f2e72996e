"""Clocks of real cameras: of PETS2009 nobody knows how well its cameras were in step, but what is added must be found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.core.solution import Solution
from passerby.core.synchronisation import resample_to_common_steps
from passerby.evaluation.metrics import compare
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import solve

pytestmark = pytest.mark.real
FPS = 7.0


def every_other(boxes: Boxes, first: int) -> CameraObservations:
    """Frames first, first + 2, ... as frames 1, 2, ..."""
    kept = boxes.take((boxes.frame >= first) & ((boxes.frame - first) % 2 == 0))
    return CameraObservations(replace(kept, frame=(kept.frame - first) // 2 + 1))


def found_offsets(truth: Rig, seen: dict[str, CameraObservations], fps: float) -> tuple[np.ndarray, Solution]:
    """Offsets of the clocks (C,), seconds, after two passes."""
    clocks = dict.fromkeys(truth.names, Clock(fps))
    for _ in range(2):
        observations = resample_to_common_steps(Observations(seen), clocks)
        solution = solve(truth, observations, options=PeopleOptions(refine_time=True))
        for name, clock in solution.figures.clocks.items():
            clocks[name] = replace(clocks[name], offset_s=clocks[name].offset_s + clock.correction_s)
    return np.array([clocks[name].offset_s for name in truth.names]), solution


def test_half_a_frame_more_is_found(data_root: Path) -> None:
    """Every other frame, from the first on or, in three cameras, from the second on: these show everything 1/7 s later.

    The differences found were off by 21 ms at most, 4 ms on the mean. With clocks refined the rig is at 229 mm, 0.65 degrees,
    from all frames and without at 247 mm, 0.71: V4, V5 and V6 come out as showing the world 0.07 to 0.1 s earlier than V1.
    """
    folder = data_root / "pets2009"
    if not (folder / "rig.toml").is_file():
        pytest.skip(f"no data set {folder}")
    truth = read_rig(folder / "rig.toml")
    boxes = {name: read_boxes(folder / "identities" / f"{name}.txt") for name in truth.names}
    shift = {name: number % 2 for number, name in enumerate(truth.names)}
    as_is, solution = found_offsets(truth, {name: every_other(rows, 1) for name, rows in boxes.items()}, FPS / 2)
    moved, _ = found_offsets(truth, {name: every_other(rows, 1 + shift[name]) for name, rows in boxes.items()}, FPS / 2)
    miss = moved - as_is - np.array([shift[name] / FPS for name in truth.names])
    assert np.abs(miss).max() < 0.04
    assert np.abs(miss).mean() < 0.015
    found = compare(solution.rig, truth).similarity
    assert (found.mean_position_mm or np.inf) < 260
    assert (found.mean_orientation_deg or np.inf) < 0.75
