"""A published data set as a scene folder: a scene file that can be calibrated, and the truth."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from passerby.common.errors import InputError
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.datasets.published import Published
from passerby.interchange.coco import write_keypoints
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import to_csv, to_toml
from passerby.interchange.storage.transaction import whole_folder
from passerby.interchange.video_writer import VideoWriter

SCENE_FILE = "scene.toml"
VIDEOS_FILE = "videos.toml"
"""Second scene file, if the first one names boxes or joints: the same scene with videos only."""
TRUTH_FILE = "truth.toml"
MARKER = "dataset.toml"
"""States the source of the scene, and marks a folder as written by this module."""


@dataclass(frozen=True)
class SceneFolder:
    """The files of a written scene folder."""

    scene: Path
    """`scene.toml`."""
    mode: str
    """Mode of the association in `scene.toml`."""
    truth: Path | None
    """`truth.toml`; None if the set has no poses."""
    videos: Path | None
    """`videos.toml`; None if `scene.toml` itself names videos, or there are none."""
    notes: tuple[str, ...]
    """Notes of the set, and omitted parts with the reasons: whole sentences."""


def write_scene_folder(
    published: Published,
    directory: str | Path,
    source: Path,
    film: bool = False,
    executor: Executor | None = None,
    tell: Progress = silent,
) -> SceneFolder:
    """Write a scene folder, as a whole or not at all.

    The folder holds `scene.toml`, `intrinsics.toml` (lenses, no poses), `truth.toml` (the rig with its true poses),
    `ground_positions.csv` (true positions of people), `pictures.csv` (frame and path of each picture), `dataset.toml` (the
    source), and

    - if at least two cameras have identities: `tracks/CAMERA.txt` (MOTChallenge) and `keypoints/CAMERA.json` (COCO) with true
      identities, and `scene.toml` in mode "given". If there are videos too, `videos.toml` names only them.
    - otherwise, if there are videos: `scene.toml` names them, identities are to be found. Boxes with identities, of one camera
      at most, are in `truth/CAMERA.txt`.
    - otherwise `detections/CAMERA.txt` and `keypoints/CAMERA.json` without identities, which are to be found.

    Videos are named by absolute paths, because a scene folder is moved more often than a data set. Videos `videos/CAMERA.mp4`
    are made from pictures if identities are not given, or with `film`.

    Args:
        published: the set.
        directory: the folder to write; a folder from an earlier call is replaced as a whole.
        source: the folder of the set; `directory` must not lie in it.
        film: make videos of the pictures in any case.
        executor: makes videos in parallel; if None, they are made one after the other.
        tell: called after each video.

    Raises:
        InputError: the set has people in fewer than two cameras; `directory` has other content, lies in `source`, or cannot
            be written; a picture cannot be read.
    """
    directory = Path(directory)
    if directory.resolve() == source.resolve() or source.resolve() in directory.resolve().parents:
        raise InputError(f"{directory}: lies in the folder of the data set, {source}: give one outside of it")
    given = published.identities_known
    filmed = _find_pictures_to_film(published) if film or not given else {}
    named = {camera: path.resolve().as_posix() for camera, path in published.videos.items()}
    named |= {camera: _video(camera) for camera in filmed}
    tables, mode = _cameras(published, given, named)
    unfilmed = _explain_unfilmed(published, filmed) if film or not given else []
    notes = [*published.notes, *_list_absent(published, tables), *(f"{one}." for one in unfilmed)]
    if len(tables) < 2:
        unfit = f" ({unfilmed[0]})" if unfilmed else ""
        raise InputError(
            f"{source}: has people in {len(tables) or 'no'} camera{'' if len(tables) == 1 else 's'} of "
            f"{len(published.rig)}: two are needed with boxes, keypoints, a video or images{unfit}; fetch more of the set"
        )
    videos = _describe_videos(named) if given and len(named) >= 2 else {}
    with whole_folder(directory, MARKER, "a scene made from a data set") as folder:
        _write_truth(published, folder)
        _write_people(published, folder, tables)
        jobs = [(folder / _video(camera), pictures, published.fps or 0.0) for camera, pictures in filmed.items()]
        side_by_side(_film, jobs, executor, tell, "videos")
        write_text(folder / SCENE_FILE, _scene(published, tables, mode))
        if videos:
            write_text(folder / VIDEOS_FILE, _scene(published, videos, "combined"))
        made = {"name": published.name, "from": source.resolve().as_posix(), "notes": notes}
        write_text(folder / MARKER, to_toml(made))
    return SceneFolder(
        scene=directory / SCENE_FILE,
        mode=mode,
        truth=directory / TRUTH_FILE if len(published.rig.posed()) else None,
        videos=directory / VIDEOS_FILE if videos else None,
        notes=tuple(notes),
    )


def _cameras(published: Published, given: bool, named: dict[str, str]) -> tuple[dict[str, dict[str, str]], str]:
    """Return the tables of the cameras with people, and the mode of the association."""
    if not given and len(named) >= 2:
        return _describe_videos(named), "combined"
    tables: dict[str, dict[str, str]] = {}
    for camera in published.rig.names:
        boxes, joints = published.boxes.get(camera), published.keypoints.get(camera)
        table = {} if boxes is None else {"tracks" if given else "detections": _boxes(camera, given)}
        if joints is not None:
            table["keypoints"] = _keypoints(camera)
        if table:
            tables[camera] = {"intrinsics": "intrinsics.toml", **table}
    return tables, "given" if given else "combined"


def _describe_videos(named: dict[str, str]) -> dict[str, dict[str, str]]:
    return {camera: {"intrinsics": "intrinsics.toml", "video": video} for camera, video in named.items()}


def _find_pictures_to_film(published: Published) -> dict[str, tuple[Path, ...]]:
    """Return the pictures of cameras that can get a video: none so far, frames from 1 without a gap, and a known frame rate."""
    if published.fps is None:
        return {}
    return {
        camera: pictures
        for camera, pictures in published.pictures.items()
        if camera not in published.videos
        and pictures
        and published.frames_of_pictures(camera) == tuple(range(1, len(pictures) + 1))
    }


def _list_absent(published: Published, tables: dict[str, dict[str, str]]) -> list[str]:
    """Return a note for each camera that is not in the scene."""
    return [
        f"{camera} is not in {SCENE_FILE}: it has no people in its view."
        for camera in published.rig.names
        if camera not in tables
    ]


def _explain_unfilmed(published: Published, filmed: dict[str, tuple[Path, ...]]) -> list[str]:
    """Return, for each camera whose pictures make no video, the reason."""
    why = "the set states no frame rate" if published.fps is None else "they do not go from frame 1 on without a gap"
    return [
        f"No video is made of the images of {camera}: {why}"
        for camera in published.pictures
        if camera not in filmed and camera not in published.videos
    ]


def _scene(published: Published, tables: dict[str, dict[str, str]], mode: str) -> str:
    """Return the text of a scene file."""
    # Videos state their own frame rates.
    counted = all("video" not in table for table in tables.values())
    fps = {"fps": float(published.fps)} if counted and published.fps is not None else {}
    content: dict[str, Any] = {
        "scene": {"name": published.name, **fps},
        "cameras": tables,
        "association": {"mode": mode},
    }
    return to_toml(content)


def _write_people(published: Published, folder: Path, tables: dict[str, dict[str, str]]) -> None:
    """Write the boxes and joints that the tables name, and as truth other boxes with identities."""
    for camera, boxes in published.boxes.items():
        table = tables.get(camera, {})
        if "tracks" in table:
            write_boxes(folder / table["tracks"], boxes)
        elif "detections" in table:
            write_boxes(folder / table["detections"], _drop_identities(boxes))
        if "tracks" not in table and (boxes.identity > UNKNOWN).any():
            write_boxes(folder / "truth" / f"{camera}.txt", boxes)
    for camera, joints in published.keypoints.items():
        table = tables.get(camera, {})
        if "keypoints" in table:
            known = published.identities_known
            write_keypoints(folder / table["keypoints"], joints if known else _drop_joint_identities(joints))


def _drop_identities(boxes: Boxes) -> Boxes:
    return replace(boxes, identity=boxes.identity * 0 + UNKNOWN)


def _drop_joint_identities(joints: Keypoints) -> Keypoints:
    return replace(joints, identity=joints.identity * 0 + UNKNOWN)


def _write_truth(published: Published, folder: Path) -> None:
    """Write the lenses, the true poses, the positions on the ground, and the list of the pictures."""
    write_rig(folder / "intrinsics.toml", Rig(tuple(replace(camera, pose=None, sigma=None) for camera in published.rig)))
    posed = published.rig.posed()
    if len(posed):
        write_rig(folder / TRUTH_FILE, posed)
    ground = published.ground
    if ground is not None:
        places = (
            (frame, identity, f"{x:.4f}", f"{y:.4f}")
            for frame, identity, (x, y) in sorted(
                zip(ground.frame.tolist(), ground.identity.tolist(), ground.xy.tolist(), strict=True)
            )
        )
        write_text(folder / "ground_positions.csv", to_csv(("frame", "id", "x_m", "y_m"), places))
    if published.pictures:
        pictures = (
            (camera, frame, path.resolve().as_posix())
            for camera, paths in published.pictures.items()
            for frame, path in zip(published.frames_of_pictures(camera), paths, strict=True)
        )
        write_text(folder / "pictures.csv", to_csv(("camera", "frame", "path"), pictures))


def _film(job: tuple[Path, tuple[Path, ...], float]) -> None:
    """Make a video of pictures; the last row or column is left out if the size is odd, as H.264 requires."""
    path, pictures, fps = job
    first = _picture(pictures[0])
    size = (first.shape[1] // 2 * 2, first.shape[0] // 2 * 2)
    with VideoWriter(path, size, fps, crf=18) as video:
        for picture in pictures:
            read = _picture(picture)
            if read.shape != first.shape:
                raise InputError(f"{picture}: has another size than {pictures[0]}: images of one camera must be alike")
            video.write(read[: size[1], : size[0]])


def _picture(path: Path) -> Any:
    """Read a picture (H, W, 3), BGR. Raises `InputError` if it cannot be read."""
    read = cv2.imread(str(path))
    if read is None:
        raise InputError(f"{path}: is not an image that can be read: fetch it again")
    return read


def _boxes(camera: str, given: bool) -> str:
    return f"{'tracks' if given else 'detections'}/{camera}.txt"


def _keypoints(camera: str) -> str:
    return f"keypoints/{camera}.json"


def _video(camera: str) -> str:
    return f"videos/{camera}.mp4"
