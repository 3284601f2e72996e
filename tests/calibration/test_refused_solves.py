"""An inner solve that is refused, in whatever round, ends in a refusal that is written like any other result."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import passerby.solver.initialisation as stages
import passerby.solver.people as people
from passerby.association.clocks.drift import Drift
from passerby.association.result import Association
from passerby.calibration import calibrate, known_identities
from passerby.calibration.camera_motion import DetectedMotion, MotionCorrection, MotionSearch, correct_motion, measure_motions
from passerby.calibration.clock_skew import clock_rate_figures, correct_clock_rates
from passerby.calibration.diagnostics import smaller_pictures
from passerby.calibration.in_memory import calibrate_observations
from passerby.calibration.run import Corrections, Estimate
from passerby.core.cameras import Lens, Pose, Rig
from passerby.core.figures import AdjustedFigures, ClockCorrection
from passerby.core.observations import Clock
from passerby.core.solution import Solution
from passerby.findings.finding import refusal
from passerby.findings.ranking import RefusalError
from passerby.hypotheses.changes import PoseChange
from passerby.scene.inputs import SceneInputs
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve, without_poses

pytestmark = pytest.mark.system

FORCED = refusal("too_little_evidence", why="forced")


def refused(rig: Rig) -> Solution:
    return Solution("people", without_poses(rig), "refused", (FORCED,))


@cache
def scene(given: bool) -> SimulatedScene:
    return simulate(
        SimulationOptions(
            preset="terrace", seed=3, cameras=3, people=6, seconds=10.0, box_noise=0.02, joint_noise_px=1.0,
            unrelated_ids=not given, embeddings="distinct",
        )
    )  # fmt: skip


class Solver:
    """The true rig in place of a solve, with clocks where these are asked for; a refusal in one round."""

    def __init__(self, truth: Rig, refuse_at: int) -> None:
        self.truth, self.refuse_at, self.calls = truth, refuse_at, 0

    def __call__(self, run: Any, rig: Rig, *_: Any, refine_time: bool = False, **__: Any) -> Solution:
        self.calls += 1
        if self.calls == self.refuse_at + 1:
            return refused(rig)
        clocks = {
            name: ClockCorrection(correction_s=0.0, sigma_s=0.01 if name != rig.names[0] else 0.0)
            for name in (rig.names if refine_time else ())
        }
        figures = AdjustedFigures(clocks=clocks)
        return Solution("people", replace(self.truth, verdict="accepted"), "accepted", figures=figures)


MODES: list[dict[str, Any]] = [
    {"mode": "trajectory", "max_offset_s": 0.0},
    {"mode": "combined", "max_offset_s": 1.0},
    {"mode": "appearance", "max_offset_s": 0.0},
    {"mode": "given", "max_offset_s": 0.0},
    {"mode": "given", "max_offset_s": 1.0},
]
SOLVERS: dict[str, dict[str, Any]] = {
    "plain": {},
    "lens": {"refine": ["focal", "principal_point"]},
    "clock_rate": {"refine": ["clock_rate"]},
    "geopose": {"method": "geopose", "reference": "C1"},
}
QUICK = MODES[0], MODES[3]
"""In which the other solvers are tried too: the rounds are the mode's, not the solver's."""


@pytest.mark.parametrize(
    ("association", "table"),
    [(mode, SOLVERS[name]) for mode in MODES for name in (SOLVERS if mode in QUICK else ("clock_rate",))],
    ids=lambda table: "-".join(str(value) for value in table.values()) or "plain",
)
def test_a_refused_solve_in_any_round_is_a_refusal(
    association: dict[str, Any], table: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = scene(association["mode"] == "given")
    boxes = {name: seen.boxes for name, seen in simulated.observations.cameras.items()}
    rounds = 0
    while True:
        solver = Solver(simulated.rig, rounds)
        for module in (calibrate, known_identities, smaller_pictures):
            monkeypatch.setattr(module, "solve_scene", solver)
        found = calibrate_observations(
            simulated.rig, boxes, fps=5.0, association=association, solver=table, world={"camera": "C1", "towards": "C2"}
        )
        if solver.calls <= rounds:
            break  # that round did not come
        if solver.calls == rounds + 1:  # later solves, of a moved camera or of another frame rate, may hold
            assert found.verdict == "refused"
            assert FORCED in found.diagnostics
            assert not len(found.rig.posed())
            found.write(tmp_path / f"round{rounds}")
            assert (tmp_path / f"round{rounds}" / "calibration.json").is_file()
        rounds += 1
    # First guesses, the rounds between and the last solve were refused in turn.
    assert rounds >= (1 if association == MODES[3] else 2)


def inputs() -> SceneInputs:
    seen = scene(True)
    clocks = {name: Clock(5.0) for name in seen.rig.names}
    return SceneInputs(without_poses(seen.rig), replace(seen.observations, clocks=clocks), ())


@pytest.mark.unit
def test_rates_of_a_solve_that_is_refused_after_a_clock_was_corrected() -> None:
    whole = inputs()
    seen = whole.observations
    drifts = {name: Drift(rate, 1e-5, 8.0) for name, rate in zip(whole.rig.names, (0.0, 0.02, 0.0), strict=True)}
    first = Estimate(Solution("people", scene(True).rig, "accepted"), Association(seen, seen, seen.clocks, drifts=drifts))
    correction = correct_clock_rates(whole, first)
    after = Estimate(refused(whole.rig), Association(seen, seen, seen.clocks))
    assert correct_clock_rates(correction.inputs, after) is None
    assert clock_rate_figures(whole, correction.inputs, after) == {}


@pytest.mark.unit
@pytest.mark.parametrize("given", [False, True])
def test_the_size_of_a_move_where_the_solve_after_it_is_refused(given: bool) -> None:
    whole = inputs()
    seen, pose = whole.observations, scene(True).rig["C2"].pose
    other = Pose.from_centre(pose.R_cw, pose.centre + 1.0)
    change = PoseChange(((20, 40),), False, True, pose, other, 99.0, 99.0, 0.5)
    corrections = Corrections((MotionCorrection(whole, DetectedMotion("C2", ((20, 40),), 5.0, change)),))
    after = Estimate(refused(whole.rig), Association(seen, seen, seen.clocks))
    search = MotionSearch(whole, given, 1.72)
    assert correct_motion(search, whole, after) is None
    assert [one.camera for one in measure_motions(search, corrections, after)] == ["C2"]


@pytest.mark.slow
@pytest.mark.unit
def test_lenses_from_which_no_first_guess_can_be_made_anew_leave_a_doubtful_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lenses without intrinsics are too far from the first guess, and with them no arrangement of the cameras agrees."""
    truth = simulated("basketball")
    stated = Rig(tuple(replace(camera, lens=Lens.unknown(camera.lens.size), pose=None) for camera in truth.rig))
    calls: list[Any] = []
    select = stages.select_initial_rig

    def only_once(*args: Any) -> Any:
        calls.append(args)
        if len(calls) > 1:
            raise RefusalError(FORCED)
        return select(*args)

    monkeypatch.setattr(people, "select_initial_rig", only_once)
    monkeypatch.setattr(stages.Initialisation, "near", lambda start, other: False)
    options = PeopleOptions(max_sightings=2000, coarse_people=200, refine_lens=LENS_PARTS)
    solution = solve(stated, part(truth.observations), options=options)
    assert len(calls) == 2
    assert solution.verdict == "doubtful"
    assert "reinitialisation_failed" in [doubt.code for doubt in solution.findings]
    assert len(solution.rig.posed()) == len(truth.rig)
