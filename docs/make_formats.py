"""Writes the list of formats in `docs/formats.md` from the registry: what `passerby formats --markdown` prints.

    python docs/make_formats.py

`tests/docs/test_formats_page.py` fails where the committed page is not what this writes.
"""

from __future__ import annotations

from pathlib import Path

from passerby.cli.commands.formats import as_markdown
from passerby.interchange.formats import all_formats
from passerby.interchange.storage.atomic import write_text

PAGE = Path(__file__).resolve().parent / "formats.md"
BEGIN, END = "<!-- formats: written by docs/make_formats.py -->\n", "<!-- formats: end -->\n"


def page(text: str) -> str:
    """The page with the list as it is now."""
    before, rest = text.split(BEGIN)
    return before + BEGIN + "\n" + as_markdown(list(all_formats())) + "\n" + END + rest.split(END)[1]


if __name__ == "__main__":
    write_text(PAGE, page(PAGE.read_text(encoding="utf-8")))
