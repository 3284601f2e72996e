"""A page of several parts that are run at different times: those that are not run now stay as the page has them.

The page itself is the record, so that nothing is lost with a folder of temporary files. Before each section stands a comment
that readers of the page do not see: the part's name, the code that it was run on, and what the head of the page says of it.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pages.commit import commit
from pages.page import FOOT, Page, load

NOT_RUN = "not run"
_MARK = re.compile(r"^<!-- part (\S+) (\{.*\}) -->$", re.MULTILINE)
_OLDER = "*Run on an earlier state of the code.*"


@dataclass(frozen=True)
class Heading:
    """What stands above the figures of a part."""

    title: str
    says: str = ""
    """Markdown: what the tables are."""


@dataclass(frozen=True)
class Found:
    """What a part found, so far."""

    text: str
    """Markdown."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Plain values of which the head of the page is made."""
    further: tuple[Page, ...] = ()
    """Pages of this part alone."""


@dataclass(frozen=True)
class Section:
    """A part on the page."""

    part: str
    """Its name, a single word."""
    title: str
    text: str
    """Markdown below the title."""
    code: str = ""
    """Digest of the code that it was run on; empty where it was not run."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    further: tuple[Page, ...] = ()
    """Pages to be written with this one; none of a section that was read."""


Head = str | Callable[[Sequence[Section]], str]
"""Markdown above the sections, or what makes it of them."""


@dataclass(frozen=True)
class SectionedPage:
    """A page of parts, as it is to be written."""

    name: str
    head: Head
    headings: Mapping[str, Heading]
    """Of all parts, in their order on the page."""
    code: str | Mapping[str, str]
    """Digest of the code as it is now, of all parts or by part."""
    timed: bool = True
    """Whether a section ends with its time and commit: not where finished cases are taken from an earlier run."""

    def grow(self, parts: Mapping[str, Callable[[], Iterable[Found | str]]], earlier: Mapping[str, Section]) -> Iterator[Page]:
        """Run some parts one after another; the page again and again as it grows. Without any, the page as it is.

        Args:
            parts: by name, what tells its figures as far as they are, again and again.
            earlier: the sections of `sections_on`, for the parts that are not run; those that explain their tables otherwise
                than they do now are not taken.
        """
        sections = {}
        for part, heading in self.headings.items():
            known = earlier.get(part)
            fits = known is not None and known.title == heading.title and known.text.startswith(heading.says)
            sections[part] = known if known is not None and fits else self._section(part, Found(NOT_RUN))
        if not parts:
            yield self.page(sections.values())
        for part, run in parts.items():
            began = time.perf_counter()
            for found in run():
                found = Found(found) if isinstance(found, str) else found
                if self.timed:
                    minutes = (time.perf_counter() - began) / 60
                    note = f"{minutes:.1f} minutes; mean load at the end {load():.1f}; code of commit {commit()}."
                    found = replace(found, text=f"{found.text}\n\n{note}")
                sections[part] = replace(self._section(part, found), code=self.code_of(part))
                yield self.page(sections.values())

    def page(self, sections: Iterable[Section]) -> Page:
        """The page of these sections; one of other code says that it is older."""
        sections = list(sections)
        parts = [self.head if isinstance(self.head, str) else self.head(sections)]
        for section in sections:
            known = json.dumps({"code": section.code, **section.facts}, ensure_ascii=False).replace("--", "-\\u002d")
            older = [_OLDER] if section.code not in ("", self.code_of(section.part)) else []
            parts += [f"<!-- part {section.part} {known} -->", f"## {section.title}", *older, section.text.strip()]
        further = tuple(page for section in sections for page in section.further)
        return Page(self.name, "\n\n".join(parts) + "\n", commit_in_text=True, further=further)

    def code_of(self, part: str) -> str:
        """Digest of the code of a part as it is now."""
        return self.code if isinstance(self.code, str) else self.code[part]

    def _section(self, part: str, found: Found) -> Section:
        heading = self.headings[part]
        text = "\n\n".join(paragraph for paragraph in (heading.says, found.text.strip()) if paragraph)
        return Section(part, heading.title, text, facts=found.facts, further=found.further)


def sections_on(page: Path | None) -> dict[str, Section]:
    """The sections of a page that was written before, by part; none where there is no page."""
    if page is None or not page.is_file():
        return {}
    text = page.read_text(encoding="utf-8").rpartition(f"\n\n{FOOT}")[0]
    marks = list(_MARK.finditer(text))
    ends = [*(mark.start() for mark in marks[1:]), len(text)]
    found = {}
    for mark, end in zip(marks, ends, strict=True):
        facts = json.loads(mark[2])
        title, _, rest = text[mark.end() : end].strip().removeprefix("## ").partition("\n\n")
        body = rest.removeprefix(f"{_OLDER}\n\n").strip()
        found[mark[1]] = Section(mark[1], title, body, facts.pop("code"), facts)
    return found
