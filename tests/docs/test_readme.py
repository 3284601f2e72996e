"""The tables of the README, and of other pages, are those of the records that runs have written."""

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


@pytest.mark.parametrize("where", ["README", "FILMING"])
def test_headline_tables_are_those_of_the_records(headline: ModuleType, where: str) -> None:
    file = getattr(headline, where)
    for name in headline.SHOWN[file]:
        shown = file.read_text().split(headline.begin(name))[1].split(headline.END)[0].strip()
        assert shown == headline.headlines(file, name).strip(), name


def test_records_without_the_table_are_told(headline: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no table 'Against the paper' in the records of paper"):
        headline.headlines(headline.README, "headline", tmp_path)


def test_links_lead_somewhere() -> None:
    text = (ROOT / "README.md").read_text()
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if "://" not in target:
            assert (ROOT / target).exists(), target


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "results").glob("*.md")), ids=lambda page: page.stem)
def test_every_page_of_results_tells_its_command(page: Path) -> None:
    last = page.read_text().strip().splitlines()[-1]
    assert re.match(
        r"Written by `(make reliability|python benchmarks/(run_paper|run|reliability/limits|mutation|versions)\.py)[ `]",
        last,
    ), last
