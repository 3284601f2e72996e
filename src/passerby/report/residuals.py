"""Where in a camera's picture the model misses what was seen: mean and scatter of the residuals by cells of the picture.

A wrong focal length shows as arrows that all point outwards or inwards, a wrong distortion as rings, a camera that was moved
as arrows that all point the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import group_sums
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.html import Html, element, join
from passerby.report.sheet import clip_text, offset_words, short

COLUMNS = 12
"""Cells across the picture's longer side."""
FEWEST = 4
"""Residuals of a cell that an arrow is drawn for."""
SURE = 2.0
"""Standard errors beyond which a mean is no chance; the arrows of the others are faint."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
USUAL_SHARE, USUAL_CELLS, MOST_CELLS = 0.85, 0.9, 3.0
"""So many of the sure arrows are drawn at most this long, and all of them at most that long, in cells. A faint arrow that would
be longer is left out."""
STEPS_PX = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
STRIP = 0.09
"""Height of the legend, of the picture's width."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """K residuals of one camera."""

    at: Floats
    """(K, 2) where it was seen, pixels."""
    miss: Floats
    """(K, 2) seen minus model, pixels."""
    what: str
    """What they are of: centres of boxes, or joints."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Residuals of a camera by cells of its picture, R rows and C columns."""

    size: tuple[float, float]
    """Width and height of a cell, pixels."""
    count: Ints
    """(R, C)"""
    mean: Floats
    """(R, C, 2) pixels; NaN where there is none."""
    rms: Floats
    """(R, C) root mean square of their lengths, pixels."""

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(R, C) cells with residuals enough whose mean is no chance."""
        with np.errstate(invalid="ignore", divide="ignore"):
            length = np.linalg.norm(self.mean, axis=2)
            scatter = np.sqrt(np.maximum(self.rms**2 - length**2, 0.0) / np.maximum(self.count, 1))
            return np.asarray((self.count >= FEWEST) & (length > SURE * scatter))


def residuals_of(fit: Fitted, name: str) -> Residuals:
    """Residuals of a camera's boxes, or of its joints where it has no boxes.

    Only what agrees with bodies (or joints in space) that two cameras or more agree on: what one camera saw alone always fits.
    """
    place, s, j = fit.place(name), fit.sightings, fit.joints
    rows = np.flatnonzero(
        (s.camera == place) & s.agrees & (np.bincount(s.body[s.agrees], minlength=len(fit.bodies)) > 1)[s.body]
    )
    if len(rows):
        seen = s.seen[rows]
        return Residuals(seen[:, :2] + seen[:, 2:] / 2, s.centre_px[rows], "centres of boxes")
    rows = np.flatnonzero((j.camera == place) & j.agrees & np.isfinite(j.model).all(axis=1))
    return Residuals(j.seen[rows], j.seen[rows] - j.model[rows], "keypoints" if len(rows) else "people")


def residual_cells(residuals: Residuals, size: tuple[int, int]) -> Cells:
    """Residuals by cells of a picture of a size (width, height), pixels."""
    cell = max(size) / COLUMNS
    columns, rows = max(1, round(size[0] / cell)), max(1, round(size[1] / cell))
    wide, high = size[0] / columns, size[1] / rows
    at = np.clip(((residuals.at + 0.5) / (wide, high)).astype(int), 0, (columns - 1, rows - 1))
    number, n = at[:, 1] * columns + at[:, 0], rows * columns
    count = np.bincount(number, minlength=n)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = group_sums(number, residuals.miss, n) / count[:, None]
        rms = np.sqrt(group_sums(number, (residuals.miss**2).sum(axis=1), n) / count)
    return Cells((wide, high), count.reshape(rows, columns), mean.reshape(rows, columns, 2), rms.reshape(rows, columns))


def residual_map(contents: Contents, fit: Fitted, name: str) -> str:
    """The residuals of a camera over its picture, as an SVG with the picture's width; its legend stands below.

    Cells are `rect` of the class `cell` whose `fill-opacity` is the root mean square, arrows `path` of the class `arrow`
    (`arrow faint` where chance may have made them). A `<title>` tells each cell's figures. Colours come from the style:
    `--cell` and `--arrow`, with those that fit light and dark pages in their place.
    """
    size = contents.rig[name].lens.size
    residuals = residuals_of(fit, name)
    cells = residual_cells(residuals, size)
    strip = STRIP * size[0]
    scale = _round_up(float(np.quantile(cells.rms[cells.count >= FEWEST], 0.9))) if (cells.count >= FEWEST).any() else 1.0
    factor = _magnification(cells)
    body = [
        element("rect", width=size[0], height=size[1], fill="currentColor", fill_opacity=0.04, stroke="currentColor",
                stroke_opacity=0.3, class_="canvas"),
        element("g", _cells(cells, scale), class_="layer-cells"),
        element("g", _arrows(cells, factor), class_="layer-arrows"),
        element("g", _legend(residuals, cells, size, scale, factor), class_="legend"),
    ]  # fmt: skip
    return element(
        "svg", body, viewBox=f"0 0 {size[0]} {short(size[1] + strip)}", class_="residual-map", role="img",
        xmlns="http://www.w3.org/2000/svg", font_family="sans-serif", aria_label=_describe_map(name, residuals, cells),
        data_magnification=factor,
    )  # fmt: skip


def _describe_map(name: str, residuals: Residuals, cells: Cells) -> str:
    """The map in a sentence."""
    if not len(residuals.miss):
        return f"Camera {clip_text(name)}: no residuals, because no two cameras agree on a person"
    rms = float(np.sqrt((residuals.miss**2).sum(axis=1).mean()))
    return (
        f"Camera {clip_text(name)}: residuals of {len(residuals.miss)} {residuals.what}, root mean square {rms:.1f} pixels, "
        f"{int(np.count_nonzero(cells.sure))} of {int(np.count_nonzero(cells.count >= FEWEST))} cells with a significant mean "
        f"residual"
    )


def _cells(cells: Cells, scale: float) -> Html:
    """A rectangle for each cell with residuals, the more opaque the larger they are."""
    wide, high = cells.size
    parts = []
    for row, column in zip(*np.nonzero(cells.count), strict=True):
        x, y = column * wide, row * high
        words = (
            f"x {x:.0f} to {x + wide:.0f}, y {y:.0f} to {y + high:.0f}: {cells.count[row, column]} observations, on average "
            f"{offset_words(cells.mean[row, column])} of the model, root mean square {cells.rms[row, column]:.1f} px"
        )
        opacity = 0.08 + 0.72 * min(float(cells.rms[row, column]) / scale, 1.0)
        parts.append(
            element(
                "rect", element("title", words), x=short(x), y=short(y), width=short(wide), height=short(high),
                fill_opacity=round(opacity, 2), style="fill:var(--cell,#ee6600)", class_="cell",
            )
        )  # fmt: skip
    return join(*parts)


def _arrows(cells: Cells, factor: int) -> Html:
    """From each cell's middle to where things were seen, magnified."""
    wide, high = cells.size
    parts = []
    shown = (cells.count >= FEWEST) & (cells.sure | (factor * _lengths(cells) <= MOST_CELLS * min(cells.size)))
    for row, column in zip(*np.nonzero(shown), strict=True):
        middle = np.array([(column + 0.5) * wide, (row + 0.5) * high])
        arrow = _arrow(middle, factor * cells.mean[row, column], bool(cells.sure[row, column]), 0.16 * min(wide, high))
        parts.append(element("g", arrow, data_cell=f"{row} {column}"))
    return join(*parts)


def _arrow(begin: Floats, along: Floats, sure: bool, head: float) -> Html:
    length = float(np.hypot(*along))
    end = begin + along
    d = f"M{short(begin[0])} {short(begin[1])}L{short(end[0])} {short(end[1])}"
    if length > 0:
        unit = along / length
        across = np.array([-unit[1], unit[0]])
        reach = min(head, 0.5 * length)
        for side in (1, -1):
            tip = end - reach * unit + side * 0.6 * reach * across
            d += f"M{short(end[0])} {short(end[1])}L{short(tip[0])} {short(tip[1])}"
    return element(
        "path", d=d, fill="none", style="stroke:var(--arrow,currentColor)", stroke_width=2, vector_effect="non-scaling-stroke",
        stroke_linecap="round", stroke_opacity=1 if sure else 0.35, class_="arrow" if sure else "arrow faint",
    )  # fmt: skip


def _legend(residuals: Residuals, cells: Cells, size: tuple[int, int], scale: float, factor: int) -> Html:
    """A bar of so many pixels as the arrows are drawn, and what full colour means."""
    letters = size[0] / 40
    base = size[1] + 0.62 * STRIP * size[0]
    if not len(residuals.miss):
        return _words("no residuals: no two cameras agree on a person", letters * 0.5, base, letters)
    bar = _round_down(0.9 * cells.size[0] / factor)
    left = 0.5 * letters
    d = f"M{short(left)} {short(base - 0.35 * letters)}h{short(bar * factor)}"
    ends = (short(left), short(left + bar * factor))
    tick = "".join(f"M{x} {short(base - 0.7 * letters)}v{short(0.7 * letters)}" for x in ends)
    box = size[0] * 0.56
    return join(
        element("path", d=d + tick, fill="none", style="stroke:var(--arrow,currentColor)", stroke_width=2,
                vector_effect="non-scaling-stroke", class_="scale"),
        _words(f"{bar:g} px, drawn {factor} times as long", left + bar * factor + 0.6 * letters, base, letters),
        element("rect", x=short(box), y=short(base - letters), width=short(1.6 * letters), height=short(1.2 * letters),
                fill_opacity=0.8, style="fill:var(--cell,#ee6600)"),
        _words(f"RMS {scale:g} px or more", box + 2.0 * letters, base, letters),
    )  # fmt: skip


def _words(words: str, x: float, y: float, letters: float) -> Html:
    return element("text", words, x=short(x), y=short(y), font_size=short(letters), fill="currentColor")


def _magnification(cells: Cells) -> int:
    """How many times as long arrows are drawn as they are."""
    chosen = cells.sure if cells.sure.any() else cells.count >= FEWEST
    lengths, cell = _lengths(cells)[chosen], min(cells.size)
    if not len(lengths):
        return MAGNIFICATIONS[0]
    usual, longest = float(np.quantile(lengths, USUAL_SHARE)), float(lengths.max())
    fitting = [one for one in MAGNIFICATIONS if one * usual <= USUAL_CELLS * cell and one * longest <= MOST_CELLS * cell]
    return fitting[-1] if fitting else MAGNIFICATIONS[0]


def _lengths(cells: Cells) -> Floats:
    """(R, C) of the means, pixels; NaN where there is none."""
    return np.asarray(np.linalg.norm(cells.mean, axis=2))


def _round_up(value: float) -> float:
    """The smallest round number of pixels that is not below `value`."""
    return float(min((step for step in STEPS_PX if step >= value), default=STEPS_PX[-1]))


def _round_down(value: float) -> float:
    """The largest round number of pixels that is not above `value`."""
    return float(max((step for step in STEPS_PX if step <= value * 1.0001), default=STEPS_PX[0]))
