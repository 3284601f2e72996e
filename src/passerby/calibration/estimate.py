"""One estimate of a rig: identities and clocks where they are unknown, and the rig."""

from __future__ import annotations

import numpy as np

from passerby.association.attachment import Attached
from passerby.association.clocks.offsets import clock_corrections, snap_to_whole_frames
from passerby.association.clocks.starts import FULL_SEARCH_S, WALL_CLOCK
from passerby.calibration.association_run import AssociationOptions, share_of_same_pairs
from passerby.calibration.association_start import start_association
from passerby.calibration.known_identities import estimate_with_known_identities
from passerby.calibration.run import CalibrationRun, Estimate
from passerby.calibration.scene_solver import solve_scene
from passerby.common.progress import tell_note
from passerby.core.association_figures import AssociationRound
from passerby.core.solution import Solution
from passerby.core.unknown_focals import begin_with
from passerby.scene.inputs import SceneInputs

MAX_ROUNDS = 4
"""Rounds of association and solver in one estimate."""
SEARCHED_ROUNDS = 2
"""Rounds in which cameras without a pose are searched by the rig's people."""
SETTLED = 0.98
"""Identities have settled when this share of the pairs of tracklets that are one person stays the same in a round."""


def estimate_rig(run: CalibrationRun, inputs: SceneInputs) -> Estimate:
    """One estimate: identities and clocks where they are unknown, and the rig; six solves at most.

    Identities make a rig, and the rig improves the identities, until both settle.
    """
    scene, rig = run.scene, inputs.rig
    search_s = scene.association.search_s if inputs.observations.clocks else 0.0
    # The recorders' clocks are within the offsets that are searched in full.
    measured = tuple(one for one in inputs.measured if one.found_by != WALL_CLOCK or search_s > FULL_SEARCH_S)
    if scene.association.given:
        return estimate_with_known_identities(run, inputs, search_s, measured)
    wanted = AssociationOptions(
        scene.association.mode, search_s, scene.scale.person_height_m, inputs.pointed, measured, inputs.stated,
        scene.sites.groups,
    )  # fmt: skip
    rng, refine_time = run.rng(), search_s > 0  # one stream of random numbers for association and solver

    # 1. Tracklets of each camera, pairs of cameras that their people register, first identities and clocks.
    start = start_association(run, rig, inputs.observations, wanted, rng)
    state, initial = start.run, start.initial
    if initial is None:
        singles = np.arange(len(state.tracklets.start_s))
        association = state.association(singles, np.zeros(len(state.cameras)), None, None, [])
        return Estimate(Solution("association", state.rig, "refused", start.refusal), association)
    person, offset_s = initial.person, initial.offset_s
    lenses = state.rig if any(camera.lens.uncalibrated for camera in state.rig) else None
    rounds, attached, solution = list[AssociationRound](), dict[int, Attached](), None

    # 2. Rounds: solve with these identities and clocks, then identify people by the rig.
    for number in range(MAX_ROUNDS):
        run.progress(f"round {number + 1}")
        rows = state.rows(person, offset_s, solution)
        instants, known = state.instants(state.identified(rows), offset_s), state.known(rows).people
        solution = solve_scene(
            run, rig, instants, rng, guesses=initial.guesses, known=known, passing=True, refine_time=refine_time, lenses=lenses
        )
        if solution.verdict == "refused":
            return Estimate(solution, state.association(person, offset_s, None, initial, rounds))
        offset_s = offset_s + clock_corrections(solution)[0]
        if lenses is not None:
            state, lenses = state.with_lenses(solution.rig), begin_with(lenses, solution.rig)
        before = person
        person, registered = state.identify_by_rig(
            person, offset_s, solution, initial, attached, search=number < SEARCHED_ROUNDS, executor=run.executor,
            tell=run.progress,
        )  # fmt: skip
        rounds.append(AssociationRound(registered=registered, unchanged=share_of_same_pairs(before, person)))
        tell_note(run.progress, f"{registered} of {len(rig)} cameras have poses")
        if rounds[-1].unchanged > SETTLED:
            break

    # 3. The last solve, with all of the evidence; a second one where all clocks turn out to differ by whole frames.
    run.progress("solving")
    rows = state.rows(person, offset_s, solution)
    identified, known = state.identified(rows), state.known(rows).people
    instants = state.instants(identified, offset_s)
    solution = solve_scene(
        run, rig, instants, rng, guesses=initial.guesses, known=known, refine_time=refine_time, lenses=lenses
    )
    sigma_s = None
    if refine_time and solution.verdict != "refused":
        correction_s, sigma_s = clock_corrections(solution)
        offset_s = offset_s + correction_s
        whole = snap_to_whole_frames(offset_s, sigma_s, np.array([camera.clock.fps for camera in state.cameras]))
        if whole is not None:
            offset_s, instants = whole, state.instants(identified, whole)
            solution = solve_scene(run, rig, instants, rng, guesses=initial.guesses, known=known, lenses=lenses)
    return Estimate(solution, state.association(person, offset_s, solution, initial, rounds, sigma_s, attached))
