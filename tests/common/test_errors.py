from pathlib import Path

from passerby.common.errors import LONGEST, InputError
from passerby.interchange.storage.safe_parsing import FileFaults

LONG = "[" * 5000


def test_a_word_that_is_longer_than_any_file_name_is_shown_by_its_ends():
    shown = str(InputError(f"points.csv: line 6: point <{LONG}> occurs a second time in camera A: delete one"))
    assert shown == f"points.csv: line 6: point <{'[' * 79}...{'[' * 19}> occurs a second time in camera A: delete one"
    faults = FileFaults([f"a: {LONG}", f"b: {LONG}"])
    assert len(str(faults)) < 150
    assert all(len(fault) < 150 for fault in faults.faults)


def test_paths_stay_whole_however_long_they_are():
    path = Path("/").joinpath(*(letter * 255 for letter in "abcdef"))
    assert str(InputError(f"{path}: no such file")) == f"{path}: no such file"


def test_a_message_of_many_words_is_shown_by_its_ends():
    shown = str(InputError("a few words " * 10_000 + "the fix"))
    assert len(shown) <= LONGEST
    assert shown.startswith("a few words")
    assert shown.endswith("the fix")


def test_words_without_end_are_shown_by_their_ends():
    shown = str(InputError(f"intri.yml: camera {'- ' * 2000}- is missing: a 3 x 3 camera matrix is needed"))
    assert shown.startswith("intri.yml: camera - - ")
    assert shown.endswith("- is missing: a 3 x 3 camera matrix is needed")
    assert len(shown) < 400


def test_lists_of_names_and_paths_are_shown_whole():
    names = ", ".join(f"camera {number}" for number in range(100))
    path = "/".join(["a folder"] * 50)
    assert str(InputError(f"{path}/scene.toml: {names}: no such cameras")) == f"{path}/scene.toml: {names}: no such cameras"
