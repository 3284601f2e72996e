"""Draws `docs/figures/rooms.svg`: the rooms of the package in their layers, and which room imports which.

    python docs/make_rooms.py

Layers are those of the contract in pyproject.toml; arrows and lines of code are counted in the source. The same source draws
the same bytes.
"""

from __future__ import annotations

import ast
import tomllib
from collections import Counter
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "passerby"
PICTURE = ROOT / "docs" / "figures" / "rooms.svg"
WIDTH, HIGH, GAP, LAYER = 940, 44, 14, 78
"""Pixels: of the picture, a room's height, between two rooms, from layer to layer."""
INK, PAPER, LINE = "#1f2430", "#eef3fb", "#8ea3c0"


def main() -> None:
    """Write the picture."""
    PICTURE.write_text(drawing(), encoding="utf-8")
    print(f"written: {PICTURE.relative_to(ROOT).as_posix()}")


def layers() -> list[list[str]]:
    """The rooms of each layer, the highest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(one["layers"] for one in contracts if one["type"] == "layers")
    return [[room.strip() for room in row.split("|")] for row in rows if not row.startswith("_")]


def room_of(module: str) -> str | None:
    """The room that a dotted name is in; None for names of other packages and for the package's head."""
    parts = module.split(".")
    return parts[1] if parts[0] == "passerby" and len(parts) > 1 and not parts[1].startswith("_") else None


def imports() -> Counter[tuple[str, str]]:
    """How many import statements lead from one room to another, those in functions and for types counted too."""
    count: Counter[tuple[str, str]] = Counter()
    for path in sorted(PACKAGE.rglob("*.py")):
        here = path.relative_to(PACKAGE).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for there in filter(None, map(room_of, names)):
                if there != here and not here.startswith("_"):
                    count[here, there] += 1
    return count


def lines_of(room: str) -> int:
    """Lines of code, docstrings and comments of a room."""
    paths = [PACKAGE / f"{room}.py"] if (PACKAGE / f"{room}.py").is_file() else sorted((PACKAGE / room).rglob("*.py"))
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def drawing() -> str:
    """The picture as SVG."""
    rows, count = layers(), imports()
    boxes: dict[str, tuple[float, float, float]] = {}
    for number, rooms in enumerate(rows):
        width = min(220.0, (WIDTH - GAP) / len(rooms) - GAP)
        left = (WIDTH - len(rooms) * (width + GAP) + GAP) / 2
        for place, room in enumerate(rooms):
            boxes[room] = left + place * (width + GAP), 10.0 + number * LAYER, width
    height = len(rows) * LAYER - (LAYER - HIGH) + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" role="img">',
        "<title>The rooms of the package; a line leads from a room to one below that it imports</title>",
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
    ]
    for (here, there), number in sorted(count.items()):
        if here in boxes and there in boxes:
            (x, y, w), (u, v, z) = boxes[here], boxes[there]
            thick = min(0.4 + 0.04 * number, 4.0)
            parts.append(
                f'<path d="M{x + w / 2:.1f} {y + HIGH:.1f} C{x + w / 2:.1f} {y + HIGH + 26:.1f} {u + z / 2:.1f} {v - 26:.1f} '
                f'{u + z / 2:.1f} {v:.1f}" fill="none" stroke="{LINE}" stroke-width="{thick:.2f}" stroke-opacity="0.55">'
                f"<title>{escape(here)} imports {escape(there)} {number} times</title></path>"
            )
    for room, (x, y, w) in boxes.items():
        parts += [
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{HIGH}" rx="6" fill="{PAPER}" stroke="{INK}"/>',
            f'<text x="{x + w / 2:.1f}" y="{y + 19:.1f}" text-anchor="middle" font-size="15" fill="{INK}">{room}</text>',
            f'<text x="{x + w / 2:.1f}" y="{y + 35:.1f}" text-anchor="middle" font-size="11" fill="{INK}" '
            f'fill-opacity="0.7">{lines_of(room):,} lines</text>',
        ]
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    main()
