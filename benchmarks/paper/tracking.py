"""People's ways over the ground, against the truth: a page of tables."""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w

from pages.kept import Kept
from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.parts import Wanted
from paper.plots import FAILS, quartiles
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.errors import PasserbyError
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
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
from passerby.simulation import PRESETS, SimulationOptions, simulate, write_scene

BOX_NOISE = 0.02
FAILED = float("inf")
CAMERAS = ("similarity", "metric", "true")
"""Estimated cameras placed by a similarity, and by the reference camera; and the true ones."""
IDENTITIES = ("given", "found")
TRACKLET_S = 20.0  # mean length of the pieces that identities are found from
TAPE_SD_M = 0.02
TRUTH_FILE = "ground_positions.csv"


@dataclass(frozen=True)
class Case:
    """One scene."""

    preset: str
    seed: int
    identities: str
    tape: bool = False  # whether the distance between two cameras is known

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
    scale_error: float  # |estimated length / true length - 1|; infinite where undefined
    mean_m: dict[str, float]  # `METHOD CAMERAS` -> mean distance to the truth; infinite where there is no way
    covered: float  # share of the true places that have one found by the smoothed method and the estimated cameras
    sigma_share: float  # share of its places that lie within their sigma, by the true cameras
    one_camera_m: float  # mean distance of its places seen by one camera, by the true cameras; infinite where there is none


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
    why: str  # why it was not run; empty where it was
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


SEEDS, FOUND_SEEDS, QUICK_SEEDS = 3, 2, 1  # finding identities takes four times as long as following people who are known
KINDS = (("given", False), ("given", True), ("found", False))  # identities, and whether a distance is known
GOAL_M = 0.15
PAPER_M = (0.26, 0.59)
"""Mean distances from the truth on the paper's three real scenes, the best and the worst (Xu et al., CVPR 2021)."""
REAL = (("pets2009", 7.0), ("wildtrack", 2.0), ("multiviewx", 2.0))
"""Folders of the data, and the frame rates that their publishers tell."""


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
    """Three scenes of three kinds, then the real sets that are at hand; one seed and few kinds in a quick run."""
    seeds = wanted.seeds or (QUICK_SEEDS if wanted.quick else SEEDS)
    found_seeds = wanted.seeds or min(seeds, FOUND_SEEDS)
    cases = [
        Case(preset, seed, *kind)
        for preset in PRESETS
        for kind in KINDS
        for seed in range(found_seeds if kind[0] == "found" else seeds)
    ]
    if wanted.quick:
        cases = [case for case in cases if (case.identities == "given" or case.preset == "terrace") and not case.tape]
    jobs = [Job(case, wanted.kept) for case in cases]
    outcomes = dict(zip(cases, side_by_side(run_case, jobs, executor, tell, "tracking"), strict=True))
    sets = [] if wanted.quick else [RealSet(name, fps, data_folder(wanted.data, name)) for name, fps in REAL]
    real = side_by_side(run_set, sets, executor, tell, "tracking, real data sets")
    tables = {
        "Identities given": _table(outcomes, "given"), "One length measured": _table(outcomes, "given", tape=True),
        "Identities found": _table(outcomes, "found"), "Within the goal": _goals(outcomes), "Sigmas": _sigma_table(outcomes),
    }  # fmt: skip
    if real:
        tables["Real data sets"] = _real_table(real)
    return Found(tables, run=f"{seeds} seeds, {found_seeds} where identities are found")


HEAD = (
    "scene", "method", "by a similarity", "by the reference camera", "true cameras", "scale error", "covered", "failed",
)  # fmt: skip


def _table(outcomes: dict[Case, Outcome], identities: str, *, tape: bool = False) -> Table:
    """A row for each preset and method; medians over the seeds, the worst in brackets."""
    rows = []
    for preset in PRESETS:
        of = [one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, identities, tape)]
        if not of:
            rows.append([preset, "*not run* in a quick run", *[""] * (len(HEAD) - 2)])
            continue
        failed = sum(one.mean_m["smoothed similarity"] == FAILED for one in of)
        for method in METHODS:
            cells = [_cell([one.mean_m[f"{method} {cameras}"] for one in of]) for cameras in CAMERAS]
            scale = quartiles([one.scale_error for one in of])[1]
            covered = f"{number(100 * float(np.median([one.covered for one in of])))} %"
            tail = [_percent(scale), covered if method == "smoothed" else "", f"{failed} of {len(of)}"]
            rows.append([preset, method, *cells, *tail])
    return table(HEAD, rows)


def _cell(values: Sequence[float]) -> str:
    """The median, and the worst in brackets where there are several."""
    middle = quartiles(values)[1]
    told = FAILS if middle == FAILED else f"{number(middle, 3)} m"
    if len(values) == 1:
        return told
    return f"{told} ({FAILS if max(values) == FAILED else number(max(values), 3)})"


def _percent(share: float) -> str:
    return FAILS if share == FAILED else f"{number(100 * share)} %"


def _goals(outcomes: dict[Case, Outcome]) -> Table:
    """Whether every seed is within the goal and below the paper's best, by the default method."""
    rows = []
    for preset in PRESETS:
        for identities, tape in KINDS:
            of = [
                one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, identities, tape)
            ]
            if not of:
                continue
            for cameras, name in (("similarity", "similarity"), ("metric", "reference camera")):
                scale = "people and a tape" if tape else "people"
                worst = max(one.mean_m[f"smoothed {cameras}"] for one in of)
                told = FAILS if worst == FAILED else f"{number(worst, 3)} m"
                rows.append([preset, identities, scale, name, told, yes(worst <= GOAL_M), yes(worst < PAPER_M[0])])
    below = f"below the paper's {PAPER_M[0]} m"
    head = ("scene", "identities", "scale by", "placed by", "worst seed", f"within {GOAL_M} m", below)
    return table(head, rows)


def _sigma_table(outcomes: dict[Case, Outcome]) -> Table:
    """How honest the sigmas are, and what one camera alone is good for."""
    rows = []
    for preset in PRESETS:
        of = [one for case, one in outcomes.items() if (case.preset, case.identities, case.tape) == (preset, "given", False)]
        share = [one.sigma_share for one in of]
        alone = [one.one_camera_m for one in of if one.one_camera_m != FAILED]
        rows.append([
            preset, f"{number(100 * min(share), 0)} to {number(100 * max(share), 0)} %",
            f"{number(float(np.median(alone)), 3)} m" if alone else "none",
        ])  # fmt: skip
    return table(("scene", "places within their sigma", "places seen by one camera, distance"), rows)


def _real_table(sets: Sequence[RealOutcome]) -> Table:
    """A row for each real set and method."""
    head = (
        "data set", "method", "by a similarity", "by the reference camera", "true cameras", "scale error",
        "disagreement of the cameras",
    )  # fmt: skip
    rows = []
    for one in sets:
        apart = "" if one.disagreement_m is None else f"{number(one.disagreement_m, 3)} m"
        if one.outcome is None:
            rows.append([one.name, f"*not run*: {one.why}", "", "", "", "", apart])
            continue
        for method in METHODS:
            cells = [_cell([one.outcome.mean_m[f"{method} {cameras}"]]) for cameras in CAMERAS]
            rows.append([one.name, method, *cells, _percent(one.outcome.scale_error), apart if method == "smoothed" else ""])
    return table(head, rows)
