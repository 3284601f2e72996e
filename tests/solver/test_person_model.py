"""Every Jacobian of the person model against central differences."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.symmetric import inverse_of
from passerby.core.cameras import Camera, Lens, Rig
from passerby.geometry.triangulation import PointObservations
from passerby.people.sightings import Sightings
from passerby.solver.cue_terms import CueRows
from passerby.solver.lens_sigmas import lens_places
from passerby.solver.lens_unknowns import LENS_PARTS, LensModel, LensUnknowns
from passerby.solver.optimizer.least_squares import NormalEquations, Step, Stopping, minimise
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from support.scenes.people_and_rigs import LENS, looking_at

BOTH, NAMES = LensUnknowns(("focal", "principal_point")), "ABC"
STATED = Rig(tuple(Camera(name, LENS) for name in NAMES))
POSES = [looking_at(centre, (0, 0, 1)) for centre in ((6.0, 0, 2.5), (-5, 3, 3.0), (0, -7, 2.0))]
R, CENTRE = np.array([pose.R_cw for pose in POSES]), np.array([pose.centre for pose in POSES])


@pytest.fixture(scope="module")
def case():
    """Three cameras, two people at five places, four joints, the ends of a length that is marked, and cues."""
    rng, n_blocks = np.random.default_rng(5), 5
    people = np.column_stack(
        [rng.uniform(-1.5, 1.5, (n_blocks, 2)), rng.normal(0, 0.05, n_blocks), rng.normal(1.7, 0.1, n_blocks)]
    )
    joints, points = (rng.uniform([-1, -1, 0], [1, 1, 1.8], (count, 3)) for count in (4, 6))
    slack, heights = rng.normal(0, 0.02, 3), np.array([1.7, 1.8])
    state = AdjustmentState(R, CENTRE, slack, np.array([0.12]), heights, people, joints, lengths=points.reshape(-1, 6))

    def rays(camera, world, noise_px):
        d = np.einsum("mij,mj->mi", R[camera], world - CENTRE[camera])
        return LENS.bearings(LENS.project_rays(d) + rng.normal(0, noise_px, (len(world), 2)))

    def each(count):
        return (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(count), indexing="ij"))

    camera, block = each(n_blocks)
    top, bottom = (rays(camera, people[block][:, [0, 1, end]], 4) for end in (3, 2))
    n = len(camera)
    sightings = Sightings(
        camera, np.zeros(n, np.int64), block, block=block, top=top, bottom=bottom, top_tangent=LENS.tangents(top),
        bottom_tangent=LENS.tangents(bottom), extent_px=rng.uniform(150, 250, n), top_fraction=rng.uniform(0.9, 1, n),
        bottom_fraction=rng.uniform(0, 0.1, n), has_foot=(np.arange(n) % 2).astype(float),
    )  # fmt: skip

    def sight(world):
        c, p = each(len(world))
        bearing = rays(c, world[p], 2)
        return PointObservations(c, p, bearing, LENS.tangents(bearing), rng.uniform(1, 2, len(c)))

    cues = CueRows(
        sight(points), np.array([[1.2, 0.02], [0.8, 0.01], [0.8, 0.01]]), np.array([0, 1, 1]), np.array([[0, 1]]),
        np.array([[11.0, 0.1]]), np.array([2]), np.array([[2.1, 0.05]]),
    )  # fmt: skip
    return PeopleProblem(
        3, sightings, sight(joints), np.array([0, 0, 1, 1, 1]), len(joints), np.full(2, 1.72), np.full(2, 0.09),
        rng.uniform(0.2, 1, n_blocks), cues=cues,
    ), state  # fmt: skip


@pytest.fixture(scope="module")
def timed_case(case):
    """The same with clocks that may be wrong."""
    problem, state = case
    rng = np.random.default_rng(6)
    sightings = replace(problem.sightings, velocity=rng.normal(0, 60, (len(problem.sightings), 2)))
    joints = replace(problem.joints, velocity=rng.normal(0, 60, (len(problem.joints.camera), 2)))
    return replace(problem, sightings=sightings, joints=joints), replace(state, time=np.array([0.05, -0.1, 0.02]))


def with_lenses(problem, change, **rest):
    """The rays of lenses that are changed by this (C, 3)."""
    sightings, joints = BOTH.sightings(problem.sightings, STATED, change), BOTH.points(problem.joints, STATED, change)
    return replace(problem, sightings=sightings, joints=joints, lens_model=LensModel(BOTH, STATED), **rest)


@pytest.fixture(scope="module")
def lens_case(case):
    """The same without cues, and with lenses between those of the rays and those stated."""
    problem, state = case
    rng = np.random.default_rng(3)
    lens = np.column_stack([[0.03, -0.02, 0.01], rng.normal(0, 5, (3, 2))])
    core = {"lens_core": BOTH.core(STATED), "lens_weight": rng.uniform(1, 5, (3, 3))}
    return with_lenses(replace(problem, cues=None), np.zeros((3, 3)), **core), replace(
        state, lens=lens, lengths=np.zeros((0, 6))
    )


def unit_step(problem, level, index, size):
    layout = problem.layout
    blocks = tuple(np.zeros((family.count, family.size)) for family in layout.families)
    step = Step(np.zeros(layout.n_shared), np.zeros(layout.n_groups), blocks)
    {"shared": step.shared, "group": step.groups}.get(level, blocks[level] if isinstance(level, int) else None)[index] = size
    return step


def numerical(problem, state, level, index):
    """The column of one unknown in each term's Jacobian (M, k)."""
    plus, minus = (
        problem.terms(problem.retract(state, unit_step(problem, level, index, h)), jacobians=False) for h in (1e-6, -1e-6)
    )
    return [(one.residual - other.residual) / 2e-6 for one, other in zip(plus, minus, strict=True)]


def dense(problem, term, level, index):
    """The same by the term itself."""
    layout = problem.layout
    out = np.zeros_like(term.residual)
    first = layout.n_cameras * layout.camera_size
    if level == "shared":
        if term.by_shared is not None:
            out += term.by_shared[:, :, index]
        if index < first and term.by_camera is not None:
            rows = term.camera == index // layout.camera_size
            out[rows] += term.by_camera[rows][:, :, index % layout.camera_size]
        if index >= first and term.by_globals is not None:
            out += term.by_globals[:, :, index - first]
    elif level == "group" and term.by_group is not None:
        rows = term.group == index
        out[rows] += term.by_group[rows]
    elif isinstance(level, int) and term.by_block is not None and term.family == level:
        rows = term.block == index[0]
        out[rows] += term.by_block[rows][:, :, index[1]]
    return out


def all_unknowns(problem):
    layout = problem.layout
    yield from (("shared", i) for i in range(layout.n_shared))
    yield from (("group", i) for i in range(layout.n_groups))
    for f, family in enumerate(layout.families):
        yield from ((f, (i, j)) for i in range(family.count) for j in range(family.size))


@pytest.mark.parametrize(("which", "count"), [("case", 15), ("timed_case", 16), ("lens_case", 12)])
def test_every_jacobian_matches_central_differences(which, count, request):
    problem, state = request.getfixturevalue(which)
    terms = problem.terms(state, jacobians=True)
    assert len(terms) == count
    seen = np.zeros(len(terms), dtype=bool)
    for level, index in all_unknowns(problem):
        for number, (term, expected) in enumerate(zip(terms, numerical(problem, state, level, index), strict=True)):
            seen[number] |= bool(np.abs(expected).max() > 1e-3)
            said = f"term {number}, unknown {level} {index}"
            np.testing.assert_allclose(dense(problem, term, level, index), expected, rtol=2e-5, atol=2e-5, err_msg=said)
    assert seen.all(), "a term depends on nothing"


def test_residuals_follow_a_lens_exactly_however_large_they_are(lens_case):
    """As those of rays that are made anew with it."""
    problem, state = lens_case
    change = 0.02 * np.array([[1.0, 100.0, -200.0], [-1.0, 50.0, 100.0], [0.5, -100.0, 0.0]])
    here, anew = (one.terms(replace(state, lens=change), jacobians=False) for one in (problem, with_lenses(problem, change)))
    for one, exact in zip(here, anew, strict=True):
        np.testing.assert_allclose(one.residual, exact.residual, atol=1e-6)


def test_the_noise_of_joints_moves_no_lens():
    """With 2 px of noise the optimum is off by its own sigmas. Residuals linear around noisy rays bias focal lengths."""
    rng, n, every = np.random.default_rng(5), 4000, LensUnknowns(LENS_PARTS)
    wide = Lens((1280, 720), np.array([[600.0, 0, 640], [0, 600.0, 360], [0, 0, 1]]), np.zeros(4))
    stated = Rig(tuple(Camera(name, wide) for name in NAMES))
    world = np.column_stack([rng.uniform(-3, 3, (n, 2)), rng.uniform(0, 2, n)])
    camera, point = (grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(n), indexing="ij"))
    d = np.einsum("mij,mj->mi", R[camera], world[point] - CENTRE[camera])
    bearing = wide.bearings(wide.project_rays(d) + 2 * rng.standard_normal((len(d), 2)))
    joints = PointObservations(camera, point, bearing, wide.tangents(bearing), np.full(len(d), 2.0))
    joints = every.points(joints, stated, np.zeros((3, every.size)))
    unseen = Sightings(*(np.zeros(0, np.int64) for _ in range(3)))
    problem = PeopleProblem(
        3, unseen, joints, np.zeros(0, np.int64), n, np.ones(0), np.ones(0), np.zeros(0), lens_normal=True,
        lens_core=np.tile([0.3, 25.0, 25.0, 0.3], (3, 1)), lens_model=LensModel(every, stated),
    )  # fmt: skip
    lens = np.zeros((3, every.size))
    state = AdjustmentState(R, CENTRE, np.zeros(3), np.array([0.08]), np.zeros(0), np.zeros((0, 4)), world, lens=lens)
    result = minimise(problem, state, Stopping(60, 1e-9))
    sigma = np.sqrt(np.diag(inverse_of(result.normal.reduce().H))[lens_places(3, problem.layout.camera_size, every.size)])
    assert np.abs(result.state.lens / sigma).max() < 3
    assert np.abs(result.state.lens[:, 0]).max() < 0.02
    linear = minimise(replace(problem, lens_model=None), state, Stopping(60, 1e-9)).state.lens
    assert np.abs(linear[:, 0]).max() > 0.05


def test_reduced_step_solves_the_full_normal_equations(case):
    problem, state = case
    terms = problem.terms(state, jacobians=True)
    unknowns = list(all_unknowns(problem))
    rows, rhs = [], []
    for term in terms:
        squared = np.sum(term.residual**2, axis=1)
        root = np.sqrt(term.loss.weight(squared)) if term.loss else np.ones(len(squared))
        rows.append(np.stack([(dense(problem, term, *u) * root[:, None]).ravel() for u in unknowns], axis=1))
        rhs.append((term.residual * root[:, None]).ravel())
    J, r = np.concatenate(rows), np.concatenate(rhs)
    H, damping = J.T @ J, 1e-3
    full = -np.linalg.solve(H + damping * np.diag(np.diag(H)), J.T @ r)
    step = NormalEquations(problem.layout, terms).reduce(damping).solve(np.ones(problem.layout.n_shared, dtype=bool))
    flat = np.concatenate([step.shared, step.groups, *(b.ravel() for b in step.blocks)])
    np.testing.assert_allclose(flat, full, rtol=1e-6, atol=1e-9)
