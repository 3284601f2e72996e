"""Recordings that begin 20 minutes apart, without wall clocks: their starts found or refused, on simulated passing crowds."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.clocks.starts import find_starts
from passerby.association.initial_association import associate_by_ground_tracks
from passerby.association.sampling import STEP_S
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import EvidenceError
from passerby.core.figures import adjusted
from passerby.core.observations import Boxes
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.simulation.passing_crowd import CrowdOptions, PassingCrowd, simulate_crowd

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


@dataclass(frozen=True)
class FarCalibration:
    """A whole calibration with far starts, and the same recordings with starts that are known."""

    verdicts: tuple[str, str]
    largest_offset_error_s: float
    seconds: tuple[float, float]


@dataclass(frozen=True)
class Row:
    """A row of the page of sources."""

    name: str
    case: str
    figure: str
    acceptable: str
    aim: str


def cases(count: int = 10) -> list[FarCase]:
    """Scenes with unknown identities, with known ones, and with a camera that stands elsewhere."""
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


def whole(case: FarCase) -> FarCalibration:
    """The calibration of a scene from its boxes on, far and near."""
    crowd = simulate_crowd(case.options)
    verdicts, seconds, error = [], [], float("nan")
    for near in (False, True):
        boxes = {name: _counted(crowd, name, near) for name in crowd.rig.names}
        began = time.process_time()
        association = {"mode": "combined", "max_offset_s": NEAR_S if near else SEARCHED_S}
        found = calibrate_observations(crowd.rig, fps=case.options.fps, association=association, boxes=boxes)
        seconds.append(time.process_time() - began)
        verdicts.append(found.verdict)
        if not near and found.association is not None and found.verdict != "refused":
            assert adjusted(found.figures)
            offsets = [found.association.clocks[name].offset_s for name in crowd.rig.names]
            off = np.array(offsets) - np.array(crowd.starts_s)
            error = float(np.abs(off - off[0]).max())
    return FarCalibration((verdicts[0], verdicts[1]), error, (seconds[0], seconds[1]))


def _counted(crowd: PassingCrowd, name: str, near: bool) -> Boxes:
    """A camera's boxes, in frames of its own or, near, of the first camera."""
    boxes = crowd.observations[name].boxes
    later = crowd.starts_s[crowd.rig.names.index(name)] if near else 0.0
    return replace(boxes, frame=boxes.frame + round(later * crowd.observations.clocks[name].fps))


def rows(outcomes: Sequence[FarOutcome], calibration: FarCalibration | None = None) -> list[Row]:
    """The rows of the page."""
    kinds = {
        "identities unknown": [one for one in outcomes if not one.case.identities_known and not one.case.strangers],
        "identities known": [one for one in outcomes if one.case.identities_known],
        "one camera sees other people": [one for one in outcomes if one.case.strangers],
    }
    out = []
    for kind, some in kinds.items():
        found, wrong = sum(one.found for one in some), sum(one.wrong for one in some)
        out.append(
            Row(
                "starts 20 minutes apart", f"{kind}: found (wrong)", f"{found} of {len(some)} ({wrong})",
                f"{len(some)} or refused (0)", f"{len(some)} (0)",
            )
        )  # fmt: skip
    first = kinds["identities unknown"]
    ratio = sum(one.far_s for one in first) / max(sum(one.near_s for one in first), 1e-9)
    out.append(
        Row("starts 20 minutes apart", "time of search and registration, against ±5 s", f"{ratio:.2f} x", "3 x", "1.5 x")
    )
    if calibration is not None:
        far, near = calibration.seconds
        out.append(Row("starts 20 minutes apart", "time of a calibration, against ±5 s", f"{far / near:.2f} x", "3 x", "1.5 x"))
        error = 1000 * calibration.largest_offset_error_s
        out.append(Row("starts 20 minutes apart", "largest error of an offset", f"{error:.0f} ms", "", ""))
    return out
