"""Initial rig of the person-model solver: evidence, hypotheses of pairs, and the spanning tree with the most agreement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.figures import TreeFigures
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.unknown_focals import needs_focal_search, shared_lenses
from passerby.findings.finding import Finding, doubt, refusal
from passerby.findings.ranking import RefusalError
from passerby.geometry.rotations import angle_between, chordal_mean_rotation
from passerby.geometry.single_view import Level, level_camera
from passerby.geometry.two_view import PairHypothesis
from passerby.people.model import JOINED_FOOT_SHIFT_SD, Noise, Priors
from passerby.solver.adjustment_problem import (
    AdjustmentProblem,
    PriorKnowledge,
    RigState,
    build_problem,
    rig_of,
)
from passerby.solver.cues import (
    cue_rows,
    expected_heights,
    initial_scale,
    population_spread,
    refuse_wrong_units,
    settle_cues,
    triangulate_marks,
    without_gaps,
)
from passerby.solver.evidence import Evidence, draw_blocks, gather_evidence
from passerby.solver.focal_search import search_focals
from passerby.solver.lens_sigmas import lens_evidence
from passerby.solver.lens_unknowns import LensModel, LensPart, LensUnknowns
from passerby.solver.optimizer.least_squares import Result, Stopping, minimise
from passerby.solver.pairs import ALL_PAIRS_UP_TO, pair_hypotheses, verify_guesses
from passerby.solver.people_state import AdjustmentState
from passerby.solver.pose_graph import gravity_aligned, poses_of_tree, spanning_trees
from passerby.solver.registrations import contradicted
from passerby.solver.systematic import ConsiderParameters
from passerby.solver.uncertainty import design_effect, joint_design_effect

# A descent from another tree is a rival if it ends with at least this share of the best one's agreeing sightings. Rivals count
# as the same rig when no relative rotation of two cameras differs by more than this angle.
_RIVAL_SHARE = 0.97
_RIVAL_ANGLE = np.deg2rad(4.0)
# A descent that starts as near as this to the end of another one ends there as well, so that it is left out: twice the angle of
# rivals, and a share of the distance of the cameras from their middle. Of 40 descents in twelve simulated scenes (three
# to six cameras, seeds 990001 to 990003 of four kinds in benchmarks/reliability/other_inputs.py) those that began within 5.5
# degrees and 0.13 ended within 0.2 degrees of each other; one began at 9.3 degrees and 0.22, and ended 4 degrees away.
_SAME_ANGLE, _SAME_SHIFT = np.deg2rad(8.0), 0.2
# A rig with fewer agreeing sightings than this share of the largest number is not selected, even if it contradicts fewer
# registrations.
_SOUND_SHARE = 0.9
# An initial rig is computed again if a focal length was wrong by more than this (difference of logarithms).
_MISLEADING_FOCAL = 0.25
# Mean number of observations per camera, for rigs of many cameras, in the coarse descents and in the round that learns the
# noise: in rooms of eight cameras of which half see each person, the default numbers of people give 200 and 750.
_COARSE_OF_CAMERA, LEARNING_OF_CAMERA = 60, 200
# Limits of a coarse descent; the optimum needs more evidence in any case.
_COARSE = Stopping(15, 1e-4)


@dataclass(frozen=True)
class PeopleOptions:
    """Options of the person-model solver."""

    max_sightings: int = 30_000
    """Largest number of observations of people in the adjustment; more are sampled at random by person and time step."""
    max_joints: int = 24_000
    """Largest number of keypoint observations, likewise."""
    coarse_people: int = 400
    """People, each at one time step, in the coarse adjustments that select the initial rig."""
    coarse_joints: int = 1500
    """Keypoints in the coarse adjustments."""
    learning_people: int = 1500
    """People, each at one time step, in the first round, which estimates the noise of the observations."""
    learning_joints: int = 6000
    """Keypoints in the first round."""
    rounds: int = 3
    """Rounds of outlier removal, adjustment and noise estimation on all evidence; more rounds while the noise still grows."""
    max_iterations: int = 60
    """Iterations of the adjustment in each round."""
    tolerance: float = 1e-6
    """Relative decrease of the cost at which a round has converged."""
    refine_time: bool = False
    """Whether each camera's clock has an unknown error; needs observations with a known frame rate."""
    refine_lens: tuple[LensPart, ...] = ()
    """Which intrinsics are refined, with the stated values as priors: "focal", "principal_point"."""

    def __post_init__(self) -> None:
        for name in (
            "max_sightings",
            "max_joints",
            "coarse_people",
            "coarse_joints",
            "learning_people",
            "learning_joints",
            "rounds",
            "max_iterations",
        ):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}: it must be 1 or more")
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance is {self.tolerance}: it must lie between 0 and 1")


@dataclass(frozen=True, eq=False)
class Initialisation:
    """Evidence, levels, hypotheses and prior knowledge before the first descent."""

    rig: Rig
    """The cameras with the lenses from which the rays were computed."""
    evidence: Evidence
    levels: list[Level | None]
    hypotheses: list[PairHypothesis]
    knowledge: PriorKnowledge
    stated: Rig
    """The cameras with the lenses as stated."""
    unknowns: LensUnknowns
    lens: Floats
    """(C, L) differences of the lenses of `rig` from the stated ones."""

    @classmethod
    def prepare(
        cls, stated: Rig, observations: Observations, cues: ScaleCues, options: PeopleOptions, rng: np.random.Generator,
        guesses: Sequence[PairHypothesis] = (), begin: JoinedRig | None = None,
    ) -> Initialisation:  # fmt: skip
        """Gather the evidence, level each camera, and compute hypotheses of all pairs.

        `guesses` are added to the hypotheses; with `begin`, a rig that is known, they are the only ones.
        """
        unknowns = LensUnknowns(options.refine_lens)
        searched = "distortion" in unknowns.parts and needs_focal_search(stated)
        lens = np.zeros((len(stated), unknowns.size))
        rig = stated
        evidence = gather_evidence(
            rig, observations, rng, max_sightings=options.max_sightings, max_joints=options.max_joints,
            moving=options.refine_time,
        )  # fmt: skip
        mean, sd = expected_heights(cues, evidence.identities)
        person_height_m = float(np.median(mean)) if len(mean) else cues.population.mean_m
        if searched:
            rig = search_focals(evidence, stated, unknowns, person_height_m, rng)
            evidence = _with_rays_of(rig, stated, evidence, unknowns)
            stated = rig
        levels = [level_of(evidence, c, person_height_m, rng) for c in range(len(rig))]
        focal = np.array([camera.lens.focal for camera in rig])
        hypotheses = [] if begin is not None else pair_hypotheses(evidence, levels, focal, person_height_m, rng)
        hypotheses += verify_guesses(guesses, evidence, focal, person_height_m)
        lens_core = unknowns.first_core(stated) if unknowns.parts else None
        never_calibrated = "distortion" in unknowns.parts
        groups = tuple(tuple(group) for group in shared_lenses(stated) if len(group) > 1) if never_calibrated else ()
        knowledge = PriorKnowledge(
            mean, sd, usual_priors(evidence), cue_rows(cues, rig), lens_core, lens_normal=never_calibrated, lens_groups=groups,
            height_spread=population_spread(cues, evidence.identities),
            lens_model=LensModel(unknowns, stated) if unknowns.parts else None,
            groups=() if begin is None else begin.places_among(stated),
        )  # fmt: skip
        return cls(rig, evidence, levels, hypotheses, knowledge, stated, unknowns, lens).with_lenses(lens)

    def with_free(self, *parts: LensPart) -> Initialisation:
        """Return the same start with only these parts of the lenses free, where lenses were never calibrated.

        From a rough rig, an adjustment with all parts free diverges.
        """
        if "distortion" not in self.unknowns.parts:
            return self
        core = self.unknowns.core(self.stated, free=parts, near_start=True)
        return replace(self, knowledge=replace(self.knowledge, lens_core=core))

    def with_unknowns(self, parts: Sequence[LensPart]) -> Initialisation:
        """Return the same start with parts of the stated lenses free, none changed yet."""
        unknowns = LensUnknowns(tuple(parts))
        core, far = unknowns.first_core(self.stated), unknowns.uncalibrated_sd(self.stated)
        nothing = np.zeros((len(self.stated), unknowns.size))
        knowledge = replace(self.knowledge, lens_core=core, lens_far=far, lens_model=LensModel(unknowns, self.stated))
        return replace(self, unknowns=unknowns, knowledge=knowledge).with_lenses(nothing)

    def weighed(self, model: AdjustmentProblem, result: Result[AdjustmentState]) -> Initialisation:
        """Return the same start with the weight of the lens priors adapted to the correlation of an optimum's sightings."""
        if not self.unknowns.parts:
            return self
        problem, state = model.problem, result.state
        terms = problem.terms(state, jacobians=False)
        effects = design_effect(model, self.evidence, terms), joint_design_effect(model, self.evidence, terms)
        held = ConsiderParameters.of_lenses(self.rig, problem, state, self.unknowns.parts)
        weight = lens_evidence(problem, state, *effects, held).prior_weight
        core = self.unknowns.core(self.stated)
        return replace(self, knowledge=replace(self.knowledge, lens_core=core, lens_weight=weight))

    def near(self, other: Initialisation) -> bool:
        """Return whether all focal lengths differ from those of `other` too little to make an initial rig wrong."""
        focal = (other.lens - self.lens)[:, self.unknowns.columns_of("focal")]
        return bool((np.abs(focal) < _MISLEADING_FOCAL).all())

    def with_lenses(self, lens: Floats) -> Initialisation:
        """Return the same start with the rays of lenses that differ from the stated ones by `lens` (C, L)."""
        if not self.unknowns.parts:
            return self
        unknowns, stated, cues = self.unknowns, self.stated, self.knowledge.cues
        if cues is not None and cues.marks is not None:
            cues = replace(cues, marks=unknowns.points(cues.marks, stated, lens))
        if cues is not None and cues.plan is not None:
            cues = replace(cues, plan=replace(cues.plan, rays=unknowns.points(cues.plan.rays, stated, lens)))
        evidence = replace(
            self.evidence, sightings=unknowns.sightings(self.evidence.sightings, stated, lens),
            joints=unknowns.points(self.evidence.joints, stated, lens),
        )  # fmt: skip
        knowledge = replace(self.knowledge, cues=cues)
        return replace(self, rig=unknowns.rig(stated, lens), evidence=evidence, knowledge=knowledge, lens=lens)


@dataclass(frozen=True, eq=False)
class JoinedRig:
    """A rig joined from groups of cameras that were separate rigs before."""

    rig: Rig
    """Cameras with approximate poses."""
    groups: tuple[tuple[str, ...], ...]
    """Names of the cameras, group by group."""

    def places_among(self, rig: Rig) -> tuple[tuple[int, ...], ...]:
        """Return the numbers in a rig of the cameras of each group; cameras that are not in it are left out."""
        found = (tuple(c for c, name in enumerate(rig.names) if name in group) for group in self.groups)
        return tuple(group for group in found if group)


@dataclass(frozen=True, eq=False)
class InitialRig:
    """The selected rough rig, and the candidates that compete with it."""

    state: RigState
    tree: str
    agreeing: int
    candidates: tuple[TreeFigures, ...]
    doubts: list[Finding]


def _with_rays_of(rig: Rig, stated: Rig, evidence: Evidence, unknowns: LensUnknowns) -> Evidence:
    """Return the evidence with the rays of the lenses in `rig`; it was gathered with those in `stated`."""
    pixels = np.zeros((len(stated), unknowns.size))
    seen, joints = unknowns.sightings(evidence.sightings, stated, pixels), unknowns.points(evidence.joints, stated, pixels)
    return replace(evidence, sightings=unknowns.sightings(seen, rig, pixels), joints=unknowns.points(joints, rig, pixels))


def usual_priors(evidence: Evidence) -> Priors:
    """Return the usual priors on people and detectors; a narrower one on the foot shift where there are boxes and joints."""
    boxes = bool((evidence.sightings.has_foot > 0).any())
    return Priors(foot_shift_sd=JOINED_FOOT_SHIFT_SD) if boxes and evidence.n_joints else Priors()


def level_of(evidence: Evidence, camera: int, person_height_m: float, rng: np.random.Generator) -> Level | None:
    """Return the vertical and height of one camera from its own people, assumed of one height; None where they are too few."""
    s = evidence.sightings.take(evidence.sightings.camera == camera)
    span, foot = person_height_m * (s.top_fraction - s.bottom_fraction), person_height_m * s.bottom_fraction
    return level_camera(s.top, s.bottom, s.top_tangent, s.extent_px, span, foot, rng)


def people_for_all(evidence: Evidence, people: int, of_camera: int) -> int:
    """Return the number of person-instants in a part of the evidence, so that each camera of a large rig has enough.

    Where each person is seen by few of many cameras, a fixed number would leave each camera only a few observations.

    Args:
        evidence: all evidence.
        people: number of person-instants that is enough for up to `ALL_PAIRS_UP_TO` cameras.
        of_camera: smallest mean number of observations per camera.
    """
    if evidence.n_cameras <= ALL_PAIRS_UP_TO or not len(evidence.sightings):
        return people
    seen_by = len(evidence.sightings) / len(evidence.person)
    return max(people, int(np.ceil(of_camera * evidence.n_cameras / seen_by)))


def check_units(start: Initialisation) -> None:
    """Raise `InputError` for a stated length that, by every rough rig, is in another unit than metres."""
    n, rigs = len(start.rig), []
    if start.knowledge.cues is None:
        return
    for _, tree in spanning_trees(start.hypotheses, range(n), n):
        poses = gravity_aligned(poses_of_tree(tree, 0), start.levels)
        rigs.append((np.array([poses[c].R_cw for c in range(n)]), np.array([poses[c].centre for c in range(n)])))
    refuse_wrong_units(start.knowledge.cues, rigs)


def select_initial_rig(start: Initialisation, options: PeopleOptions, rng: np.random.Generator) -> InitialRig:
    """Select the initial rig by descents from the spanning trees, on a part of the evidence.

    A tree that is near the end of another descent is left out. The rig that contradicts the fewest registrations of pairs is
    selected; of several, the one with the most agreeing sightings.
    """
    n = len(start.rig)
    most = people_for_all(start.evidence, options.coarse_people, _COARSE_OF_CAMERA)
    blocks = draw_blocks(start.evidence, most, rng)
    joints = np.sort(rng.permutation(start.evidence.n_joints)[: options.coarse_joints])
    found = list[tuple[TreeFigures, RigState]]()
    start = start.with_free()
    for name, tree in spanning_trees(start.hypotheses, range(n), n):
        poses = gravity_aligned(poses_of_tree(tree, 0), start.levels)
        R, centre = np.array([poses[c].R_cw for c in range(n)]), np.array([poses[c].centre for c in range(n)])
        state, here = rescaled(start, R, centre), start
        if any(tried.agreeing and _leads_to(state, other) for tried, other in found):
            continue
        for noise, share in ((Noise(loss=30.0), 0.4), (Noise(), 0.2)):
            model = build_problem(here.evidence, state, noise, here.knowledge, share=share, blocks=blocks, joints=joints)
            if not (len(model.rows) or len(model.joint_rows)):
                break
            state = rig_of(minimise(model.problem, model.state, _COARSE).state)
            here = here.with_lenses(state.lens)
        model = build_problem(here.evidence, state, Noise(), here.knowledge, share=0.1, blocks=blocks, joints=joints)
        against = len(contradicted(start.hypotheses, state.R, state.centre))
        tried = TreeFigures(tree=name, agreeing=len(model.rows) + len(model.joint_rows), contradicted=against)
        found.append((tried, state))
    most_agreeing = max((tried.agreeing for tried, _ in found), default=0)
    if most_agreeing == 0:
        raise RefusalError(refusal("no_arrangement_fits"))
    sound = [item for item in found if item[0].agreeing >= _SOUND_SHARE * most_agreeing]
    best, state = min(sound, key=lambda item: (item[0].contradicted, -item[0].agreeing))
    rivals = [
        other
        for tried, other in found
        if tried.agreeing > _RIVAL_SHARE * best.agreeing and tried.contradicted <= best.contradicted
        if _differ(other, state) > _RIVAL_ANGLE
    ]
    doubts = [doubt("arrangement_ambiguous")] if rivals else []
    return InitialRig(state, best.tree, best.agreeing, tuple(tried for tried, _ in found), doubts)


def start_at(start: Initialisation, begin: JoinedRig, options: PeopleOptions, rng: np.random.Generator) -> InitialRig:
    """Return the known rig with the scale of the people as the initial rig; no other arrangement is tried."""
    placed = [pose for name in start.rig.names if (pose := begin.rig[name].pose) is not None]
    R, centre = np.array([pose.R_cw for pose in placed]), np.array([pose.centre for pose in placed])
    state = rescaled(start, R, centre)
    blocks = draw_blocks(start.evidence, people_for_all(start.evidence, options.coarse_people, _COARSE_OF_CAMERA), rng)
    joints = np.sort(rng.permutation(start.evidence.n_joints)[: options.coarse_joints])
    model = build_problem(start.evidence, state, Noise(), start.knowledge, share=0.1, blocks=blocks, joints=joints)
    return InitialRig(state, "groups", len(model.rows) + len(model.joint_rows), (), [])


def rescaled(start: Initialisation, R: Floats, centre: Floats) -> RigState:
    """Return a first state with the scale that best fits people and cues."""
    knowledge = start.knowledge
    expected = knowledge.height_mean
    rows = settle_cues(knowledge.cues, R, centre, expected, expected, knowledge.height_sd)
    marks = triangulate_marks(rows, R, centre)
    sd = float(np.mean(knowledge.height_sd / knowledge.height_mean)) if len(knowledge.height_sd) else 0.05
    factor = initial_scale(rows, R, centre, marks, len(knowledge.height_sd), sd)
    ends = factor * without_gaps(rows, marks)
    state = RigState.start(R, centre * factor, knowledge.height_mean * factor, knowledge.priors, ends, start.lens)
    return state


def _differ(a: RigState, b: RigState) -> float:
    """Return the largest angle between corresponding rotations of two rigs after the best common rotation, radians."""
    return float(np.max(angle_between(a.R @ _common_turn(a, b), b.R)))


def _common_turn(a: RigState, b: RigState) -> Floats:
    """Return the rotation (3, 3) of the world that best aligns the orientations of one rig's cameras with the other's."""
    return chordal_mean_rotation(np.einsum("cji,cjk->cik", a.R, b.R))


def _leads_to(start: RigState, found: RigState) -> bool:
    """Return whether a rough rig is so near the end of a descent that a descent from it would end there, too."""
    if _differ(start, found) > _SAME_ANGLE:
        return False
    turn = _common_turn(start, found)
    a, b = ((one.centre - one.centre.mean(axis=0)) @ by for one, by in ((start, turn), (found, np.eye(3))))
    a, b = (one / max(float(np.sqrt((one**2).sum(axis=1).mean())), 1e-9) for one in (a, b))
    return bool(np.linalg.norm(a - b, axis=1).max() < _SAME_SHIFT)
