"""What every value that a reader gives must be like, whatever file it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import UNKNOWN, Boxes, Clock, Keypoints
from passerby.core.scale_cues import KnownPoint, KnownPosition
from passerby.core.trajectories import Trajectories
from passerby.datasets.published import GroundTruth, Published
from passerby.interchange.formats import People
from passerby.interchange.formats.tsai import TsaiCamera
from passerby.interchange.motchallenge import Embeddings
from passerby.interchange.opencv_lens import StoredLens
from passerby.interchange.output_folder import OutputFolder
from passerby.interchange.trajectories_csv import GroundPositions
from passerby.perception.video_probe import VideoInfo
from passerby.scene.scene import Scene


def check(value: Any) -> None:
    """Raise `AssertionError` unless a value keeps what its type promises; tables and lists are looked into."""
    for kind, promise in PROMISES.items():
        if isinstance(value, kind):
            promise(value)
            return
    if isinstance(value, Mapping):
        for inner in value.values():
            check(inner)
    elif isinstance(value, tuple | list):
        for inner in value:
            check(inner)
    elif isinstance(value, np.ndarray):
        assert value.dtype.kind in "biuf", value.dtype


def finite(values: Any) -> None:
    """All numbers are finite."""
    assert np.isfinite(np.asarray(values, dtype=np.float64)).all(), values


def _lens(lens: Lens) -> None:
    assert min(lens.size) >= 1
    finite(lens.matrix)
    finite(lens.distortions)
    assert lens.matrix[0, 0] > 0
    assert lens.matrix[1, 1] > 0


def _pose(pose: Pose) -> None:
    finite(pose.t_cw)
    assert np.allclose(pose.R_cw @ pose.R_cw.T, np.eye(3), atol=1e-3), pose.R_cw
    assert np.linalg.det(pose.R_cw) > 0


def _camera(camera: Camera) -> None:
    assert isinstance(camera.name, str)
    assert camera.name
    _lens(camera.lens)
    if camera.pose is not None:
        _pose(camera.pose)
    if camera.sigma is not None:
        sigmas = [camera.sigma.position_m, camera.sigma.orientation_deg]
        # A file that leaves out one of the two says that nothing fixes it: that one is infinite, and there is no covariance.
        finite([sigma for sigma in sigmas if sigma != np.inf])
        assert min(sigmas) >= 0
        assert min(sigmas) < np.inf
        assert np.isfinite(sigmas).all() or camera.sigma.covariance is None


def _rig(rig: Rig) -> None:
    assert len(set(rig.names)) == len(rig) > 0
    for camera in rig:
        _camera(camera)


def _stored(lens: StoredLens) -> None:
    _lens(lens.lens(lens.size or (640, 480)))


def _boxes(boxes: Boxes) -> None:
    finite(boxes.ltwh)
    finite(boxes.score)
    assert (boxes.ltwh[:, 2:] > 0).all()
    assert (boxes.identity >= UNKNOWN).all()
    assert (boxes.frame >= 0).all()


def _keypoints(keypoints: Keypoints) -> None:
    finite(keypoints.xy)
    assert ((keypoints.score >= 0) & (keypoints.score <= 1)).all()
    assert (keypoints.identity >= UNKNOWN).all()
    assert (keypoints.frame >= 0).all()
    assert len(set(keypoints.joints)) == len(keypoints.joints)


def _people(people: People) -> None:
    _boxes(people.boxes)
    _keypoints(people.keypoints)
    assert all(isinstance(note, str) for note in people.notes)


def _embeddings(found: Embeddings) -> None:
    length = np.linalg.norm(found.vectors, axis=1)
    assert (np.isclose(length, 1, atol=1e-3) | (length == 0)).all()
    assert found.frame is None or found.frame.shape == (len(found),)


def _trajectories(found: Trajectories) -> None:
    finite(found.xyz)
    finite(found.time_s)
    assert len(found.identity) == len(found.frame) == len(found.time_s) == len(found.part) > 0
    _clock(found.clock)


def _positions(found: GroundPositions) -> None:
    finite(found.xy)
    assert found.frame.shape == found.identity.shape == (len(found.xy),)


def _clock(clock: Clock) -> None:
    assert clock.fps > 0
    finite([clock.fps, clock.offset_s])


def _scene(scene: Scene) -> None:
    assert len(scene.cameras) > 1
    scene.scale_cues()
    assert scene.size_bytes >= 0
    assert all(fps is None or 0 < fps < math.inf for fps in map(scene.fps_of, scene.cameras))


def _output(found: OutputFolder) -> None:
    assert found.verdict in ("accepted", "doubtful")
    _rig(found.rig)
    assert set(found.boxes) == set(found.rig.names)
    check(dict(found.boxes))
    check(dict(found.clocks))
    for figure in (found.fps, found.person_height_m):
        assert figure is None or 0 < figure < math.inf


def _video(info: VideoInfo) -> None:
    assert min(info.size) >= 1
    assert 0 < info.clock_fps < math.inf
    assert 0 < info.average_fps < math.inf
    assert info.frames is None or info.frames >= 0


def _point(point: KnownPoint) -> None:
    finite(point.xyz)
    finite(list(point.pixels.values()))
    assert point.sd_m > 0


def _position(position: KnownPosition) -> None:
    finite(position.place[:2])
    assert not np.isinf(position.place).any()
    assert position.sd_m > 0


def _truth(truth: GroundTruth) -> None:
    finite(truth.xy)


def _published(published: Published) -> None:
    _rig(published.rig)
    check(dict(published.boxes))


PROMISES: Mapping[type, Callable[[Any], None]] = {
    Rig: _rig, Camera: _camera, Lens: _lens, StoredLens: _stored, Boxes: _boxes, Keypoints: _keypoints, People: _people,
    Embeddings: _embeddings, Trajectories: _trajectories, GroundPositions: _positions, Clock: _clock, Scene: _scene,
    OutputFolder: _output, VideoInfo: _video, KnownPoint: _point, KnownPosition: _position, GroundTruth: _truth,
    Published: _published, TsaiCamera: lambda camera: _pose(camera.pose),
}  # fmt: skip
