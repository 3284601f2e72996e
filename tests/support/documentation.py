"""The documentation's examples: blocks of code in Markdown, and what HTML comments before them say of how to run them.

`<!-- example: NAME -->`     from here on in a fresh folder that holds what `tests/docs/conftest.py` prepares under that name
`<!-- not run: WHY -->`      the next block is not run
`<!-- edit: FILE -->`        the next block of TOML is put into a file as readers do: lines that are switched off are replaced
`<!-- exit status: N -->`    with which the last command of the next block ends; 0 unless told
`<!-- toml: KIND -->`        the next block of TOML is no part of a scene file: `rig`, `model` or `training`
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from support.paths import ROOT

DOCS = ROOT / "docs"
COMMENT = re.compile(r"<!-- (example|not run|edit|exit status|toml): (.*?) -->")


@dataclass(frozen=True)
class Block:
    """A fenced block of code."""

    language: str
    text: str
    line: int
    """Of its first line in the page, from 1."""
    told: dict[str, str] = field(default_factory=dict)
    """What the comments before it say."""

    @property
    def commands(self) -> list[str]:
        """The command lines of a block for the shell, without prompts, comments and output."""
        lines = self.text.replace("\\\n", " ").splitlines()
        if self.language == "console":
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        return [line for line in (re.sub(r"(^|\s+)#.*", "", line).strip() for line in lines) if line]

    @property
    def outputs(self) -> list[list[str]]:
        """The lines shown below each command of a console block."""
        shown: list[list[str]] = []
        for line in self.text.splitlines():
            if line.startswith("$ "):
                shown.append([])
            elif shown:
                shown[-1].append(line)
        return shown


def pages() -> list[Path]:
    """The pages that people have written, and the README."""
    return [ROOT / "README.md", *sorted(path for path in DOCS.glob("*.md"))]


def blocks_of(page: Path) -> list[Block]:
    """All fenced blocks of a page, in order."""
    found, told, body, fence, language, start = [], {}, [], None, "", 0
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        opening = re.match(r"^(\s*)(```+)\s*([\w-]*)", line)
        if fence is None and opening:
            fence, language, start, body = (opening[1], opening[2]), opening[3], number + 1, []
        elif fence is not None and line.strip() == fence[1]:
            found.append(Block(language, "\n".join(body), start, told))
            fence, told = None, {}
        elif fence is not None:
            body.append(line.removeprefix(fence[0]))
        elif comment := COMMENT.search(line):
            told = {**told, comment[1]: comment[2]}
    return found


def without_code(text: str) -> str:
    """The page's text with fenced blocks and inline code taken out."""
    text = re.sub(r"^\s*```.*?^\s*```\s*$", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "", text)
