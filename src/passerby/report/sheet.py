"""A sheet of paper over a camera's picture: lines and letters that can be read on a photograph and on a blank page.

Coordinates are those of the camera's pixels, whose origin is the middle of the first one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from passerby.common.arrays import Floats
from passerby.core.cameras import Camera
from passerby.report.backdrop import Backdrop
from passerby.report.html import Attribute, Html, element, join

TEXT_SHARE = 1 / 40
"""Height of the letters, of the picture's width."""
MOST_TEXT = 40


@dataclass(frozen=True, eq=False)
class Sheet:
    """What all layers of one drawing share."""

    camera: Camera
    backdrop: Backdrop
    ink: str
    """Of lines that belong to no person."""

    @property
    def letters(self) -> float:
        """Height of letters, pixels of the camera."""
        return round(self.camera.lens.size[0] * TEXT_SHARE, 1)

    def path(self, d: str, width: float, **attributes: Attribute) -> Html:
        """A line, on a picture with a dark one behind it."""
        common: dict[str, Attribute] = {
            "d": d,
            "fill": "none",
            "vector_effect": "non-scaling-stroke",
            "stroke_linecap": "round",
        }
        behind = None
        if self.backdrop.uri is not None:
            behind = element("path", **common, stroke="#000", stroke_opacity=0.45, stroke_width=width + 1.6, class_="behind")
        return join(behind, element("path", **{**common, "stroke": self.ink, "stroke_width": width, **attributes}))

    def text(self, words: str, xy: Sequence[float], **attributes: Attribute) -> Html:
        """Letters, on a picture with a dark rim."""
        rim: dict[str, Attribute] = {}
        if self.backdrop.uri is not None:
            rim = {"stroke": "#000", "stroke_opacity": 0.6, "stroke_width": round(self.letters / 5, 1), "paint_order": "stroke"}
        return element(
            "text", clip_text(words), x=short(xy[0]), y=short(xy[1]), font_size=self.letters,
            **{"fill": self.ink, **rim, **attributes},
        )  # fmt: skip


def clip_text(words: str, most: int = MOST_TEXT) -> str:
    """Text on one line that XML can hold, cut off where it is too long for a drawing."""
    plain = "".join(letter if letter.isprintable() else " " for letter in words)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def path_of(points: Floats) -> str:
    """(K, 2) pixels as an SVG path of straight strokes."""
    return "M" + "L".join(f"{short(x)} {short(y)}" for x, y in points.tolist())


def within(sheet: Sheet, xy: Sequence[float] | Floats) -> tuple[float, float]:
    """Where letters begin that are to stay in the picture."""
    width, height = sheet.camera.lens.size
    x, y = float(xy[0]), float(xy[1])
    return min(max(x, 0.3 * sheet.letters), width - 1.5 * sheet.letters), min(
        max(y, 1.1 * sheet.letters), height - 0.4 * sheet.letters
    )


def dot(xy: Floats, radius: float, colour: str, **attributes: Attribute) -> Html:
    """A disc around a pixel (2,)."""
    return element("circle", cx=short(xy[0]), cy=short(xy[1]), r=short(radius), fill=colour, **attributes)


def dot_path(xy: Floats, radius: float) -> str:
    """A disc as a path: many in one element take a third of the room."""
    x, y, r = float(xy[0]), float(xy[1]), short(radius)
    return f"M{short(x - radius)} {short(y)}a{r} {r} 0 1 0 {short(2 * radius)} 0a{r} {r} 0 1 0 {short(-2 * radius)} 0"


def short(value: float) -> str:
    """To a tenth of a pixel, without needless zeros."""
    return f"{round(float(value), 1) + 0.0:g}"


def offset_words(offset: Floats) -> str:
    """How far (2,) pixels right and down lead, in words."""
    right, down = offset.tolist()
    return f"{abs(right):.1f} px {'right' if right >= 0 else 'left'} and {abs(down):.1f} px {'down' if down >= 0 else 'up'}"
