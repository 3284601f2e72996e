"""Cameras' names: made from the names of files, and matched with the names in a calibration.

The rules are few and simple, so that a name can be predicted: see `camera_names` and `match_names`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from passerby.common.text import _NUMBER
from passerby.interchange.rig_toml import METADATA

_WORD = re.compile(r"[^\s_.\-]+")


def valid_name(text: str) -> str:
    """The text with what cannot stand in a camera's name (see `passerby.scene.scene.CAMERA_NAME`) replaced by a space."""
    name = re.sub(r"\s+", " ", re.sub(r"[^\w .+@-]", " ", text))
    name = name.lstrip(" .+").rstrip(" .") or "camera"
    return f"{name} camera" if name == METADATA else name


def camera_names(texts: Sequence[str]) -> list[str]:
    """One valid name for each text, all different.

    Words (separated by spaces, `_`, `-` and full stops) that all texts begin with, or end with, are dropped, as long as what is
    left of each holds a letter: "walk_cam1_1080p" and "walk_cam2_1080p" are cam1 and cam2, "cam_1" and "cam_2" stay.
    A name that comes up again gets "-2", "-3", ...
    """
    whole = [valid_name(text) for text in texts]
    words = [list(_WORD.finditer(text)) for text in whole]
    first, last = _common(words)

    def without(first: int, last: int) -> list[str]:
        return [
            text[found[first].start() : found[len(found) - 1 - last].end()] if found else text
            for text, found in zip(whole, words, strict=True)
        ]

    names = without(first, last)
    while not _all_have_letters(names) and (first or last):
        first, last = (first - 1, last) if first else (0, last - 1)
        names = without(first, last)
    if not _all_have_letters(names) or (first, last) == (0, 0):
        names = whole
    return _different([valid_name(name) for name in names])


def match_names(cameras: Sequence[str], others: Sequence[Sequence[str]], *, by_number: bool = True) -> dict[int, int]:
    """Which of the other things belongs to which camera: index of the camera to index of the other, each at most once.

    Args:
        cameras: The cameras' names.
        others: The names that each of the other things goes by.
        by_number: Whether numbers in the names may match them.

    By name; then by name with capitals, spaces and `_ - .` set aside; then by the last number in the name, if by it every
    camera that is left finds a thing of its own: cameras 1 to 4 are not matched with tables 0 to 3.
    """
    found: dict[int, int] = {}
    for same in (str, _plain):
        found |= _by(same, cameras, others, found)
    numbered = _by(_last_number, cameras, others, found) if by_number else {}
    if len(found) + len(numbered) == len(cameras):
        found |= numbered
    return found


def _by(
    same: Callable[[str], object], cameras: Sequence[str], others: Sequence[Sequence[str]], known: dict[int, int]
) -> dict[int, int]:
    """What is matched where `same` of two names is equal, not None, and stands once on either side."""
    ours: dict[object, list[int]] = {}
    theirs: dict[object, list[int]] = {}
    for index, name in enumerate(cameras):
        if index not in known:
            ours.setdefault(same(name), []).append(index)
    for index, names in enumerate(others):
        if index not in known.values():
            for key in {same(name) for name in names}:
                theirs.setdefault(key, []).append(index)
    pairs = {
        ours[key][0]: theirs[key][0]
        for key in ours
        if key is not None and len(ours[key]) == 1 and len(theirs.get(key, ())) == 1
    }
    return pairs if len(set(pairs.values())) == len(pairs) else {}


def _plain(name: str) -> str:
    return re.sub(r"[\s_.\-]", "", name.casefold())


def _last_number(name: str) -> str | None:
    """Its digits without zeros before them: a name may have more than a number can."""
    numbers = _NUMBER.findall(name)
    return numbers[-1].lstrip("0") if numbers else None


def _common(words: list[list[re.Match[str]]]) -> tuple[int, int]:
    """How many words all texts share at the beginning and at the end, so that at least one of each is left."""
    texts = [[word.group() for word in found] for found in words]
    if len(texts) < 2:
        return 0, 0
    spare = max(min(map(len, texts)) - 1, 0)
    first = last = 0
    while first < spare and len({text[first] for text in texts}) == 1:
        first += 1
    while last < spare - first and len({text[-1 - last] for text in texts}) == 1:
        last += 1
    return first, last


def _all_have_letters(names: Sequence[str]) -> bool:
    return all(any(character.isalpha() for character in name) for name in names)


def _different(names: Sequence[str]) -> list[str]:
    """The names, those that stood before (capitals aside: they become file names) with a number."""
    found: list[str] = []
    taken: set[str] = set()
    for name in names:
        number, chosen = 1, name
        while chosen.casefold() in taken or (number > 1 and chosen in names):
            number += 1
            chosen = f"{name}-{number}"
        taken.add(chosen.casefold())
        found.append(chosen)
    return found
