"""Clothes of people: a colour for each quad of their surface, and their optional parts."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.simulation.rendering.mesh import OPTIONAL, Template

Mask = NDArray[np.bool_]
Colour = tuple[float, float, float]
"""Blue, green, red; 0 to 255, in full light."""

SKINS: tuple[Colour, ...] = ((150, 180, 225), (135, 165, 215), (120, 150, 200), (95, 130, 185), (70, 100, 150), (50, 70, 110))
HAIRS: tuple[Colour, ...] = ((25, 25, 30), (28, 35, 50), (40, 58, 85), (70, 110, 150), (110, 160, 195), (140, 140, 145))
LEATHERS: tuple[Colour, ...] = ((30, 30, 32), (40, 55, 85), (215, 215, 215), (120, 60, 45), (45, 45, 170))
VEST: Colour = (60, 235, 215)
VEST_TROUSERS: Colour = (85, 60, 45)
REFLECTIVE: Colour = (215, 220, 220)
PATTERNS = ("plain", "plain", "plain", "stripes", "halves", "jacket", "logo")


@dataclass(frozen=True)
class Outfit:
    """Clothes, hair and build of one person."""

    skin: Colour
    hair: Colour
    hair_style: str
    """short | long | bald | cap (`hair` is then the colour of the cap)."""
    shirt: Colour
    second: Colour
    """Second colour of the pattern."""
    pattern: str
    """plain | stripes | halves | jacket | logo | vest."""
    sleeves: str
    """long | short."""
    trousers: Colour
    legs: str
    """long | shorts | skirt."""
    shoes: Colour
    backpack: Colour | None
    build: float
    """Factor on all widths of the body."""


def draw_outfits(clothes: str, count: int, rng: np.random.Generator) -> tuple[Outfit, ...]:
    """Draw the outfits of `count` people; `clothes` as in `RenderOptions`. Each person uses a child of `rng`."""
    return tuple(_draw(clothes, person) for person in rng.spawn(count))


def _draw(clothes: str, rng: np.random.Generator) -> Outfit:
    skin, hair, shoes = (kinds[int(rng.integers(len(kinds)))] for kinds in (SKINS, HAIRS, LEATHERS))
    style = str(rng.choice(("short", "long", "cap", "bald"), p=(0.5, 0.28, 0.12, 0.10)))
    build = float(rng.uniform(0.95, 1.05))
    shirt, second, trousers, cap, bag = (_cloth(rng) for _ in range(5))
    sleeves = "long" if rng.uniform() < 0.5 else "short"
    legs = str(rng.choice(("long", "shorts", "skirt"), p=(0.7, 0.18, 0.12)))
    pattern = PATTERNS[int(rng.integers(len(PATTERNS)))]
    backpack = bag if rng.uniform() < 0.15 else None
    if clothes == "alike":
        style = "short" if style == "cap" else style
        return Outfit(skin, hair, style, VEST, VEST_TROUSERS, "vest", "long", VEST_TROUSERS, "long", shoes, None, build)
    hair = cap if style == "cap" else hair
    return Outfit(skin, hair, style, shirt, second, pattern, sleeves, trousers, legs, shoes, backpack, build)


def _cloth(rng: np.random.Generator) -> Colour:
    """Draw the colour of a garment: any hue; one in three is white, grey or black."""
    hue, saturation, value = rng.uniform(0, 1), rng.uniform(0.25, 0.9), rng.uniform(0.25, 0.95)
    if rng.uniform() < 0.35:
        saturation, value = 0.08, float(rng.choice((0.15, 0.3, 0.55, 0.9)))
    red, green, blue = colorsys.hsv_to_rgb(hue, saturation, value)
    return 255 * blue, 255 * green, 255 * red


@dataclass(frozen=True, eq=False)
class Wardrobe:
    """The outfits of P people on a template of F quads."""

    colours: Floats
    """(P, F, 3) blue, green, red in full light."""
    worn: Mask
    """(P, F) whether a person has a quad."""


def dress(template: Template, outfits: tuple[Outfit, ...]) -> Wardrobe:
    """Return the colours and the worn parts of all people's quads."""
    return Wardrobe(
        np.stack([_colours(template, outfit) for outfit in outfits]),
        np.stack([_find_worn(template, outfit) for outfit in outfits]),
    )


def _find_worn(template: Template, outfit: Outfit) -> Mask:
    wears = {
        "hair": outfit.hair_style == "long",
        "skirt": outfit.legs == "skirt",
        "backpack": outfit.backpack is not None,
        "brim": outfit.hair_style == "cap",
    }
    worn = np.ones(len(template.quads), dtype=np.bool_)
    for part in OPTIONAL:
        worn[template.faces(part)] = wears[part]
    return worn


def _colours(template: Template, outfit: Outfit) -> Floats:
    colours = np.zeros((len(template.quads), 3))
    ring, front = template.ring, np.sin(template.angle)

    def paint(part: str, colour: Colour, where: Callable[[], Mask] | None = None) -> None:
        mask = template.faces(part)
        colours[mask if where is None else mask & where()] = colour

    for part in ("neck", "hand", "head"):
        paint(part, outfit.skin)
    for part in ("hair", "brim"):
        paint(part, outfit.hair)
    _paint_head(template, outfit, colours)
    paint("trunk", outfit.shirt)
    paint("arm", outfit.shirt)
    _paint_pattern(template, outfit, colours)
    if outfit.sleeves == "short":
        paint("arm", outfit.skin, lambda: ring >= 4)
    paint("trunk", outfit.trousers, lambda: ring >= 8)
    paint("trunk", (0.5 * np.array(outfit.trousers)).tolist(), lambda: ring == 7) if outfit.legs != "skirt" else None
    paint("leg", outfit.trousers)
    bare = {"long": 99, "shorts": 4, "skirt": 0}[outfit.legs]
    paint("leg", outfit.skin, lambda: ring >= bare)
    paint("skirt", outfit.trousers)
    paint("shoe", outfit.shoes)
    paint("backpack", outfit.backpack or (0.0, 0.0, 0.0))
    # The soles are dark and the tops are lit: this edge makes shoes recognisable.
    paint("shoe", (0.45 * np.array(outfit.shoes)).tolist(), lambda: front < -0.5)
    return colours


def _paint_head(template: Template, outfit: Outfit, colours: Floats) -> None:
    """Paint hair over the forehead and behind the ears, and brows and mouth a little darker than the skin."""
    head, ring, front = template.faces("head"), template.ring, np.sin(template.angle)
    skin = np.array(outfit.skin)
    if outfit.hair_style != "bald":
        hairy = head & (
            (ring <= 1) | ((ring == 2) & (front < 0.75)) | ((ring <= 6) & (front < 0.1)) | ((ring == 7) & (front < -0.3))
        )
        colours[hairy] = outfit.hair
    ahead = head & (front > 0.7)
    colours[ahead & (ring == 4) & (front < 0.97)] = 0.55 * skin  # brows and eyes, beside the nose
    colours[ahead & (ring == 5) & (front > 0.9)] = np.minimum(1.08 * skin, 255)
    colours[ahead & (ring == 7) & (front > 0.85)] = skin * (0.75, 0.7, 0.85)  # mouth


def _paint_pattern(template: Template, outfit: Outfit, colours: Floats) -> None:
    trunk, arm = template.faces("trunk"), template.faces("arm")
    ring, front, second = template.ring, np.sin(template.angle), np.array(outfit.second)
    if outfit.pattern == "stripes":
        colours[(trunk | arm) & (ring % 2 == 1)] = second
    elif outfit.pattern == "halves":
        colours[(trunk & (ring >= 5)) | (arm & (ring >= 6))] = second
    elif outfit.pattern == "jacket":
        colours[trunk & (front > 0.85)] = second
    elif outfit.pattern == "logo":
        colours[trunk & (np.abs(front) > 0.8) & ((ring == 3) | (ring == 4))] = second
    elif outfit.pattern == "vest":
        colours[arm] = second
        colours[trunk & ((ring == 4) | (ring == 6))] = REFLECTIVE
