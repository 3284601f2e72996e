"""Are the sigmas true of other inputs than boxes under known names? One simulated scene of each, errors over stated sigmas.

Everything that is stated to the calibration is drawn from what the statement says: intrinsics with their usual errors, a
surveyed position with its standard deviation. So are principal points that nobody stated: simulated cameras have theirs nearer
to the centre than the solver has to expect of real ones. The lower edges of boxes are drawn as in `coverage`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pages.records import Found
from pages.tables import Table, table
from passerby.calibration.alignment.world import align_to_positions
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.calibration.in_memory import calibrate_observations
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import adjusted
from passerby.core.observations import CameraObservations
from passerby.core.scale_cues import KnownPosition
from passerby.geometry.rotations import angle_between
from passerby.interchange.rig_toml import write_rig
from passerby.scene.scene import Scene
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate, write_scene
from passerby.simulation.rendering import RenderOptions
from passerby.simulation.write import MEAN_SD
from passerby.solver.lens_unknowns import FOCAL_CORE, UNKNOWN_PRINCIPAL_POINT
from passerby.solver.systematic import LOWER_EDGE
from reliability.coverage import KINDS, ONE, TWO, in_sigmas, shares, stated_lenses, with_lower_edges
from reliability.lens_figures import with_joints_off
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept

KEYPOINTS, KEYPOINTS_ALIKE = "keypoints", "keypoints that err alike"
FOUND, VIDEOS = "identities found", "videos"
REFINED, REFINED_KEYPOINTS = "refined lenses", "refined lenses, keypoints"
UNKNOWN, UNKNOWN_KEYPOINTS = "lenses unknown", "lenses unknown, keypoints"
ALIGNED, ALONE = "aligned", "one person, 12 s"
STATED = (*KINDS, "focal length")
FIRST_SEED: Mapping[str, int] = MappingProxyType({
    kind: 110_000 + 1000 * number
    for number, kind in enumerate(
        (KEYPOINTS, FOUND, VIDEOS, REFINED, REFINED_KEYPOINTS, UNKNOWN, UNKNOWN_KEYPOINTS, ALIGNED, ALONE, KEYPOINTS_ALIKE)
    )
})  # fmt: skip
"""Kind of input -> the first of its seeds."""
MOST_FOCAL_ERROR = 0.2
"""Stated focal lengths are off by a Cauchy distribution of the core that the solver takes; cut here."""
SCENES, QUICK_SCENES = 60, 2
"""Of each kind of input: shares of 60 scenes have a standard error of 3 to 4 %, where the goals are 16 % wide."""
SURVEYED_SD_M = 0.03
FILM_CAMERAS, FILM_PEOPLE, FILM_SECONDS = 4, 8, 25.0


def work(case: tuple[str, int]) -> dict[str, Any]:
    """The scene of a kind of input and a seed: verdict, and errors as multiples of the stated sigmas, by what is stated."""
    kind, seed = case
    options = drawn(kind, seed)
    scene = simulate(options)
    if kind in (UNKNOWN, UNKNOWN_KEYPOINTS):
        scene = with_principal_points(scene, np.random.default_rng([14, seed]))
    found, focals = CALIBRATED[kind](scene, seed)
    about = {
        "kind": kind, "preset": options.preset, "cameras": options.n_cameras, "people": options.n_people,
        "seconds": options.seconds, "verdict": found.verdict, "reasons": list(found.reasons),
    }  # fmt: skip
    if len(found.rig.posed()) < 2:
        return about | {"sigmas": {}}
    if kind == ALIGNED:
        return about | {"sigmas": _aligned_errors(found, scene, seed)}
    sigmas = in_sigmas(found, scene, bool(options.clock_offsets))
    return about | {"sigmas": sigmas | ({"focal length": _focal_errors(found, scene)} if focals else {})}


def drawn(kind: str, seed: int) -> SimulationOptions:
    """The options of the scene of a kind of input and a seed: the three presets in turn, all else at random."""
    rng = np.random.default_rng([8, seed])
    found, alone, filmed = kind in (FOUND, VIDEOS), kind == ALONE, kind == VIDEOS
    unknown = kind in (UNKNOWN, UNKNOWN_KEYPOINTS)
    cameras = int(rng.integers(3, FILM_CAMERAS + 1 if filmed else 7))
    people = int(rng.integers(4, FILM_PEOPLE + 1 if filmed else 11)) if found or unknown else int(rng.integers(2, 11))
    seconds = FILM_SECONDS if filmed else float(rng.uniform(20, 60))
    joints = kind in (KEYPOINTS, KEYPOINTS_ALIKE, REFINED_KEYPOINTS, UNKNOWN_KEYPOINTS)
    return SimulationOptions(
        preset=tuple(PRESETS)[seed % len(PRESETS)], seed=seed, cameras=cameras, people=1 if alone else people,
        seconds=12.0 if alone else seconds, box_noise=float(rng.uniform(0.01, 0.04)),
        missing=float(rng.uniform(0.0, 0.1)), false_boxes=float(rng.uniform(0.0, 0.1)),
        joint_noise_px=float(rng.uniform(1.0, 3.0)) if joints else 0.0, unrelated_ids=kind == FOUND,
        tracklet_seconds=float(rng.uniform(6.0, 20.0)) if kind == FOUND else 0.0,
        clock_offsets=float(rng.uniform(0.0, 1.0)) if found else 0.0,
    )  # fmt: skip


def _scale(options: SimulationOptions) -> dict[str, float]:
    """What is stated of how tall people are: what they were drawn from."""
    return {
        "person_height_m": options.person_height_mean_m, "person_height_sd_m": options.person_height_sd_m,
        "person_height_mean_sd_m": MEAN_SD * options.person_height_mean_m,
    }  # fmt: skip


def _in_memory(scene: SimulatedScene, lenses: Rig, seed: int, mode: str = "given", **tables: Any) -> Calibration:
    seen = scene.observations.cameras
    boxes = with_lower_edges(scene, LOWER_EDGE * np.random.default_rng([12, seed]).standard_normal())
    joints = {name: camera.keypoints for name, camera in seen.items()} if scene.options.joint_noise_px else None
    return calibrate_observations(
        lenses, boxes, keypoints=joints, fps=scene.options.fps, association={"mode": mode},
        scale=_scale(scene.options), **tables,
    )  # fmt: skip


def _stated(scene: SimulatedScene, seed: int) -> Rig:
    """The lenses as they are stated."""
    return stated_lenses(scene.rig, np.random.default_rng([13, seed]))


def _known(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    return _in_memory(scene, _stated(scene, seed), seed), False


def _alike(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    seen = with_joints_off(scene.observations, np.random.default_rng([11, seed]))
    return _in_memory(replace(scene, observations=seen), _stated(scene, seed), seed), False


def _found(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    return _in_memory(scene, _stated(scene, seed), seed, "combined"), False


def _refined(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    rng = np.random.default_rng([9, seed])
    off = np.clip(FOCAL_CORE * rng.standard_cauchy(len(scene.rig)), -MOST_FOCAL_ERROR, MOST_FOCAL_ERROR)
    stated = []
    for camera, true, error in zip(_stated(scene, seed), scene.rig, off.tolist(), strict=True):
        stated.append(replace(camera, lens=_longer(camera.lens, error - float(np.log(camera.lens.focal / true.lens.focal)))))
    return _in_memory(scene, Rig(tuple(stated)), seed, solver={"refine": ["focal"]}), True


def _longer(lens: Lens, log_factor: float) -> Lens:
    matrix = np.array(lens.matrix)
    matrix[[0, 1], [0, 1]] *= np.exp(log_factor)
    return replace(lens, matrix=matrix)


def _unknown(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    return _in_memory(
        scene, Rig(tuple(Camera(camera.name, Lens.unknown(camera.lens.size)) for camera in scene.rig)), seed
    ), True


def with_principal_points(scene: SimulatedScene, rng: np.random.Generator) -> SimulatedScene:
    """The scene on image sensors that are not centred: principal points as far from the centre as unknown ones may be.

    A sensor that is moved behind its lens moves all pixels. Only boxes that are whole on both sensors are left.
    """
    cameras, seen = [], {}
    for camera in scene.rig:
        lens, own = camera.lens, scene.observations[camera.name]
        matrix, middle = np.array(lens.matrix), 0.5 * np.array(lens.size)
        moved = middle + UNKNOWN_PRINCIPAL_POINT * lens.size[0] * rng.standard_normal(2) - matrix[:2, 2]
        matrix[:2, 2] += moved
        cameras.append(replace(camera, lens=replace(lens, matrix=matrix)))
        boxes = own.boxes.take(own.boxes.inside(lens.size))
        boxes = replace(boxes, ltwh=boxes.ltwh + [*moved, 0.0, 0.0])
        xy = own.keypoints.xy + moved
        score = np.where(((xy >= 0) & (xy < lens.size)).all(axis=2), own.keypoints.score, 0.0)
        joints = replace(own.keypoints, xy=xy, score=score)
        joints = joints.take(np.flatnonzero(score.any(axis=1)))
        seen[camera.name] = CameraObservations(boxes.take(boxes.inside(lens.size)), joints)
    return replace(scene, rig=Rig(tuple(cameras)), observations=replace(scene.observations, cameras=seen))


def _filmed(scene: SimulatedScene, seed: int) -> tuple[Calibration, bool]:
    with tempfile.TemporaryDirectory() as scratch:
        path = write_scene(scene, Path(scratch) / "scene", video=RenderOptions())
        write_rig(path.with_name("intrinsics.toml"), _stated(scene, seed))
        return calibrate(Scene.load(path)), False


CALIBRATED: Mapping[str, Callable[[SimulatedScene, int], tuple[Calibration, bool]]] = MappingProxyType({
    KEYPOINTS: _known,
    KEYPOINTS_ALIKE: _alike,
    FOUND: _found,
    VIDEOS: _filmed,
    REFINED: _refined,
    REFINED_KEYPOINTS: _refined,
    UNKNOWN: _unknown,
    UNKNOWN_KEYPOINTS: _unknown,
    ALIGNED: _known,
    ALONE: _known,
})  # fmt: skip
"""Kind of input -> calibrates its scene; and whether focal lengths are estimated."""


def _focal_errors(found: Calibration, scene: SimulatedScene) -> list[float]:
    """Errors of the focal lengths' logarithms over their sigmas."""
    errors = []
    for name, lens in adjusted(found.figures).lenses.items():
        if lens.focal is not None and lens.focal.sigma_px:
            off = np.log(found.rig[name].lens.focal / scene.rig[name].lens.focal)
            errors.append(abs(float(off)) / (lens.focal.sigma_px / lens.focal.refined_px))
    return errors


def _aligned_errors(found: Calibration, scene: SimulatedScene, seed: int) -> dict[str, list[float]]:
    """Errors in the world of a survey of three cameras or more; the true world, in which nothing else is free."""
    rng = np.random.default_rng([10, seed])
    names = found.rig.posed().names
    count = min(len(names), int(rng.integers(3, len(names) + 1))) if len(names) > 3 else len(names)
    surveyed = [
        KnownPosition(name, np.asarray(scene.rig[name].centre) + SURVEYED_SD_M * rng.standard_normal(3), SURVEYED_SD_M)
        for name in rng.permutation(names)[:count].tolist()
    ]
    rig = align_to_positions(found.rig, surveyed, with_scale=True).rig
    out: dict[str, list[float]] = {"position": [], "orientation": []}
    for camera in rig.posed():
        truth, sigma = scene.rig[camera.name].pose, camera.sigma
        assert isinstance(truth, Pose)
        if sigma is None or camera.pose is None or not np.isfinite(sigma.position_m):
            continue
        out["position"].append(float(np.linalg.norm(camera.pose.centre - truth.centre)) / sigma.position_m)
        turned = np.degrees(angle_between(camera.pose.R_cw, truth.R_cw))
        out["orientation"].append(float(turned) / sigma.orientation_deg)
    return out


CAPTION = "Within one and two sigmas"


def run_keypoints(wanted: Wanted) -> Found:
    """Scenes with keypoints under known identities, lenses known."""
    return _run(wanted, (KEYPOINTS, KEYPOINTS_ALIKE))


def run_found(wanted: Wanted) -> Found:
    """Boxes: identities found, rigs in a surveyed world, and one person."""
    return _run(wanted, (FOUND, ALIGNED, ALONE))


def run_freed(wanted: Wanted) -> Found:
    """Lenses that are refined or unknown, by boxes and by keypoints."""
    return _run(wanted, (REFINED, REFINED_KEYPOINTS, UNKNOWN, UNKNOWN_KEYPOINTS))


def run_videos(wanted: Wanted) -> Found:
    """Rendered videos in which people are detected."""
    return _run(wanted, (VIDEOS,))


def _run(wanted: Wanted, kinds: Sequence[str]) -> Found:
    """All scenes of some kinds of input."""
    count = QUICK_SCENES if wanted.quick else SCENES
    cases = {f"{kind} {seed}": (kind, seed) for kind in kinds for seed in range(FIRST_SEED[kind], FIRST_SEED[kind] + count)}
    found = kept(wanted, "inputs", cases, work)
    by_kind = {kind: [found[key] for key in cases if cases[key][0] == kind] for kind in kinds}
    return part_found([_line(kind, results) for kind, results in by_kind.items()], {CAPTION: _table(by_kind)})


def _line(kind: str, results: Sequence[Mapping[str, Any]]) -> Line:
    """Whether all that is stated of a kind of input is as sure as it says."""
    seen, reached = [], True
    for what in STATED:
        one, two, count = shares(results, what)
        if count:
            seen.append(f"{what} {100 * one:.0f}, {100 * two:.0f}")
            reached &= ONE[0] <= one <= ONE[1] and TWO[0] <= two <= TWO[1]
    return Line(f"errors within 1 and 2 sigmas, {kind}, %", "; ".join(seen), "60 to 76, 90 to 99", bool(seen) and reached)


def _table(by_kind: Mapping[str, Sequence[Mapping[str, Any]]]) -> Table:
    """Percentages of errors within one and two sigmas, and their number."""
    rows = []
    for kind, results in by_kind.items():
        cells = []
        for what in STATED:
            one, two, count = shares(results, what)
            cells.append(f"{100 * one:.0f}, {100 * two:.0f} of {count}" if count else "-")
        rows.append([kind, str(len(results)), str(sum(one["verdict"] == "accepted" for one in results)), *cells])
    return table(("input", "scenes", "accepted", *STATED), rows)
