"""Cameras whose poses can be written down by hand, for tests of file formats."""

import re

import numpy as np

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Given, export, find_format

LOOKING_NORTH = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""World to camera: level, along the world's y; x to the right is the world's x, y down is the world's -z."""
MATRIX = np.array([[1000.0, 0, 960], [0, 1100, 540], [0, 0, 1]])
SIZE = (1920, 1080)
CENTRE = (4.0, -3.0, 2.5)
TRANSLATION = (-4.0, 2.5, 3.0)
"""`-R C`."""
POINTS = np.array([[4.0, 7, 2.5], [5, 7, 2.5], [4, 7, 3.5]])
"""Ten metres ahead; a metre to the right of it; a metre above it."""
PIXELS = np.array([[960.0, 540], [1060, 540], [960, 430]])
NASTY_NAMES = ('a: "b"\n#\'é {x}', "../up/.down", "A", "a", "01", "1e5", "null", "y", "-", "camera_01", "%", "\u202e&*!|>\x1b")
"""Names that are other things in YAML, in file names, or the same where case does not count."""


def facing(name="north", centre=CENTRE, distortions=(), fisheye=False, matrix=MATRIX):
    """A camera that looks along the world's y."""
    return Camera(
        name, Lens(SIZE, matrix, np.array(distortions, dtype=float), fisheye), Pose.from_centre(LOOKING_NORTH, centre)
    )


def looking_down(name="down", **lens):
    """A camera that sees the ground: 30 degrees below the horizon."""
    sine, cosine = 0.5, 0.75**0.5
    R_cw = np.array([[1, 0, 0], [0, -sine, -cosine], [0, cosine, -sine]])
    return Camera(name, facing(**lens).lens, Pose.from_centre(R_cw, CENTRE))


def turned_rig(names, lenses=None, seed=5):
    """Cameras at random places, turned at random."""
    rng = np.random.default_rng(seed)
    cameras = []
    for index, name in enumerate(names):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose = Pose.from_centre(axes * np.sign(np.linalg.det(axes)), rng.normal(0, 5, 3))
        cameras.append(Camera(name, lenses[index] if lenses else Lens(SIZE, MATRIX, np.zeros(0)), pose))
    return Rig(tuple(cameras))


def written(form, rig, target, **options):
    """Write a rig in a format; what was lost."""
    from passerby.interchange.formats import Export

    return export(Export(rig), form, target, **options)


def read_back(form, path, **told):
    """Read a rig, and what could not be kept."""
    given = Given(**told)
    return find_format(form).read(path, given), given.losses.told


def same_cameras(ours, theirs, at_most_px=1e-7):
    """Whether two rigs have the same cameras, of the same size, which see a cloud of points at the same pixels."""
    if set(ours.names) != set(theirs.names):
        return False
    for camera in ours:
        other = theirs[camera.name]
        rays = np.random.default_rng(0).uniform((-0.8, -0.4, 1), (0.8, 0.4, 1), (50, 3)) * np.linspace(1, 20, 50)[:, None]
        points = rays @ camera.pose.R_cw + camera.centre
        if camera.lens.size != other.lens.size or np.abs(camera.project(points) - other.project(points)).max() > at_most_px:
            return False
    return True


def largest_told_px(told):
    """The largest error that a loss tells, pixels."""
    return max(float(px) for text in told for px in re.findall(r"up to ([\d.e+-]+) px off", text))
