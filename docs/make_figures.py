"""Draws the figures of the documentation into `docs/figures`, from what Passerby computes.

    python docs/make_figures.py

A terrace is simulated, seen by four cameras, and calibrated; nothing in the figures is drawn by hand but words and arrows.
Needs matplotlib (`pip install 'passerby[evidence]'`). The same libraries draw the same bytes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Rectangle

from passerby.association.camera_tracklets import CameraTracklets, build_tracklets
from passerby.association.ground.registration import Registration, register_pair
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Clock
from passerby.simulation import SimulatedScene, SimulationOptions, simulate, write_scene

FOLDER = Path(__file__).resolve().parent / "figures"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Of Okabe and Ito: colour-blind people can distinguish them too."""
GREY, INK = "#9aa0a6", "#202124"
USUAL_PX = 150.0
"""Height of the box that is drawn: of somebody some metres off, as most are."""
OPTIONS = SimulationOptions(preset="terrace", seconds=40.0, unrelated_ids=True, box_noise=0.02)
STYLE = {
    "font.size": 10,
    "svg.fonttype": "path",
    "svg.hashsalt": "passerby",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "figure.facecolor": "white",
}


@dataclass(frozen=True, eq=False)
class Example:
    """A terrace whose truth is known, and its calibration."""

    scene: SimulatedScene
    calibration: Calibration
    prepared: list[CameraTracklets]

    @classmethod
    def make(cls) -> Example:
        """Simulate and calibrate."""
        scene = simulate(OPTIONS)
        with tempfile.TemporaryDirectory() as folder:
            calibration = calibrate(write_scene(scene, Path(folder) / "terrace"))
        clocks = {name: Clock(OPTIONS.fps, 0.0) for name in scene.rig.names}
        prepared = build_tracklets(scene.rig, scene.observations, clocks, 1.72, np.random.default_rng(0))
        return cls(scene, calibration, prepared)


@contextmanager
def drawing(name: str, columns: int, size: tuple[float, float], **options: Any) -> Iterator[Any]:
    """Axes side by side, written to `docs/figures/NAME.svg` in the end."""
    figure, axes = plt.subplots(1, columns, figsize=size, **options)
    yield axes
    figure.tight_layout()
    FOLDER.mkdir(exist_ok=True)
    figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)


def arrow(ax: Axes, start: Any, end: Any, colour: str, text: str = "", offset: tuple[float, float] = (0.0, 0.0)) -> None:
    """An arrow with a word at its tip."""
    ax.annotate(
        "", xy=end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )
    ax.text(end[0] + offset[0], end[1] + offset[1], text, color=colour, ha="center", va="center")


# --- conventions ----------------------------------------------------------------------------------------------------------


def conventions() -> None:
    """World, camera and picture."""
    with drawing("conventions", 2, (9.0, 3.6), gridspec_kw={"width_ratios": [1.35, 1]}) as (world, picture):
        _world_axes(world)
        _picture_axes(picture)


def _flat(point: Any) -> Floats:
    """Where a point of the world stands in an oblique drawing."""
    x, y, z = point
    return np.array([x + 0.45 * y, z + 0.32 * y])


def _world_axes(ax: Axes) -> None:
    ground = np.array([_flat(p) for p in [(-1, -0.6, 0), (3.4, -0.6, 0), (3.4, 3.2, 0), (-1, 3.2, 0)]])
    ax.fill(*ground.T, color="#eef1f4", zorder=0)
    origin = _flat((0, 0, 0))
    for tip, name, shift in (((1.2, 0, 0), "x", (0.15, 0)), ((0, 1.6, 0), "y", (0.12, 0.12)), ((0, 0, 0.9), "z", (-0.16, 0))):
        arrow(ax, origin, _flat(tip), INK, name, shift)
    ax.text(*(origin + (0.05, -0.28)), "origin: on the ground,\nbelow the first camera", fontsize=8, ha="center", va="center")
    centre = np.array([0.0, 0.0, 2.0])
    ax.plot(*np.array([_flat(centre), _flat((0, 0, 0.95))]).T, color=GREY, ls=":", lw=1)
    ax.plot(*_flat(centre), "s", ms=9, color=COLOURS[0])
    tilt = np.deg2rad(6)
    forward, down = np.array([0, np.cos(tilt), -np.sin(tilt)]), np.array([0, -np.sin(tilt), -np.cos(tilt)])
    arrow(ax, _flat(centre), _flat(centre + 1.9 * forward), COLOURS[0], "z: forward", (0.5, 0.12))
    arrow(ax, _flat(centre), _flat(centre + (1.0, 0, 0)), COLOURS[0], "x: right", (0.45, -0.02))
    arrow(ax, _flat(centre), _flat(centre + 0.75 * down), COLOURS[0], "y: down", (-0.48, 0.06))
    ax.text(*(_flat(centre) + (-0.2, 0.62)), "camera: $x_c = R\\,X_w + t$", color=COLOURS[0], ha="center")
    ax.text(*_flat((2.35, 2.4, 0)), "ground: z = 0", color="#5f6368", ha="center")
    ax.set_title("world and camera, metres", fontsize=10)
    ax.axis("equal")
    ax.axis("off")


def _picture_axes(ax: Axes) -> None:
    width, height = 16, 10
    ax.add_patch(Rectangle((-0.5, -0.5), width, height, fill=False, ec=INK))
    for n in range(3):
        for m in range(3):
            ax.add_patch(Rectangle((n - 0.5, m - 0.5), 1, 1, fill=False, ec="#dadce0"))
    ax.plot(0, 0, "o", ms=4, color=COLOURS[1])
    ax.annotate("(0, 0) is the centre of\nthe first pixel", (0, 0), (3.4, 1.6), color=COLOURS[1], fontsize=8,
                arrowprops={"arrowstyle": "-", "color": COLOURS[1]})  # fmt: skip
    arrow(ax, (-0.5, -1.3), (5, -1.3), INK, "u: right", (2.2, 0))
    arrow(ax, (-1.3, -0.5), (-1.3, 4), INK, "v: down", (0, 0.9))
    ax.add_patch(Rectangle((9.5, 3.0), 2.0, 5.0, fill=False, ec=COLOURS[2], lw=1.8))
    ax.plot(9.5, 3.0, "o", ms=4, color=COLOURS[2])
    ax.text(9.1, 3.0, "left, top", color=COLOURS[2], ha="right", fontsize=8)
    ax.text(10.5, 8.7, "width", color=COLOURS[2], ha="center", fontsize=8)
    ax.text(12.7, 5.5, "height", color=COLOURS[2], ha="center", fontsize=8)
    ax.set_title("image, pixels", fontsize=10)
    ax.set_xlim(-2.6, width)
    ax.set_ylim(height, -2.2)
    ax.set_aspect("equal")
    ax.axis("off")


# --- a box and its body ---------------------------------------------------------------------------------------------------


def box_and_body(example: Example) -> None:
    """A box of the simulation, and the upright body that the true camera would see there."""
    scene, camera = example.scene, example.scene.rig.cameras[0]
    frame, who, box = _clear_sighting(scene, camera)
    place = scene.ground_positions[frame, who]
    height = scene.heights[int(scene.identities[who])]
    body = np.array([[*place, z] for z in np.linspace(0.0, height, 15)])
    low, high = camera.project(body[[0]])[0], camera.project(body[[-1]])[0]
    with drawing("box", 2, (9.0, 4.0), gridspec_kw={"width_ratios": [1.5, 1]}) as (side, picture):
        _from_the_side(side, camera, place, height)
        pixels = camera.project(body)
        picture.add_patch(Rectangle(tuple(box[:2]), box[2], box[3], fill=False, ec=COLOURS[1], lw=2))
        picture.plot(*pixels.T, color=COLOURS[0], lw=7, alpha=0.35, solid_capstyle="round")
        picture.plot(*np.array([low, high]).T, "o", color=COLOURS[0], ms=5)
        middle, centre = (low + high) / 2, box[:2] + box[2:] / 2
        picture.plot(*middle, "x", color=COLOURS[0], ms=10, mew=2)
        picture.plot(*centre, "+", color=COLOURS[1], ms=13, mew=2)
        gap = box[3] * 0.62
        for point, text, colour in ((high, "top of the body", COLOURS[0]), (low, "its foot", COLOURS[0]),
                                    (middle, "centre of the body ×\ncentre of the box +", INK)):  # fmt: skip
            picture.annotate(text, point, (point[0] + gap, point[1]), color=colour, fontsize=9, va="center",
                             arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.8})  # fmt: skip
        picture.text(box[0], box[1] - box[3] * 0.06, "box", color=COLOURS[1], ha="center", fontsize=9)
        pad = box[3] * 0.2
        picture.set_xlim(box[0] - pad, box[0] + box[2] + box[3] * 1.1)
        picture.set_ylim(box[1] + box[3] + pad, box[1] - pad)
        picture.set_aspect("equal")
        picture.set_title(f"in the image of {camera.name}, pixels", fontsize=10)


def _clear_sighting(scene: SimulatedScene, camera: Camera) -> tuple[int, int, Floats]:
    """(instant, person, box) of somebody upright, near and whole in the picture."""
    truth = scene.truth[camera.name]
    best: tuple[float, int, int, Floats] | None = None
    for row in range(len(truth)):
        frame, who = int(truth.frame[row]) - 1, int(truth.identity[row]) - 1
        left, top, width, height = truth.ltwh[row]
        inside = left > 40 and top > 40 and left + width < camera.lens.size[0] - 40 and top + height < camera.lens.size[1] - 40
        if inside and scene.upright[frame, who] and (best is None or abs(height - USUAL_PX) < best[0]):
            best = (abs(height - USUAL_PX), frame, who, truth.ltwh[row])
    assert best is not None
    return best[1], best[2], best[3]


def _from_the_side(ax: Axes, camera: Camera, place: Floats, height: float) -> None:
    """The vertical plane through the camera and the person."""
    centre = camera.pose.centre if camera.pose is not None else np.zeros(3)
    reach = float(np.linalg.norm(place - centre[:2]))
    ax.axhline(0, color="#80868b", lw=1.2)
    ax.plot(0, centre[2], "s", ms=9, color=INK)
    ax.annotate("camera", (0, centre[2]), (0.0, centre[2] + 0.35), ha="center")
    for z, style in ((height, "-"), (0.0, "-"), (height / 2, "--")):
        ax.plot([0, reach], [centre[2], z], color=GREY, lw=1, ls=style)
    ax.plot([reach, reach], [0, height], color=COLOURS[0], lw=9, alpha=0.35, solid_capstyle="round")
    ax.plot([reach], [height / 2], "x", color=COLOURS[0], ms=9, mew=2)
    ax.annotate("", (reach + 0.45, 0), (reach + 0.45, height), arrowprops={"arrowstyle": "<->", "color": INK})
    ax.text(reach + 0.6, height / 2, "height h of this person:\nunknown, 1.72 ± 0.09 m", va="center", fontsize=9)
    ax.text(reach, -0.45, "position (x, y) at this time step", ha="center", fontsize=9, color=COLOURS[0])
    ax.text(reach * 0.35, 0.08, "ground, z = 0", fontsize=9, color="#5f6368")
    ax.set_xlim(-0.6, reach + 3.4)
    ax.set_ylim(-0.7, max(centre[2], height) + 0.6)
    ax.set_aspect("equal")
    ax.set_yticks([0, 1, 2])
    ax.set_ylabel("metres")
    ax.set_title("from the side", fontsize=10)


# --- registration of two cameras ------------------------------------------------------------------------------------------


def ground_tracks(example: Example) -> None:
    """The ground tracks of two cameras, each in its own frame, and aligned."""
    a, b = example.prepared[0], example.prepared[1]
    assert a.tracks is not None
    assert b.tracks is not None
    best: Registration = register_pair(0, 1, a.tracks, b.tracks, 5.0).candidates[0]
    with drawing("ground-tracks", 3, (9.6, 3.9)) as axes:
        for ax, one, colour in ((axes[0], a, COLOURS[0]), (axes[1], b, COLOURS[1])):
            _tracks(ax, one, colour, lambda z: z)
            ax.set_title(f"{one.name} alone", fontsize=10)
            ax.set_xlabel("right of the camera, m")
            ax.set_ylabel("in front of the camera, m")
        _tracks(axes[2], a, COLOURS[0], lambda z: best.turn * z + best.shift)
        _tracks(axes[2], b, COLOURS[1], lambda z: z)
        degrees = np.degrees(np.angle(best.turn))
        axes[2].set_title(f"{a.name} rotated by {degrees:.0f}° and moved", fontsize=10)
        axes[2].set_xlabel(f"share {best.share:.0%}, time offset {best.lag_s:+.2f} s")
        for ax in axes:
            ax.set_aspect("equal", adjustable="datalim")


def _tracks(ax: Axes, camera: CameraTracklets, colour: str, moved: Any) -> None:
    """Every tracklet as a line, and the camera."""
    tracks = camera.tracks
    assert tracks is not None
    for number in np.unique(tracks.tracklet):
        rows = np.flatnonzero(tracks.tracklet == number)
        rows = rows[np.argsort(tracks.step[rows], kind="stable")]
        place = moved(tracks.position[rows])
        ax.plot(place.real, place.imag, color=colour, lw=0.9, alpha=0.75)
    here = moved(np.array([0j]))[0]
    ax.plot(here.real, here.imag, "s", color=colour, ms=8, mec=INK)
    ax.text(here.real + 1.0, here.imag, camera.name, ha="center", va="center", fontsize=9)


# --- the view graph -------------------------------------------------------------------------------------------------------


def view_graph(example: Example) -> None:
    """The cameras from above with their sigmas, and the registration of every two."""
    told = example.calibration.to_dict()
    rig: Rig = example.calibration.rig
    with drawing("view-graph", 1, (6.4, 5.2)) as ax:
        for pair in told["association"]["pairs"]:
            first, second = (rig[name].pose.centre for name in pair["cameras"])
            ax.plot(
                [first[0], second[0]], [first[1], second[1]], color="#5f6368", lw=1 + 5 * pair["share"], alpha=0.35, zorder=1
            )
            # Off the middle, where the diagonals cross.
            at = first + (second - first) * 0.36
            text = f"share {pair['share']:.2f}\nsecond-best {pair['runner_up']:.2f}"
            ax.text(
                at[0],
                at[1],
                text,
                fontsize=8,
                ha="center",
                va="center",
                bbox={"fc": "white", "ec": "none", "pad": 1.5, "alpha": 0.9},
            )
        for colour, camera in zip(COLOURS, rig, strict=True):
            assert camera.pose is not None
            assert camera.sigma is not None
            centre, forward = camera.pose.centre, camera.pose.R_cw[2]
            block = camera.sigma.covariance[:2, :2]
            size, axes = np.linalg.eigh(block)
            angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
            ax.add_patch(
                Ellipse(tuple(centre[:2]), 2 * size[1] ** 0.5, 2 * size[0] ** 0.5, angle=angle, fc=colour, alpha=0.35, zorder=2)
            )
            ax.plot(*centre[:2], "s", color=colour, ms=4, zorder=3)
            arrow(ax, centre[:2], centre[:2] + 1.8 * forward[:2] / np.linalg.norm(forward[:2]), colour)
            outwards = -forward[:2] / np.linalg.norm(forward[:2])
            ax.text(*(centre[:2] + 1.1 * outwards), camera.name, color=colour, ha="center", va="center", fontsize=11)
        ax.set_xlabel("x, m")
        ax.set_ylabel("y, m")
        ax.set_xlim(-12, 12)
        ax.set_ylim(-2, 18.5)
        ax.set_aspect("equal")


def main() -> None:
    """Draw all."""
    with mpl.rc_context(STYLE):
        example = Example.make()
        conventions()
        box_and_body(example)
        ground_tracks(example)
        view_graph(example)


if __name__ == "__main__":
    main()
