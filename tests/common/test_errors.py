from pathlib import Path

import pytest

from passerby.common.errors import LONGEST, InputError
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
