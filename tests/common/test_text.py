"""Messages of errors are cut to what a person reads, and lists of names are short."""

from pathlib import Path

import pytest

from passerby.common.errors import LONGEST, InputError
from passerby.common.text import list_names
from passerby.interchange.storage.safe_parsing import FileFaults

LONG = "[" * 5000


def test_a_word_that_is_longer_than_any_file_name_is_shown_by_its_ends():
    shown = str(InputError(f"points.csv: line 6: point <{LONG}> occurs a second time in camera A: delete one"))
    assert shown == f"points.csv: line 6: point <{'[' * 79}...{'[' * 19}> occurs a second time in camera A: delete one"
    faults = FileFaults([f"a: {LONG}", f"b: {LONG}"])
    assert len(str(faults)) < 150
    assert all(len(fault) < 150 for fault in faults.faults)


def test_paths_and_lists_of_names_stay_whole_however_long_they_are():
    path = Path("/").joinpath(*(letter * 255 for letter in "abcdef"))
    names = ", ".join(f"camera {number}" for number in range(100))
    for text in (f"{path}: no such file", f"{'/'.join(['a folder'] * 50)}/scene.toml: {names}: no such cameras"):
        assert str(InputError(text)) == text


@pytest.mark.parametrize(
    ("text", "begin", "end", "longest"),
    [
        ("a few words " * 10_000 + "the fix", "a few words", "the fix", LONGEST),
        (f"intri.yml: camera {'- ' * 2000}- is missing: give it", "intri.yml: camera - - ", "- is missing: give it", 399),
    ],
)  # fmt: skip
def test_a_message_of_many_words_is_shown_by_its_ends(text, begin, end, longest):
    shown = str(InputError(text))
    assert shown.startswith(begin)
    assert shown.endswith(end)
    assert len(shown) <= longest


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["C1", "C2", "C3"], "C1, C2, C3"),
        ([f"C{number}" for number in range(8, 13)], "C8 to C12"),
        (["hall", "C1", "C2", "C3", "C4", "C6"], "hall, C1 to C4, C6"),
        (["cam08", "cam09", "cam10", "cam11"], "cam08 to cam11"),
        (["cam8", "cam9", "cam010", "cam011"], "cam8, cam9, cam010, cam011"),
        (["C4", "C3", "C2", "C1"], "C4, C3, C2, C1"),
        (["A1", "B2", "C3", "D4"], "A1, B2, C3, D4"),
        ([], ""),
    ],
)
def test_numbered_names_are_shown_by_the_first_and_the_last(names: list[str], told: str):
    assert list_names(names) == told


def test_the_first_of_very_many_names_are_shown():
    assert list_names([f"C{number}" for number in range(1, 1001)]) == "C1 to C1000"
    for more, count in (([], 500), ([f"C{number}" for number in range(1, 10)], 509)):
        shown = list_names([f"hall-{number}-north" for number in range(500)] + more)
        names, _, left = shown.removesuffix(" more").rpartition(" and ")
        assert names.startswith("hall-0-north, hall-1-north, ")
        assert names.count(",") + 1 + int(left) == count
