"""Text of a scene file for the user to edit: every table is explained, and the settings are commented out at their defaults.

Explanations begin with `# `, a setting that is commented out begins with `#` alone. Without both, it is still a scene file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from passerby.interchange.storage import text_formats
from passerby.interchange.storage.text_formats import comment, key, value
from passerby.perception.plan import CROPS_PER_S
from passerby.scene.scale_tables import ScaleTable
from passerby.scene.start.folders import SOURCES, FoundCamera
from passerby.scene.start.recordings_found import ProposedSpan
from passerby.scene.tables import SEARCHED_S, WATCHED_FPS, AssociationTable, PerceptionTable, SolverTable


@dataclass(frozen=True, eq=False)
class SceneCamera:
    """The data of one camera that are written."""

    found: FoundCamera
    intrinsics: Path | None
    """The rig file with its intrinsics; None: they are estimated together with the rig."""
    remarks: tuple[str, ...] = ()
    """Remarks about its lens, one line each."""
    fps: float | None = None
    """Frames per second, if the scene file must state them; else None."""
    same_as: str | None = None
    """An earlier camera whose video is from the same device, by the metadata of both."""

    @property
    def name(self) -> str:
        """The camera's name in the scene."""
        return self.found.name


def scene_text(name: str, cameras: Sequence[SceneCamera], path: Path, span: ProposedSpan | None = None) -> str:
    """Return the text of a scene file at `path`. The names of all cameras must be valid and different.

    `span` is the part of long recordings that is used; None: all of them.
    """
    parts = [_head(path), _scene(name, cameras, span), *(_camera(camera, path) for camera in cameras)]
    return "\n".join([*parts, _perception(cameras), _association(), _solver(cameras[0].name), _scale(cameras)])


def _head(path: Path) -> str:
    return comment(
        "A scene: the cameras, their observations, and known lengths. Paths are relative to this file.\n"
        "A line that begins with # and no space is a setting that is commented out: delete the #, and change its value.\n"
        f"Then: passerby check {path.name}, and passerby calibrate {path.name} -o out"
    )


def _scene(name: str, cameras: Sequence[SceneCamera], span: ProposedSpan | None) -> str:
    rate = next((camera.found.info.average_fps for camera in cameras if camera.found.info is not None), None)
    if rate is None:
        told = "fps: frames per second of the frame numbers. Without it, clock offsets and walking speeds are not used."
    else:
        told = "fps: frames per second. Without it, the frame rate that each video states. For videos that state a wrong one."
    text = f"[scene]\nname = {value(name)}   # name in the reports\n{comment(told)}#fps = {value(round(rate or 25.0, 3))}\n"
    if span is not None:
        text += comment(f"The used part, by the clock of the files' names: {span.why}.")
        text += f"from = {value(span.first)}\nuntil = {value(span.last)}\n"
    return text


def _camera(camera: SceneCamera, path: Path) -> str:
    """Return the text of one camera's table."""
    lines = [f"[cameras.{key(camera.name)}]\n", *(comment(remark) for remark in camera.remarks)]
    if camera.intrinsics is not None:
        source = value(text_formats.relative(camera.intrinsics, path))
        lines.append(f"intrinsics = {source}   # its table [{key(camera.name)}]\n")
    else:
        lines += _write_lens_keys(camera)
    if camera.found.video is not None:
        info = camera.found.info
        told = f"   # {_video(camera.found)}" if info else ""
        lines.append(f"video = {value(text_formats.relative(camera.found.video, path))}{told}\n")
    if camera.found.times is not None:
        times = value(text_formats.relative(camera.found.times, path))
        lines.append(f"times = {times}   # of the frames, one row each\n")
    switched = "#" if camera.found.video is not None else ""
    files = [(source, camera.found.files[source]) for source in SOURCES if source in camera.found.files]
    if switched and files:
        lines.append(comment("Found beside the video. Delete the # to use it instead of detecting people in the video:"))
    lines += [f"{switched}{source} = {value(text_formats.relative(file, path))}\n" for source, file in files]
    if camera.found.recording is not None and camera.found.recording.unknown_rate:
        lines.append('fps = "IMAGES PER SECOND"   # TO DO: that the numbers of the images count\n')
    elif camera.fps is not None:
        lines.append(
            f"fps = {value(camera.fps)}   # ASSUMED, as of a video: correct it if the frame numbers have another rate\n"
        )
    elif camera.found.times is None:
        lines.append(f"#fps = {value(_rate(camera))}   # of this camera only\n")
    lines.append("#from_s = 0.0   # observations before from_s or after until_s are left out\n")
    lines.append(
        "#exclude = [[[0, 0], [400, 0], [400, 250], [0, 250]]]   # people whose feet are in it, pixels, are left out\n"
    )
    return "".join(lines)


def _write_lens_keys(camera: SceneCamera) -> list[str]:
    """Return the lines with the keys of a lens that is estimated, with values from the metadata of its video."""
    info = camera.found.info
    lines = [comment("No intrinsics: they are estimated together with the rig.")]
    if info is None and camera.found.video is None:
        lines.append('image_size = ["WIDTH", "HEIGHT"]\n')
    if camera.same_as is not None and info is not None:
        told = "the video is from the same device: share one lens if the zoom is the same too"
        lines.append(comment(f"Recorded with: {info.camera.device}."))
        lines.append(f"#lens = {value(f'same as {camera.same_as}')}   # {told}\n")
    elif info is not None and info.camera.focal_35mm is not None:
        lines.append(f"#focal_35mm = {value(info.camera.focal_35mm)}   # of the video's metadata, used as it is; or your own\n")
    else:
        lines.append(
            "#hfov_deg = 90.0   # horizontal field of view, if a data sheet states it; or focal_mm and sensor_width_mm\n"
        )
    return lines


def _rate(camera: SceneCamera) -> float:
    """Return the frame rate of the video, or 25, as an example value."""
    info = camera.found.info
    return round(info.average_fps if info is not None else 25.0, 3)


def _video(found: FoundCamera) -> str:
    """Describe a video by its size, frame rate and length."""
    info = found.info
    if info is None:
        return ""
    rate = f"{info.average_fps:.4g} frames per second" + (", not constant" if info.variable else "")
    length = "" if info.seconds is None else f", {info.seconds:.1f} s"
    return f"{info.size[0]} x {info.size[1]}, {rate}{length}"


def _perception(cameras: Sequence[SceneCamera]) -> str:
    """Return the text of the table of detection in videos."""
    defaults = PerceptionTable()
    videos = any(camera.found.video is not None for camera in cameras)
    return (
        comment(
            "How people are detected in the videos." if videos else "How people are detected in videos; there are none so far."
        )
        + "[perception]\n"
        + _setting(
            "detector",
            defaults.detector,
            'detects people. auto: a neural network, or "background" if none is available; background: a background model,\n'
            "needs no network. Or a name that `passerby models list` prints, or the path of an .onnx file.",
        )
        + _setting(
            "embedder",
            defaults.embedder,
            'describes the appearance of people. auto: a neural network, or "stripes" if none is available; stripes: colour\n'
            "histograms of horizontal stripes, needs no network; none. Or a name, or a path.",
        )
        + _setting(
            "keypoints",
            defaults.keypoints,
            "detects keypoints of people. auto: the best network on this computer, or one that is downloaded; none. Or a\n"
            "name, or a path.",
        )
        + _setting(
            "keypoints_per_s",
            CROPS_PER_S,
            "people whose keypoints are measured, per second of video. Without it, everybody if `keypoints` names a network.",
        )
        + _setting("min_score", defaults.min_score, "detections with a lower score are dropped.")
        + _setting("tiles", defaults.tiles, "overlapping tiles in which small people are detected: auto, none, or [3, 2].")
        + _setting(
            "fps", WATCHED_FPS, "frames processed per second of video. Without it, more in videos shorter than a minute."
        )
        + _setting("models", "models", "a folder with the files of networks, for a computer without a connection.")
        + _setting(
            "lens_network",
            "fov.onnx",
            "a network of your own that sees the field of view in one image, for cameras without intrinsics.",
        )
    )


def _association() -> str:
    """Return the text of the table of association."""
    return (
        comment("How identities are associated across cameras, and how clock offsets are estimated.")
        + "[association]\n"
        + _setting(
            "mode",
            AssociationTable().mode,
            "combined: by trajectories and appearance; trajectory: by trajectories; appearance: by appearance, needs\n"
            "synchronised clocks; given: known identities, equal ids in the files of all cameras are the same person.",
        )
        + _setting(
            "max_offset_s",
            SEARCHED_S,
            "seconds, the largest clock offset between two cameras that is searched for. More if recordings were\n"
            "started by hand at different times; 0 where the cameras are synchronised.",
        )
        + _setting("sound", "auto", "clock offsets by the sound of the videos, where two cameras have any: auto, or off.")
    )


def _solver(first: str) -> str:
    """Return the text of the tables of the solver and of the world frame."""
    return (
        comment("How the poses of the cameras are computed.")
        + "[solver]\n"
        + _setting("method", SolverTable().method, "people: more accurate; geopose: the method of Xu et al., CVPR 2021.")
        + _setting("reference", first, "the reference camera, which geopose needs.")
        + _setting(
            "refine",
            SolverTable().refine,
            'what is refined besides the poses: "focal", each camera\'s focal length; "principal_point"; "clock_rate", its\n'
            'frames per second. For example ["focal"].',
        )
        + "\n"
        + comment("Options of the method, for experiments:")
        + "#[solver.options]\n#max_iterations = 60\n\n"
        + comment("The world frame: origin below this camera, x axis along its viewing direction. Others: see the manual.")
        + f"#[world]\n#camera = {value(first)}\n"
    )


def _scale(cameras: Sequence[SceneCamera]) -> str:
    """Return the text of the tables of known lengths, with examples for these cameras."""
    scale = ScaleTable()
    first, second = cameras[0], cameras[1]
    between = value([first.name, second.name])
    points = ", ".join(f"{key(camera.name)} = {_example_ends(camera)}" for camera in (first, second))
    return (
        comment(
            "Known lengths, in metres. The height of people alone determines the scale to about 4 %; one length\n"
            "measured with a tape improves that. sd_m is the standard deviation of the measurement and is optional below."
        )
        + "[scale]\n"
        + _setting("population", scale.population, '"adults", "children" or "mixed", where no mean height is stated.')
        + _setting("person_height_m", scale.person_height_m, "mean standing height of the people, with shoes.")
        + _setting("person_height_sd_m", scale.person_height_sd_m, "standard deviation of their heights.")
        + _setting("person_height_mean_sd_m", 0.07, "standard deviation of the mean; default: 4.5 % of it.")
        + "\n"
        + comment("A distance between two cameras (delete the # of all lines of an example, and fill in your values):")
        + f"#[[scale.distances]]\n#between = {between}\n#metres = 10.0\n#sd_m = 0.05\n\n"
        + comment("A camera's height above the ground that people walk on:")
        + f"#[[scale.camera_heights]]\n#camera = {value(first.name)}\n#metres = 3.0\n#sd_m = 0.05\n\n"
        + comment("The height of one person, whom a pixel of one camera names at one time of its recording:")
        + f"#[[scale.people]]\n#camera = {value(first.name)}\n#time_s = 10.0\n#at = [320, 240]\n#height_m = 1.75\n\n"
        + comment("A length between two points that two or more cameras see: the pixels of its two ends, in the same order:")
        + f"#[[scale.lengths]]\n#metres = 2.0\n#sd_m = 0.02\n#points = {{ {points} }}\n"
    )


def _example_ends(camera: SceneCamera) -> str:
    """Return two points in the lower half of a camera's image as example text."""
    width, height = camera.found.info.size if camera.found.info else (640, 480)
    return value([[float(width // 3), float(2 * height // 3)], [float(2 * width // 3), float(2 * height // 3)]])


def _setting(name: str, default: object, meaning: str) -> str:
    """Return a setting that is commented out, after its explanation."""
    return comment(f"{name}: {meaning}") + f"#{name} = {value(default)}\n"
