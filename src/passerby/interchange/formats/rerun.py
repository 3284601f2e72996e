"""Rerun recordings, `.rrd`: cameras, ground, and people over time, for the Rerun viewer. Needs the extra `passerby[rerun]`.

The world is `/world`, right-handed with z up, metres. `/world/cameras/NAME` is a `Transform3D` (from the camera to its parent)
with a `Pinhole` (OpenCV's axes: x right, y down, z forward). Rerun's viewer has (0, 0) at the edge of the first pixel, OpenCV
at its centre, so the principal point is half a pixel more than in the rig. A pinhole has no distortion and no skew: such a
lens is a loss, and the nearest pinhole is written; `/world/frusta/NAME` is drawn through the true lens.
`/world/camera_sigmas/NAME` is the ellipsoid of one sigma of the camera's position, where the rig knows it.

`/world/ways/person N` are the stretches of a person's trajectory as line strips; on the timelines `time` (the rig's time,
seconds) and `frame` (of the first camera's clock), `/world/people/person N` is the person's position and
`/world/people_sigmas/person N` one sigma of it on the ground. A person is only drawn at times at which the position is known.

https://rerun.io/docs/reference/types; the tracker (#3896) states that the viewer's pixels begin at their edge. Recordings
contain random identifiers of their parts, so two recordings of one rig are not the same bytes.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, PoseSigma
from passerby.core.trajectories import Trajectories
from passerby.interchange.formats.drawing import GROUND_COLOUR, Drawing, Frustum, Way, draw
from passerby.interchange.formats.format import Export, Format, Losses
from passerby.interchange.formats.lens_models import PINHOLE, express_lens

APPLICATION = "passerby"
HALF_A_PIXEL = 0.5
PERSON_RADIUS_M, LINE_RADIUS_M = 0.12, 0.01
FLAT_M = 0.005
"""Half the height of the ellipsoid of a position on the ground."""


def write(rig: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as a Rerun recording. A camera without a pose, and a lens that is no pinhole, are losses.

    Raises `InputError` where rerun-sdk is not installed.
    """
    try:
        rr: Any = import_module("rerun")
    except ImportError:
        raise InputError("format rerun needs the package rerun-sdk: pip install 'passerby[rerun]'") from None
    posed = rig.posed(losses)
    drawing = draw(posed, rig.trajectories)
    # Without properties, which contain the time of writing.
    recording = rr.RecordingStream(APPLICATION, recording_id=_identifier(rig), send_properties=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.rrd"
        recording.save(path)
        recording.send_recording_name(rig.name)
        _log(recording, ["world"], rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        _log_ground(rr, recording, drawing)
        for frustum in drawing.frusta:
            _log_camera(rr, recording, frustum, losses)
        for way in drawing.ways:
            assert rig.trajectories is not None
            _log_person(rr, recording, way, rig.trajectories)
        recording.flush()
        recording.disconnect()
        return {"": path.read_bytes()}


def _identifier(rig: Export) -> str:
    """Compute a recording's identifier from the rig's name and poses. The viewer merges recordings with equal identifiers."""
    told = hashlib.sha256(rig.name.encode("utf-8", "replace"))
    for camera in rig.rig:
        told.update(camera.name.encode("utf-8", "replace"))
        if camera.pose is not None:
            told.update(camera.pose.R_cw.tobytes() + camera.pose.t_cw.tobytes())
    return told.hexdigest()[:32]


def _log(recording: Any, path: list[str], what: Any) -> None:
    """Log `what` at a path for all times; names in the path are escaped. Without `strict`, Rerun only warns of mistakes."""
    recording.log(path, what, static=True, strict=True)


def _log_ground(rr: Any, recording: Any, drawing: Drawing) -> None:
    lines = rr.LineStrips3D(drawing.ground, colors=GROUND_COLOUR, radii=LINE_RADIUS_M / 2)
    _log(recording, ["world", f"ground, {drawing.spacing_m:g} m"], lines)


def _log_camera(rr: Any, recording: Any, frustum: Frustum, losses: Losses) -> None:
    """Log a camera, its true frustum and its sigma."""
    camera = frustum.camera
    lens, _ = express_lens(camera, (PINHOLE,), losses, " (Rerun has no other; the lines of its frustum keep the true lens)")
    matrix = np.array(lens.matrix)
    matrix[:2, 2] += HALF_A_PIXEL
    path = ["world", "cameras", camera.name]
    _log(recording, path, rr.Transform3D(translation=frustum.pose.centre, mat3x3=frustum.pose.R_cw.T))
    pinhole = rr.Pinhole(
        image_from_camera=matrix, resolution=lens.size, camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=float(frustum.rim[:, 2].max()),
    )  # fmt: skip
    _log(recording, path, pinhole)
    points = frustum.world
    strips = [points[edge] for edge in frustum.edges]
    _log(recording, ["world", "frusta", camera.name], rr.LineStrips3D(strips, colors=frustum.colour, radii=LINE_RADIUS_M))
    if camera.sigma is not None and math.isfinite(camera.sigma.position_m + camera.sigma.orientation_deg):
        half_sizes, turn = _ellipsoid(camera.sigma)
        shape = rr.Ellipsoids3D(
            centers=[frustum.pose.centre], half_sizes=[half_sizes], quaternions=[rr.Quaternion(xyzw=turn)],
            colors=[frustum.colour], labels=[_describe_clock(camera)],
        )  # fmt: skip
        _log(recording, ["world", "camera_sigmas", camera.name], shape)


def _describe_clock(camera: Camera) -> str:
    assert camera.sigma is not None
    return f"{camera.name}: {1000 * camera.sigma.position_m:.0f} mm, {camera.sigma.orientation_deg:.2f} degrees"


def _ellipsoid(sigma: PoseSigma) -> tuple[Floats, Floats]:
    """Compute the one-sigma ellipsoid of a position: its half axes (3,), metres, and its rotation (4,), x, y, z, w."""
    if sigma.covariance is None:
        return np.full(3, sigma.position_m / math.sqrt(3)), np.array([0.0, 0.0, 0.0, 1.0])
    squares, axes = np.linalg.eigh(np.asarray(sigma.covariance)[:3, :3])
    axes = axes * np.sign(np.linalg.det(axes))
    return np.sqrt(np.maximum(squares, 0.0)), np.asarray(Rotation.from_matrix(axes).as_quat())


def _log_person(rr: Any, recording: Any, way: Way, found: Trajectories) -> None:
    """Log a person's trajectory as a whole, and each position at its time."""
    name = f"person {way.identity}"
    strips = [way.xyz[part] for part in way.parts if part.stop - part.start > 1]
    if strips:
        _log(recording, ["world", "ways", name], rr.LineStrips3D(strips, colors=way.colour, radii=LINE_RADIUS_M))
    # An empty entry one instant after each stretch: without it, the last position would stay visible.
    rows = [row for part in way.parts for row in (*range(part.start, part.stop), None)]
    ends = iter([part.stop - 1 for part in way.parts])
    seconds = np.array([way.time_s[next(ends)] + 1 / found.clock.fps if row is None else way.time_s[row] for row in rows])
    times = [
        rr.TimeColumn("time", duration=seconds),
        rr.TimeColumn("frame", sequence=np.rint(found.clock.frames(seconds)).astype(np.int64)),
    ]
    here = [row for row in rows if row is not None]
    points = rr.Points3D.columns(positions=way.xyz[here])
    path = ["world", "people", name]
    present = points.partition([int(row is not None) for row in rows])
    recording.send_columns(rr.new_entity_path(path), times, present, strict=True)
    looks = rr.Points3D.from_fields(colors=way.colour, radii=PERSON_RADIUS_M, labels=name)
    _log(recording, path, looks)
    _log_sigmas(rr, recording, way, rows, times)


def _log_sigmas(rr: Any, recording: Any, way: Way, rows: Sequence[int | None], times: list[Any]) -> None:
    """Log one sigma of each position on the ground, where it is known."""
    known = [row is not None and bool(np.isfinite(way.sigma_m[row])) for row in rows]
    here = [row for row, is_known in zip(rows, known, strict=True) if is_known and row is not None]
    if not here:
        return
    across = way.sigma_m[here] / math.sqrt(2)
    path = ["world", "people_sigmas", f"person {way.identity}"]
    centres = np.column_stack([way.xyz[here, :2], np.full(len(here), FLAT_M)])
    half_sizes = np.column_stack([across, across, np.full(len(here), FLAT_M)])
    shapes = rr.Ellipsoids3D.columns(centers=centres, half_sizes=half_sizes)
    present = shapes.partition([int(is_known) for is_known in known])
    recording.send_columns(rr.new_entity_path(path), times, present, strict=True)
    _log(recording, path, rr.Ellipsoids3D.from_fields(colors=way.colour))


FORMAT = Format(
    name="rerun",
    title="Recording of cameras, and of people over time, for the Rerun viewer",
    tools=("Rerun",),
    target="file",
    suffixes=(".rrd",),
    conventions=(
        "A drawing of the rig, not read back; needs passerby[rerun]. World right-handed, z up, metres. A camera is a "
        "Transform3D from its frame to the world and a Pinhole with OpenCV's axes; pixels begin at the edge of the first "
        "one, so the principal point is half a pixel more than in the rig. A pinhole has no distortion and no skew: another "
        "lens is a loss (of the camera, not of the lines of its frustum). People are points on the timelines time (seconds) "
        "and frame, with their trajectories as line strips; ellipsoids show the sigmas of cameras and positions."
    ),
    write=write,
)
