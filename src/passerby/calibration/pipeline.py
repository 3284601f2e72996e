"""`calibrate()`: the order of the stages, and nothing else."""

from __future__ import annotations

import difflib
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError
from threadpoolctl import threadpool_limits

from passerby.association.result import Association
from passerby.calibration.alignment.scene_world import in_world
from passerby.calibration.association_loop import AssociationOptions, solve_unidentified
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import steadied
from passerby.calibration.clock_skew import rate_findings, rated
from passerby.calibration.diagnostics.ground_planarity import ground_figures, shape_of, told_of_ground
from passerby.calibration.diagnostics.smaller_pictures import doubts_of_smaller_pictures
from passerby.calibration.diagnostics.verdict import judged
from passerby.calibration.diagnostics.walking_speed import ScaleBasis, doubts_of_heights, scale_basis
from passerby.calibration.temporal_calibration import association_in_step, solve_with_clocks
from passerby.common.errors import EvidenceError, InputError
from passerby.common.progress import Progress, silent, tell_note
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.overlap import connected_groups, missing_overlap, shared_people
from passerby.core.solution import Solution
from passerby.core.synchronisation import clocks_of, common_instants
from passerby.geometry.relative_pose import PairHypothesis
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.same_content import doubts_of_same_place
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import Videos, joints_remedy
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleOptions, solve_people
from passerby.solver.refined_lenses import lens_notes

if TYPE_CHECKING:
    from passerby.solver.geopose.geopose import GeoPoseOptions


PASSING_SIGHTINGS = 8000
"""Sightings in the solutions between two rounds of association: enough to place people to a fraction of their width."""
PASSING_TOLERANCE = 1e-5
"""Relative gain at which such a solution ends: the digits beyond are the last solution's business."""


def calibrate(
    scene: Scene | str | Path, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None,
    keep: str | Path | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate the cameras of a scene from the people in it.

    Too little evidence does not raise: it is a calibration with the verdict "refused" or "doubtful" and its reasons.

    Args:
        scene: a scene, or the path of a scene file.
        seed: of the random numbers (RANSAC); the same scene and seed give the same result, bit for bit.
        progress: called with the name of each stage as it begins and, where its parts can be counted, with the number of parts
            that are done and their total.
        executor: works on cameras, and on pairs of them, side by side, such as a `concurrent.futures.ProcessPoolExecutor`;
            None: one after the other. The result does not depend on it.
        keep: folder in which is kept what was seen in the videos, so that a run that was stopped, or is repeated with other
            options, goes on from there: mostly that which the calibration is written into. None: nothing is kept.

    Raises:
        InputError: the scene file or a file that it names is missing, broken, or contradicts another.
    """
    tell = progress or silent
    began = time.perf_counter()
    tell("reading")
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    solver_options(scene)  # what is wrong with them is told before hours are spent on videos
    watch = Videos(None if keep is None else Path(keep), executor, tell)
    inputs = read_inputs(scene, watch)
    for note in (_amount(inputs), *inputs.findings):  # what `watch` has to note was told when it was found
        tell_note(tell, note)
    read = time.perf_counter()
    found = calibrate_inputs(scene, inputs, seed=seed, progress=tell, executor=executor)
    missing = len(found.rig.posed()) < len(found.rig)
    joints = joints_remedy(scene) if missing else None
    return replace(
        found,
        reasons=(*found.reasons, *([joints] if joints else [])),
        findings=(*watch.notes, *found.findings),
        perception=watch.figures,
        seconds={"reading": read - began, **watch.seconds, **found.seconds},
    )


def calibrate_inputs(
    scene: Scene, inputs: SceneInputs, *, seed: int = 0, progress: Progress | None = None, executor: Executor | None = None
) -> Calibration:
    """Calibrate from inputs that were read; arguments and errors as of `calibrate`."""
    tell = progress or silent
    began = time.perf_counter()
    options = solver_options(scene)
    # The systems are small: more BLAS threads only wait for each other, and the number of them would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        given, body_m = scene.association.given, scene.scale.person_height_m

        def solve(inputs: SceneInputs) -> tuple[Solution, Association]:
            return _solved(scene, inputs, options, np.random.default_rng(seed), tell, executor)

        in_step = partial(rated, solve=solve) if "clock_rate" in scene.solver.refine else solve
        steady = steadied(inputs, in_step, given=given, body_m=body_m)
        association = steady.association
        shape = shape_of(steady.solution, association.instants, body_m)
        tilt_known = scene.world is not None and scene.world.tilt
        uneven, ground = told_of_ground(shape, placed=scene.world is not None, tilt_known=tilt_known)
        found = replace(steady.solution, figures=steady.solution.figures | {"ground": ground_figures(shape)})
        placed = in_world(scene, found)
        basis, grown = _scale_of(scene, found, placed.rig)
        tall = doubts_of_heights(found.figures.get("people", {}).get("heights_m"), grown, body_m) if grown != 1.0 else ()
        sizes = doubts_of_smaller_pictures(
            inputs.rig,
            inputs.observations,
            found,
            lambda rig: _solve(scene, rig, association.instants, options, np.random.default_rng(seed)),
        )
        places = doubts_of_same_place(found.rig, inputs.observations)
        doubts = (*inputs.doubts, *places, *sizes, *steady.reasons, *association.notes, *uneven, *tall)
        why = association.lost
        solution = judged(found, association.instants, given=given, why=why, doubts=doubts, basis=basis, grown=grown)
    solved = time.perf_counter()
    refined = (*lens_notes(solution.figures), *rate_findings(solution.figures), *ground)
    for note in (
        *refined,
        *association.findings,
        *placed.findings,
        f"{solution.verdict}{''.join(f': {reason}' for reason in solution.reasons[:1])}",
    ):
        tell_note(tell, note)
    return Calibration(
        scene=scene,
        rig=replace(placed.rig, verdict=solution.verdict),
        verdict=solution.verdict,
        reasons=solution.reasons,
        observations=association.observations,
        seed=seed,
        options=asdict(options),
        figures=placed.figures,
        findings=(*inputs.findings, *association.findings, *refined, *placed.findings),
        association=association,
        clocked=bool(inputs.observations.clocks),
        world=placed.world,
        seconds={"solving": solved - began},
    )


def _scale_of(scene: Scene, found: Solution, placed: Rig) -> tuple[ScaleBasis, float]:
    """What the scale rests on, and what known places multiplied it by."""
    said = bool(scene.scale.model_fields_set & {"person_height_m", "people"})
    basis = scale_basis(found.figures.get("scale", {}).get("cues"), said=said)
    if scene.world is None or not scene.world.scale:
        return basis, 1.0
    centres = [np.array([camera.pose.centre for camera in rig if camera.pose is not None]) for rig in (found.rig, placed)]
    before, after = (float(np.linalg.norm(each - each.mean(axis=0))) if len(each) else 0.0 for each in centres)
    if before <= 0 or abs(after / before - 1) < 1e-12:
        return basis, 1.0
    return "measured", after / before


def _amount(inputs: SceneInputs) -> str:
    """How much there is to calibrate from, in words."""
    seen = inputs.observations
    boxes = sum(len(seen[name].boxes) for name in inputs.rig.names)
    joints = sum(len(seen[name].keypoints) for name in inputs.rig.names)
    return f"{len(inputs.rig)} cameras, {boxes} boxes" + (f", {joints} bodies of joints" if joints else "")


def solver_options(scene: Scene) -> PeopleOptions | GeoPoseOptions:
    """The options dataclass of the scene's method. Raises `InputError` for a key or a value that it does not take."""
    chosen = dict(scene.solver.options)
    if lenses := tuple(part for part in LENS_PARTS if part in scene.solver.refine):
        chosen.setdefault("refine_lens", lenses)
    if scene.solver.method == "geopose":
        chosen["reference"] = scene.solver.reference
        if "person_height_m" in scene.scale.model_fields_set:
            chosen.setdefault("person_height_m", scene.scale.person_height_m)
    kind = _options_type(scene.solver.method)
    known = [option.name for option in fields(kind)]
    for key in chosen:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
            mend = f"did you mean '{close[0]}'?" if close else f"method {scene.solver.method} has {', '.join(known)}"
            raise InputError(f"{scene.place}: [solver.options]: unknown key '{key}': {mend}")
    try:
        return TypeAdapter(kind).validate_python(chosen)
    except ValidationError as error:
        fault = error.errors()[0]
        raise InputError(
            f"{scene.place}: [solver.options] {'.'.join(map(str, fault['loc']))} is {fault['input']!r}: {fault['msg']}"
        ) from None
    except InputError as error:
        raise InputError(f"{scene.place}: [solver.options]: {error}") from None


def _options_type(method: str) -> type[PeopleOptions] | type[GeoPoseOptions]:
    if method == "geopose":
        from passerby.solver.geopose.geopose import GeoPoseOptions

        return GeoPoseOptions
    return PeopleOptions


def _solved(
    scene: Scene, inputs: SceneInputs, options: Any, rng: np.random.Generator, tell: Progress, executor: Executor | None
) -> tuple[Solution, Association]:
    """Who is who, and the rig."""
    rig, seen = inputs.rig, inputs.observations
    search_s, body_m = scene.association.search_s if seen.clocks else 0.0, scene.scale.person_height_m
    if scene.association.given and search_s == 0:
        instants = _synchronised(rig, seen)
        tell("solving")
        solution = _solve(scene, rig, instants, options, rng)
        return solution, association_in_step(rig, seen, instants, solution)

    def solve(instants: Observations, guesses: Sequence[PairHypothesis], *, passing: bool, refine_time: bool) -> Solution:
        chosen = options
        if isinstance(options, PeopleOptions):
            chosen = replace(options, refine_time=options.refine_time or refine_time)
            if passing:
                sightings, tolerance = min(chosen.max_sightings, PASSING_SIGHTINGS), max(chosen.tolerance, PASSING_TOLERANCE)
                chosen = replace(chosen, max_sightings=sightings, tolerance=tolerance)
        return _solve(scene, rig, instants, chosen, rng, guesses)

    if scene.association.given:
        return solve_with_clocks(rig, seen, search_s, body_m, solve, rng, tell=tell, executor=executor)
    wanted = AssociationOptions(scene.association.mode, search_s, body_m)
    return solve_unidentified(rig, seen, wanted, solve, rng, tell=tell, executor=executor)


def _synchronised(rig: Rig, seen: Observations) -> Observations:
    """The people at common time steps, by the clocks as they are stated."""
    sizes = {camera.name: camera.lens.size for camera in rig}
    found = common_instants(seen, clocks_of(seen, rig.names), sizes=sizes)
    return found if seen.clocks or seen.fps else replace(found, fps=None)


def _solve(
    scene: Scene, rig: Rig, instants: Observations, options: Any, rng: np.random.Generator,
    guesses: Sequence[PairHypothesis] = (),
) -> Solution:  # fmt: skip
    """Run the scene's solver; a want of evidence is a refused solution without poses."""
    shared = shared_people(instants)
    try:
        if len(connected_groups(shared)[0]) == 1:
            reasons = tuple(missing_overlap(shared, given=scene.association.given))
            raise EvidenceError(reasons[0], reasons)
        if scene.solver.method == "geopose":
            from passerby.solver.geopose.geopose import solve_geopose

            return solve_geopose(rig, instants, scene.scale_cues(), options, rng=rng)
        return solve_people(rig, instants, scene.scale_cues(), options, rng=rng, guesses=guesses)
    except EvidenceError as error:
        return Solution(scene.solver.method, rig, "refused", error.reasons)
