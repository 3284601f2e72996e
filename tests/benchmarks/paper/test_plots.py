"""Figures over seeds, where a failure is infinitely far and never averaged away, and plots of them."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from paper.conditions import Outcome
from paper.plots import HEAD, Axis, Line, Panel, _set_levels, error_plot, quartiles, spread_cells

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
    assert "<svg" in plot(Line("a", (0.0, 5.0), ((math.inf, math.inf), (math.inf, math.inf)))), "nothing but failures"


@pytest.mark.parametrize("scale", ["linear", "log", "symlog"])
def test_levels_at_which_all_fail_lie_within_the_axis(scale):
    from matplotlib.figure import Figure

    axis = Figure().subplots()
    _set_levels(axis, Panel("terrace", (Line("a", (5.0, 10.0), ((math.inf,), (1.0,))),)), Axis("shared", "n", scale=scale))
    axis.plot([10.0], [1.0])
    low, high = axis.get_xlim()
    assert low < 5.0 < 10.0 < high


def outcome(mm):
    if math.isinf(mm):
        return Outcome("refused", "too little", 3, 4)
    return Outcome("accepted", "", 4, 4, mm, mm / 100, 2 * mm, mm / 50, 0.01)


@given(st.lists(st.floats(0.1, 1e6), min_size=1, max_size=12))
def test_quartiles_of_finite_figures_are_numpys(values):
    assert quartiles(values) == pytest.approx(np.quantile(values, (0.25, 0.5, 0.75)), rel=1e-12)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, 2, 3, 4, math.inf], (2, 3, 4)),
        ([1, 2, 3, math.inf, math.inf], (2, 3, math.inf)),
        ([1, math.inf], (math.inf, math.inf, math.inf)),
        ([5, math.inf, math.inf], (math.inf, math.inf, math.inf)),
        ([math.inf], (math.inf, math.inf, math.inf)),
    ],
)
def test_failures_are_larger_than_anything(values, expected):
    assert quartiles(values) == expected


def test_failures_are_counted_and_move_the_median() -> None:
    shown = spread_cells([outcome(10.0), outcome(20.0), outcome(math.inf)])
    assert shown[:3] == ["20.0 mm 0.200°", "15.0 to fails", "fails"]
    assert shown[-2:] == ["1 of 3", "2 accepted, 1 refused"]
    assert len(shown) == len(HEAD)
    # Where half of the seeds fail no figure stands.
    shown = spread_cells([outcome(10.0), outcome(math.inf)])
    assert shown[:-2] == ["fails"] * (len(HEAD) - 2)
    assert shown[-2] == "1 of 2"
