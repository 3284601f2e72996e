"""Small data sets in the layouts of EPFL and PETS 2009, written from a simulated scene whose cameras are known.

Nothing here is shared with the readers: Tsai's lens is drawn by solving its cubic, the boxes are redrawn through it, and the
angles of a rotation are scipy's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from passerby.core.cameras import Camera, Lens, Pose
from passerby.interchange.video_writer import VideoWriter
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

SENSOR_MM = 0.023
"""Of a pixel's side."""
AREA = ((-0.5, -1.5), (7.5, 11.0))
"""Corner and extent of the Terrace's grid, metres."""
GRID = (30, 44)
SHIFT = np.array([3.25, 4.0, 0.0])
"""Where the simulated world's origin lies in the sets' world, metres."""


@dataclass(frozen=True)
class Tsai:
    """The camera of a generated set; the parameters as the file has them."""

    size: tuple[int, int]
    focal: float
    kappa1: float
    cx: float
    cy: float
    sx: float
    pose: Pose
    dpx: float = SENSOR_MM
    dpy: float = SENSOR_MM

    def draw(self, plane):
        """(N, 2) x / z and y / z in the camera's frame to (N, 2) pixels."""
        undistorted = self.focal * np.asarray(plane, dtype=np.float64)
        length = np.linalg.norm(undistorted, axis=1)
        drawn = np.array([_root(self.kappa1, one) for one in length])
        sensor = undistorted * np.where(length > 0, drawn / np.maximum(length, 1e-12), 1.0)[:, None]
        return np.column_stack([self.cx + self.sx * sensor[:, 0] / self.dpx, self.cy + sensor[:, 1] / self.dpy])

    def project(self, points):
        """(N, 3) metres of the world to (N, 2) pixels."""
        inside = np.asarray(points) @ self.pose.R_cw.T + self.pose.t_cw
        return self.draw(inside[:, :2] / inside[:, 2:])

    def xml(self):
        rz, ry, rx = Rotation.from_matrix(self.pose.R_cw).as_euler("ZYX")
        tx, ty, tz = 1000 * self.pose.t_cw
        width, height = self.size
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n<Camera name="generated">\n'
            f'  <Geometry width="{width}" height="{height}" ncx="{height}" nfx="{height}" dx="{self.dpx!r}" dy="{self.dpy!r}" '
            f'dpx="{self.dpx!r}" dpy="{self.dpy!r}"/>\n'
            f'  <Intrinsic focal="{self.focal!r}" kappa1="{self.kappa1!r}" cx="{self.cx!r}" cy="{self.cy!r}" '
            f'sx="{self.sx!r}"/>\n'
            f'  <Extrinsic tx="{tx:.10e}" ty="{ty:.10e}" tz="{tz:.10e}" rx="{rx:.10e}" ry="{ry:.10e}" rz="{rz:.10e}"/>\n'
            "</Camera>\n"
        )


def _root(kappa, undistorted):
    """The d nearest to 0 with d (1 + kappa d^2) = undistorted."""
    if kappa == 0:
        return undistorted
    roots = np.roots([kappa, 0.0, 1.0, -undistorted])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(real[real >= 0].min(initial=np.inf))


@cache
def scene() -> SimulatedScene:
    """Seven people on a terrace for 20 seconds, four cameras."""
    return simulate(SimulationOptions(preset="terrace", seconds=20.0, fps=5.0, seed=3))


@cache
def cameras() -> dict[str, Tsai]:
    """The cameras of the scene with lenses of Tsai's kind, in the set's world."""
    found = {}
    for number, camera in enumerate(scene().rig):
        width, height = camera.lens.size
        found[camera.name] = Tsai(
            size=camera.lens.size,
            focal=SENSOR_MM * camera.lens.focal,
            kappa1=(5.7e-4, 5.2e-4, -1.5e-4, 4.3e-4)[number % 4],
            cx=width / 2 + 6.5 - 4 * number,
            cy=height / 2 - 8.25 + 5 * number,
            sx=(1.0, 1.01, 1.0, 0.99)[number % 4],
            pose=Pose.from_centre(camera.pose.R_cw, camera.centre + SHIFT),
        )
    return found


def boxes(name, scale=1.0):
    """(N, 6) frame, identity, left, top, right, bottom of one camera's people as its Tsai lens draws them, at `scale`."""
    seen, camera, tsai = scene().observations[name].boxes, scene().rig[name], cameras()[name]
    left, top, width, height = seen.ltwh.T
    middles = np.vstack([np.column_stack([left + width / 2, top]), np.column_stack([left + width / 2, top + height])])
    rays = camera.lens.bearings(middles)
    drawn = tsai.draw(rays[:, :2] / rays[:, 2:])
    high, low = np.split(drawn, 2)
    half = width / 2 * (low - high)[:, 1] / height
    x = (high[:, 0] + low[:, 0]) / 2
    corners = np.column_stack([x - half, high[:, 1], x + half, low[:, 1]])
    inside = (corners[:, :2] > 0).all(axis=1) & (corners[:, 2] < tsai.size[0] - 1) & (corners[:, 3] < tsai.size[1] - 1)
    table = np.column_stack([seen.frame, seen.identity, scale * (corners + 0.5) - 0.5])
    return table[inside]


def vatic(name, scale=1.0):
    """One camera's boxes as VATIC writes them."""
    lines = [
        f'{identity:.0f} {left:.4f} {top:.4f} {right:.4f} {bottom:.4f} {frame - 1:.0f} 0 0 0 "PERSON"'
        for frame, identity, left, top, right, bottom in boxes(name, scale)
    ]
    return "\n".join([*lines, '0 1 1 1 1 0 1 0 0 "PERSON"']) + "\n"


def grid(step=5):
    """The positions of the people as cells of a grid, as EPFL's gt_terrace1.txt has them."""
    places = scene().ground_positions + SHIFT[:2]
    rows = ["1", f"{len(places)} {places.shape[1]} {GRID[0]} {GRID[1]} {step} 0 {len(places) - 1}"]
    (left, near), (wide, deep) = AREA
    for instant, people in enumerate(places):
        cells = []
        for x, y in people:
            column, row = (x - left) / (wide / GRID[0]), (y - near) / (deep / GRID[1])
            inside = np.isfinite(x) and 0 <= column < GRID[0] and 0 <= row < GRID[1]
            cells.append(str(int(row) * GRID[0] + int(column)) if inside else "-2")
        rows.append("\t".join(cells if instant % step == 0 else ["-1"] * len(people)))
    return "\n".join(rows) + "\n"


def cvml(name):
    """One camera's boxes as CVML."""
    table = boxes(name)
    frames = []
    for frame in range(1, int(table[:, 0].max()) + 1):
        people = "".join(
            f'<object id="{identity:.0f}"><box h="{bottom - top:.4f}" w="{right - left:.4f}" xc="{(left + right) / 2:.4f}" '
            f'yc="{(top + bottom) / 2:.4f}"/></object>'
            for _, identity, left, top, right, bottom in table[table[:, 0] == frame]
        )
        frames.append(f'<frame number="{frame - 1}"><objectlist>{people}</objectlist></frame>\n')
    return f'<?xml version="1.0"?>\n<dataset name="generated">\n{"".join(frames)}</dataset>\n'


def mot_truth(name):
    """One camera's boxes and positions as the 3D MOTChallenge has them, person after person."""
    places = scene().ground_positions + SHIFT[:2]
    table = boxes(name)
    lines = []
    for frame, identity, left, top, right, bottom in table[np.lexsort((table[:, 0], table[:, 1]))]:
        x, y = places[int(frame) - 1, int(identity) - 1]
        lines.append(
            f"{frame:.0f},{identity:.0f},{left:.3f},{top:.3f},{right - left:.3f},{bottom - top:.3f},1,{x:.4f},{y:.4f},0"
        )
    return "\n".join(lines) + "\n"


def write_epfl(folder: Path, sequence="terrace1", views=True) -> Path:
    """A sequence: videos of half the calibrated size, Tsai's files, positions, and with `views` the boxes in each view."""
    for number, (name, camera) in enumerate(cameras().items()):
        size = (camera.size[0] // 2, camera.size[1] // 2)
        _grey_video(folder / f"{sequence}-c{number}.avi", size, 100 + 10 * number)
        _write(folder / "calibration" / f"terrace-tsai-c{number}.xml", camera.xml())
        if views:
            _write(folder / f"{sequence}-c{number}.txt", vatic(name, 0.5))
    _write(folder / f"gt_{sequence}.txt", grid())
    return folder


def write_pets(folder: Path, views=True, pictures=4) -> Path:
    """A recording: pictures, Tsai's files, boxes of the first view in CVML, or with `views` of all of them in VATIC's text."""
    for number, (name, camera) in enumerate(cameras().items(), start=1):
        view = f"View_{number:03}"
        _write(folder / f"{view}.xml", camera.xml())
        for picture in range(pictures):
            path = folder / "S2" / "L1" / "Time_12-34" / view / f"frame_{picture:04}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), np.full((camera.size[1], camera.size[0], 3), 60 + 10 * number + picture, np.uint8))
        if views:
            _write(folder / "annotation" / f"{view}.txt", vatic(name))
    if not views:
        _write(folder / "PETS2009-S2L1.xml", cvml(next(iter(cameras()))))
    return folder


def true_camera(name, new_name):
    """A camera of the set, without distortion, for comparing poses."""
    tsai = cameras()[name]
    return Camera(new_name, Lens(tsai.size, np.diag([1000.0, 1000.0, 1.0]), np.zeros(0)), tsai.pose)


def _grey_video(path: Path, size, first, pictures=6):
    """A video of nothing; .avi files are written as .mkv and renamed, for a reader looks at what is in them."""
    with VideoWriter(path.with_suffix(".mkv"), size, 5.0) as video:
        for level in range(pictures):
            video.write(np.full((size[1], size[0], 3), first + level, np.uint8))
    path.with_suffix(".mkv").rename(path)


def _write(path: Path, text: str):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
