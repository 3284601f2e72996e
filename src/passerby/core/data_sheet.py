"""Fields of view and the focal lengths that follow from them: of a pinhole, and of an equidistant fisheye."""

from __future__ import annotations

import numpy as np

from passerby.common.errors import InputError

DATA_SHEET_SD = 0.15
"""Relative standard deviation of a focal length from a data sheet. It is 5 to 20 % too small because of what cameras crop when
they film, and 13 % too small where a field of view is stated for the diagonal of 16:9."""
NARROWEST_FIELD_DEG = 2.0
"""The longest zoom lenses of surveillance cameras have about this field of view."""
WIDEST_PINHOLE_DEG, WIDEST_FISHEYE_DEG = 150.0, 240.0
"""Beyond 150 degrees a pinhole shows little more than its border; almost no fisheye lens has more than 240."""
_VAGUEST_SD = 0.45
"""Largest relative standard deviation, that of the widest fields of view of a pinhole: a larger one would count as unknown."""
_ROUNDING_DEG = 1e-6


def focal_of_field(field_deg: float, side: float, *, fisheye: bool = False) -> float:
    """Return the focal length, pixels, of a lens that sees `field_deg` degrees over `side` pixels.

    Raises `InputError` for a field of view that no lens of this kind has.
    """
    narrowest, widest = NARROWEST_FIELD_DEG, _find_widest(fisheye)
    if not narrowest <= field_deg <= widest:
        more = "" if fisheye else f", or up to {WIDEST_FISHEYE_DEG:g} of a fisheye"
        raise InputError(
            f"hfov_deg {field_deg:g} is not the field of view of a {_kind(fisheye)} lens: give {narrowest:g} to {widest:g} "
            f"degrees{more}"
        )
    half = np.radians(field_deg) / 2
    return float(0.5 * side / (half if fisheye else np.tan(half)))


def sd_of_field(field_deg: float, *, fisheye: bool = False) -> float:
    """Return the relative standard deviation of a focal length that is computed from the field of view in a data sheet.

    The field of view includes the lens's distortion. Wide lenses lie between a pinhole and an equidistant lens, which are taken
    to be two standard deviations apart: 24 % at 90 degrees.
    """
    if fisheye:
        return DATA_SHEET_SD
    half = np.radians(field_deg) / 2
    return float(min(np.hypot(DATA_SHEET_SD, 0.5 * np.log(np.tan(half) / half)), _VAGUEST_SD))


def check_field(focal_px: float, size: tuple[int, int], *, fisheye: bool = False) -> None:
    """Raise `InputError` for a focal length that no lens has, by the field of view over the longer side of (width, height)."""
    if not (np.isfinite(focal_px) and focal_px > 0):
        raise InputError(f"a focal length of {focal_px:g} px is none: give a number above 0")
    side = max(size)
    half = 0.5 * side / focal_px
    field_deg = float(np.degrees(2 * (half if fisheye else np.arctan(half))))
    widest = _find_widest(fisheye)
    if not NARROWEST_FIELD_DEG - _ROUNDING_DEG <= field_deg <= widest + _ROUNDING_DEG:
        raise InputError(
            f"a focal length of {focal_px:.4g} px means {field_deg:.3g} degrees over the {side} px of a {size[0]} x {size[1]} "
            f"image, and a {_kind(fisheye)} lens sees {NARROWEST_FIELD_DEG:g} to {widest:g}: check the units, and whether the "
            "value is that of the image's other side"
        )


def _find_widest(fisheye: bool) -> float:
    return WIDEST_FISHEYE_DEG if fisheye else WIDEST_PINHOLE_DEG


def _kind(fisheye: bool) -> str:
    return "fisheye" if fisheye else "pinhole"
