"""The point bundle adjustment against pycolmap's: the same problem, the same start, one process, in turn.

Run as a program it prints one JSON object; `speed.py` runs it in a process of its own, because importing pycolmap enlarges the
peak memory that later children seem to have.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Pose
from passerby.geometry.triangulation import PointObservations
from passerby.solver.geopose.bundle import PointAdjustment, adjust_points

CAMERAS, POINTS = 8, 2000
SIZE, FOCAL = (1920, 1080), 1000.0
NOISE_PX, START_ROTATION_RAD, START_POSITION_M = 1.0, 0.03, 0.2
LOSS_SCALE_PX = 2.0
THREADS = 2
SAME_STOP = 1e-8  # share of the cost below which an iteration ends the descent: Passerby's own tolerance, given to pycolmap too


@dataclass(frozen=True, eq=False)
class BundleProblem:
    """Cameras, points and their pictures, and where both solvers start."""

    lens: Lens
    poses: tuple[Pose, ...]  # where the descent starts
    points: Floats  # (N, 3) where the descent starts, metres
    pixels: Floats  # (C, N, 2) sightings: every camera sees every point


def make_problem(seed: int = 0) -> BundleProblem:
    """Cameras on a circle of 10 m around points in a block of 8 x 8 x 2 m; the first camera starts, and stays, at the truth."""
    rng = np.random.default_rng(seed)
    lens = Lens(SIZE, np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1.0]]), np.zeros(4))
    points = rng.uniform((-4, -4, 0), (4, 4, 2), (POINTS, 3))
    poses, start, pixels = [], [], []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, CAMERAS, endpoint=False)):
        pose = _looking_at_the_middle(np.array([10 * np.cos(angle), 10 * np.sin(angle), 3.0]))
        turn = Rotation.from_rotvec(rng.normal(0, START_ROTATION_RAD, 3)).as_matrix()
        shift = rng.normal(0, START_POSITION_M, 3)
        poses.append(pose)
        start.append(pose if index == 0 else Pose.from_centre(turn @ pose.R_cw, pose.centre + shift))
        exact = lens.project_rays(points @ pose.R_cw.T + pose.t_cw)
        pixels.append(exact + rng.normal(0, NOISE_PX, exact.shape))
    return BundleProblem(lens, tuple(start), points + rng.normal(0, START_POSITION_M, points.shape), np.array(pixels))


def _looking_at_the_middle(centre: Floats) -> Pose:
    forward = np.array([0.0, 0.0, 1.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return Pose.from_centre(np.array([right, np.cross(forward, right), forward]), centre)


def cost(problem: BundleProblem, poses: tuple[Pose, ...], points: Floats, loss_scale_px: float | None) -> float:
    """Half the summed loss of the pixel residuals, computed alike for both solvers; plain squares without a scale."""
    total = 0.0
    for pose, seen in zip(poses, problem.pixels, strict=True):
        squared = np.sum((problem.lens.project_rays(points @ pose.R_cw.T + pose.t_cw) - seen) ** 2, axis=1)
        if loss_scale_px is not None:
            squared = loss_scale_px**2 * np.log1p(squared / loss_scale_px**2)
        total += 0.5 * float(squared.sum())
    return total


def passerby_observations(problem: BundleProblem) -> PointObservations:
    """The sightings as rays and tangents."""
    pixels = problem.pixels.reshape(-1, 2)
    bearing = problem.lens.bearings(pixels)
    return PointObservations(
        camera=np.repeat(np.arange(CAMERAS), POINTS), point=np.tile(np.arange(POINTS), CAMERAS), bearing=bearing,
        tangent=problem.lens.tangents(bearing), sigma_px=np.ones(len(pixels)),
    )  # fmt: skip


def run_passerby(problem: BundleProblem, loss_scale_px: float | None) -> tuple[float, PointAdjustment]:
    """Seconds, from pixels to adjusted poses with their covariance, and the result."""
    began = time.perf_counter()
    # Without a robust loss: a scale so wide that the Cauchy loss is the square, to ten digits.
    scale = 1e6 if loss_scale_px is None else loss_scale_px
    result = adjust_points(problem.poses, problem.points, passerby_observations(problem), loss_scale_px=scale)
    return time.perf_counter() - began, result


def make_reconstruction(problem: BundleProblem) -> Any:
    """The same problem as pycolmap holds it; one lens, one rig a camera, all poses at the start."""
    reconstruction = pycolmap.Reconstruction()
    matrix = problem.lens.matrix
    parameters = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    for index, (pose, seen) in enumerate(zip(problem.poses, problem.pixels, strict=True), start=1):
        camera = pycolmap.Camera(model="PINHOLE", width=SIZE[0], height=SIZE[1], params=parameters, camera_id=index)
        reconstruction.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=str(index), keypoints=seen, camera_id=index, image_id=index)
        reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(np.column_stack([pose.R_cw, pose.t_cw])))
    for index, point in enumerate(problem.points):
        track = pycolmap.Track()
        for image_id in range(1, CAMERAS + 1):
            track.add_element(image_id, index)
        reconstruction.add_point3D(point, track)
    return reconstruction


def pycolmap_options(loss_scale_px: float | None, same_stop: bool) -> Any:
    """Intrinsics held, two threads; otherwise pycolmap's defaults, or Passerby's stopping rule."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = False
    options.print_summary = False
    options.ceres.min_num_residuals_for_cpu_multi_threading = 0
    options.ceres.solver_options.num_threads = THREADS
    if loss_scale_px is not None:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = loss_scale_px
    if same_stop:
        options.ceres.solver_options.function_tolerance = SAME_STOP
    return options


def run_pycolmap(problem: BundleProblem, loss_scale_px: float | None, same_stop: bool) -> tuple[float, tuple[Any, Any]]:
    """Seconds of setting up and solving (not of filling the reconstruction), and (reconstruction, summary)."""
    reconstruction = make_reconstruction(problem)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in range(1, CAMERAS + 1):
        config.add_image(image_id)
        config.set_constant_cam_intrinsics(image_id)
    # One pose and one coordinate of another. Passerby leaves the scale to the damping; pycolmap's Cholesky fails on that.
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap_options(loss_scale_px, same_stop)
    began = time.perf_counter()
    summary = pycolmap.create_default_bundle_adjuster(options, config, reconstruction).solve()
    return time.perf_counter() - began, (reconstruction, summary)


def pycolmap_state(reconstruction: Any) -> tuple[tuple[Pose, ...], NDArray[np.float64]]:
    """Poses and points of a reconstruction, in the problem's order."""
    matrices = [reconstruction.image(index).cam_from_world().matrix() for index in range(1, CAMERAS + 1)]
    points = np.array([reconstruction.point3D(index).xyz for index in sorted(reconstruction.point3D_ids())])
    return tuple(Pose(matrix[:, :3], matrix[:, 3]) for matrix in matrices), points


def race(repeats: int) -> dict[str, Any]:
    """Both solvers in turn, after one warm-up each, for both losses and both of pycolmap's stopping rules."""
    problem = make_problem()
    rows = []
    for name, scale in (("Cauchy, 2 px", LOSS_SCALE_PX), ("squares", None)):
        runners: dict[str, Callable[[], tuple[float, Any]]] = {
            "passerby": lambda scale=scale: run_passerby(problem, scale),  # type: ignore[misc]
            "pycolmap": lambda scale=scale: run_pycolmap(problem, scale, False),  # type: ignore[misc]
            "pycolmap, same stop": lambda scale=scale: run_pycolmap(problem, scale, True),  # type: ignore[misc]
        }
        seconds: dict[str, list[float]] = {key: [] for key in runners}
        last: dict[str, Any] = {}
        for repeat in range(repeats + 1):
            for key, runner in runners.items():
                took, last[key] = runner()
                if repeat:
                    seconds[key].append(took)
        ours = np.array(seconds["passerby"])
        for key, times in seconds.items():
            adjusted = last[key]
            if key == "passerby":
                poses, points, iterations = adjusted.poses, adjusted.points, adjusted.iterations
            else:
                poses, points = pycolmap_state(adjusted[0])
                report = adjusted[1].ceres_summary
                iterations = report.num_successful_steps + report.num_unsuccessful_steps
            rows.append(
                {
                    "loss": name,
                    "solver": key,
                    "seconds": float(np.median(times)),
                    "ratio": float(np.median(ours / np.array(times))),
                    "cost": cost(problem, poses, points, scale),
                    "iterations": int(iterations),
                }
            )
    return {"rows": rows, "repeats": repeats, "pycolmap": pycolmap.__version__}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=15)
    print(json.dumps(race(parser.parse_args().repeats)))
