"""Every Jacobian of the person model against central differences."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Lens
from passerby.geometry.triangulation import PointObservations
from passerby.people.sightings import Sightings
from passerby.solver.cue_terms import CueRows
from passerby.solver.optimizer.least_squares import NormalEquations, Step
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 905.0, 360], [0, 0, 1]]), np.array([-0.1, 0.02, 0.001, -0.001, 0.0]))


def looking_at(centre, target):
    z = (target - centre) / np.linalg.norm(target - centre)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(5)
    n_cameras, _n_people, n_blocks, n_joints = 3, 2, 5, 4
    centre = np.array([[6.0, 0, 2.5], [-5, 3, 3.0], [0, -7, 2.0]])
    R = np.array([looking_at(c, np.array([0, 0, 1.0])) for c in centre])
    people = np.column_stack(
        [rng.uniform(-1.5, 1.5, (n_blocks, 2)), rng.normal(0, 0.05, n_blocks), rng.normal(1.7, 0.1, n_blocks)]
    )
    joints = rng.uniform([-1, -1, 0], [1, 1, 1.8], (n_joints, 3))
    points = rng.uniform([-1, -1, 0], [1, 1, 1.8], (6, 3))
    state = AdjustmentState(
        R,
        centre,
        rng.normal(0, 0.02, 3),
        np.array([0.12]),
        np.array([1.7, 1.8]),
        people,
        joints,
        lengths=points.reshape(-1, 6),
    )
    camera, block = (a.ravel() for a in np.meshgrid(np.arange(n_cameras), np.arange(n_blocks), indexing="ij"))

    def rays(world):
        d = np.einsum("mij,mj->mi", R[camera[: len(world)]], world - centre[camera[: len(world)]])
        px = LENS.project_rays(d) + rng.normal(0, 4, (len(world), 2))
        return LENS.bearings(px)

    top = rays(np.column_stack([people[block, :2], people[block, 3]]))
    bottom = rays(np.column_stack([people[block, :2], people[block, 2]]))
    n = len(camera)
    sightings = Sightings(
        camera, np.zeros(n, np.int64), block, block=block, top=top, bottom=bottom, top_tangent=LENS.tangents(top),
        bottom_tangent=LENS.tangents(bottom), extent_px=rng.uniform(150, 250, n), top_fraction=rng.uniform(0.9, 1, n),
        bottom_fraction=rng.uniform(0, 0.1, n), has_foot=(np.arange(n) % 2).astype(float),
    )  # fmt: skip

    def sight(world):
        c, p = (a.ravel() for a in np.meshgrid(np.arange(n_cameras), np.arange(len(world)), indexing="ij"))
        d = np.einsum("mij,mj->mi", R[c], world[p] - centre[c])
        b = LENS.bearings(LENS.project_rays(d) + rng.normal(0, 2, (len(c), 2)))
        return PointObservations(c, p, b, LENS.tangents(b), rng.uniform(1, 2, len(c)))

    cues = CueRows(
        sight(points),
        np.array([[1.2, 0.02], [0.8, 0.01], [0.8, 0.01]]),
        np.array([0, 1, 1]),
        np.array([[0, 1]]),
        np.array([[11.0, 0.1]]),
        np.array([2]),
        np.array([[2.1, 0.05]]),
    )
    return PeopleProblem(
        n_cameras,
        sightings,
        sight(joints),
        np.array([0, 0, 1, 1, 1]),
        n_joints,
        np.full(2, 1.72),
        np.full(2, 0.09),
        rng.uniform(0.2, 1, n_blocks),
        cues=cues,
    ), state


@pytest.fixture(scope="module")
def timed_case(case):
    """The same with clocks that may be wrong."""
    problem, state = case
    rng = np.random.default_rng(6)
    sightings = replace(problem.sightings, velocity=rng.normal(0, 60, (len(problem.sightings), 2)))
    joints = replace(problem.joints, velocity=rng.normal(0, 60, (len(problem.joints.camera), 2)))
    return replace(problem, sightings=sightings, joints=joints), replace(state, time=np.array([0.05, -0.1, 0.02]))


def unit_step(problem, level, index, size):
    layout = problem.layout
    step = Step(
        np.zeros(layout.n_shared), np.zeros(layout.n_groups), tuple(np.zeros((f.count, f.size)) for f in layout.families)
    )
    if level == "shared":
        step.shared[index] = size
    elif level == "group":
        step.groups[index] = size
    else:
        step.blocks[level][index] = size
    return step


def numerical(problem, state, level, index, term):
    h = 1e-6
    plus = problem.terms(problem.retract(state, unit_step(problem, level, index, h)), jacobians=False)[term].residual
    minus = problem.terms(problem.retract(state, unit_step(problem, level, index, -h)), jacobians=False)[term].residual
    return (plus - minus) / (2 * h)


def dense(problem, term, level, index):
    """The column of one unknown in a term's Jacobian (M, k)."""
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


@pytest.mark.parametrize(("which", "count"), [("case", 15), ("timed_case", 16)])
def test_every_jacobian_matches_central_differences(which, count, request):
    problem, state = request.getfixturevalue(which)
    terms = problem.terms(state, jacobians=True)
    assert len(terms) == count
    seen = np.zeros(len(terms), dtype=bool)
    for level, index in all_unknowns(problem):
        for number, term in enumerate(terms):
            expected = numerical(problem, state, level, index, number)
            seen[number] |= bool(np.abs(expected).max() > 1e-3)
            np.testing.assert_allclose(
                dense(problem, term, level, index),
                expected,
                rtol=2e-5,
                atol=2e-5,
                err_msg=f"term {number}, unknown {level} {index}",
            )
    assert seen.all(), "a term depends on nothing"


def test_reduced_step_solves_the_full_normal_equations(case):
    """The Schur complement over blocks and people gives the step of the full dense system."""
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
    H = J.T @ J
    damping = 1e-3
    full = -np.linalg.solve(H + damping * np.diag(np.diag(H)), J.T @ r)
    step = NormalEquations(problem.layout, terms).reduce(damping).solve(np.ones(problem.layout.n_shared, dtype=bool))
    flat = np.concatenate([step.shared, step.groups, *(b.ravel() for b in step.blocks)])
    np.testing.assert_allclose(flat, full, rtol=1e-6, atol=1e-9)
