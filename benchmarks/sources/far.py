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
FIRST_SEED = 2000
WRONG_S = 0.5
"""A start that is off by more was not found: the steps of the first search are as long."""
PER_MINUTE = (2.0, 6.0, 15.0)


@dataclass(frozen=True)
class FarCase:
    """One scene: three cameras, of which the second begins 20 minutes after the first, and the third 10."""

    seed: int
    identities_known: bool = False
    strangers: bool = False
    """Whether the third camera stands elsewhere: its start must stay unknown."""

    @property
    def kind(self) -> str:
        """What is different about it, in words."""
        return (
            "one camera elsewhere" if self.strangers else "identities known" if self.identities_known else "identities unknown"
        )

    @property
    def options(self) -> CrowdOptions:
        """Of the simulation; how many people come changes from seed to seed."""
        return CrowdOptions(
            self.seed, starts_s=(0.0, APART_S, 0.5 * APART_S), seconds=SECONDS,
            per_minute=PER_MINUTE[self.seed % len(PER_MINUTE)], identities_known=self.identities_known,
            strangers=(2,) if self.strangers else (),
        )  # fmt: skip


@dataclass(frozen=True)
class FarOutcome:
    """What became of the search."""

    case: FarCase
    errors_s: tuple[float | None, ...]
    """Of each camera's start against the first's; None where it stayed unknown."""
    far_s: float
    """Seconds of the processor for the search and the registration of all pairs,"""
    near_s: float
    """and for the same with starts known to 5 s, which is searched in full."""

    @property
    def wrong(self) -> bool:
        """Whether any start is stated that is not true."""
        rest = self.errors_s[2] if self.case.strangers else None
        return rest is not None or any(error is not None and abs(error) > WRONG_S for error in self.errors_s)

    @property
    def found(self) -> bool:
        """Whether all starts are found that can be."""
        least = self.errors_s[:2] if self.case.strangers else self.errors_s
        return not self.wrong and all(error is not None for error in least)


SCENES = 10
"""Of each kind."""


def cases() -> dict[str, FarCase]:
    """Scenes with unknown identities, with known ones, and with a camera that stands elsewhere, by key."""
    return {f"{case.kind} {case.seed}": case for case in drawn(SCENES)}


def measured(case: FarCase) -> dict[str, Any]:
    """What became of a scene: plain values."""
    found = work(case)
    return {
        "about": {"kind": case.kind}, "cpu_s": found.far_s + found.near_s, "found": found.found, "wrong": found.wrong,
        "errors_s": list(found.errors_s), "far_s": found.far_s, "near_s": found.near_s,
    }  # fmt: skip


def drawn(count: int) -> list[FarCase]:
    """So many scenes of each kind."""
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    return [
        *(FarCase(seed) for seed in seeds),
        *(FarCase(seed, identities_known=True) for seed in seeds),
        *(FarCase(seed, strangers=True) for seed in seeds),
    ]


def work(case: FarCase) -> FarOutcome:
    """Search one scene, by the tracks of its simulated people."""
    crowd = simulate_crowd(case.options)
    cameras = build_tracklets(
        crowd.rig, crowd.observations, crowd.observations.clocks, PERSON_HEIGHT_M, np.random.default_rng(0), given=True
    )
    began = time.process_time()
    starts = find_starts(cameras, SEARCHED_S, known=case.identities_known)
    errors: tuple[float | None, ...] = (None,) * len(cameras)
    try:
        found = associate_by_ground_tracks(cameras, Tracklets.of(cameras), SEARCHED_S, {}, starts=starts)
    except EvidenceError:
        pass
    else:
        assert found.graph is not None
        joined = found.graph.groups[0]
        off = found.offset_s - np.array(crowd.starts_s)
        errors = tuple(float(off[c] - off[joined[0]]) if c in joined else None for c in range(len(cameras)))
    far_s = time.process_time() - began
    near = [_later(camera, start) for camera, start in zip(cameras, crowd.starts_s, strict=True)]
    began = time.process_time()
    associate_by_ground_tracks(near, Tracklets.of(near), NEAR_S, {})
    return FarOutcome(case, errors, far_s, time.process_time() - began)


def _later(camera: CameraTracklets, start_s: float) -> CameraTracklets:
    assert camera.tracks is not None
    return replace(camera, tracks=replace(camera.tracks, step=camera.tracks.step + round(start_s / STEP_S)))
