"""What to do about what speaks against a calibration.

A reason is a sentence `what is wrong: what to do`. Where one tells no mend, a general one of its kind is given.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from passerby.report.values import listed

IMPERATIVES = (
    "add",
    "calibrate",
    "check",
    "choose",
    "convert",
    "correct",
    "cut",
    "declare",
    "delete",
    "fix",
    "give",
    "install",
    "leave",
    "let",
    "list",
    "look",
    "lower",
    "make",
    "mark",
    "measure",
    "move",
    "name",
    "place",
    "put",
    "raise",
    "record",
    "remove",
    "rename",
    "run",
    "search",
    "see",
    "set",
    "show",
    "sort",
    "state",
    "take",
    "tell",
    "try",
    "turn",
    "use",
    "wait",
    "write",
    r"under \[",
)
"""What a mend begins with."""

_MEND = re.compile(rf"[:;,] (?=(?:{'|'.join(IMPERATIVES)})\b)")

BY_KIND = (
    (r"embedding|looks", 'Go by the tracks instead: under [association] set mode = "combined" in the scene file.'),
    (r"clock|drift|offset", "Check the frame rates, and when the recordings were started."),
    (r"share|joined|registered|overlap", "Record people who walk where the views of these cameras overlap."),
    (r"focal|lens|intrinsics|distort", "Check the camera's intrinsics: calibrate its lens again with a board."),
    (r"scale|height of|distance|length", "Measure again what is stated under [scale] in the scene file."),
    (r"vertical", "Record people who walk about, seen from head to feet."),
    (r"line|spot|direction", "Record people who walk all over the view that the cameras share."),
    (r"converge", "Record longer, or under [solver.options] set max_iterations = 200."),
    (r"uncertain|too few|sightings|people", "Record longer, with more people in more places."),
)
"""By words of a reason, in this order."""
FOR_ANY = "Run passerby check on the scene file, and record more people who walk where the views overlap."


@dataclass(frozen=True)
class Point:
    """Something that is wrong or weak, and the mend."""

    what: str
    mend: str


def point_of(reason: str) -> Point:
    """A reason, parted at its mend."""
    text = " ".join(reason.split())
    found = _MEND.search(text)
    if found is not None and found.start() > 0:
        return Point(sentence(text[: found.start()]), sentence(text[found.end() :]))
    return Point(sentence(text), _general(text))


def points_of(reasons: Sequence[str], names: Sequence[str]) -> list[Point]:
    """All reasons, parted at their mends; those that say the same of several of the cameras, `names`, become one."""
    # Of two names that begin alike the longer one is tried first.
    one_of = "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
    one_camera = re.compile(rf"camera ({one_of})([ :].*)")
    alike: dict[str, list[str]] = {}
    for reason in reasons:
        one = one_camera.fullmatch(" ".join(reason.split()))
        rest = one[2] if one is not None else ""
        # The rest must not tell of figures: these are each camera's own.
        key, name = (rest, one[1]) if one is not None and not re.search(r"\d", rest) else (reason, "")
        alike.setdefault(key, []).append(name)
    whole = [
        f"camera{'s' if len(names) > 1 else ''} {listed(names)}{rest}" if names[0] else rest for rest, names in alike.items()
    ]
    return [point_of(text) for text in whole]


def sentence(text: str) -> str:
    """Text with a capital and a full stop; names that begin it keep their spelling."""
    text = text.strip()
    # A path, as in "videos/north.mp4: ...", is no word.
    first = re.match(r"([^\W\d_]+)[,:;]?(?:\s|$)", text)
    if first is not None and first[1].islower():
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."


def _general(text: str) -> str:
    """The mend of a kind of reason."""
    lower = text.lower()
    return next((mend for pattern, mend in BY_KIND if re.search(pattern, lower)), FOR_ANY)
