"""Faults of the files, points and cameras that `[world]` names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.text import suggest_name
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.interchange.world_files import read_known_points, read_known_positions
from passerby.scene.scene import Scene
from passerby.scene.world_tables import plan_faults


def world_faults(scene: Scene, sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    """List the faults of the lines and files of `[world]`, one line each.

    Args:
        scene: the scene, which names the files.
        sizes: camera -> (width, height) of its image, pixels.
    """
    return [*_line_faults(scene, sizes), *_file_faults(scene, sizes)]


def _line_faults(scene: Scene, sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    """List the pixels of lines that lie outside their images."""
    return [
        f"{scene.place}: [[world.lines]] {number} points: [{u:g}, {v:g}] lies outside the {sizes[name][0]} x {sizes[name][1]} "
        f"image of camera {name}: give pixels of that image"
        for number, line in enumerate(scene.world.lines if scene.world is not None else (), start=1)
        for name, ends in line.points.items()
        for u, v in ends
        if name in sizes and not (0 <= u <= sizes[name][0] and 0 <= v <= sizes[name][1])
    ]


def _file_faults(scene: Scene, sizes: Mapping[str, tuple[int, int]]) -> list[str]:
    """List the faults of the plan, or of the file of points or positions."""
    files = world_file_paths(scene)
    if scene.world is not None and scene.world.plan is not None:
        plan = scene.world.plan
        placed = plan.model_copy(update={"image": scene.resolve(plan.image)})
        return plan_faults(placed, f"{scene.place}: [world.plan]", sizes)
    try:
        if files["points"] is not None:
            path = scene.resolve(files["points"])
            points = read_known_points(path)
            marks = [(point.name, name, pixel) for point in points for name, pixel in point.pixels.items()]
            return [
                f"{path}: point {point} in camera {name}: ({u:g}, {v:g}) lies outside its {sizes[name][0]} x {sizes[name][1]} "
                "image: give pixels of that image"
                for point, name, (u, v) in marks
                if name in sizes and not (0 <= u <= sizes[name][0] and 0 <= v <= sizes[name][1])
            ] + _list_unknown(scene, path, [name for _, name, _ in marks])
        if files["positions"] is not None:
            path = scene.resolve(files["positions"])
            return _list_unknown(scene, path, [known.camera for known in read_known_positions(path)[0]])
    except InputError as error:
        return list(faults_of(error))
    return []


def world_file_paths(scene: Scene) -> dict[str, Path | None]:
    """Return the paths of `[world]` as the scene file states them; None if a key is not stated."""
    return {"points": scene.world.points if scene.world else None, "positions": scene.world.positions if scene.world else None}


def _list_unknown(scene: Scene, path: Path, names: list[str]) -> list[str]:
    """List the cameras that the scene does not declare."""
    return [
        f"{path}: camera '{name}' is not declared in {scene.place}: {suggest_name(name, list(scene.cameras))}"
        for name in dict.fromkeys(names)
        if name not in scene.cameras
    ]
