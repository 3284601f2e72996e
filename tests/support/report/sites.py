"""Contents of a site: halls of four cameras each, people who walk in them, and what a calibration would tell of it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from passerby.core.cameras import Camera, PoseSigma, Rig
from passerby.core.observations import Clock, Observations
from passerby.report.contents import Contents
from support.report.pages import calibration_tables, diagnosed, document_of
from support.scenes.people_and_rigs import LENS, looking_at, observe

HALL_M, STREET_M = (20.0, 14.0), 8.0
CORNERS = 4
FPS = 2.0
PEOPLE, HEIGHT_M = 3, 1.72
"""In each hall."""


def site(cameras, seconds=20.0, seed=0, problems=(), lost=(), stated=None, groups=None):
    """Contents of so many cameras, four in the corners of each hall; neighbouring halls share only people who walk over.

    Args:
        cameras: how many.
        seconds: of the recording.
        seed: of where people walk.
        problems: findings.
        lost: names of cameras without a pose.
        stated: groups of cameras that the scene file states.
        groups: entries of further groups.
    """
    rng, rig = np.random.default_rng(seed), _rig(cameras)
    frames = np.arange(1, round(seconds * FPS) + 1)
    halls = -(-cameras // CORNERS)
    ground, frame, identity = [], [], []
    for who in range(1, PEOPLE * halls + 1):
        walk = _walk(rng, _corner((who - 1) // PEOPLE, halls), len(frames))
        ground.append(walk)
        frame.append(frames)
        identity.append(np.full(len(frames), who))
    at, when, who = np.concatenate(ground), np.concatenate(frame), np.concatenate(identity)
    seen = {}
    for camera in rig:
        near = np.linalg.norm(at - camera.centre[:2], axis=1) < 1.2 * HALL_M[0]
        heights = np.full(np.count_nonzero(near), HEIGHT_M)
        seen |= observe(Rig((camera,)), at[near], heights, when[near], who[near])
    rig = Rig(tuple(replace(one, pose=None, sigma=None) if one.name in lost else one for one in rig), "accepted")
    clocks = {name: Clock(FPS) for name in rig.names}
    pairs = [(a, b, 300 - place % 200) for place, (a, b) in enumerate(pairwise(rig.posed().names))]
    heights = dict.fromkeys(range(1, PEOPLE * halls + 1), HEIGHT_M)
    tables = calibration_tables("site", rig, seen, FPS, pairs, heights) | diagnosed(*problems)
    if stated is not None:
        tables["scene"]["sites"] = {"groups": stated}
    if groups is not None:
        tables["groups"] = groups
    return Contents(document_of(tables), rig, Observations(seen, FPS, clocks), clocks, {})


def _corner(hall, halls):
    """(2,) the lowest x and y of a hall."""
    columns = max(1, round((halls * HALL_M[1] / HALL_M[0]) ** 0.5))
    return np.array([hall % columns, hall // columns]) * (np.array(HALL_M) + STREET_M)


def _rig(cameras):
    found, covariance = [], np.diag([0.01, 0.01, 0.01, 1e-5, 1e-5, 1e-5])
    halls = -(-cameras // CORNERS)
    for number in range(cameras):
        low = _corner(number // CORNERS, halls)
        side = np.array([number % 2, number // 2 % 2])
        centre, middle = low + side * HALL_M, low + 0.5 * np.array(HALL_M)
        pose = looking_at((*centre, 3.0), (*middle, 0.5))
        found.append(Camera(f"cam-{number + 1:03d}", LENS, pose, PoseSigma(0.17, 0.3, covariance)))
    return Rig(tuple(found))


def _walk(rng, low, count):
    """(count, 2) places of somebody who walks to and fro in a hall."""
    ends = low + rng.uniform(0.15, 0.85, (2, 2)) * HALL_M
    share = 0.5 + 0.5 * np.sin(np.linspace(0, rng.uniform(2, 6), count) + rng.uniform(0, 6))
    return ends[0] + share[:, None] * (ends[1] - ends[0])
