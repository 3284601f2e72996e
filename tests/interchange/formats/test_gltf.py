"""glTF of rig and people's ways: read back with an own parser, projected through the camera nodes, and by other readers."""

import base64
import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.common.errors import InputError
from passerby.interchange.formats import Export, export
from support.scenes.rigs_to_draw import BENT, CENTRED, FISHEYE, NASTY, rig, ways

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From the rig's world to glTF's: (x, y, z) becomes (x, z, -y)."""


class Scene:
    def __init__(self, path):
        data = path.read_bytes()
        if path.suffix == ".glb":
            magic, version, length, text, kind = struct.unpack("<4sIII4s", data[:20])
            assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
            self.content = json.loads(data[20 : 20 + text])
            size, kind = struct.unpack("<I4s", data[20 + text : 28 + text])
            assert kind == b"BIN\0"
            assert text % 4 == size % 4 == 0
            assert 28 + text + size == len(data)
            self.blob = data[28 + text :]
        else:
            self.content = json.loads(data)
            self.blob = base64.b64decode(self.content["buffers"][0]["uri"].partition(",")[2])
        assert 0 <= len(self.blob) - self.content["buffers"][0]["byteLength"] < 4
        (self.root,) = self.content["scenes"][0]["nodes"]
        self.world = {}
        self._walk(self.root, np.eye(4))

    def _walk(self, index, matrix):
        node = self.content["nodes"][index]
        assert index not in self.world
        own = np.eye(4)
        own[:3, :3] = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
        own[:3, 3] = node.get("translation", (0, 0, 0))
        self.world[index] = matrix @ own
        for child in node.get("children", ()):
            self._walk(child, matrix @ own)

    def named(self, name):
        """The node of that name, and its matrix to glTF's world."""
        (index,) = [i for i, node in enumerate(self.content["nodes"]) if node.get("name") == name]
        return self.content["nodes"][index], self.world[index]

    def values(self, index):
        accessor = self.content["accessors"][index]
        view = self.content["bufferViews"][accessor["bufferView"]]
        width = {"VEC3": 3, "SCALAR": 1}[accessor["type"]]
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        assert view["byteLength"] == 4 * width * accessor["count"]
        found = np.frombuffer(self.blob, kind, width * accessor["count"], view["byteOffset"]).reshape(-1, width)
        if width == 3:
            np.testing.assert_array_equal(found.min(axis=0), accessor["min"])
            np.testing.assert_array_equal(found.max(axis=0), accessor["max"])
        return found

    def strips(self, name):
        """(mode, places in the rig's world, times) of each stretch of a person."""
        node, matrix = self.named(name)
        found = []
        for strip in self.content["meshes"][node["mesh"]]["primitives"]:
            points = self.values(strip["attributes"]["POSITION"]) @ matrix[:3, :3].T + matrix[:3, 3]
            found.append((strip["mode"], points @ Y_UP, self.values(strip["attributes"]["_TIME_S"])[:, 0]))
        return found

    def project(self, name, points):
        """Where the camera node of that name has points of the rig's world, pixels of a picture of 640 x 480 as OpenCV's."""
        node, matrix = self.named(name)
        seen = self.content["cameras"][node["camera"]]
        assert seen["type"] == "perspective"
        x, y, z = (np.linalg.inv(matrix) @ np.column_stack([points @ Y_UP.T, np.ones(len(points))]).T)[:3]
        high = 1 / np.tan(seen["perspective"]["yfov"] / 2)
        across, up = high / seen["perspective"]["aspectRatio"] * x / -z, high * y / -z
        return np.column_stack([(across + 1) / 2 * 640 - 0.5, (1 - up) / 2 * 480 - 0.5])


@pytest.fixture(params=["gltf", "glb"])
def write(request, tmp_path):
    def written(made, trajectories=None, **options):
        path = tmp_path / f"rig.{request.param}"
        losses = export(Export(made, "hall", trajectories), request.param, path, **options)
        return Scene(path), losses

    return written


def in_view(made):
    rng = np.random.default_rng(0)
    return rng.uniform((-1, 5, 0), (2, 7, 2), (50, 3)) if made.name != "C2" else rng.uniform((-1, 4, 0), (1, 7, 1.5), (50, 3))


def test_camera_nodes_see_what_the_cameras_see(write):
    # At (1, 2, 3), looking along +y: glTF's world has it at (1, 3, -2), looking along -z with y up, which is no turn at all.
    made = rig()
    scene, losses = write(made)
    node, matrix = scene.named(NASTY)
    assert losses == ()
    np.testing.assert_allclose(matrix, [[1, 0, 0, 1], [0, 1, 0, 3], [0, 0, 1, -2], [0, 0, 0, 1]], atol=1e-12)
    perspective = scene.content["cameras"][node["camera"]]["perspective"]
    assert (perspective["yfov"], perspective["aspectRatio"]) == pytest.approx((2 * np.arctan(0.6), 0.64 / 0.6))
    for camera in made:
        pixels = camera.project(in_view(camera))
        assert np.isfinite(pixels).all()
        np.testing.assert_allclose(scene.project(camera.name, in_view(camera)), pixels, atol=1e-6)


@pytest.mark.parametrize("lens", [BENT, FISHEYE])
def test_another_lens_is_a_loss_of_the_camera_but_not_of_its_frustum(write, lens):
    made = rig(CENTRED, lens)
    with pytest.raises(InputError, match=r"camera C2: its lens .* perspective camera .* px off"):
        write(made)
    scene, (told,) = write(made, lossy=True)
    camera = made["C2"]
    bound = float(told.split("up to ")[1].split(" px")[0])
    true = {
        "size": [640, 480],
        "matrix": lens.matrix.tolist(),
        "distortions": lens.distortions.tolist(),
        "fisheye": lens.fisheye,
    }
    assert scene.named("C2")[0]["extras"] == true
    points = in_view(camera)
    miss = np.linalg.norm(scene.project("C2", points) - camera.project(points), axis=1)
    assert 0.5 < miss.max() <= bound
    frustum, matrix = scene.named("C2: what it sees")
    (lines, faces) = scene.content["meshes"][frustum["mesh"]]["primitives"]
    assert (lines["mode"], faces["mode"]) == (1, 4)
    rim = scene.values(lines["attributes"]["POSITION"])[1:-3] @ matrix[:3, :3].T + matrix[:3, 3]
    corners = [[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]]
    np.testing.assert_allclose(camera.project(rim[::8] @ Y_UP), corners, atol=2e-3)
    for part in (lines, faces):
        assert scene.values(part["indices"]).max() < len(rim) + 4


def test_an_axis_off_the_middle_is_a_loss(write):
    shifted = type(CENTRED)(CENTRED.size, CENTRED.matrix + np.array([[0, 0, 10], [0, 0, 0], [0, 0, 0]]), np.zeros(0))
    _, (told,) = write(rig(CENTRED, shifted), lossy=True)
    assert 9 < float(told.split("up to ")[1].split(" px")[0]) < 12


def test_ways_are_whole_and_everything_hangs_below_the_turned_root(write):
    found = ways()
    scene, _ = write(rig(), found)
    strips = scene.strips("person 3")
    assert [mode for mode, _, _ in strips] == [3, 0]  # a line strip, and a place by itself
    np.testing.assert_allclose(np.vstack([points for _, points, _ in strips]), found.xyz[:4], atol=1e-6)
    np.testing.assert_allclose(np.concatenate([times for _, _, times in strips]), found.time_s[:4], atol=1e-5)
    ((mode, points, _),) = scene.strips("person 11")
    assert mode == 3
    np.testing.assert_allclose(points, found.xyz[4:], atol=1e-6)
    assert set(scene.world) == set(range(len(scene.content["nodes"])))
    np.testing.assert_allclose(scene.world[scene.root][:3, :3], Y_UP, atol=1e-12)
    assert scene.content["asset"]["version"] == "2.0"
    ground, matrix = scene.named("ground, 1 m")
    points = scene.values(scene.content["meshes"][ground["mesh"]]["primitives"][0]["attributes"]["POSITION"])
    np.testing.assert_allclose((points @ matrix[:3, :3].T)[:, 1], 0, atol=1e-6)


def test_trimesh_opens_it(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed: pip install trimesh")
    export(Export(rig(), "hall", ways()), "glb", tmp_path / "rig.glb")
    scene = trimesh.load(tmp_path / "rig.glb")
    matrix, _ = scene.graph["C2: what it sees"]
    np.testing.assert_allclose(matrix[:3, 3], Y_UP @ rig()["C2"].centre, atol=1e-6)
    # What trimesh draws reaches from below the ground's grid to the top of the frusta.
    assert scene.bounds[0][1] == pytest.approx(0, abs=1e-6)
    assert scene.bounds[1][1] > 4
