"""Rigs of many cameras in zones: overlapping parts are solved separately, and joined by the cameras that they share.

An initial rig along a tree over a hundred cameras accumulates errors, and an adjustment from it may end in a wrong optimum.
Within a zone the paths are short. The zones only give the initial rig: the adjustment that follows is of all cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import EvidenceError
from passerby.common.parallel import side_by_side
from passerby.common.progress import silent
from passerby.core.cameras import Rig
from passerby.core.figures import SeamFigures, TreeFigures, ZoneFigures
from passerby.geometry.rotations import angle_between
from passerby.solver.adjustment_problem import PriorKnowledge
from passerby.solver.evidence import Evidence
from passerby.solver.initialisation import Initialisation, InitialRig, PeopleOptions, rescaled, select_initial_rig
from passerby.solver.pairs import shared_blocks
from passerby.solver.registrations import contradicted
from passerby.solver.uncertainty import RigCovariance

ZONE_CAMERAS = 30
"""Largest number of cameras of a zone, and of a rig that is solved as one."""
CORE_CAMERAS = 18
"""Largest number of cameras of a zone before cameras of its neighbours are added."""
IN_COMMON = 3
"""Number of cameras that neighbouring zones share, where they have any people in common."""


@dataclass(frozen=True, eq=False)
class Seam:
    """Two zones that share cameras, and their disagreement."""

    first: int
    second: int
    """Numbers of the zones."""
    cameras: tuple[int, ...]
    position_m: float
    """Largest distance between the two zones' positions of a common camera, after the zones were placed, metres."""
    orientation_deg: float


@dataclass(frozen=True, eq=False)
class ZonedRig:
    """An initial rig, joined from zones."""

    rig: InitialRig
    zones: tuple[tuple[int, ...], ...]
    """Cameras of each zone, ascending."""
    agreeing: tuple[int, ...]
    """Number of observations that agree with each zone."""
    seams: tuple[Seam, ...]

    def figures(self, rig: Rig) -> tuple[ZoneFigures, ...]:
        """Return the figures of the zones, with the camera names of `rig`."""
        return tuple(
            ZoneFigures(cameras=tuple(rig.names[c] for c in zone), agreeing=agreeing)
            for zone, agreeing in zip(self.zones, self.agreeing, strict=True)
        )


def cut_zones(shared: Ints) -> tuple[tuple[int, ...], ...]:
    """Divide a rig into overlapping zones.

    Args:
        shared: (C, C) number of sightings that each two cameras share; symmetric.

    Returns:
        The cameras of each zone, ascending: every camera is in one or more, no zone has more than `ZONE_CAMERAS`. Zones whose
        cameras share sightings have `IN_COMMON` cameras in common, as far as there is room.
    """
    weight = np.array(shared, dtype=np.float64)
    np.fill_diagonal(weight, 0.0)
    cores = _cores(weight)
    zones = [list(core) for core in cores]
    between = np.array([[weight[np.ix_(a, b)].sum() for b in cores] for a in cores])
    pairs = [(a, b) for a in range(len(cores)) for b in range(a + 1, len(cores)) if between[a, b] > 0]
    for a, b in sorted(pairs, key=lambda pair: -between[pair]):
        # Cameras of the larger zone are added to the smaller one.
        receiving, giving = (a, b) if len(zones[a]) <= len(zones[b]) else (b, a)
        while len(set(zones[receiving]) & set(zones[giving])) < IN_COMMON and len(zones[receiving]) < ZONE_CAMERAS:
            rest = [c for c in cores[giving] if c not in zones[receiving]]
            if not rest:
                break
            tie = weight[np.ix_(rest, zones[receiving])].sum(axis=1)
            if tie.max() <= 0:
                break
            zones[receiving].append(rest[int(np.argmax(tie))])
    return tuple(tuple(sorted(zone)) for zone in zones)


def _cores(weight: Floats) -> list[list[int]]:
    """Divide the cameras into disjoint parts.

    Each part starts at the camera with the fewest partners among the remaining ones. It grows by the camera that shares most
    with it.
    """
    left = np.ones(len(weight), bool)
    cores: list[list[int]] = []
    while left.any():
        degree = np.where(left, (weight[:, left] > 0).sum(axis=1), len(weight) + 1)
        core = [int(np.argmin(degree))]
        left[core[0]] = False
        while len(core) < CORE_CAMERAS:
            tie = np.where(left, weight[:, core].sum(axis=1), 0.0)
            if tie.max() <= 0:
                break
            core.append(int(np.argmax(tie)))
            left[core[-1]] = False
        cores.append(core)
    return _without_small(cores, weight)


def _without_small(cores: list[list[int]], weight: Floats) -> list[list[int]]:
    """Join parts with fewer than twice `IN_COMMON` cameras to the part that shares most with them and has room."""
    kept = sorted(cores, key=len)
    out: list[list[int]] = []
    while kept:
        core = kept.pop(0)
        others = [one for one in (*kept, *out) if len(one) + len(core) <= ZONE_CAMERAS - 2 * IN_COMMON]
        tie = [weight[np.ix_(core, one)].sum() for one in others]
        if len(core) < 2 * IN_COMMON and tie and max(tie) > 0:
            others[int(np.argmax(tie))].extend(core)
        else:
            out.append(core)
    return sorted(out, key=min)


def initial_rig_by_zones(
    start: Initialisation, options: PeopleOptions, rng: np.random.Generator, executor: Executor | None = None
) -> ZonedRig | None:
    """Compute a rough rig, joined from zones that are solved separately.

    Args:
        start: start of all cameras, which people connect.
        options: options of the solver.
        rng: drives the choice of evidence, zone by zone.
        executor: solves the zones in parallel; one after the other when None.

    Returns:
        None where a zone cannot be solved or connected with the others: then the rig has to be solved as one.
    """
    n = len(start.rig)
    zones = cut_zones(shared_blocks(start.evidence))
    jobs = [_Job(restricted(start, zone), options, one) for zone, one in zip(zones, rng.spawn(len(zones)), strict=True)]
    found = side_by_side(_solved, jobs, executor, silent, "zones")
    if any(one is None for one in found):
        return None
    rigs = [one for one in found if one is not None]
    placed = _placed(zones, rigs, n)
    if placed is None:
        return None
    R, centre, seams = placed
    lens = np.zeros_like(start.lens)
    for zone, one in zip(zones, rigs, strict=True):
        lens[list(zone)] = one.state.lens
    agreeing = sum(one.agreeing for one in rigs)
    state = replace(rescaled(start, R, centre), lens=lens)
    against = len(contradicted(start.hypotheses, state.R, state.centre))
    figures = (TreeFigures(tree="zones", agreeing=agreeing, contradicted=against),)
    ambiguous = [finding for one in rigs for finding in one.doubts][:1]
    of_zones = tuple(one.agreeing for one in rigs)
    return ZonedRig(InitialRig(state, "zones", agreeing, figures, ambiguous), zones, of_zones, seams)


def seams_of(zoned: ZonedRig, rig: Rig, covariance: RigCovariance, R: Floats) -> tuple[SeamFigures, ...]:
    """Return the figures of the seams: disagreement of the zones, and the sigma of their relative heading.

    Args:
        zoned: the zones.
        rig: names of the cameras.
        covariance: covariance of the adjusted rig.
        R: (C, 3, 3) orientations of the adjusted rig, world to camera.
    """
    out = []
    for seam in zoned.seams:
        sigma = _heading_sigma_deg(zoned.zones[seam.first], zoned.zones[seam.second], covariance, R)
        out.append(
            SeamFigures(
                zones=(seam.first + 1, seam.second + 1), cameras=tuple(rig.names[c] for c in seam.cameras),
                apart_m=seam.position_m, turned_deg=seam.orientation_deg, heading_sigma_deg=sigma,
            )
        )  # fmt: skip
    return tuple(out)


def _heading_sigma_deg(first: Sequence[int], second: Sequence[int], covariance: RigCovariance, R: Floats) -> float | None:
    """Return one sigma, degrees, of the relative heading of two zones without their common cameras; None where unknown."""
    common = set(first) & set(second)
    own = [[c for c in zone if c not in common] for zone in (first, second)]
    if not all(own) or not len(covariance.together) or set(covariance.free.cameras) & {*own[0], *own[1]}:
        return None
    along = np.zeros(len(covariance.together))
    for sign, zone in zip((1.0, -1.0), own, strict=True):
        for c in zone:
            # The component of a rotation vector (camera frame) along the vertical is the rotation about the vertical.
            along[6 * c + 3 : 6 * c + 6] = sign * R[c, :, 2] / len(zone)
    variance = float(along @ covariance.together @ along)
    return float(np.degrees(np.sqrt(max(variance, 0.0))))


@dataclass(frozen=True, eq=False)
class _Job:
    start: Initialisation
    options: PeopleOptions
    rng: np.random.Generator


def _solved(job: _Job) -> InitialRig | None:
    """Compute the rough rig of one zone; None where no arrangement fits."""
    try:
        return select_initial_rig(job.start, job.options, job.rng)
    except EvidenceError:
        return None


def restricted(start: Initialisation, cameras: Sequence[int]) -> Initialisation:
    """Return the start of some cameras only. Their scale is from people; other cues are used in the rig of all cameras only."""
    index = list(cameras)
    people, evidence = _evidence_of(start.evidence, index)
    knowledge = start.knowledge
    number = {camera: k for k, camera in enumerate(index)}
    groups = [tuple(number[c] for c in group if c in number) for group in knowledge.lens_groups]
    weight = knowledge.lens_weight
    own = PriorKnowledge(
        knowledge.height_mean[people], knowledge.height_sd[people], knowledge.priors, None,
        None if knowledge.lens_core is None else knowledge.lens_core[index], weight if weight.ndim == 0 else weight[index],
        knowledge.lens_normal, tuple(group for group in groups if len(group) > 1),
        lens_model=None if knowledge.lens_model is None else knowledge.lens_model.among(index),
    )  # fmt: skip
    hypotheses = [inside for h in start.hypotheses if (inside := h.among(index)) is not None]
    return Initialisation(
        _part(start.rig, index), evidence, [start.levels[c] for c in index], hypotheses, own, _part(start.stated, index),
        start.unknowns, start.lens[index],
    )  # fmt: skip


def _part(rig: Rig, cameras: Sequence[int]) -> Rig:
    return Rig(tuple(rig.cameras[c] for c in cameras))


def _evidence_of(evidence: Evidence, cameras: Sequence[int]) -> tuple[Ints, Evidence]:
    """Return the people (indices among all) that two or more of some cameras see at once, and these cameras' evidence."""
    number = np.full(evidence.n_cameras, -1)
    number[list(cameras)] = np.arange(len(cameras))
    s, o = evidence.sightings, evidence.joints
    rows, block, blocks = _kept(number[s.camera], s.block, len(evidence.person))
    sightings = replace(s.take(rows), camera=number[s.camera[rows]], block=block)
    rows, point, points = _kept(number[o.camera], o.point, evidence.n_joints)
    joints = replace(o.take(rows), camera=number[o.camera[rows]], point=point)
    people, person = np.unique(evidence.person[blocks], return_inverse=True)
    return people, Evidence(
        sightings, person.ravel(), evidence.frame[blocks], evidence.identities[people], joints, evidence.joint_kind[points],
        evidence.joint_person[points], evidence.joint_frame[points],
        len(cameras),
    )  # fmt: skip


def _kept(camera: Ints, block: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """Find the rows of kept cameras (number 0 or more) in blocks that two or more of them see.

    Returns the rows, the new numbers of their blocks, and the old numbers of these blocks.
    """
    inside = np.flatnonzero(camera >= 0)
    views = np.bincount(block[inside], minlength=count)
    rows = inside[views[block[inside]] >= 2]
    blocks, renumbered = np.unique(block[rows], return_inverse=True)
    return rows, renumbered.ravel(), blocks


def _placed(
    zones: Sequence[tuple[int, ...]], rigs: Sequence[InitialRig], n_cameras: int
) -> tuple[Floats, Floats, tuple[Seam, ...]] | None:
    """Join the zones in the frame of the one with the most agreeing observations.

    Zones are metric and upright, each by its own people: a rotation about the vertical and a shift align one with another.

    Returns rotations (C, 3, 3), centres (C, 3) and the seams; None where a zone shares no camera with the others.
    """
    R, centre = np.zeros((n_cameras, 3, 3)), np.zeros((n_cameras, 3))
    known = np.zeros(n_cameras, bool)
    own: list[tuple[Floats, Floats]] = [(rig.state.R, rig.state.centre) for rig in rigs]
    waiting = set(range(len(zones)))
    while waiting:
        # The zone that shares most cameras with those already placed; at first the one with the most agreeing observations.
        best = max(sorted(waiting), key=lambda k: (int(known[list(zones[k])].sum()), rigs[k].agreeing))
        waiting.remove(best)
        members = np.array(zones[best])
        common = known[members]
        if known.any():
            if not common.any():
                return None
            own[best] = _moved(*own[best], R[members[common]], centre[members[common]], common)
        fresh = members[~common]
        R[fresh], centre[fresh] = own[best][0][~common], own[best][1][~common]
        known[members] = True
    if not known.all():
        return None
    seams = [seam for a in range(len(zones)) for b in range(a + 1, len(zones)) if (seam := _seam(a, b, zones, own)) is not None]
    return R, centre, tuple(seams)


def _moved(R: Floats, centre: Floats, to_R: Floats, to_centre: Floats, common: Floats) -> tuple[Floats, Floats]:
    """Rotate a zone about the vertical and shift it along the ground so that its `common` cameras fit the given poses."""
    turns = np.asarray(to_R.transpose(0, 2, 1) @ R[common])
    angle = np.arctan2((turns[:, 1, 0] - turns[:, 0, 1]).sum(), (turns[:, 0, 0] + turns[:, 1, 1]).sum())
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    shift = (to_centre - centre[common] @ turn.T).mean(axis=0) * [1.0, 1.0, 0.0]
    return R @ turn.T, centre @ turn.T + shift


def _seam(a: int, b: int, zones: Sequence[tuple[int, ...]], own: Sequence[tuple[Floats, Floats]]) -> Seam | None:
    """Return the seam of two zones with their disagreement; None where they have no camera in common."""
    common, in_a, in_b = np.intersect1d(zones[a], zones[b], return_indices=True)
    if not len(common):
        return None
    apart = np.linalg.norm(own[a][1][in_a] - own[b][1][in_b], axis=1)
    turned = np.degrees(angle_between(own[a][0][in_a], own[b][0][in_b]))
    return Seam(a, b, tuple(common.tolist()), float(np.max(apart)), float(np.max(turned)))
