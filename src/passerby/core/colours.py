"""Colours of cameras and people: readable on white and on near-black, and distinct for colour-blind people.

Every colour has a contrast of 3 or more against white and against #111111 (WCAG 2.2, 1.4.11). Lightness can then vary only
little, so the colours differ by hue. Any two colours of cameras are 18 or more apart in CIE Lab as protanopes, deuteranopes and
tritanopes see them (Machado, Oliveira, Fernandes 2009), any two of people 15; the first ones much more. Names are written
beside every colour, because a long list repeats colours.
"""

from __future__ import annotations

CAMERA_COLOURS = (
    "#0066cc", "#ee6600", "#aa8899", "#8822ff", "#aa4411", "#118855", "#ff0055", "#775588", "#ff00ff", "#dd66cc",
)  # fmt: skip
PERSON_COLOURS = (
    "#0066cc", "#ff2233", "#22aa55", "#8800ff", "#994477", "#557711", "#ee33ff", "#669988", "#bb77cc", "#bb2255", "#9988aa",
    "#bb0099",
)  # fmt: skip
NOBODY = "#808080"
"""Colour of a box of an unknown person."""


def camera_colour(index: int) -> str:
    """Return `#rrggbb` of the camera with this index in the rig, from 0; the colours repeat after the last."""
    return CAMERA_COLOURS[index % len(CAMERA_COLOURS)]


def person_colour(identity: int) -> str:
    """Return `#rrggbb` of a person; grey for an unknown one (below 0)."""
    return NOBODY if identity < 0 else PERSON_COLOURS[identity % len(PERSON_COLOURS)]
