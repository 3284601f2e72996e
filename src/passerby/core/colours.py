"""Colours of cameras and people: readable on white and on near-black, apart for those who see fewer colours.

Every colour has a contrast of 3 or more against white and against #111111 (WCAG 2.2, 1.4.11). That leaves little room for
light and dark, so they are spread by hue: any two of the cameras' are 18 or more apart in CIE Lab as protanopes, deuteranopes
and tritanopes see them (Machado, Oliveira, Fernandes 2009), any two of the people's 15; the first ones much farther. Names
are written beside every colour, since a long list repeats them.
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
"""A box of which it is not known whose it is."""


def camera_colour(index: int) -> str:
    """`#rrggbb` of the camera with this place in the rig, from 0; repeated after the last."""
    return CAMERA_COLOURS[index % len(CAMERA_COLOURS)]


def person_colour(identity: int) -> str:
    """`#rrggbb` of a person; grey for an unknown one (below 0)."""
    return NOBODY if identity < 0 else PERSON_COLOURS[identity % len(PERSON_COLOURS)]
