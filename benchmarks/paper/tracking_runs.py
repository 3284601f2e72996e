"""Following people, scene by scene: simulated and real ones, by estimated and by true cameras, against the truth."""

from __future__ import annotations

import os
import tempfile
import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w

from pages.kept import Kept
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.errors import PasserbyError
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.core.trajectories import Trajectories
from passerby.evaluation.trajectories import GroundTruth, judge, placements
from passerby.geometry.rotations import Similarity
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.trajectories_csv import read_ground_positions
from passerby.people.trajectories.trajectories import METHODS, Method, TrackOptions, trajectories
from passerby.scene.scene import Scene
from passerby.simulation import SimulationOptions, simulate, write_scene

BOX_NOISE = 0.02
FAILED = float("inf")
CAMERAS = ("similarity", "metric", "true")
"""Estimated cameras placed by a similarity, and by the reference camera; and the true ones."""
IDENTITIES = ("given", "found")
TRACKLET_S = 20.0
"""Mean length of the pieces that identities are found from."""
TAPE_SD_M = 0.02
TRUTH_FILE = "ground_positions.csv"


@dataclass(frozen=True)
class Case:
    """One scene."""

    preset: str
    seed: int
    identities: str
    tape: bool = False
    """Whether the distance between two cameras is known."""

    @property
    def options(self) -> SimulationOptions:
        """The scene: identities that are to be found are those of tracklets, with looks that tell people apart."""
        usual = SimulationOptions(preset=self.preset, seed=self.seed, box_noise=BOX_NOISE)
        if self.identities == "given":
            return usual
        return replace(usual, unrelated_ids=True, tracklet_seconds=TRACKLET_S, embeddings="distinct")


@dataclass(frozen=True)
class Outcome:
    """What became of a case."""

    verdict: str
    scale_error: float
    """|estimated length / true length - 1|; infinite where undefined."""
    mean_m: dict[str, float]
    """`METHOD CAMERAS` -> mean distance to the truth; infinite where there is no way."""
    covered: float
    """Share of the true places that have one found by the smoothed method and the estimated cameras."""
    sigma_share: float
    """Share of its places that lie within their sigma, by the true cameras."""
    one_camera_m: float
    """Mean distance of its places seen by one camera, by the true cameras; infinite where there is none."""


@dataclass(frozen=True)
class Job:
    """A case, and where outcomes are kept."""

    case: Case
    kept: Path | None


def run_case(job: Job) -> Outcome:
    """The outcome of one case; what was kept is not worked out again."""
    kept = Kept(job.kept)
    known = kept.get(f"tracking {job.case!r}")
    if known is not None:
        return Outcome(**known)
    outcome = outcome_of(job.case)
    kept.put(f"tracking {job.case!r}", asdict(outcome))
    return outcome


def outcome_of(case: Case) -> Outcome:
    """Simulate, calibrate as `passerby calibrate` does, follow people, compare."""
    simulated = simulate(case.options)
    with tempfile.TemporaryDirectory(prefix="passerby-tracking-") as folder:
        path = write_scene(simulated, Path(folder) / "scene")
        if case.tape:
            _measure(path, simulated.rig)
        calibration = calibrate(Scene.load(path))
    people = np.broadcast_to(simulated.identities, simulated.ground_positions.shape[:2])
    frames = np.broadcast_to(simulated.frames[:, None], people.shape)
    there = np.isfinite(simulated.ground_positions[:, :, 0])
    fps = case.options.fps
    truth = GroundTruth.of(people[there], Clock(fps).seconds(frames[there]), simulated.ground_positions[there])
    return _compared(calibration, simulated.rig, truth, fps, same_ids=case.identities == "given")


def _measure(scene: Path, rig: Rig) -> None:
    """Add to a scene file what a tape says of the way from the first camera to the third, which stands opposite."""
    first, other = rig.names[0], rig.names[2]
    content = tomllib.loads(scene.read_text(encoding="utf-8"))
    metres = float(np.linalg.norm(rig[first].centre - rig[other].centre))
    content["scale"]["distances"] = [{"between": [first, other], "metres": metres, "sd_m": TAPE_SD_M}]
    scene.write_text(tomli_w.dumps(content), encoding="utf-8")


def _compared(calibration: Calibration, true_rig: Rig, truth: GroundTruth, fps: float, *, same_ids: bool) -> Outcome:
    """The figures of a calibrated scene."""
    by_name, scale, found = _ways(calibration, true_rig, fps)
    means = {f"{method} {cameras}": FAILED for method in METHODS for cameras in CAMERAS}
    covered, sigma_share, one_camera = 0.0, 0.0, FAILED
    for (method, cameras), way in found.items():
        judged = judge(way, truth, by_name[cameras], same_ids=same_ids)
        means[f"{method} {cameras}"] = _defined(judged.distances.mean_m)
        if (method, cameras) == ("smoothed", "similarity"):
            covered = judged.covered or 0.0
        if (method, cameras) == ("smoothed", "true"):
            sigma_share = judged.distances.within_sigma or 0.0
            one_camera = _defined(judged.by_cameras["one"].mean_m)
    return Outcome(calibration.verdict, scale, means, covered, sigma_share, one_camera)


def _ways(
    calibration: Calibration, true_rig: Rig, fps: float
) -> tuple[dict[str, Similarity | None], float, dict[tuple[Method, str], Trajectories]]:
    """How each world is placed, the scale's error, and the ways by method and cameras; no way where there are no poses."""
    posed = calibration.rig.posed()
    motions: dict[str, Similarity | None] = {"true": None}
    if len(posed):
        motions |= placements(posed, true_rig)
    similarity = motions.get("similarity")
    scale = abs(1 / similarity.scale - 1) if similarity else FAILED
    clocks = dict(calibration.association.clocks) if calibration.association else {}
    found: dict[tuple[Method, str], Trajectories] = {}
    for method in METHODS:
        for rig, places in ((posed, ("similarity", "metric")), (true_rig, ("true",))):
            try:
                way = trajectories(
                    rig, calibration.observations, clocks or {name: Clock(fps) for name in rig.names}, TrackOptions(method)
                )
            except PasserbyError:
                continue  # stays a failure in every table
            found |= {(method, place): way for place in places if place in motions}
    return motions, scale, found


def _defined(value: float | None) -> float:
    return FAILED if value is None else value


@dataclass(frozen=True)
class RealSet:
    """A real data set."""

    name: str
    fps: float
    folder: Path | None


@dataclass(frozen=True)
class RealOutcome:
    """What became of it."""

    name: str
    why: str
    """Why it was not run; empty where it was."""
    outcome: Outcome | None = None
    disagreement_m: float | None = None


def data_folder(data: Path | None, name: str) -> Path | None:
    """The set's folder: in the one given, in `$PASSERBY_DATA`, or in ../shared/data beside the working folder."""
    places = [data, Path(os.environ["PASSERBY_DATA"]) if os.environ.get("PASSERBY_DATA") else None, Path("../shared/data")]
    return next((place / name for place in places if place and (place / name / "rig.toml").is_file()), None)


def run_set(job: RealSet) -> RealOutcome:
    """Calibrate a real set from its boxes with true identities, and follow people."""
    if job.folder is None or not (job.folder / "identities").is_dir():
        return RealOutcome(job.name, "no data at hand")
    true_rig = read_rig(job.folder / "rig.toml")
    content = {
        "scene": {"name": job.name, "fps": job.fps},
        "cameras": {
            name: {
                "intrinsics": str((job.folder / "rig.toml").resolve()),
                "tracks": str((job.folder / "identities" / f"{name}.txt").resolve()),
            }
            for name in true_rig.names
        },
        "association": {"mode": "given"},
    }
    calibration = calibrate(Scene.model_validate(content))
    seen = Observations({n: CameraObservations(read_boxes(job.folder / "identities" / f"{n}.txt")) for n in true_rig.names})
    if not len(calibration.rig.posed()):
        return RealOutcome(job.name, f"calibration {calibration.verdict}: {'; '.join(calibration.reasons)}")
    own = trajectories(calibration.rig, seen, {name: Clock(job.fps) for name in true_rig.names})
    disagreement = own.figures["disagreement_m"]
    if not (job.folder / TRUTH_FILE).is_file():
        return RealOutcome(job.name, "no true positions in its folder", None, disagreement)
    places = read_ground_positions(job.folder / TRUTH_FILE)
    truth = GroundTruth.of(places.identity, Clock(job.fps).seconds(places.frame), places.xy)
    return RealOutcome(job.name, "", _compared(calibration, true_rig, truth, job.fps, same_ids=True), disagreement)
