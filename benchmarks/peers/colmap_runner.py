"""COLMAP through pycolmap: incremental mapping, with the option `wide` or without, or with `global` GLOMAP's.

A static camera is one picture whose keypoints are all the points that it ever saw; the same point in two pictures is a match.
COLMAP verifies the pairs itself, then maps; the lenses are known and held. It gets undistorted pixels and pinhole cameras.
"""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
import pycolmap
from protocol import Points, Poses, run

SEED = 0
WIDE = 3.0
"""Factor of the thresholds with the option `wide`. COLMAP's 4 px are meant for corners in pictures; points of people are off by
more, in the order of 10 px where they are near."""
MIN_MATCHES = 15  # COLMAP's own default: pairs with fewer matches are left out


def solve(source: Path, option: str) -> Poses:
    """The poses of the largest model."""
    points = Points.read(source)
    with tempfile.TemporaryDirectory(prefix="peers-colmap-") as scratch:
        folder = Path(scratch)
        database, pairs = folder / "database.db", folder / "pairs.txt"
        images = fill(points, database, pairs)
        factor = WIDE if option == "wide" else 1.0
        pycolmap.verify_matches(database, pairs, two_view_options(factor))
        models = global_mapping(database, folder) if option == "global" else incremental_mapping(database, folder, factor)
        if not models:
            return {}
        model = max(models.values(), key=lambda model: model.num_reg_images())
        poses = {}
        for number, name in images.items():
            if number in model.images and model.images[number].has_pose:
                pose = model.images[number].cam_from_world()
                poses[name] = (pose.rotation.matrix(), pose.translation)
        return poses


def fill(points: Points, database: Path, pairs: Path) -> dict[int, str]:
    """Write cameras, keypoints and matches into a new database; image number -> name of the camera."""
    numbers = points.point_numbers()
    with pycolmap.Database.open(database) as db:
        images, seen = {}, {}
        for index, name in enumerate(points.names):
            K, size = points.matrix[index], points.size[index]
            lens = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5]
            camera = pycolmap.Camera(model="PINHOLE", width=int(size[0]), height=int(size[1]), params=lens)
            camera.has_prior_focal_length = True
            camera.camera_id = db.write_camera(camera)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(camera.sensor_id)
            rig.rig_id = db.write_rig(rig)
            image = pycolmap.Image(name=f"{name}.png", camera_id=camera.camera_id)
            image.image_id = db.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig.rig_id
            frame.add_data_id(image.data_id)
            db.write_frame(frame)
            rows = np.flatnonzero(points.camera == index)
            # COLMAP counts from the corner of the first pixel, OpenCV from its middle.
            db.write_keypoints(image.image_id, points.undistorted[rows].astype(np.float32) + 0.5)
            images[image.image_id], seen[image.image_id] = str(name), numbers[rows]
        lines = []
        for a, b in itertools.combinations(images, 2):
            _, in_a, in_b = np.intersect1d(seen[a], seen[b], return_indices=True)
            if len(in_a) >= MIN_MATCHES:
                db.write_matches(a, b, np.column_stack([in_a, in_b]).astype(np.uint32))
                lines.append(f"{images[a]}.png {images[b]}.png")
    pairs.write_text("\n".join(lines) + "\n")
    return images


def two_view_options(factor: float) -> pycolmap.TwoViewGeometryOptions:
    """The defaults with a fixed seed; the filter of watermarks is meant for pictures."""
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = SEED
    options.ransac.max_error *= factor
    options.detect_watermark = False
    return options


def incremental_mapping(database: Path, folder: Path, factor: float) -> dict[int, pycolmap.Reconstruction]:
    """COLMAP's incremental mapping, the lenses held, every threshold of the image's error multiplied by `factor`."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed = 1, SEED
    options.extract_colors = False
    options.min_model_size = 3
    options.ba_refine_focal_length = options.ba_refine_principal_point = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = False
    options.mapper.init_max_error *= factor
    options.mapper.abs_pose_max_error *= factor
    options.mapper.filter_max_reproj_error *= factor
    options.triangulation.create_max_angle_error *= factor
    options.triangulation.continue_max_angle_error *= factor
    options.triangulation.merge_max_reproj_error *= factor
    options.triangulation.complete_max_reproj_error *= factor
    return dict(pycolmap.incremental_mapping(database, folder, folder, options))


def global_mapping(database: Path, folder: Path) -> dict[int, pycolmap.Reconstruction]:
    """GLOMAP, the lenses held."""
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads, options.random_seed = 1, SEED
    options.mapper.bundle_adjustment.refine_focal_length = False
    options.mapper.bundle_adjustment.refine_principal_point = False
    options.mapper.bundle_adjustment.refine_extra_params = False
    return dict(pycolmap.global_mapping(database, folder, folder, options))


if __name__ == "__main__":
    pycolmap.logging.minloglevel = pycolmap.logging.Level.ERROR.value
    run(solve, "pycolmap")
