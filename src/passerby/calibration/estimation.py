"""One estimate from one set of inputs: identities and clocks where they are unknown, and the rig."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.clocks.starts import FULL_SEARCH_S, WALL_CLOCK
from passerby.association.not_people import without_people
from passerby.association.result import Association
from passerby.calibration.association_loop import EarlierAssociation, solve_with_unknown_identities
from passerby.calibration.association_run import AssociationOptions
from passerby.calibration.kept_tracklets import KeptTracklets
from passerby.calibration.pointed_heights import identity_in, pointed_heights
from passerby.calibration.scene_solver import SceneSolver, SolverOptions
from passerby.calibration.temporal_calibration import associate_synchronised, solve_with_unknown_offsets
from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.pointing import StatedIdentities
from passerby.core.solution import Solution
from passerby.core.synchronisation import clocks_of, resample_to_common_steps
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Estimate:
    """A rig, and the association that it uses."""

    solution: Solution
    association: Association


@dataclass(frozen=True, eq=False)
class Estimator:
    """Makes estimates of one scene, each with the same random numbers: none depends on another.

    Only what was found of single cameras and pairs is used again where their input is the same.
    """

    scene: Scene
    options: SolverOptions
    seed: int
    progress: Progress
    executor: Executor | None = None
    kept: KeptTracklets | None = None
    """Tracklets of earlier runs, and of this one for the next."""
    earlier: EarlierAssociation = field(default_factory=EarlierAssociation)

    def __call__(self, inputs: SceneInputs) -> Estimate:
        """The rig and the association from one set of inputs; six solves at most: four rounds of identities and two more."""
        scene, rig, seen = self.scene, inputs.rig, inputs.observations
        solver = self.solver(rig)
        rng = solver.rng  # one stream for association and solver
        search_s = scene.association.search_s if seen.clocks else 0.0
        # What recorders' clocks say is within the offsets that are searched in full.
        measured = tuple(one for one in inputs.measured if one.found_by != WALL_CLOCK or search_s > FULL_SEARCH_S)
        height_m = scene.scale.person_height_m
        if not scene.association.given:
            wanted = AssociationOptions(
                scene.association.mode,
                search_s,
                height_m,
                inputs.pointed,
                measured,
                inputs.stated,
                scene.sites.groups,
            )
            return Estimate(
                *solve_with_unknown_identities(
                    rig,
                    seen,
                    wanted,
                    solver,
                    rng,
                    tell=self.progress,
                    executor=self.executor,
                    earlier=self.earlier,
                    kept=self.kept,
                )
            )
        seen = _without_not_people(seen, inputs.stated)
        heights = pointed_heights(inputs.pointed, identity_in(seen))
        solver = replace(solver, known=heights.people)
        if search_s > 0:
            solution, association = solve_with_unknown_offsets(
                rig, seen, search_s, height_m, solver, rng, measured=measured, tell=self.progress, executor=self.executor
            )
        else:
            synchronised = _synchronised(rig, seen)
            self.progress("solving")
            solution = solver(synchronised)
            association = associate_synchronised(rig, seen, synchronised, solution)
        return Estimate(solution, replace(association, known_heights=heights.people, height_findings=heights.findings))

    def solver(self, rig: Rig) -> SceneSolver:
        """The scene's solver for cameras with these lenses, at the beginning of its random numbers."""
        return SceneSolver(self.scene, rig, self.options, np.random.default_rng(self.seed), executor=self.executor)


def _without_not_people(seen: Observations, stated: StatedIdentities) -> Observations:
    """The people without the ids, in their cameras, of what the user says is no person."""
    if not stated.not_people:
        return seen
    cameras = {
        name: without_people(camera, [one for one in stated.not_people if one.camera == name])
        for name, camera in seen.cameras.items()
    }
    return replace(seen, cameras=cameras)


def _synchronised(rig: Rig, seen: Observations) -> Observations:
    """The people at common time steps, by the clocks as they are stated."""
    sizes = {camera.name: camera.lens.size for camera in rig}
    found = resample_to_common_steps(seen, clocks_of(seen, rig.names), sizes=sizes)
    return found if seen.clocks or seen.fps else replace(found, fps=None)
