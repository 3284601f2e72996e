"""The solver that a scene asks for, with its options: from people at common time steps to a rig."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace

import numpy as np
from pydantic import TypeAdapter, ValidationError

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.overlap import connected_groups, count_shared_observations, missing_overlap
from passerby.core.quarter_turns import turn_cues
from passerby.core.scale_cues import PersonHeight, combine_heights, lengths_of_wands
from passerby.core.solution import Solution
from passerby.findings.refusals import RefusalError, findings_of
from passerby.geometry.relative_pose import PairHypothesis
from passerby.scene.scene import Scene
from passerby.solver.geopose.geopose import GeoPoseOptions, solve_geopose
from passerby.solver.lens_unknowns import LENS_PARTS
from passerby.solver.people import PeopleOptions, solve_people

SolverOptions = PeopleOptions | GeoPoseOptions

PASSING_SIGHTINGS = 8000
"""Observations in the solutions between two rounds of association: enough to place people to a fraction of their width."""
PASSING_TOLERANCE = 1e-5
"""Relative gain at which such a solution ends: the digits beyond are the last solution's business."""


@dataclass(frozen=True, eq=False)
class SceneSolver:
    """One scene's solver: its random numbers go on from solve to solve."""

    scene: Scene
    rig: Rig
    """Names and lenses."""
    options: SolverOptions
    rng: np.random.Generator
    known: tuple[PersonHeight, ...] = ()
    """Heights of people by identity, beside those that the scene states."""
    executor: Executor | None = None
    """Solves zones of large rigs side by side."""

    def __call__(
        self, synchronised: Observations, guesses: Sequence[PairHypothesis] = (), *, passing: bool = False,
        refine_time: bool = False, lenses: Rig | None = None, known: Sequence[PersonHeight] = (),
    ) -> Solution:  # fmt: skip
        """The rig from people at common time steps, refused where the evidence does not do.

        Args:
            synchronised: people with identities that hold over the cameras.
            guesses: relative poses of pairs, found before.
            passing: a part of the evidence is enough, since another solve follows.
            refine_time: the clocks' errors are unknowns.
            lenses: names and lenses to begin with, where they are known better than those of the scene.
            known: heights of people by these identities, beside those that the scene states and `known` of the solver.
        """
        options = self.options
        if isinstance(options, PeopleOptions) and any(camera.lens.uncalibrated for camera in self.rig):
            options = replace(options, refine_lens=LENS_PARTS)
        if isinstance(options, PeopleOptions) and refine_time:
            options = replace(options, refine_time=True)
        if isinstance(options, PeopleOptions) and passing:
            sightings = min(options.max_sightings, PASSING_SIGHTINGS)
            options = replace(options, max_sightings=sightings, tolerance=max(options.tolerance, PASSING_TOLERANCE))
        known = (*self.known, *known)
        return solve_scene(self.scene, lenses or self.rig, synchronised, options, self.rng, guesses, known, self.executor)


def solve_scene(
    scene: Scene, rig: Rig, synchronised: Observations, options: SolverOptions, rng: np.random.Generator,
    guesses: Sequence[PairHypothesis] = (), known: Sequence[PersonHeight] = (), executor: Executor | None = None,
) -> Solution:  # fmt: skip
    """Run the scene's solver; insufficient evidence is a refused solution without poses. `known` adds to the scene's cues."""
    cues = turn_cues(scene.scale_cues(), rig, scene.turns)
    lengths = (*cues.lengths, *lengths_of_wands(cues.wands, synchronised))
    cues = replace(cues, people=combine_heights((*cues.people, *known)), lengths=lengths)
    shared = count_shared_observations(synchronised)
    try:
        if len(connected_groups(shared)[0]) == 1:
            raise RefusalError(missing_overlap(shared, given=scene.association.given))
        if isinstance(options, GeoPoseOptions):
            return solve_geopose(rig, synchronised, cues, options, rng=rng)
        return solve_people(rig, synchronised, cues, options, rng=rng, guesses=guesses, executor=executor)
    except EvidenceError as error:
        return Solution(scene.solver.method, rig, "refused", findings_of(error))


def solver_options(scene: Scene) -> SolverOptions:
    """The options dataclass of the scene's method. Raises `InputError` for a key or a value that it does not take."""
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
