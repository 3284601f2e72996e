"""How a page of parts is grown: each part's cases are run side by side, and the page is there again after each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pages.cases import Outcomes, run_cases
from pages.commit import commit
from pages.kept import Kept, code_digest
from pages.page import Page
from pages.sections import Found, Head, Heading, Section, SectionedPage


@dataclass(frozen=True)
class Wanted:
    """What the user asks of a page of parts."""

    kept: Path
    """The folder of finished cases."""
    parts: Sequence[str] = ()
    """Names of parts; all where none is named."""
    seeds: int = 10
    """Of each scene."""
    workers: int = 2
    earlier: Mapping[str, Section] | None = None
    """Sections of the page as it was, for the parts that are not run."""


FoundIn = Callable[[str, Mapping[str, Any], Outcomes, str], Found]
"""Of a part's name, its cases, the outcomes of those that are finished and the commit: the part as far as it is finished."""


def finished(
    part: str, cases: Mapping[str, Any], work: Callable[[Any], Mapping[str, Any]], found_in: FoundIn, wanted: Wanted,
    code: Sequence[str],
) -> Iterator[Found]:  # fmt: skip
    """A part again and again, as its cases are finished; `code` names the folders that its outcomes depend on."""
    store, name = Kept(wanted.kept, code), commit()
    for done in run_cases(store, part, cases, work, wanted.workers):
        yield found_in(part, cases, done, name)


def grown(
    name: str, head: Head, headings: Mapping[str, Heading], part: Callable[[str], Iterable[Found | str]], wanted: Wanted,
    code: Sequence[str],
) -> Iterator[Page]:  # fmt: skip
    """The page after each finished case of the wanted parts; `part` runs one by its name."""
    runs: dict[str, Callable[[], Iterable[Found | str]]] = {one: partial(part, one) for one in wanted.parts or headings}
    return SectionedPage(name, head, headings, code_digest(*code), timed=False).grow(runs, wanted.earlier or {})
