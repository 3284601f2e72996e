import pytest

from passerby.common.text import LISTED, list_names


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
def test_numbered_names_are_told_by_the_first_and_the_last(names: list[str], told: str):
    assert list_names(names) == told


def test_the_first_of_very_many_names_are_told():
    told = list_names([f"hall-{number}-north" for number in range(LISTED + 7)])
    assert told.endswith(f"hall-{LISTED - 1}-north and 7 more")
    assert list_names([f"C{number}" for number in range(1, 1001)]) == "C1 to C1000"
    several = [f"hall-{number}-north" for number in range(LISTED)] + [f"C{number}" for number in range(1, 10)]
    assert list_names(several).endswith(f"hall-{LISTED - 1}-north and 9 more")
