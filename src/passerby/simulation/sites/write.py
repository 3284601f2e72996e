"""A simulated site as a folder: a scene file ready to calibrate, and the truth beside it, written camera after camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.interchange.embeddings import write_embeddings
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.csv_text import to_csv
from passerby.interchange.storage.toml_text import to_toml
from passerby.interchange.storage.whole_folder import whole_folder
from passerby.simulation.sites.site import Site, SiteCamera
from passerby.simulation.sites.walkers import NOWHERE
from passerby.simulation.write import MEAN_SD, OPTIONS_FILE, SCENE_FILE

PEOPLE_AT_ONCE = 100


def write_site(site: Site, directory: str | Path, tell: Progress = silent) -> Path:
    """Write a site's folder, whole or not at all, and return the path of its scene file.

    The folder holds what `write_scene` writes: `scene.toml` (identities to be found), `intrinsics.toml`, `tracks/CAMERA.txt`,
    `embeddings/CAMERA.npz` on request, and the truth: `truth.toml`, `truth/CAMERA.txt`, `heights.csv`, `simulation.toml`. Of a
    site's own are `cameras.csv` (floor, its height, and clock offset of each camera), `overlaps.csv` (pairs of cameras that see
    ground in common, and how much) and `ground_positions.csv` (where people are each second, with their floor).

    `tell` is called for each camera that is done. A folder written by an earlier simulation is replaced as a whole. Raises
    `InputError` for one that holds anything else, or that cannot be written.
    """
    directory = Path(directory)
    with whole_folder(directory, OPTIONS_FILE, "a simulated scene") as new:
        _write_truth(site, new)
        write_text(new / SCENE_FILE, to_toml(_scene(site, directory.resolve().name)))
        stage, count = "simulating cameras", len(site.rig)
        tell(stage, 0, count)
        for done, camera in enumerate(site.cameras(), start=1):
            _write_camera(camera, new)
            tell(stage, done, count)
    return directory / SCENE_FILE


def _write_camera(camera: SiteCamera, folder: Path) -> None:
    # In the order in which they are written, so that the rows of the embeddings are those of the tracks.
    boxes = camera.seen.boxes.take(np.lexsort((camera.seen.boxes.identity, camera.seen.boxes.frame)))
    write_boxes(folder / "tracks" / f"{camera.name}.txt", boxes)
    if boxes.embedding is not None:
        write_embeddings(folder / "embeddings" / f"{camera.name}.npz", boxes.embedding, boxes.frame)
    write_boxes(folder / "truth" / f"{camera.name}.txt", camera.truth)


def _write_truth(site: Site, folder: Path) -> None:
    rig, names = site.rig, site.rig.names
    write_rig(folder / "intrinsics.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in rig)))
    write_rig(folder / "truth.toml", rig)
    heights = ((person, f"{height:.4f}") for person, height in enumerate(site.walkers.heights, start=1))
    write_text(folder / "heights.csv", to_csv(("id", "height_m"), heights))
    floors = site.plan.floors.tolist()
    cameras = (
        (name, floor, f"{site.plan.floor_z_m[floor]:g}", f"{offset:.6f}")
        for name, floor, offset in zip(names, floors, site.clock_offsets_s.tolist(), strict=True)
    )
    write_text(folder / "cameras.csv", to_csv(("camera", "floor", "floor_z_m", "clock_offset_s"), cameras))
    shared = ((names[a], names[b], f"{area:g}") for (a, b), area in site.shared_m2.items())
    write_text(folder / "overlaps.csv", to_csv(("camera_a", "camera_b", "shared_m2"), shared))
    write_text(folder / "ground_positions.csv", to_csv(("frame", "id", "floor", "x_m", "y_m"), _positions(site)))
    options = {key: value for key, value in asdict(site.options).items() if value is not None}
    offsets = dict(zip(names, site.clock_offsets_s.tolist(), strict=True))
    write_text(folder / OPTIONS_FILE, to_toml({"options": options, "clock_offsets_s": offsets}))


def _positions(site: Site) -> Iterator[tuple[object, ...]]:
    """Where people are at the first frame of each second, person after person."""
    options = site.options
    frames = np.unique(np.round(np.arange(0.0, options.seconds, max(1.0, 1.0 / options.fps)) * options.fps).astype(int))
    for start in range(0, len(site.walkers), PEOPLE_AT_ONCE):
        people = np.arange(start, min(start + PEOPLE_AT_ONCE, len(site.walkers)))
        xy, floors = site.walkers.places(people, frames / options.fps)
        for column, person in enumerate(people.tolist()):
            for frame, floor, (x, y) in zip(frames.tolist(), floors[:, column].tolist(), xy[:, column].tolist(), strict=True):
                if floor != NOWHERE:
                    yield frame + 1, person + 1, floor, f"{x:.3f}", f"{y:.3f}"


def _scene(site: Site, name: str) -> dict[str, Any]:
    """The content of the scene file: nothing in it says where cameras are, or what their clocks' offsets are."""
    options = site.options
    cameras = {
        camera: {"intrinsics": "intrinsics.toml", "tracks": f"tracks/{camera}.txt"}
        | ({"embeddings": f"embeddings/{camera}.npz"} if options.embeddings != "none" else {})
        for camera in site.rig.names
    }
    # Two clocks differ by up to twice what one is off by.
    search = {"max_offset_s": 2.0 * options.clock_offsets} if options.clock_offsets > 0 else {}
    return {
        "scene": {"name": name, "fps": float(options.fps)},
        "cameras": cameras,
        "association": {"mode": "combined"} | search,
        "solver": {"method": "people"},
        "scale": {
            "person_height_m": options.person_height_mean_m,
            # As in `write_scene`: a spread is not known to better than a centimetre.
            "person_height_sd_m": max(options.person_height_sd_m, 0.01),
            "person_height_mean_sd_m": MEAN_SD * options.person_height_mean_m,
        },
    }
