"""PLY of rig and people's ways: read back with an own parser, and by other readers where they are installed."""

import json
import re

import numpy as np
import pytest

from passerby.core.colours import camera_colour, person_colour
from passerby.interchange.formats import Export, export
from support.scenes.rigs_to_draw import BENT, FISHEYE, NASTY, SKEWED, rig, ways

TYPES = {"float": "<f4", "uchar": "u1", "int": "<i4"}
CORNERS = [[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]]


def parsed(data):
    """The comments, and the elements as record arrays; every byte has to be used."""
    header, _, body = data.partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    elements, comments, tables, at = {}, [], {}, 0
    for line in lines[2:]:
        kind, _, rest = line.partition(" ")
        words = rest.split()
        if kind == "comment":
            comments.append(rest)
        elif kind == "element":
            name = words[0]
            elements[name] = (int(words[1]), [])
        elif words[0] == "list":
            elements[name][1].extend([("n", "u1"), (words[3], "<i4", (3,))])
        else:
            elements[name][1].append((words[1], TYPES[words[0]]))
    for name, (count, fields) in elements.items():
        record = np.dtype(fields)
        tables[name] = np.frombuffer(body, record, count, at)
        at += count * record.itemsize
    assert at == len(body)
    return comments, tables


def drawn(folder, made, trajectories=None):
    """The tables of a file, and where its vertices are."""
    assert export(Export(made, "ha\nll", trajectories), "ply", folder / "rig.ply") == ()
    comments, tables = parsed((folder / "rig.ply").read_bytes())
    vertex = tables["vertex"]
    edges = np.column_stack([tables["edge"]["vertex1"], tables["edge"]["vertex2"]])
    return comments, vertex, places(vertex), tables["face"], edges


def places(table):
    return np.column_stack([table["x"], table["y"], table["z"]]).astype(float)


@pytest.mark.parametrize(("lens", "border"), [(SKEWED, 4), (BENT, 32), (FISHEYE, 32)])
def test_frusta_end_at_the_pictures_border_through_the_true_lens(tmp_path, lens, border):
    made = rig(lens, lens)
    _, vertex, place, _, _ = drawn(tmp_path, made)
    for index, camera in enumerate(made):
        points = place[vertex["camera"] == index]
        assert len(points) == 1 + border + 3
        np.testing.assert_allclose(points[0], camera.centre, atol=1e-6)
        pixels = camera.project(points[1 : 1 + border])
        np.testing.assert_allclose(pixels[:: border // 4], CORNERS, atol=2e-3)
        on_border = (np.abs(pixels - (-0.5, -0.5)) < 2e-3) | (np.abs(pixels - (639.5, 479.5)) < 2e-3)
        assert on_border.any(axis=1).all()
        # The triangle is above the picture: higher than its upper edge, in front of the camera.
        assert camera.project(points[-1:])[0, 1] < -1


def test_a_level_camera_has_the_frustum_and_the_name_that_it_has_by_hand(tmp_path):
    # Twin cameras 9.3 m apart have frusta 0.15 times as deep; the picture is 640 / 500 as wide as it is deep, 480 / 400 high.
    comments, vertex, place, _, _ = drawn(tmp_path, rig())
    depth = 0.15 * np.linalg.norm(np.array([1, 2, 3]) - (0, 10, 4))
    left, right, top, bottom = (np.array([-0.64, 0.64, 0.6, -0.6]) * depth).tolist()
    corners = [[1 + x, 2 + depth, 3 + z] for x, z in ((left, top), (right, top), (right, bottom), (left, bottom))]
    np.testing.assert_allclose(place[vertex["camera"] == 0][1:5], corners, atol=1e-5)
    assert comments[1] == 'scene "ha\\nll"'
    name = re.fullmatch(r"camera 0 (\".*\") (#\w+)", comments[2])
    assert (json.loads(name[1]), name[2], comments[3]) == (NASTY, camera_colour(0), f'camera 1 "C2" {camera_colour(1)}')
    # A fisheye that sees behind itself has a frustum too.
    wide = type(FISHEYE)((640, 480), np.array([[110.0, 0, 319], [0, 110, 241], [0, 0, 1]]), np.zeros(4), fisheye=True)
    assert np.isfinite(drawn(tmp_path, rig(wide, wide))[2]).all()


def test_ways_are_whole_and_in_their_colours_above_the_ground(tmp_path):
    found = ways()
    _, vertex, place, face, edges = drawn(tmp_path, rig(BENT, FISHEYE), found)
    for person in (3, 11):
        rows, mine = vertex["person"] == person, found.identity == person
        np.testing.assert_allclose(place[rows], found.xyz[mine], atol=1e-6)
        np.testing.assert_allclose(vertex["time_s"][rows], found.time_s[mine], atol=1e-5)
        colour = "#{:02x}{:02x}{:02x}".format(*[int(vertex[name][rows][0]) for name in ("red", "green", "blue")])
        assert colour == person_colour(person)
    steps = vertex[edges][vertex["person"][edges[:, 0]] >= 0]
    # Two steps of person 3, none over the gap; one of person 11.
    assert steps["person"].tolist() == [[3, 3], [3, 3], [11, 11]]
    np.testing.assert_allclose(steps["time_s"], [[0.25, 0.35], [0.35, 0.45], [0.65, 0.75]], atol=1e-6)
    # Faces and edges are of one thing each.
    assert (face["n"] == 3).all()
    assert face["vertex_indices"].min() >= 0
    assert face["vertex_indices"].max() < len(vertex)
    for column in ("camera", "person"):
        for ends in (face["vertex_indices"], edges):
            assert (np.ptp(vertex[column][ends], axis=1) == 0).all()
    ground, others = place[(vertex["camera"] < 0) & (vertex["person"] < 0)], place[vertex["person"] >= 0]
    assert (ground[:, 2] == 0).all()
    assert (ground.min(axis=0) < others.min(axis=0)).all()
    assert (ground.max(axis=0)[:2] > others.max(axis=0)[:2]).all()


def test_two_faces_make_a_band_of_the_ground(tmp_path):
    """Side by side, not one upon the other: together they are as wide and as long as their corners are apart."""
    _, vertex, point, face, _ = drawn(tmp_path, rig())
    corners = face["vertex_indices"]
    ground = (vertex["camera"][corners] < 0).all(axis=1)
    assert np.count_nonzero(ground) >= 8
    _, band = np.unique(corners[ground].min(axis=1), return_inverse=True)
    for one in np.unique(band):
        faces = corners[ground][band == one]
        ends = np.unique(faces)
        assert (faces.shape, len(ends)) == ((2, 3), 4)
        np.testing.assert_allclose(point[faces].mean(axis=(0, 1)), point[ends].mean(axis=0), atol=1e-5)
        assert np.ptp(point[ends][:, :2], axis=0).min() > 1e-4


def test_other_readers_open_it(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed: pip install trimesh")
    _, vertex, place, face, _ = drawn(tmp_path, rig(BENT), ways())
    mesh = trimesh.load(tmp_path / "rig.ply", process=False)
    assert len(mesh.faces) == len(face)
    np.testing.assert_allclose(mesh.vertices, place, atol=1e-6)
    colours = np.column_stack([vertex[name] for name in ("red", "green", "blue")])
    np.testing.assert_array_equal(np.asarray(mesh.visual.vertex_colors)[:, :3], colours)
