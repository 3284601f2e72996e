"""The tables of the README, and of other pages, are those of the pages that commands have written."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from support.paths import ROOT


@pytest.fixture(scope="module")
def headline() -> ModuleType:
    spec = importlib.util.spec_from_file_location("headline", ROOT / "benchmarks" / "headline.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["headline"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["README", "FILMING"])
def test_headline_tables_are_those_of_the_pages(headline: ModuleType, name: str) -> None:
    file = getattr(headline, name)
    shown = file.read_text().split(headline.BEGIN)[1].split(headline.END)[0].strip()
    assert shown == headline.headlines(file).strip()


def test_a_page_without_the_table_is_told(headline: ModuleType) -> None:
    with pytest.raises(ValueError, match="no table"):
        headline.first_table("# Page\n\ntext\n", "## Goals")
    assert headline.first_table("## A\n\n| x |\n|---|\n| 1 |\n\n| y |\n", "## A") == "| x |\n|---|\n| 1 |"


def test_links_lead_somewhere() -> None:
    text = (ROOT / "README.md").read_text()
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if "://" not in target:
            assert (ROOT / target).exists(), target


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "results").glob("*.md")), ids=lambda page: page.stem)
def test_every_page_of_results_tells_its_command(page: Path) -> None:
    last = page.read_text().strip().splitlines()[-1]
    assert re.match(
        r"Written by `python benchmarks/(run_paper|run|reliability/limits|mutation|versions)\.py[ `]",
        last,
    ), last
