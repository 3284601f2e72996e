"""What the drawings of a report hold."""

import re
from xml.etree import ElementTree

import numpy as np

SVG = "{http://www.w3.org/2000/svg}"


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
