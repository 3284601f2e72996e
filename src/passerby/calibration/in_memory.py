"""Calibration from arrays in memory: lenses, boxes and joints, without any file."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from passerby.calibration.calibrate import calibrate_inputs
from passerby.calibration.calibration import Calibration
from passerby.common.errors import InputError
from passerby.common.progress import Progress
from passerby.core.cameras import Lens, Rig
from passerby.core.observations import Boxes, BoxFormat, Keypoints
from passerby.interchange.storage.safe_parsing import FileFaults
from passerby.scene.inputs import IN_MEMORY, assemble_inputs
from passerby.scene.joint_layouts import correct_layouts
from passerby.scene.reading import input_from_memory
from passerby.scene.scene import TABLES, Scene
from passerby.scene.table import explain_fault

Lenses = Rig | Mapping[str, Lens]
SeenBoxes = Mapping[str, Boxes | ArrayLike]


def calibrate_observations(
    lenses: Lenses, boxes: SeenBoxes | None = None, *, keypoints: Mapping[str, Keypoints] | None = None,
    fps: float | Mapping[str, float] | None = None, box_format: str = "ltwh", name: str = "scene", seed: int = 0,
    progress: Progress | None = None, executor: Executor | None = None, **tables: Mapping[str, Any],
) -> Calibration:  # fmt: skip
    """Calibrate from arrays in memory: boxes or joints of each camera.

        lens = passerby.Lens((1280, 720), [[900, 0, 640], [0, 900, 360], [0, 0, 1]], [])
        passerby.calibrate_observations(
            {"C1": lens, "C2": lens}, {"C1": boxes_1, "C2": boxes_2}, fps=25, association={"mode": "given"}
        )

    All inputs are checked as files are. Too little evidence gives a verdict and no error, as in `calibrate`.

    Args:
        lenses: the lens of each camera; or a rig, whose poses are not used.
        boxes: for each camera, `Boxes` or an array (N, 6 or 7): frame, id (-1 where unknown), left, top, width, height in
            pixels, and score; or the four numbers of `box_format` in place of left, top, width, height.
        keypoints: joints of the cameras that have any; the ids are those of the boxes.
        fps: frames per second of the frame numbers, for all cameras or for each.
        box_format: format of the arrays' four numbers, as the key `boxes` of the scene file: "ltwh", "corners", "centres", or
            "normalised ltwh" and so on.
        name: name of the scene.
        seed: as in `calibrate`.
        progress: as in `calibrate`.
        executor: as in `calibrate`.
        tables: tables of the scene file as mappings: `association`, `sites`, `scale`, `solver`, `world`. With mode "given" of
            `association`, an id is the same person in all cameras; without it, identities are found.

    Raises:
        InputError: a camera has no lens, an array has another shape, or a setting does not exist.
    """
    known = {camera.name: camera.lens for camera in lenses} if isinstance(lenses, Rig) else dict(lenses)
    try:
        form = BoxFormat.of_text(box_format)
    except ValueError as error:
        raise InputError(f"box_format: {error}") from None
    joints = dict(keypoints or {})
    for camera in (*(boxes or {}), *joints):
        if camera not in known:
            raise InputError(
                f"camera {camera} has people, but no intrinsics: add it to the lenses ({', '.join(known) or 'none'})"
            )
    seen = {camera: _boxes(camera, rows, form, known[camera].size) for camera, rows in (boxes or {}).items()}
    scene = _scene(name, known, fps, form, tables)
    empty = Boxes.empty(), Keypoints.empty()
    readings = [
        input_from_memory(scene, camera, lens, seen.get(camera, empty[0]), joints.get(camera, empty[1]))
        for camera, lens in known.items()
    ]
    correct_layouts(readings)
    return calibrate_inputs(scene, assemble_inputs(scene, readings), seed=seed, progress=progress, executor=executor)


def _scene(
    name: str, lenses: Mapping[str, Lens], fps: float | Mapping[str, float] | None, form: BoxFormat, tables: Mapping[str, Any]
) -> Scene:
    """Make a scene that names no files. Raises `FileFaults` (an `InputError`) as for a scene file."""
    rates = dict(fps) if isinstance(fps, Mapping) else {}
    declared: dict[str, dict[str, Any]] = {
        camera: {"intrinsics": IN_MEMORY, "tracks": IN_MEMORY, "rotate": lens.rotate} for camera, lens in lenses.items()
    }
    for camera, rate in rates.items():
        if camera not in declared:
            raise InputError(f"fps: camera {camera} has no lens: name one of {', '.join(lenses) or 'none'}")
        declared[camera] = {**declared[camera], "fps": rate}
    own = {"name": name, "boxes": str(form)} | ({} if fps is None or rates else {"fps": fps})
    allowed = ("association", "sites", "scale", "solver", "world")
    for table in tables:
        if table not in allowed:
            raise InputError(
                f"'{table}' is not a table of the scene file that can be used here: there are {', '.join(allowed)}"
            )
    try:
        return Scene.model_validate({"scene": own, "cameras": declared, **tables})
    except ValidationError as error:
        raise FileFaults([f"scene {name}: {explain_fault(dict(fault), TABLES)}" for fault in error.errors()]) from None


def _boxes(camera: str, rows: Boxes | ArrayLike, form: BoxFormat, size: tuple[int, int]) -> Boxes:
    """Make boxes from an array (N, 6 or 7) of a format, in an image of (width, height).

    Raises `InputError`, with the camera's name, if the array does not contain boxes.
    """
    if isinstance(rows, Boxes):
        return rows
    columns = f"frame, id (-1 where unknown), {', '.join(form.columns)}[, score]"
    try:
        table = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"boxes of camera {camera} are not numbers ({error}): give {columns}") from None
    if table.size == 0:
        return Boxes.empty()
    if table.ndim != 2 or table.shape[1] not in (6, 7):
        raise InputError(f"boxes of camera {camera} have the shape {table.shape}: give rows of {columns}")
    score = table[:, 6] if table.shape[1] == 7 else np.ones(len(table))
    try:
        return Boxes(table[:, 0], table[:, 1], form.to_ltwh(table[:, 2:6], size), score)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"boxes of camera {camera}: {error}") from None
