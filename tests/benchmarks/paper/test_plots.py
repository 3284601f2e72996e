"""Plots hold the figures that they are given, in text that is the same for the same figures."""

import math
import re
from xml.etree import ElementTree

import pytest

from paper.plots import Axis, Line, Panel, _set_levels, error_plot

matplotlib = pytest.importorskip("matplotlib")

ACROSS = Axis("corner noise, px", "N", scale="symlog")
NS = "{http://www.w3.org/2000/svg}"


def line_of(svg, name):
    """The pen strokes of one line: lists of (x, y) in the picture."""
    root = ElementTree.fromstring(svg)
    group = next(item for item in root.iter(f"{NS}g") if item.get("id") == name)
    path = next(group.iter(f"{NS}path")).get("d")
    strokes = [stroke for stroke in path.split("M") if stroke.strip()]
    return [[tuple(map(float, point.split())) for point in re.split("L", stroke)] for stroke in strokes]


def plot(*lines):
    return error_plot([Panel("terrace", lines)], ACROSS, "error, mm")


def test_points_lie_where_a_logarithmic_axis_has_them():
    svg = plot(Line("people", (0.0, 1.0, 10.0), ((10.0,), (100.0,), (1000.0,))))
    [points] = line_of(svg, "terrace: people")
    (x0, y0), (x1, y1), (x2, y2) = points
    assert x0 < x1 < x2
    assert y0 - y1 == pytest.approx(y1 - y2, rel=1e-3)
    assert y0 > y1


def test_the_line_is_the_median_and_breaks_where_it_fails():
    ten, hundred = (10.0, 10.0, 10.0), (100.0, 100.0, 100.0)
    whole = Line("whole", (0.0, 1.0, 10.0, 20.0), (ten, hundred, ten, hundred))
    half = Line("broken", (0.0, 1.0, 10.0, 20.0), ((1.0, 10.0, math.inf), hundred, (10.0, math.inf, math.inf), hundred))
    svg = plot(whole, half)
    [drawn] = line_of(svg, "terrace: whole")
    pieces = line_of(svg, "terrace: broken")
    assert [len(piece) for piece in pieces] == [2, 1]
    assert [*pieces[0], *pieces[1]] == [drawn[0], drawn[1], drawn[3]]


def test_same_figures_same_text_in_any_style():
    lines = Line("a", (0.0, 5.0), ((1.0, 2.0), (3.0, 4.0))), Line("b", (0.0, 5.0), ((9.0, 8.0), (math.inf, 6.0)))
    first = plot(*lines)
    with matplotlib.rc_context({"lines.linewidth": 9, "axes.grid": False, "font.size": 30, "svg.fonttype": "none"}):
        assert plot(*lines) == first
    assert plot(lines[0], Line("b", (0.0, 5.0), ((9.0, 8.0), (7.0, 6.0)))) != first
    assert not re.search(r"\d\d:\d\d:\d\d", first)


def test_nothing_but_failures_can_be_drawn():
    assert "<svg" in plot(Line("a", (0.0, 5.0), ((math.inf, math.inf), (math.inf, math.inf))))


@pytest.mark.parametrize("scale", ["linear", "log", "symlog"])
def test_levels_at_which_all_fail_lie_within_the_axis(scale):
    from matplotlib.figure import Figure

    axis = Figure().subplots()
    _set_levels(axis, Panel("terrace", (Line("a", (5.0, 10.0), ((math.inf,), (1.0,))),)), Axis("shared", "n", scale=scale))
    axis.plot([10.0], [1.0])
    low, high = axis.get_xlim()
    assert low < 5.0 < 10.0 < high
