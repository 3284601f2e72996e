"""Every reader of files that Passerby did not write itself, each with sound examples."""

# ruff: noqa: E501 (tables of text that is broken, or read, as it stands)

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from passerby.common.errors import EvidenceError, InputError
from passerby.datasets.annotations import read_cvml, read_mot_truth, read_vatic
from passerby.datasets.epfl import read_grid
from passerby.datasets.parsing import mat_matrix, text_matrix, xml_numbers
from passerby.interchange.coco import read_keypoints
from passerby.interchange.formats import Given, all_formats, read_people_as, read_rig_as, recognise_format
from passerby.interchange.motchallenge import read_boxes, read_embeddings
from passerby.interchange.opencv_lens import read_opencv_lens
from passerby.interchange.output_folder import read_output
from passerby.interchange.rig_toml import read_lens, read_rig
from passerby.interchange.trajectories_csv import read_ground_positions, read_trajectories
from passerby.interchange.world_files import read_known_points, read_known_positions
from passerby.perception.kept import StageCache
from passerby.perception.networks import read_own_network
from passerby.perception.video import VideoReader, probe
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.start.folders import FoundCamera
from passerby.scene.start.lenses import find_lenses
from passerby.training.crops import read_picture
from passerby.training.curves import TrainingLog
from passerby.training.data.reading import msmt17
from passerby.training.data.tracks import camera_of_sequence
from support.untrusted import example_files as example

OWN_PROCESS = 0.01
"""Of the usual number of cases, where each is read in a new process: SciPy can be made to end its own."""


@dataclass(frozen=True, eq=False)
class Reader:
    """One way into the program for a file."""

    name: str
    files: Callable[[], example.Files]
    """A sound example; the first file is the main one."""
    read: Callable[[Path], Any]
    """Takes the path of the main file."""
    refuses: tuple[type[Exception], ...] = (InputError,)
    """What it may raise."""
    broken: tuple[str, ...] = ()
    """Names (or endings) of the files that are broken; none: all of the example's."""
    share: float = 1.0
    """Of the usual number of cases: less where a case takes long."""
    folders: tuple[str, ...] = field(default=())
    """Empty folders that the example needs."""


def _one(name: str, content: Callable[[], bytes | str]) -> Callable[[], example.Files]:
    """An example of one file."""

    def files() -> example.Files:
        found = content()
        return {name: found.encode() if isinstance(found, str) else found}

    return files


def _probed(path: Path) -> Any:
    """What a video tells, and its first pictures."""
    info = probe(path)
    for number, _ in enumerate(VideoReader(info)):
        if number == 3:
            break
    return info


def _kept(path: Path) -> Any:
    stage = StageCache(path.parent, "key")
    return stage.load(0), stage.summary()


def _kept_files() -> example.Files:
    import tempfile

    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        stage = StageCache(Path(folder), "key")
        stage.save(0, {"boxes": np.arange(12.0).reshape(3, 4)})
        stage.finish({"frames": 3, "notes": ["one"]})
        return dict(reversed(example.files_of(Path(folder)).items()))


def _network(path: Path) -> Any:
    from passerby.perception.crop_network import CropNetwork

    own = read_own_network(path, "embedder", hashlib.sha256(path.read_bytes()).hexdigest())
    return CropNetwork(own, batch=4).probed()


def _lenses(path: Path) -> Any:
    notes: list[str] = []
    cameras = [FoundCamera("A"), FoundCamera("B")]
    found = find_lenses(path.parent, cameras, notes, path.parent / "scene" / "scene.toml")
    return [lens.lens for lens in found.values() if lens.lens is not None]


def _scene(path: Path) -> Any:
    scene = Scene.load(path)
    return scene, read_inputs(scene).rig


def _recognised(path: Path) -> Any:
    """What reads a file that is recognised; nothing for one that is not."""
    form = recognise_format(path)
    return None if form is None else read_rig_as(form.name, path, Given((640, 480), 1.0), lossy=True)[0]


def _panoptic(path: Path) -> Any:
    from passerby.datasets.panoptic import _rig

    return _rig(path)


def _formats() -> list[Reader]:
    """Every format of other tools that is read."""
    readers = []
    for form in all_formats():
        if form.read is None:
            continue
        given = Given(size=None if form.name in example.READ_ONLY else (640, 480), metres_per_unit=1.0)
        for target in [f"rig{form.suffixes[0]}"] if form.target == "file" else [""]:
            readers.append(
                Reader(
                    f"format {form.name}",
                    lambda name=form.name, target=target: example.exported(name, target),  # type: ignore[misc]
                    lambda path, name=form.name, target=target, given=given: read_rig_as(  # type: ignore[misc]
                        name, path if target else _root(path), Given(given.size, given.metres_per_unit), lossy=True
                    )[0],
                )
            )
    return readers


def _root(path: Path) -> Path:
    """The folder of an example, which a reader of folders is given."""
    return next(parent for parent in path.parents if parent.name == "case")


PEOPLE: Mapping[str, tuple[str, Callable[[], example.Files]]] = {
    "format openpose": ("openpose", example.openpose),
    "format alphapose": ("alphapose", example.alphapose),
    "format coco": ("coco", example.coco_people),
    "format coco, results": ("coco", example.coco_results),
}


def _people() -> list[Reader]:
    """The formats of other tools that hold people."""
    return [
        Reader(
            title,
            files,
            lambda path, name=name: read_people_as(name, path.parent if name == "openpose" else path),  # type: ignore[misc]
        )
        for title, (name, files) in PEOPLE.items()
    ]


READERS: tuple[Reader, ...] = (
    Reader("scene file", _one("scene.toml", lambda: example.SCENE), Scene.load),
    Reader("scene and its files", example.scene_folder, _scene),
    Reader("rig file", _one("rig.toml", example.rig_file), read_rig),
    Reader("lens of a rig file", _one("rig.toml", example.rig_file), lambda path: read_lens(path, "A")),
    Reader("OpenCV lens, YAML", lambda: example.opencv_lens(".yml"), read_opencv_lens),
    Reader("OpenCV lens, XML", lambda: example.opencv_lens(".xml"), read_opencv_lens),
    Reader("OpenCV lens, JSON", lambda: example.opencv_lens(".json"), read_opencv_lens),
    Reader("OpenCV lens, of a script", example.plain_lens, read_opencv_lens),
    Reader("OpenCV lens, of ROS", example.ros_lens, read_opencv_lens),
    Reader("lenses of a folder", lambda: {"intrinsics.toml": example.rig_file()}, _lenses),
    Reader("boxes", _one("A.txt", example.boxes_file), read_boxes),
    Reader("joints", _one("A.json", example.joints_file), read_keypoints),
    Reader("embeddings", _one("A.npz", example.looks_file), read_embeddings),
    Reader("embeddings, compressed", _one("A.npz", example.looks_packed), read_embeddings),
    Reader("trajectories", _one("trajectories.csv", lambda: example.TRAJECTORIES), read_trajectories),
    Reader("true ground positions", _one("ground.csv", lambda: example.GROUND), read_ground_positions),
    Reader("known points, CSV", _one("points.csv", lambda: example.POINTS), read_known_points),
    Reader("known points, TOML", _one("points.toml", lambda: example.POINTS_TOML), read_known_points),
    Reader("known positions, CSV", _one("positions.csv", lambda: example.POSITIONS), read_known_positions),
    Reader("known positions, TOML", _one("positions.toml", lambda: example.POSITIONS_TOML), read_known_positions),
    Reader("output folder", example.output_folder, lambda path: read_output(path.parent), (InputError, EvidenceError)),
    *_formats(),
    *_people(),
    Reader("recognised file, JSON", lambda: example.exported("krt-json", "cameras.json"), _recognised),
    Reader("recognised file, pickle", lambda: example.exported("opencap", "camera.pickle"), _recognised),
    Reader("kept results of videos", _kept_files, _kept, ()),
    Reader("network", _one("net.onnx", example.network), _network),
    Reader("description of a network", lambda: {"net.onnx": example.bare_network(), "net.toml": example.NETWORK.encode()},
           _network, broken=("net.toml",)),
    Reader("video, MP4", lambda: example.video(".mp4"), _probed),
    Reader("video, MKV", lambda: example.video(".mkv"), _probed),
    Reader("video, AVI", lambda: example.video(".avi"), _probed),
    Reader("picture, PNG", _one("a.png", lambda: example.picture(".png")), read_picture),
    Reader("picture, JPEG", _one("a.jpg", lambda: example.picture(".jpg")), read_picture),
    Reader("VATIC", _one("a.txt", lambda: example.VATIC), read_vatic),
    Reader("CVML", _one("a.xml", lambda: example.CVML), read_cvml),
    Reader("MOTChallenge truth", _one("gt.txt", lambda: example.MOT_TRUTH), read_mot_truth),
    Reader("EPFL positions", _one("gt.txt", lambda: example.GRID), read_grid),
    Reader("Panoptic cameras", _one("calibration_a.json", lambda: example.json.dumps(example.PANOPTIC)), _panoptic),
    Reader("projection matrix, text", _one("P.txt", lambda: "1 2 3 4\n5 6 7.5 8\n9 10 11 12e0\n"), text_matrix),
    Reader("projection matrix, MATLAB", example.matlab, lambda path: mat_matrix(path, "cam1", (3, 4)), share=OWN_PROCESS),
    Reader("OpenCV storage, XML", _one("a.xml", lambda: example.XML_STORAGE), lambda path: xml_numbers(path, "camera_matrix", (3, 3))),
    Reader("MOTChallenge sequence", lambda: {"seqinfo.ini": example.SEQUENCE.encode(), "gt/gt.txt": example.PEDESTRIANS.encode()},
           lambda path: camera_of_sequence(path.parent).boxes, folders=("img1",)),
    Reader("MSMT17 lists", lambda: {f"list_{part}.txt": example.MSMT17.encode() for part in ("train", "val", "query", "gallery")},
           lambda path: [row.person for row in msmt17(path.parent).train], folders=("train", "test")),
    Reader("log of a training", _one("log.csv", lambda: example.LOG), lambda path: TrainingLog(path.parent).rows()),
)  # fmt: skip
