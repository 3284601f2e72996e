"""PLY: the rig, the ground and people's trajectories as coloured points, lines and faces, for viewers.

World as in the rig: right-handed, z up, ground at z = 0, metres. Cameras are pyramids from their centre to the border of their
picture, drawn through their own lens with its distortion. The ground is a grid of faces, because some viewers draw no lines.
Each position of each person is a point of the person's colour, x and y on the ground and z in the middle of the body;
positions of one stretch are joined by edges. The properties `camera` and `person` of a vertex are the camera's index in the rig
and the person's identity, -1 for none; `time_s` is the rig's time at a person's position. Comments in the header name the
cameras, as JSON strings.

G. Turk, "The PLY Polygon File Format", 1994; binary, little-endian, version 1.0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.interchange.formats.drawing import GROUND_COLOUR, Colour, Drawing, Frustum, Way, draw
from passerby.interchange.formats.format import Export, Format, Losses

NOBODY = -1
LINE_SHARE = 0.02
"""Width of the ground's lines as a share of the distance between them."""
VERTEX = np.dtype([
    ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"),
    ("camera", "<i4"), ("person", "<i4"), ("time_s", "<f4"),
])  # fmt: skip
FACE = np.dtype([("count", "u1"), ("vertices", "<i4", (3,))])
EDGE = np.dtype([("vertex1", "<i4"), ("vertex2", "<i4")])
_NAMES = {"<f4": "float", "|u1": "uchar", "<i4": "int"}


def write(rig: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as PLY. Cameras without a pose are losses."""
    drawing = draw(rig.posed(losses), rig.trajectories)
    parts = _Parts()
    for index, frustum in enumerate(drawing.frusta):
        parts.add(frustum.world, frustum.colour, camera=index, faces=frustum.faces, edges=frustum.edges)
    corners, faces = _ground(drawing)
    parts.add(corners, GROUND_COLOUR, faces=faces)
    for way in drawing.ways:
        parts.add(way.xyz, way.colour, person=way.identity, time_s=way.time_s, edges=_list_steps(way))
    return {"": parts.file(_comments(rig.name, drawing.frusta))}


class _Parts:
    """The vertices, faces and edges of a file while they are gathered."""

    def __init__(self) -> None:
        self._vertices: list[NDArray[np.void]] = []
        self._faces: list[NDArray[np.int64]] = [np.zeros((0, 3), dtype=np.int64)]
        self._edges: list[NDArray[np.int64]] = [np.zeros((0, 2), dtype=np.int64)]
        self._count = 0

    def add(
        self,
        points: Floats,
        colour: Colour,
        *,
        camera: int = NOBODY,
        person: int = NOBODY,
        time_s: Floats | float = 0.0,
        faces: NDArray[np.int64] | None = None,
        edges: NDArray[np.int64] | None = None,
    ) -> None:
        """Add points (N, 3) in the world frame, with faces and edges as indices into them."""
        rows = np.zeros(len(points), dtype=VERTEX)
        for axis, name in enumerate("xyz"):
            rows[name] = points[:, axis]
        for name, value in zip(("red", "green", "blue"), colour, strict=True):
            rows[name] = value
        rows["camera"], rows["person"], rows["time_s"] = camera, person, time_s
        self._vertices.append(rows)
        if faces is not None:
            self._faces.append(faces + self._count)
        if edges is not None:
            self._edges.append(edges + self._count)
        self._count += len(points)

    def file(self, comments: list[str]) -> bytes:
        """Format the whole file."""
        vertices, ends = np.concatenate(self._vertices), np.vstack(self._edges)
        corners = np.vstack(self._faces)
        faces, edges = np.zeros(len(corners), dtype=FACE), np.zeros(len(ends), dtype=EDGE)
        faces["count"], faces["vertices"] = 3, corners
        edges["vertex1"], edges["vertex2"] = ends.T
        header = [
            "ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments),
            f"element vertex {len(vertices)}", *_properties(VERTEX),
            f"element face {len(faces)}", "property list uchar int vertex_indices",
            f"element edge {len(edges)}", *_properties(EDGE), "end_header",
        ]  # fmt: skip
        return "\n".join(header).encode("ascii") + b"\n" + vertices.tobytes() + faces.tobytes() + edges.tobytes()


def _properties(record: np.dtype[np.void]) -> list[str]:
    """Return the header's lines for the fields of a record."""
    return [f"property {_NAMES[record[name].str]} {name}" for name in record.names or ()]


def _comments(name: str, frusta: tuple[Frustum, ...]) -> list[str]:
    """Return the header's comments. Names are JSON strings in ASCII, so that no name can end its line or the header."""
    colours = ["#{:02x}{:02x}{:02x}".format(*frustum.colour) for frustum in frusta]
    return [
        "metres; z up; ground at z = 0",
        f"scene {json.dumps(name)}",
        *(f"camera {i} {json.dumps(f.camera.name)} {colours[i]}" for i, f in enumerate(frusta)),
    ]


def _ground(drawing: Drawing) -> tuple[Floats, NDArray[np.int64]]:
    """Compute corners (4 L, 3) and faces (2 L, 3) of the grid's L lines as narrow bands."""
    half = LINE_SHARE * drawing.spacing_m / 2
    along = drawing.ground[:, 1] - drawing.ground[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = half * np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    a, b = drawing.ground[:, 0], drawing.ground[:, 1]
    corners = np.stack([a - across, b - across, b + across, a + across], axis=1).reshape(-1, 3)
    first = 4 * np.arange(len(a))[:, None]
    return corners, np.vstack([first + [0, 1, 2], first + [0, 2, 3]])


def _list_steps(way: Way) -> NDArray[np.int64]:
    """Return the edges (E, 2) between consecutive positions of a trajectory, without edges over long gaps."""
    rows = [np.arange(part.start, part.stop) for part in way.parts]
    return np.vstack([np.column_stack([row[:-1], row[1:]]) for row in rows])


FORMAT = Format(
    name="ply",
    title="Rig, ground and trajectories of people as coloured points, lines and faces",
    tools=("MeshLab", "CloudCompare", "Blender"),
    target="file",
    suffixes=(".ply",),
    conventions=(
        "A drawing of the rig, not read back. World as in the rig (right-handed, z up, ground at z = 0), metres. Cameras are "
        "pyramids drawn through their own lens: distortion and skew are no loss. People's positions are points in the "
        "person's colour at the height of the body centre, joined by edges; the vertex properties camera and person name the "
        "owner of a point (-1: none), time_s its time."
    ),
    write=write,
    draws_people=True,
)
