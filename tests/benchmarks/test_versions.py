"""Which versions are tried, and how the page tells it."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

Bench = Callable[[str], ModuleType]


def test_the_lowest_versions_are_those_that_are_admitted(bench: Bench) -> None:
    versions = bench("versions")
    assert versions.lowest(["numpy>=2.1", "opencv-python-headless>=4.13", "tomli-w>=1.0"]) == [
        "numpy==2.1.*", "opencv-python-headless==4.13.*", "tomli-w==1.0.*",
    ]  # fmt: skip
    assert versions.lowest(["torch==2.13.0"]) == []


def test_a_failure_stands_on_the_page_with_its_name(bench: Bench) -> None:
    versions = bench("versions")
    case = {
        "version": "3.12.1",
        "end": "newest",
        "libraries": {"av": "19.0.2"},
        "passed": 6000,
        "skipped": 4,
        "failed": ["test_a::b"],
    }
    found = versions.tabulate({"python3.12 newest": case}, ["python3.14"])
    assert found.notes == ["Not here, and not tried: python3.14."]
    (row,) = found.tables["Versions"].rows
    assert "19.0.2" in row
    assert row[-3:] == ["6000", "4", "test_a::b"]
