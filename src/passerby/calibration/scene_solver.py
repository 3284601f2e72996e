"""Solution of a rig from people at common time steps, by the method that the scene names."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from pydantic import TypeAdapter, ValidationError

from passerby.calibration.run import CalibrationRun, SolverOptions
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.overlap import count_shared_observations, find_connected_groups, missing_overlap
from passerby.core.quarter_turns import turn_cues
from passerby.core.scale_cues import PersonHeight, combine_heights, lengths_of_wands
from passerby.core.solution import Solution
from passerby.findings.ranking import RefusalError, findings_of
from passerby.geometry.two_view import PairHypothesis
from passerby.scene.scene import Scene
from passerby.solver.geopose.geopose import GeoPoseOptions, solve_geopose
from passerby.solver.initialisation import JoinedRig
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleOptions, solve_people

PASSING_SIGHTINGS, PASSING_JOINTS = 8000, 4000
"""Largest numbers of observations of people, and of their joints, in a solution between two rounds of association. They are
enough to place people to a fraction of their width."""
PASSING_TOLERANCE = 1e-5
"""Relative gain at which the adjustment of such a solution ends. The last solution is more exact."""


def solve_scene(
    run: CalibrationRun, rig: Rig, synchronised: Observations, rng: np.random.Generator,
    *, guesses: Sequence[PairHypothesis] = (), known: Sequence[PersonHeight] = (), passing: bool = False,
    refine_time: bool = False, lenses: Rig | None = None, begin: JoinedRig | None = None,
) -> Solution:  # fmt: skip
    """Solve a rig by the method that the scene names; insufficient evidence gives the verdict `refused`, without poses.

    Args:
        run: the scene and its options.
        rig: names and lenses as stated; its poses are not used.
        synchronised: people at common time steps, with identities that hold over all cameras.
        rng: random numbers of the estimate; one solve continues the sequence of the last.
        guesses: relative poses of pairs of cameras, found before.
        known: heights of people by identity, metres, in addition to those that the scene states.
        passing: whether another solve follows, so that a part of the evidence is enough.
        refine_time: whether the errors of the clocks are unknowns.
        lenses: names and lenses to begin with, where they are known better than as stated.
        begin: a rig that was joined from groups, to begin with; None: all poses are sought.
    """
    scene, options = run.scene, _options_of_solve(run.options, rig, passing=passing, refine_time=refine_time)
    rig = lenses or rig
    cues = turn_cues(scene.scale_cues(), rig, scene.turns)
    lengths = (*cues.lengths, *lengths_of_wands(cues.wands, synchronised))
    cues = replace(cues, people=combine_heights((*cues.people, *known)), lengths=lengths)
    shared = count_shared_observations(synchronised)
    try:
        if len(find_connected_groups(shared)[0]) == 1:
            raise RefusalError(missing_overlap(shared, given=scene.association.given))
        if isinstance(options, GeoPoseOptions):
            return solve_geopose(rig, synchronised, cues, options, rng=rng)
        return solve_people(rig, synchronised, cues, options, rng=rng, guesses=guesses, executor=run.executor, begin=begin)
    except EvidenceError as error:
        return Solution(scene.solver.method, rig, "refused", findings_of(error))


def _options_of_solve(options: SolverOptions, rig: Rig, *, passing: bool, refine_time: bool) -> SolverOptions:
    """Return the options of one solve: unknown lenses and clocks are estimated, and a passing solve uses less evidence."""
    if isinstance(options, GeoPoseOptions):
        return options
    if any(camera.lens.uncalibrated for camera in rig):
        options = replace(options, refine_lens=LENS_PARTS)
    if refine_time:
        options = replace(options, refine_time=True)
    if passing:
        options = replace(
            options, max_sightings=min(options.max_sightings, PASSING_SIGHTINGS),
            max_joints=min(options.max_joints, PASSING_JOINTS), tolerance=max(options.tolerance, PASSING_TOLERANCE),
        )  # fmt: skip
    return options


def solver_options(scene: Scene) -> SolverOptions:
    """Return the options of the scene's method. Raises `InputError` for a key or a value that the method does not accept."""
    chosen = dict(scene.solver.options)
    if lenses := tuple(part for part in LENS_PARTS if part in scene.solver.refine):
        chosen.setdefault("refine_lens", lenses)
    if scene.solver.method == "geopose":
        chosen["reference"] = scene.solver.reference
        if "person_height_m" in scene.scale.model_fields_set:
            chosen.setdefault("person_height_m", scene.scale.person_height_m)
    kind: type[SolverOptions] = GeoPoseOptions if scene.solver.method == "geopose" else PeopleOptions
    known = [option.name for option in fields(kind)]
    for key in chosen:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
            remedy = f"did you mean '{close[0]}'?" if close else f"method {scene.solver.method} has {', '.join(known)}"
            raise InputError(f"{scene.place}: [solver.options]: unknown key '{key}': {remedy}")
    try:
        return TypeAdapter(kind).validate_python(chosen)
    except ValidationError as error:
        fault = error.errors()[0]
        raise InputError(
            f"{scene.place}: [solver.options] {'.'.join(map(str, fault['loc']))} is {fault['input']!r}: {fault['msg']}"
        ) from None
    except InputError as error:
        raise InputError(f"{scene.place}: [solver.options]: {error}") from None
