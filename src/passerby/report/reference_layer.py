"""The horizon and plumb lines as a camera's picture should show them: whether lens and pose are right, by the eye.

A vertical edge of a building lies along the plumb line of its heading, near or far, so no place on the ground is needed. A
wrong lens bends or tilts these lines against door posts and people; a wrong pose tilts the horizon.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.report.html import Html, join
from passerby.report.sheet import Sheet, path_of, within
from passerby.report.through_lens import View

COLOUR = "#ffd54a"
"""On a picture, where the page's own colours do not matter."""
ON_PAPER = "var(--warn, #855000)"
STEPS_DEG = (45.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0)
"""Between the headings of plumb lines: the narrowest with"""
MOST_LINES = 9
"""or fewer in the picture."""


def reference_layer(sheet: Sheet) -> Html:
    """The horizon and plumb lines, thin, each kind with its name."""
    if sheet.camera.pose is None:
        return Html("")
    view, colour = View(sheet.camera), COLOUR if sheet.backdrop.uri is not None else ON_PAPER
    parts = []
    lines = plumb_lines(view)
    if lines:
        d = "".join(path_of(stretch) for stretches in lines for stretch in stretches)
        parts.append(sheet.path(d, 1.0, stroke=colour, stroke_opacity=0.8, class_="verticals"))
    horizon = view.horizon()
    if horizon:
        d = "".join(path_of(stretch) for stretch in horizon)
        parts.append(sheet.path(d, 1.6, stroke=colour, stroke_dasharray="9 4", class_="horizon"))
        end = max(np.concatenate(horizon), key=lambda xy: xy[0])
        parts.append(_name(sheet, "horizon", end, colour))
    if lines:
        # Of the line that reaches highest, the one farthest to the right where several leave through the upper border.
        tops = [_highest(stretches) for stretches in lines]
        parts.append(_name(sheet, "vertical", min(tops, key=lambda xy: (round(xy[1]), -xy[0])), colour))
    return join(*parts)


def plumb_lines(view: View) -> list[list[Floats]]:
    """As many plumb lines as a drawing bears, as `View.verticals` has them."""
    fitting = None
    for step in map(np.deg2rad, STEPS_DEG):
        # To count lines takes a fifteenth of the time that it takes to find where they leave the picture.
        if view.count_verticals(step) > MOST_LINES:
            break
        fitting = step
    return [] if fitting is None else view.verticals(fitting)


def _highest(stretches: list[Floats]) -> Floats:
    """(2,) the pixel of a line that is highest in the picture."""
    points = np.concatenate(stretches)
    return np.asarray(points[np.argmin(points[:, 1])])


def _name(sheet: Sheet, words: str, end: Floats, colour: str) -> Html:
    """What a line is, to the left of one of its ends."""
    x, y = within(sheet, (end[0] - 0.4 * sheet.letters, end[1] - 0.4 * sheet.letters))
    anchor = "end" if x > 0.6 * len(words) * sheet.letters else "start"
    return sheet.text(words, (x, y), fill=colour, text_anchor=anchor, class_="line-name")
