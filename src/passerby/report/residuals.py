"""Map of a camera's residuals: their mean and scatter by cells of the picture.

A wrong focal length shows as arrows that all point outwards or inwards, a wrong distortion as rings, a camera that was moved
as arrows that all point in the same direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.geometry.groups import group_sums
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.rendering import Row, render, short
from passerby.report.sheet import clip_text, offset_words

COLUMNS = 12
"""Number of cells along the picture's longer side."""
FEWEST = 4
"""Fewest residuals in a cell for an arrow to be drawn."""
SURE = 2.0
"""Number of standard errors above which a cell's mean is significant. The arrows of other cells are faint."""
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
USUAL_SHARE, USUAL_CELLS, MOST_CELLS = 0.85, 0.9, 3.0
"""The first number is the share of the significant arrows whose drawn length is at most the second, in cells. The third is the
largest length of all of them, in cells. A faint arrow that would be longer is left out."""
STEPS_PX = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
STRIP = 0.09
"""Height of the legend, as a share of the picture's width."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """K residuals of one camera."""

    at: Floats
    """(K, 2) observed position, pixels."""
    miss: Floats
    """(K, 2) observed minus model, pixels."""
    what: str
    """Kind of the observations, in words: centres of boxes, or keypoints."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Residuals of a camera by cells of its picture, R rows and C columns."""

    size: tuple[float, float]
    """Width and height of a cell, pixels."""
    count: Ints
    """(R, C) number of residuals."""
    mean: Floats
    """(R, C, 2) mean residual, pixels; NaN in cells without residuals."""
    rms: Floats
    """(R, C) root mean square of the residuals' lengths, pixels."""

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(R, C) whether a cell has enough residuals and its mean is significant."""
        with np.errstate(invalid="ignore", divide="ignore"):
            length = np.linalg.norm(self.mean, axis=2)
            scatter = np.sqrt(np.maximum(self.rms**2 - length**2, 0.0) / np.maximum(self.count, 1))
            return np.asarray((self.count >= FEWEST) & (length > SURE * scatter))


def residuals_of(fit: Fitted, name: str) -> Residuals:
    """Return the residuals of a camera's boxes, or of its joints if it has no boxes.

    Only boxes and joints count that agree with a body (or a joint in space) on which two cameras or more agree: observations of
    a single camera always fit.
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
    """Group residuals by the cells of a picture of a size (width, height), pixels."""
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


def residual_map(contents: Contents, fit: Fitted, name: str) -> Markup:
    """Draw the residuals of a camera over its picture, as an SVG with the picture's width and a legend below.

    Cells are `rect` elements of the class `cell` whose `fill-opacity` shows the root mean square. Arrows are `path` elements of
    the class `arrow` (`arrow faint` if the mean is not significant). A `<title>` states each cell's figures. The style sets the
    colours `--cell` and `--arrow`; without them, colours that fit light and dark pages are used.
    """
    size = contents.rig[name].lens.size
    residuals = residuals_of(fit, name)
    cells = residual_cells(residuals, size)
    factor = _magnification(cells)
    return render(
        "residuals.html", size=size, label=_describe_map(name, residuals, cells), wide=cells.size[0], high=cells.size[1],
        cells=_cells(cells, _full_colour(cells)), arrows=_arrows(cells, factor),
        legend=_legend(residuals, cells, size, factor),
    )  # fmt: skip


def _describe_map(name: str, residuals: Residuals, cells: Cells) -> str:
    """Describe the map in one sentence."""
    if not len(residuals.miss):
        return f"Camera {clip_text(name)}: no residuals, because no two cameras agree on a person"
    rms = float(np.sqrt((residuals.miss**2).sum(axis=1).mean()))
    return (
        f"Camera {clip_text(name)}: residuals of {len(residuals.miss)} {residuals.what}, root mean square {rms:.1f} pixels, "
        f"{int(np.count_nonzero(cells.sure))} of {int(np.count_nonzero(cells.count >= FEWEST))} cells with a significant mean "
        f"residual"
    )


def _full_colour(cells: Cells) -> float:
    """Return the root mean square at which a cell has its full colour, pixels."""
    many = cells.count >= FEWEST
    return _round_up(float(np.quantile(cells.rms[many], 0.9))) if many.any() else 1.0


def _cells(cells: Cells, scale: float) -> list[Row]:
    """Return the values of the cells with residuals; a cell is more opaque for larger residuals."""
    wide, high = cells.size
    drawn = []
    for row, column in zip(*np.nonzero(cells.count), strict=True):
        x, y = column * wide, row * high
        title = (
            f"x {x:.0f} to {x + wide:.0f}, y {y:.0f} to {y + high:.0f}: {cells.count[row, column]} observations, on average "
            f"{offset_words(cells.mean[row, column])} of the model, root mean square {cells.rms[row, column]:.1f} px"
        )
        opacity = 0.08 + 0.72 * min(float(cells.rms[row, column]) / scale, 1.0)
        drawn.append({"x": x, "y": y, "opacity": opacity, "title": title})
    return drawn


def _arrows(cells: Cells, factor: int) -> list[Row]:
    """Return the magnified arrows from the middle of each cell along its mean residual."""
    wide, high = cells.size
    drawn = []
    shown = (cells.count >= FEWEST) & (cells.sure | (factor * _lengths(cells) <= MOST_CELLS * min(cells.size)))
    for row, column in zip(*np.nonzero(shown), strict=True):
        middle = np.array([(column + 0.5) * wide, (row + 0.5) * high])
        d = _arrow(middle, factor * cells.mean[row, column], 0.16 * min(wide, high))
        drawn.append({"cell": f"{row} {column}", "d": d, "significant": bool(cells.sure[row, column])})
    return drawn


def _arrow(begin: Floats, along: Floats, head: float) -> str:
    """Return an arrow as an SVG path."""
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
    return d


def _legend(residuals: Residuals, cells: Cells, size: tuple[int, int], factor: int) -> Row:
    """Return the values of the legend below the map: the scale of the arrows and of the cells' colour."""
    letters, bottom = size[0] / 40, size[1] + STRIP * size[0]
    base = size[1] + 0.62 * STRIP * size[0]
    bar = _round_down(0.9 * cells.size[0] / factor)
    left = 0.5 * letters
    d = f"M{short(left)} {short(base - 0.35 * letters)}h{short(bar * factor)}"
    d += "".join(f"M{short(x)} {short(base - 0.7 * letters)}v{short(0.7 * letters)}" for x in (left, left + bar * factor))
    bar_px = bar * factor if len(residuals.miss) else None
    return {
        "bottom": bottom, "base": base, "letters": letters, "factor": factor, "full_words": f"{_full_colour(cells):g}",
        "bar_px": bar_px, "bar_words": f"{bar:g}", "d": d,
    }  # fmt: skip


def _magnification(cells: Cells) -> int:
    """Choose the factor by which arrows are drawn longer than the residuals."""
    chosen = cells.sure if cells.sure.any() else cells.count >= FEWEST
    lengths, cell = _lengths(cells)[chosen], min(cells.size)
    if not len(lengths):
        return MAGNIFICATIONS[0]
    usual, longest = float(np.quantile(lengths, USUAL_SHARE)), float(lengths.max())
    fitting = [one for one in MAGNIFICATIONS if one * usual <= USUAL_CELLS * cell and one * longest <= MOST_CELLS * cell]
    return fitting[-1] if fitting else MAGNIFICATIONS[0]


def _lengths(cells: Cells) -> Floats:
    """Return the lengths (R, C) of the mean residuals, pixels; NaN in cells without residuals."""
    return np.asarray(np.linalg.norm(cells.mean, axis=2))


def _round_up(value: float) -> float:
    """Return the smallest round number of pixels that is not below `value`."""
    return float(min((step for step in STEPS_PX if step >= value), default=STEPS_PX[-1]))


def _round_down(value: float) -> float:
    """Return the largest round number of pixels that is not above `value`."""
    return float(max((step for step in STEPS_PX if step <= value * 1.0001), default=STEPS_PX[0]))
