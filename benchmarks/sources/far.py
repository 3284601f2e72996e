"""Recordings that begin 20 minutes apart, without wall clocks: their starts found or refused, on simulated passing crowds."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.clocks.starts import find_starts
from passerby.association.initial_association import associate_by_ground_tracks
from passerby.association.sampling import STEP_S
from passerby.common.errors import EvidenceError
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.simulation.passing_crowd import CrowdOptions, simulate_crowd

SECONDS, APART_S = 2400.0, 1200.0
SEARCHED_S, NEAR_S = 1800.0, 5.0
FIRST_SEED, SCENES = 2000, 10  # of each kind
WRONG_S = 0.5  # a start that is off by more was not found: the steps of the first search are as long
PER_MINUTE = (2.0, 6.0, 15.0)
UNKNOWN, KNOWN, ELSEWHERE = "identities unknown", "identities known", "one camera elsewhere"


@dataclass(frozen=True)
class FarCase:
    """One scene: three cameras, of which the second begins 20 minutes after the first, and the third 10.

    Of the kind `ELSEWHERE` the third camera sees other people: its start must stay unknown.
    """

    kind: str
    seed: int

    @property
    def options(self) -> CrowdOptions:
        """Of the simulation; how many people come changes from seed to seed."""
        return CrowdOptions(
            self.seed, starts_s=(0.0, APART_S, 0.5 * APART_S), seconds=SECONDS,
            per_minute=PER_MINUTE[self.seed % len(PER_MINUTE)], identities_known=self.kind == KNOWN,
            strangers=(2,) if self.kind == ELSEWHERE else (),
        )  # fmt: skip


def cases() -> dict[str, FarCase]:
    """Scenes of each kind by key."""
    seeds = range(FIRST_SEED, FIRST_SEED + SCENES)
    return {f"{kind} {seed}": FarCase(kind, seed) for kind in (UNKNOWN, KNOWN, ELSEWHERE) for seed in seeds}


def work(case: FarCase) -> dict[str, Any]:
    """Search one scene, by the tracks of its simulated people: plain values.

    `errors_s` of each camera's start against the first's, None where it stayed unknown; `far_s`, processor time of the search
    and of the registration of all pairs, and `near_s`, of the same with starts known to 5 s, which is searched in full.
    """
    crowd = simulate_crowd(case.options)
    cameras = build_tracklets(
        crowd.rig, crowd.observations, crowd.observations.clocks, PERSON_HEIGHT_M, np.random.default_rng(0), given=True
    )
    began = time.process_time()
    starts = find_starts(cameras, SEARCHED_S, known=case.kind == KNOWN)
    errors: list[float | None] = [None] * len(cameras)
    try:
        found = associate_by_ground_tracks(cameras, Tracklets.of(cameras), SEARCHED_S, {}, starts=starts)
    except EvidenceError:
        pass
    else:
        assert found.graph is not None
        joined = found.graph.groups[0]
        off = found.offset_s - np.array(crowd.starts_s)
        errors = [float(off[c] - off[joined[0]]) if c in joined else None for c in range(len(cameras))]
    far_s = time.process_time() - began
    near = [_later(camera, start) for camera, start in zip(cameras, crowd.starts_s, strict=True)]
    began = time.process_time()
    associate_by_ground_tracks(near, Tracklets.of(near), NEAR_S, {})
    near_s = time.process_time() - began
    wanted, rest = (errors[:2], errors[2]) if case.kind == ELSEWHERE else (errors, None)
    wrong = rest is not None or any(error is not None and abs(error) > WRONG_S for error in errors)
    return {
        "about": {"kind": case.kind}, "cpu_s": far_s + near_s, "found": not wrong and None not in wanted, "wrong": wrong,
        "errors_s": errors, "far_s": far_s, "near_s": near_s,
    }  # fmt: skip


def _later(camera: CameraTracklets, start_s: float) -> CameraTracklets:
    assert camera.tracks is not None
    return replace(camera, tracks=replace(camera.tracks, step=camera.tracks.step + round(start_s / STEP_S)))
