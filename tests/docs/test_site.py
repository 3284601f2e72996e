"""The pages as a whole: links and anchors, and the site that is built of them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from support.documentation import DOCS, ROOT, without_code

ALL = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
OFFLINE = ("fonts.googleapis", "fonts.gstatic", "unpkg.com", "cdn.", "cdnjs", "jsdelivr")


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as mkdocs makes them."""
    found: set[str] = set()
    in_code = False
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            in_code = not in_code
        heading = re.match(r"#+ (.*)", line)
        if heading is None or in_code:
            continue
        named = re.search(r"\{ *#([\w-]+) *\}", heading[1])
        text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", lambda m: m[1] or "", heading[1])
        slug = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", text).strip().lower())
        found.add(named[1] if named else slug)
    return found


@pytest.mark.parametrize("page", ALL, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
        if "://" in target or target.startswith("mailto:"):
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        assert there.exists(), target
        if page != ROOT / "README.md":
            assert there.is_relative_to(DOCS), f"{target}: lies outside the documentation"
        if anchor and there.suffix == ".md":
            assert anchor in anchors(there), target


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as strictly as by `make docs`."""
    pytest.importorskip("material", reason="mkdocs-material is not installed: pip install 'passerby[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_site_needs_no_network(site: Path) -> None:
    """No page, style or script of a page is loaded from elsewhere: mermaid's address stands in the theme, and is never used."""
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"?([^\"\s>]+)", text)
        assert [address for address in loaded if address.startswith(("http", "//"))] == []
        assert not any(word in address for address in loaded for word in OFFLINE)
        assert 'class="mermaid"' not in text


def test_the_site_has_the_pages_that_are_made_when_it_is_built(site: Path) -> None:
    for name, heading in (("commands", "passerby-models-fetch"), ("formats", "colmap"), ("findings", "All messages")):
        assert heading in (site / "reference" / f"{name}.html").read_text(encoding="utf-8")


def test_the_site_has_no_scripts(site: Path) -> None:
    assert not list(site.rglob("*.py"))
    assert "Film" in (site / "tutorial.html").read_text(encoding="utf-8")
