"""Rerun recordings: what is in them, read back by Rerun's own reader where it is installed."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.interchange.formats import Export, export
from support.scenes.rigs_to_draw import ALONG_Y, BENT, CENTRED, FISHEYE, NASTY, rig, ways

OFF_CENTRE = Lens((640, 480), np.array([[500.0, 0, 330], [0, 480, 230], [0, 0, 1]]), np.zeros(0))


@pytest.fixture
def reader():
    return pytest.importorskip("rerun.chunk", reason="no rerun-sdk that reads recordings: pip install 'passerby[rerun]'")


@pytest.fixture
def written(reader, tmp_path):
    """The components of a recording by entity, and the rows over time."""

    def write(made, trajectories=None, **options):
        path = tmp_path / "rig.rrd"
        losses = export(Export(made, NASTY, trajectories), "rerun", path, **options)
        static, timed = {}, {}
        for chunk in reader.RrdReader(path).stream():
            batch = chunk.to_record_batch()
            columns = {name: batch.column(name) for name in batch.schema.names}
            (static if chunk.is_static else timed).setdefault(chunk.entity_path, {}).update(columns)
        return static, timed, losses

    return write


def values(columns, component):
    """The numbers of a component of a static entity, flattened."""
    (found,) = [column for name, column in columns.items() if name.split(":")[-1] == component]
    flat = found
    while hasattr(flat, "flatten") and str(flat.type).startswith(("list", "fixed_size_list")):
        flat = flat.flatten()
    return np.asarray(flat.to_pylist(), dtype=float)


def test_a_level_camera_by_hand(written):
    made = Rig((Camera("C1", OFF_CENTRE, Pose.from_centre(ALONG_Y, np.array([1.0, 2.0, 3.0]))),))
    static, _, losses = written(made)
    camera = static["/world/cameras/C1"]
    assert losses == ()
    np.testing.assert_allclose(values(camera, "translation"), (1, 2, 3))
    # Stored by columns: the camera's x, y and z axis in the world.
    np.testing.assert_allclose(values(camera, "mat3x3"), (1, 0, 0, 0, 0, -1, 0, 1, 0), atol=1e-7)
    np.testing.assert_allclose(values(camera, "image_from_camera"), (500, 0, 0, 0, 480, 0, 330.5, 230.5, 1))
    np.testing.assert_allclose(values(camera, "resolution"), (640, 480))
    rdf, right_hand_z_up = (3, 2, 5), (3, 5, 1)  # Rerun's codes: up 1, down 2, right 3, left 4, forward 5, back 6
    assert (tuple(values(camera, "camera_xyz")), tuple(values(static["/world"], "xyz"))) == (rdf, right_hand_z_up)


@pytest.mark.parametrize("lens", [BENT, FISHEYE])
def test_another_lens_is_a_loss_of_the_pinhole_but_not_of_the_frustum(written, lens):
    made = rig(CENTRED, lens)
    with pytest.raises(InputError, match=r"camera C2: its lens .* is fitted by a pinhole .* px off"):
        written(made)
    static, _, (told,) = written(made, lossy=True)
    assert "C2" in told
    ends = values(static["/world/frusta/C2"], "strips").reshape(-1, 2, 3)
    corners = [[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]]
    np.testing.assert_allclose(ends[:4, 0], np.tile(made["C2"].centre, (4, 1)), atol=1e-6)
    np.testing.assert_allclose(made["C2"].project(ends[:4, 1]), corners, atol=2e-3)


def test_people_come_and_go_with_time(written):
    found = ways()
    _, timed, _ = written(rig(), found)
    person = timed["/world/people/person\\ 3"]
    (positions,) = [column for name, column in person.items() if name.endswith("positions")]
    seconds = np.array([moment.value for moment in person["time"]]) / 1e9
    frames = np.array(person["frame"].to_pylist())
    there = [len(row) for row in positions.to_pylist()]
    # Three places and none, one place and none.
    assert (there, frames.tolist()) == ([1, 1, 1, 0, 1, 0], [1, 2, 3, 4, 60, 61])
    np.testing.assert_allclose(seconds, found.clock.seconds(frames.astype(float)), atol=1e-6)
    np.testing.assert_allclose([row[0] for row in positions.to_pylist() if row], found.xyz[:4], atol=1e-6)
    sigmas = timed["/world/people_sigmas/person\\ 3"]
    (half_sizes,) = [column for name, column in sigmas.items() if name.endswith("half_sizes")]
    assert [len(row) for row in half_sizes.to_pylist()] == [1, 0, 1, 0, 1, 0]  # the second place has no sigma
    np.testing.assert_allclose(half_sizes.to_pylist()[2][0][:2], [0.2 / np.sqrt(2)] * 2, rtol=1e-6)
    # Single places without sigmas are points alone.
    static, timed, _ = written(rig(), replace(found, sigma_m=np.full(6, np.nan), part=np.arange(6)))
    assert len([name for name in timed if name.startswith("/world/people/")]) == 2
    assert not [name for name in (*static, *timed) if "/ways/" in name or "/people_sigmas/" in name]
    # A name is one part of a path.
    (path,) = [path for path in static if path.startswith("/world/cameras/") and not path.endswith("C2")]
    assert "script" in path
    assert path.replace("\\/", "").count("/") == 3


def test_sigmas_are_ellipsoids(written):
    covariance = np.diag([0.04, 0.01, 0.09, 1, 1, 1]) * 1e-2
    cameras = list(rig())
    cameras[0] = replace(cameras[0], name="C1", sigma=PoseSigma(0.3, 0.1))
    cameras[1] = replace(cameras[1], sigma=PoseSigma(0.037, 0.1, covariance))
    static, _, _ = written(Rig(tuple(cameras)))
    np.testing.assert_allclose(values(static["/world/camera_sigmas/C1"], "half_sizes"), [0.3 / np.sqrt(3)] * 3, rtol=1e-6)
    ball = static["/world/camera_sigmas/C2"]
    np.testing.assert_allclose(values(ball, "half_sizes"), (0.01, 0.02, 0.03), rtol=1e-5)
    axes = Rotation.from_quat(values(ball, "quaternions")).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(values(ball, "half_sizes") ** 2) @ axes.T, covariance[:3, :3], atol=1e-8)


def test_without_the_package_the_error_names_the_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"pip install 'passerby\[rerun\]'"):
        export(Export(rig()), "rerun", tmp_path / "rig.rrd")
    assert not (tmp_path / "rig.rrd").exists()
