"""Simulated scenes as the report has them, and what its drawings hold."""

import re
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.report.contents import Contents
from passerby.simulation import SimulationOptions, simulate
from support.report.pages import document_of

SVG = "{http://www.w3.org/2000/svg}"


@cache
def simulated(preset="terrace", seconds=12.0, **more):
    """A scene without noise, seen by the true cameras."""
    return simulate(SimulationOptions(preset=preset, seconds=seconds, fps=5.0, seed=1, occlusion=False, **more))


def contents(made, *, rig=None, seen=None, told=None, clocks=None, videos=None):
    """The report's contents with the true cameras and heights, unless others are given."""
    heights = {str(identity): height for identity, height in made.heights.items()}
    usual = {"figures": {"people": {"identities": len(heights), "heights_m": heights}, "cameras": []}}
    document = document_of({"verdict": "accepted", "cameras": [], **(told or usual)})
    return Contents(document, rig or made.rig, seen or made.observations, clocks or {}, videos or {})


def with_lens(rig, name, change):
    """The rig with another lens in one camera."""
    return Rig(tuple(replace(one, lens=change(one.lens)) if one.name == name else one for one in rig))


def longer(factor):
    """A lens with another focal length."""

    def change(lens):
        matrix = np.array(lens.matrix)
        matrix[[0, 1], [0, 1]] *= factor
        return replace(lens, matrix=matrix)

    return change


def only_boxes(made):
    """The observations without joints."""
    return Observations({name: CameraObservations(seen.boxes) for name, seen in made.observations.cameras.items()})


def only_joints(made):
    """The observations without boxes."""
    seen = made.observations.cameras
    return Observations({name: CameraObservations(keypoints=one.keypoints) for name, one in seen.items()})


def parsed(svg):
    """The drawing's root."""
    return ElementTree.fromstring(svg)


def layer(root, name):
    """One layer's element."""
    return next(g for g in root.iter(f"{SVG}g") if g.get("class") == f"layer-{name}")


def strokes(path):
    """The lines of a path of absolute M and L commands, (K, 2) each."""
    parts = path.get("d").rstrip("Z").split("M")[1:]
    return [np.array([[float(v) for v in pair.split()] for pair in part.split("L")]) for part in parts]


def of_class(root, name):
    """Elements of a class."""
    return [one for one in root.iter() if name in (one.get("class") or "").split()]


def moved(boxes, frames):
    """Boxes some frames later."""
    return Boxes(boxes.frame + frames, boxes.identity, boxes.ltwh, boxes.score)


def scripts(svg):
    """Anything in a drawing that could run or fetch."""
    return re.findall(r"<script|<foreignObject|\bon\w+\s*=\s*[\"']|javascript:|(?:href|src)=\"(?!data:image/jpeg;base64,)", svg)


def distance_to(points, stroke):
    """(N,) distances of points from a line of strokes (K, 2)."""
    a, b = stroke[:-1], stroke[1:]
    along = b - a
    share = ((points[:, None] - a) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = a + np.clip(share, 0, 1)[:, :, None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)
