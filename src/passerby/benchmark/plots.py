"""Plots of the pages: errors against a condition, as SVG that is the same for the same figures.

The only module that needs matplotlib (`pip install 'passerby[evidence]'`).
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from passerby.benchmark.spread import quartiles
from passerby.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000")
"""Of Okabe and Ito, "Color Universal Design": told apart with any colour vision."""
MARKERS = ("o", "s", "^", "D", "v")
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""Lines differ by these too, for prints without colours."""
PANEL_INCHES = (3.4, 3.0)


@dataclass(frozen=True)
class Line:
    """The errors of one method over the levels of a condition."""

    name: str
    x: tuple[float, ...]
    """Levels."""
    values: tuple[tuple[float, ...], ...]
    """For each level the figure of every seed; infinite for a failure. One seed: no spread is drawn."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    lines: tuple[Line, ...]


def check_plots() -> None:
    """Raises `InputError` where matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise InputError("plots need matplotlib, which is not installed: pip install 'passerby[evidence]'")


def error_plot(
    panels: Sequence[Panel], x_label: str, y_label: str, *, x_scale: str = "linear", y_floor: float | None = None
) -> str:
    """Errors against a condition: a panel each for several scenes, one logarithmic axis of errors for all.

    A line is the median over the seeds, its band the quartiles. Where the median is a failure the line breaks.
    A cross on the upper border, with its count, stands for the seeds that failed at a level.

    Args:
        panels: from left to right.
        x_label: the condition, with its unit.
        y_label: the error, with its unit.
        x_scale: linear, log, or symlog (linear up to 1, so that 0 has a place).
        y_floor: smallest error drawn; errors below it stand at it. None: all are drawn.

    Returns:
        SVG text; the same arguments give the same text.

    Raises:
        InputError: matplotlib is not installed.
    """
    figure, axes = _figure(len(panels))
    for index, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        axis.set_yscale("log")
        if x_scale == "symlog":
            axis.set_xscale("symlog", linthresh=1.0)
        else:
            axis.set_xscale(x_scale)
        levels = sorted({x for line in panel.lines for x in line.x})
        axis.set_xticks(levels, [f"{x:g}" for x in levels])
        axis.minorticks_off()
        axis.set_title(panel.title)
        axis.set_xlabel(x_label)
        if index == 0:
            axis.set_ylabel(y_label)
        axis.grid(visible=True, color="0.85", linewidth=0.6)
        axis.set_axisbelow(True)
        for number, line in enumerate(panel.lines):
            _draw(axis, number, f"{panel.title}: {line.name}", line, y_floor)
    names = list(dict.fromkeys(line.name for panel in panels for line in panel.lines))
    handles = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend([handles[name] for name in names], names, loc="outside lower center", ncols=len(names), frameon=False)
    return _svg(figure)


def _draw(axis: Axes, number: int, gid: str, line: Line, floor: float | None) -> None:
    """The median, the quartiles and the failures of one line."""
    number %= len(COLOURS)
    colour, dash, marker = COLOURS[number], DASHES[number], MARKERS[number]
    x = np.array(line.x)
    rows = np.array([quartiles(values) for values in line.values])
    low, middle, high = (_drawn(column, floor) for column in rows.T)
    axis.plot(x, middle, color=colour, linestyle=dash, marker=marker, markersize=4, linewidth=1.4, label=line.name, gid=gid)
    if any(len(values) > 1 for values in line.values):
        axis.fill_between(x, low, np.where(np.isfinite(high), high, middle), color=colour, alpha=0.18, linewidth=0)
    for level, values in zip(line.x, line.values, strict=True):
        failed = sum(not math.isfinite(value) for value in values)
        if failed:
            _mark_failures(axis, level, number, colour, f"{failed} of {len(values)}" if len(values) > 1 else "fails")


def _mark_failures(axis: Axes, level: float, number: int, colour: str, text: str) -> None:
    """A cross and a word on the upper border; each line has a row of its own."""
    place: Any = axis.get_xaxis_transform()
    height = 0.97 - 0.06 * number
    axis.plot([level], [height], marker="x", color=colour, markersize=5, linestyle="none", transform=place)
    axis.annotate(
        text, (level, height), xycoords=place, textcoords="offset points", xytext=(-5, 0), ha="right", va="center",
        fontsize=6, color=colour,
    )  # fmt: skip


def _drawn(values: NDArray[np.float64], floor: float | None) -> NDArray[np.float64]:
    """Failures are gaps."""
    kept = np.where(np.isfinite(values), values, np.nan)
    return kept if floor is None else np.maximum(kept, floor)


def _figure(n_panels: int) -> tuple[Any, list[Axes]]:
    """A figure with a row of panels that share their axis of errors; drawn without a screen."""
    check_plots()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL_INCHES[0] * n_panels, PANEL_INCHES[1]), layout="constrained")
    axes = figure.subplots(1, n_panels, sharey=True, squeeze=False)[0]
    return figure, list(axes)


def _svg(figure: Any) -> str:
    """The figure as SVG without date or random identifiers, its letters as outlines so that it looks alike everywhere."""
    import matplotlib as mpl

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "passerby", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"
