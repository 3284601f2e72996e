"""Plots of the pages: errors against a condition, as SVG that is the same for the same figures.

The only module that needs matplotlib (`pip install 'passerby[evidence]'`).
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from pages.tables import errors, number
from passerby.common.errors import InputError

if TYPE_CHECKING:
    from paper.conditions import Outcome

FAILS = "fails"

HEAD = (
    "similarity, median", "quartiles, mm", "worst seed", "metric, median", "worst", "scale error", "worst", "failed",
    "verdicts",
)  # fmt: skip
"""Of the cells of `spread_cells`."""


def quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile of figures of which some may be infinite.

    Interpolated as by numpy; one that lies between a finite and an infinite figure is infinite.
    """
    order = sorted(values)

    def at(share: float) -> float:
        place = share * (len(order) - 1)
        low, high = order[math.floor(place)], order[math.ceil(place)]
        return high if math.isinf(high) else low + (place % 1) * (high - low)

    return at(0.25), at(0.5), at(0.75)


def of(outcomes: Sequence[Outcome], figure: str) -> tuple[float, ...]:
    """One figure of all outcomes, in the order of the seeds."""
    return tuple(float(getattr(outcome, figure)) for outcome in outcomes)


def median(outcomes: Sequence[Outcome], figure: str) -> float:
    """The median of a figure; infinite where half of the seeds fail."""
    return quartiles(of(outcomes, figure))[1]


def spread_cells(outcomes: Sequence[Outcome]) -> list[str]:
    """The cells under `HEAD`."""
    low, _, high = quartiles(of(outcomes, "similarity_mm"))
    scale = of(outcomes, "scale_error")
    return [
        median_errors(outcomes, "similarity"),
        FAILS if math.isinf(low) else f"{number(low)} to {FAILS if math.isinf(high) else number(high)}",
        worst_errors(outcomes, "similarity"), median_errors(outcomes, "metric"), worst_errors(outcomes, "metric"),
        percent(quartiles(scale)[1]), percent(max(scale)), failures(outcomes), verdicts(outcomes),
    ]  # fmt: skip


def median_errors(outcomes: Sequence[Outcome], placement: str) -> str:
    """The medians of position and orientation error."""
    return pose_errors(median(outcomes, f"{placement}_mm"), median(outcomes, f"{placement}_deg"))


def worst_errors(outcomes: Sequence[Outcome], placement: str) -> str:
    """The largest position and the largest orientation error."""
    return pose_errors(max(of(outcomes, f"{placement}_mm")), max(of(outcomes, f"{placement}_deg")))


def pose_errors(mm: float, degrees: float) -> str:
    """Position and orientation error, or that there is none to speak of."""
    return errors(mm, degrees) if math.isfinite(mm) and math.isfinite(degrees) else FAILS


def percent(share: float, digits: int = 1) -> str:
    """A share in percent."""
    return f"{number(100 * share, digits)} %" if math.isfinite(share) else FAILS


def failures(outcomes: Sequence[Outcome]) -> str:
    """How many of the seeds failed."""
    count = sum(outcome.failed for outcome in outcomes)
    return f"{count} of {len(outcomes)}"


def verdicts(outcomes: Sequence[Outcome]) -> str:
    """How often which verdict was given."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("accepted", "doubtful", "refused") if counts[verdict])


if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000")
"""Of Okabe and Ito, "Color Universal Design": told apart with any colour vision."""
MARKERS = ("o", "s", "^", "D", "v")
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
"""Lines differ by these too, for prints without colours."""
PANEL_INCHES, WIDE_INCHES = (3.4, 3.0), 5.0
"""Width and height of a panel; the width of one that stands alone, so that the legend has room."""
LEGEND_COLUMNS = 2  # for each panel: so many names of methods have room below it
MARGIN = 0.05  # room beyond the first and the last level, as a share of what lies between them
ROW = 0.065  # height of a row of failures, as a share of the panel's


@dataclass(frozen=True)
class Line:
    """The errors of one method over the levels of a condition."""

    name: str
    x: tuple[float, ...]  # levels
    values: tuple[tuple[float, ...], ...]
    """For each level the figure of every seed; infinite for a failure. One seed: no spread is drawn."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class Axis:
    """The levels of a condition, in plots and in tables."""

    """How a page tells the levels."""

    label: str  # on plots, with the unit
    head: str  # of the tables' column
    text: Callable[[float], str] = "{:g}".format  # a level in a table
    scale: str = "linear"  # linear, log, or symlog (0 has a place)


def check_plots() -> None:
    """Raises `InputError` where matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise InputError("plots need matplotlib, which is not installed: pip install 'passerby[evidence]'")


def error_plot(panels: Sequence[Panel], across: Axis, y_label: str) -> str:
    """Errors against a condition: a panel each for several scenes, one logarithmic axis of errors for all.

    A line is the median over the seeds, its band the quartiles. Where the median is a failure the line breaks. Below the
    upper border stand the seeds that failed at a level, as 2/5.

    Returns SVG text; the same arguments give the same text. Raises `InputError`: matplotlib is not installed.
    """
    check_plots()
    from matplotlib import style

    # Whatever style the user has set: the same arguments give the same text.
    with style.context("default"):
        return _error_plot(panels, across, y_label)


def _error_plot(panels: Sequence[Panel], across: Axis, y_label: str) -> str:
    figure, axes = _figure(len(panels))
    for index, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        axis.set_title(panel.title)
        axis.set_ylabel("" if index else y_label)
        _set_levels(axis, panel, across)
        axis.grid(visible=True, color="0.85", linewidth=0.6)
        axis.set_axisbelow(True)
        for which, line in enumerate(panel.lines):
            _draw(axis, which, f"{panel.title}: {line.name}", line)
    _set_range(axes[0], panels)
    for axis, panel in zip(axes, panels, strict=True):
        for which, line in enumerate(panel.lines):
            _mark_failures(axis, which, line)
    names = list(dict.fromkeys(line.name for panel in panels for line in panel.lines))
    handles = {name: handle for axis in axes for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    columns = min(len(names), LEGEND_COLUMNS * len(panels))
    figure.legend([handles[name] for name in names], names, loc="outside lower center", ncols=columns, frameon=False)
    return _svg(figure)


def _set_levels(axis: Axes, panel: Panel, across: Axis) -> None:
    """A tick at every level."""
    from matplotlib.ticker import NullLocator

    # Linear up to 1, where a logarithm would have no place for 0.
    axis.set_xscale(across.scale, **({"linthresh": 1.0, "linscale": 0.4} if across.scale == "symlog" else {}))
    levels = sorted({x for line in panel.lines for x in line.x})
    axis.set_xticks(levels, [across.text(x) for x in levels])
    axis.xaxis.set_minor_locator(NullLocator())
    axis.set_xlabel(across.label)
    # Levels at which all seeds failed have no points that would widen the axis.
    scale = axis.xaxis.get_transform()
    low, high = scale.transform([levels[0], levels[-1]])
    beyond = MARGIN * (high - low) or 0.5
    axis.set_xlim(*scale.inverted().transform([low - beyond, high + beyond]))


def _draw(axis: Axes, number: int, gid: str, line: Line) -> None:
    """The median and the quartiles of one line."""
    number %= len(COLOURS)
    colour, dash, marker = COLOURS[number], DASHES[number], MARKERS[number]
    x = np.array(line.x)
    rows = np.array([quartiles(values) for values in line.values])
    low, middle, high = (np.where(np.isfinite(column), column, np.nan) for column in rows.T)
    axis.plot(x, middle, color=colour, linestyle=dash, marker=marker, markersize=4, linewidth=1.4, label=line.name, gid=gid)
    if any(len(values) > 1 for values in line.values):
        axis.fill_between(x, low, np.where(np.isfinite(high), high, middle), color=colour, alpha=0.18, linewidth=0)


def _set_range(axis: Axes, panels: Sequence[Panel]) -> None:
    """The range of the errors, with plain figures at 1, 2 and 5, and room above for rows of failures where there are any."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    lines = [line for panel in panels for line in panel.lines]
    every = np.array([value for line in lines for values in line.values for value in quartiles(values)])
    drawn = every[np.isfinite(every)]
    low, high = (float(drawn.min()), float(drawn.max())) if len(drawn) else (1.0, 10.0)
    margin = max(0.05 * math.log10(max(high / low, 1.0)), 0.05)
    bottom, top = math.log10(max(low, 1e-9)) - margin, math.log10(high) + margin
    if not np.isfinite(every).all() or any(map(_failed, lines)):
        rows = ROW * (1 + max(len(panel.lines) for panel in panels))
        top = bottom + (top - bottom) / (1 - rows)
    axis.set_yscale("log")
    axis.set_ylim(10**bottom, 10**top)
    subs = (1.0, 2.0, 5.0) if top - bottom < 2.5 else (1.0,)
    axis.yaxis.set_major_locator(LogLocator(subs=subs, numticks=20))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_locator(NullLocator())


def _failed(line: Line) -> int:
    return sum(not math.isfinite(value) for values in line.values for value in values)


def _mark_failures(axis: Axes, number: int, line: Line) -> None:
    """How many of the seeds failed at a level, near the upper border; each line has a row of its own."""
    place: Any = axis.get_xaxis_transform()
    height, colour = 1 - ROW * (number + 0.75), COLOURS[number % len(COLOURS)]
    for level, values in zip(line.x, line.values, strict=True):
        failed = sum(not math.isfinite(value) for value in values)
        if failed:
            text = f"{failed}/{len(values)}" if len(values) > 1 else "fails"
            axis.annotate(text, (level, height), xycoords=place, ha="center", va="center", fontsize=7, color=colour)


def _figure(n_panels: int) -> tuple[Any, list[Axes]]:
    """A figure with a row of panels that share their axis of errors; drawn without a screen."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(PANEL_INCHES[0] * n_panels, WIDE_INCHES), PANEL_INCHES[1]), layout="constrained")
    axes = figure.subplots(1, n_panels, sharey=True, squeeze=False)[0]
    return figure, list(axes)


def _svg(figure: Any) -> str:
    """The figure as SVG without date or random identifiers, its letters as outlines so that it looks alike everywhere."""
    import matplotlib as mpl

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "passerby", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"
