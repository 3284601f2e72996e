"""glTF 2.0: the rig, the ground and people's trajectories as a scene; `.gltf` (JSON with the data inside) or `.glb` (binary).

glTF's world is right-handed with y up; a camera looks along its -z with y up in the picture. A root node turns the rig's world
(z up) by -90 degrees about x; below it everything has the rig's own coordinates, metres. Each camera is a node with its name
and a perspective camera (vertical field of view, aspect ratio); beside it is its frustum as a mesh, drawn through its true
lens. glTF's perspective camera has its axis in the centre of the picture and no distortion. A different lens is a loss of the
camera's node, not of the frustum: the nearest camera is written, and the true lens, in OpenCV's parameters, is kept in the
node's `extras`. Each person is a node with one line strip for each stretch; the vertex attributes `_TIME_S` and `_CAMERAS` are
the rig's time and the number of cameras that saw the person (0: a position between others).

Khronos Group, "glTF 2.0 Specification"; extension KHR_materials_unlit, so that colours need no light.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from passerby._version import __version__
from passerby.common.arrays import Floats
from passerby.core.cameras import Lens
from passerby.interchange.formats.drawing import GROUND_COLOUR, Colour, Drawing, Frustum, Way, draw
from passerby.interchange.formats.format import Export, Format, Losses
from passerby.interchange.formats.lens_models import PINHOLE, express_lens

PERSPECTIVE = replace(PINHOLE, name="a perspective camera with its axis in the middle", centred=True)
CV_TO_GLTF = np.diag([1.0, -1.0, -1.0])
"""Conversion from OpenCV's camera axes to glTF's, and back."""
Z_UP_TO_Y_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
"""Quaternion x, y, z, w of the rotation that maps (x, y, z) to (x, z, -y)."""
NEAR_M, FAR_M = 0.05, 1000.0
SEE_THROUGH = 0.25
"""Opacity of the frusta's sides."""

POINTS, LINES, LINE_STRIP, TRIANGLES = 0, 1, 3, 4
FLOAT, UNSIGNED_INT = 5126, 5125
VERTICES, INDICES = 34962, 34963
GLB_MAGIC, GLB_JSON, GLB_BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942


class _Builder:
    """The JSON and the buffer of a file."""

    def __init__(self) -> None:
        self.lists: dict[str, list[dict[str, Any]]] = {}
        self.data = bytearray()
        self._materials: dict[tuple[Colour, float], int] = {}

    def add(self, kind: str, **item: Any) -> int:
        """Append an item to one of the file's lists, and return its index there."""
        self.lists.setdefault(kind, []).append(item)
        return len(self.lists[kind]) - 1

    def accessor(self, values: Floats | NDArray[np.int64], target: int) -> int:
        """Store vectors (N, 3), numbers (N,) or, for `INDICES`, whole numbers (N,). Return the index of the accessor."""
        whole = target == INDICES
        array = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        view = self.add("bufferViews", buffer=0, byteOffset=len(self.data), byteLength=array.nbytes, target=target)
        self.data += array.tobytes()
        shape = {"type": "VEC3", "min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self.add(
            "accessors", bufferView=view, componentType=UNSIGNED_INT if whole else FLOAT, count=len(array),
            **(shape if array.ndim == 2 else {"type": "SCALAR"}),
        )  # fmt: skip

    def material(self, colour: Colour, opacity: float = 1.0) -> int:
        """Return the index of the material of a flat colour, visible from both sides."""
        if (colour, opacity) not in self._materials:
            blend = {} if opacity == 1 else {"alphaMode": "BLEND"}
            factor = {
                "baseColorFactor": [*map(_linearise_colour, colour), opacity],
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0,
            }
            self._materials[colour, opacity] = self.add(
                "materials", pbrMetallicRoughness=factor, doubleSided=True, extensions={"KHR_materials_unlit": {}}, **blend
            )
        return self._materials[colour, opacity]

    def document(self, scene: dict[str, Any], buffer: dict[str, Any]) -> bytes:
        """Format the JSON of the file."""
        content = {
            "asset": {"version": "2.0", "generator": f"Passerby {__version__}"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [scene],
            **self.lists,
            "buffers": [{**buffer, "byteLength": len(self.data)}],
        }
        return json.dumps(content, separators=(",", ":"), allow_nan=False).encode("ascii")


def write_glb(rig: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as binary glTF. A camera without a pose, and a lens that differs from a perspective camera, are losses."""
    scene, built = _build_scene(rig, losses)
    text, data = built.document(scene, {}), bytes(built.data)
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    header = struct.pack("<III", GLB_MAGIC, 2, 12 + 8 + len(text) + 8 + len(data))
    return {"": header + struct.pack("<II", len(text), GLB_JSON) + text + struct.pack("<II", len(data), GLB_BINARY) + data}


def write_gltf(rig: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as glTF text; losses as for `write_glb`."""
    scene, built = _build_scene(rig, losses)
    data = base64.b64encode(built.data).decode("ascii")
    return {"": built.document(scene, {"uri": f"data:application/octet-stream;base64,{data}"}) + b"\n"}


def _build_scene(rig: Export, losses: Losses) -> tuple[dict[str, Any], _Builder]:
    """Build the scene and all objects that it uses."""
    drawing = draw(rig.posed(losses), rig.trajectories)
    built = _Builder()
    cameras = [node for frustum in drawing.frusta for node in _camera(built, frustum, losses)]
    children = [built.add("nodes", name="cameras", children=cameras), _ground(built, drawing)]
    if drawing.ways:
        people = [_person(built, way) for way in drawing.ways]
        children.append(built.add("nodes", name="people", children=people))
    root = built.add("nodes", name="world, z up", rotation=Z_UP_TO_Y_UP, children=children)
    return {"name": rig.name, "nodes": [root]}, built


def _camera(built: _Builder, frustum: Frustum, losses: Losses) -> tuple[int, int]:
    """Add the nodes of a camera and of its frustum. They are siblings, because some readers lose the children of a camera."""
    camera = frustum.camera
    lens, _ = express_lens(camera, (PERSPECTIVE,), losses, " (the frustum keeps the true lens)")
    (width, height), matrix = lens.size, lens.matrix
    perspective = {
        "yfov": 2 * math.atan(height / (2 * matrix[1, 1])),
        "aspectRatio": float(width * matrix[1, 1] / (height * matrix[0, 0])),
        "znear": NEAR_M,
        "zfar": FAR_M,
    }
    seen = built.add("cameras", name=camera.name, type="perspective", perspective=perspective)
    points = built.accessor(frustum.points @ CV_TO_GLTF, VERTICES)
    parts = (
        (LINES, frustum.edges, built.material(frustum.colour)),
        (TRIANGLES, frustum.faces, built.material(frustum.colour, SEE_THROUGH)),
    )
    mesh = built.add(
        "meshes",
        name=f"{camera.name}: what it sees",
        primitives=[
            {
                "attributes": {"POSITION": points},
                "indices": built.accessor(rows.ravel(), INDICES),
                "mode": mode,
                "material": material,
            }
            for mode, rows, material in parts
        ],
    )
    turn = Rotation.from_matrix(frustum.pose.R_cw.T @ CV_TO_GLTF).as_quat()
    place = {"translation": frustum.pose.centre.tolist(), "rotation": turn.tolist()}
    return (
        built.add("nodes", name=camera.name, camera=seen, extras=_lens_as_text(camera.lens), **place),
        built.add("nodes", name=f"{camera.name}: what it sees", mesh=mesh, **place),
    )


def _lens_as_text(lens: Lens) -> dict[str, Any]:
    """Return the true lens in OpenCV's parameters."""
    return {
        "size": list(lens.size),
        "matrix": lens.matrix.tolist(),
        "distortions": lens.distortions.tolist(),
        "fisheye": lens.fisheye,
    }


def _ground(built: _Builder, drawing: Drawing) -> int:
    points = built.accessor(drawing.ground.reshape(-1, 3), VERTICES)
    lines = {"attributes": {"POSITION": points}, "mode": LINES, "material": built.material(GROUND_COLOUR)}
    name = f"ground, {drawing.spacing_m:g} m"
    return built.add("nodes", name=name, mesh=built.add("meshes", name=name, primitives=[lines]))


def _person(built: _Builder, way: Way) -> int:
    """Add the node of a person: one line strip for each stretch, or a point if the stretch has only one position."""
    name = f"person {way.identity}"
    material = built.material(way.colour)
    strips = []
    for part in way.parts:
        attributes = {
            "POSITION": built.accessor(way.xyz[part], VERTICES),
            "_TIME_S": built.accessor(way.time_s[part], VERTICES),
            "_CAMERAS": built.accessor(way.cameras[part].astype(np.float64), VERTICES),
        }
        mode = LINE_STRIP if part.stop - part.start > 1 else POINTS
        strips.append({"attributes": attributes, "mode": mode, "material": material})
    return built.add("nodes", name=name, mesh=built.add("meshes", name=name, primitives=strips))


def _linearise_colour(value: int) -> float:
    """Convert a colour component from sRGB (0 to 255) to glTF's linear factor (0 to 1)."""
    share = value / 255
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


_CONVENTIONS = (
    "A drawing of the rig, not read back. A root node turns the rig's world (z up) into glTF's (y up); below it coordinates "
    "are the rig's, metres. Each camera is a node with its name that faces along -z with y up, with a perspective camera, a "
    "frustum drawn through its true lens, and that lens in its extras. A perspective camera has its axis in the middle of "
    "the image and no distortion: any other lens is a loss (of the camera, not of the frustum). Each person is a node with "
    "one line strip per interval, at the height of the body centre; the vertex attribute _TIME_S gives the time."
)
_TITLE = "Rig, ground and trajectories of people as a 3D scene with cameras"
_TOOLS = ("Blender", "three.js", "Windows 3D Viewer")
FORMATS = {
    "gltf": Format("gltf", f"{_TITLE}, as text", _TOOLS, "file", (".gltf",), _CONVENTIONS, write=write_gltf, draws_people=True),
    "glb": Format("glb", f"{_TITLE}, binary", _TOOLS, "file", (".glb",), _CONVENTIONS, write=write_glb, draws_people=True),
}
