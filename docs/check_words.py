"""Words and turns that are not used, because an engineer whose English is technical English stumbles over them.

    python docs/check_words.py

Checks README, CHANGELOG, CONTRIBUTING and the pages in `docs` that people write, and the comments, docstrings and other strings
of `src`, in Python and JavaScript. It prints each place with what to write instead, and ends with status 1 if there is one.
Names in Python are checked for the words in `ALSO_IN_NAMES`. Codes of findings and other words with underscores are not
sentences, and are not checked.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GENERATED = ("docs/results/", "docs/reliability.md")
"""Pages that benchmarks write."""
INSTEAD = {
    r"told|untold": "reported, stated, known; `distinguished` for two things",
    r"nobody": "no person, none; or the passive voice",
    r"somebody": "a person",
    r"whoever": "each person who, all people who",
    r"hardly": "barely, weakly; or a figure",
    r"mostly": "usually, in most cases; or a figure",
    r"surer|surest|surely": "less uncertain, better constrained",
    r"(is|are|be|was|were|as|not|how|so) sure": "certain only for logic; else significant, well constrained",
    r"beyond doubt": "significant",
    r"astray": "diverges, fails",
    r"runs? away": "diverges",
    r"(a|for) want of": "insufficient, missing",
    r"otherwise than": "differs from",
    r"who is who": "identities, who is the same person",
    r"all told": "in total",
    r"as good as": "nearly; or a figure",
    r"stands? to each other|stand relative": "relative pose",
    r"rest(s|ed|ing)? on": "depends on, is computed from, uses",
    r"ways of (the )?(people|walkers)|people's ways": "trajectories",
    r"knock(s|ed|ing)?": "bumped, moved",
    r"in step": "synchronised",
    r"mend(s|ed|ing)?": "fix, correct, remedy",
    r"(has|have) a say": "contributes, counts",
    r"likelier|likeliest": "more likely, most likely",
    r"foretold|foretells?": "predicted",
    r"parted|parts them": "separated, split",
    r"wants? to be": "requires, has to be",
    r"(spoken|speak|speaks) (to|with)": "its input and output conventions",
    r"speaks? (against|for)": "contradicts, is evidence against",
    r"held against": "compared with",
    r"who searches|who looks for": "name the thing that needs it",
    r"for ever|as it were|of late|ere long": "leave it out",
    r"dull": "simple",
    r"nothing but": "only",
    r"once more": "again, a second time",
    r"however (large|small|many|few|long|far|near)": "independent of",
    r"steadied|steadiness": "motion-corrected, camera motion",
    r"likeness|resemblance": "appearance, affinity, similarity",
    r"so (many|much) as": "as many as, or a figure",
    r"in (its|their) stead|nought|thereof|whereof|hitherto": "instead, nothing, of it, until now",
}
"""Regular expression of a word or turn -> what to write."""
ALSO_IN_NAMES = re.compile(r"(?<![a-z])(somebody|whoever|hardly|surer|astray|mend|knocked|foretold|likelier)(?![a-z])")
ANY = re.compile(rf"(?<![\w-])(?:{'|'.join(INSTEAD).replace(' ', ' +')})(?![\w-])", re.IGNORECASE)
"""Words of a turn may be on two lines."""


def find_turns(text: str) -> Iterator[tuple[int, str, str]]:
    """(line from 0, what is there, what to write) of each turn in a text."""
    flat = re.sub(r"\n[ #]*", lambda found: " " * len(found[0]), text)
    for found in ANY.finditer(flat):
        turn = " ".join(found[0].split())
        instead = next(why for pattern, why in INSTEAD.items() if re.fullmatch(pattern, turn, re.IGNORECASE))
        yield text.count("\n", 0, found.start()), turn, instead


def check_page(path: Path) -> Iterator[tuple[int, str, str]]:
    """The turns of a page in Markdown; code in it and tables that a command writes are not checked."""
    unchecked = re.compile(r"```.*?```|`[^`\n]*`|<!-- \w+: written by .*?<!-- end of the headline -->", re.DOTALL)
    text = unchecked.sub(lambda code: re.sub(r"[^\n]", "x", code[0]), path.read_text(encoding="utf-8"))
    for line, found, instead in find_turns(text):
        yield line + 1, found, instead


def check_module(path: Path) -> Iterator[tuple[int, str, str]]:
    """The turns in comments, strings and names of a module."""
    source = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            for line, found, instead in find_turns(re.sub(r"`[^`\n]*`", "x", node.value)):
                yield node.lineno + line, found, instead
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            for _, found, instead in find_turns(token.string):
                yield token.start[0], found, instead
        elif token.type == tokenize.NAME and (name := ALSO_IN_NAMES.search(token.string.lower())):
            yield token.start[0], token.string, f"another name than '{name[0]}'"


def check_script(path: Path) -> Iterator[tuple[int, str, str]]:
    """The turns in comments and strings of JavaScript."""
    said = re.compile(r"//.*|\"[^\"\n]*\"|`[^`\n]*`")
    source = re.sub(r"\$\{[^}]*\}", lambda code: re.sub(r"[^\n]", "x", code[0]), path.read_text(encoding="utf-8"))
    for text in said.finditer(source):
        for line, found, instead in find_turns(text[0]) if " " in text[0] else ():
            yield source.count("\n", 0, text.start()) + line + 1, found, instead


def check_all() -> Iterator[str]:
    """A line for each turn that is not used."""
    pages = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")] + sorted((ROOT / "docs").rglob("*.md"))
    for path in pages:
        name = path.relative_to(ROOT).as_posix()
        if not name.startswith(GENERATED):
            yield from (f"{name}:{line}: {found!r}: {instead}" for line, found, instead in check_page(path))
    for ending, check in ((".py", check_module), (".js", check_script)):
        for path in sorted((ROOT / "src").rglob(f"*{ending}")):
            name = path.relative_to(ROOT).as_posix()
            yield from (f"{name}:{line}: {found!r}: {instead}" for line, found, instead in check(path))


if __name__ == "__main__":
    places = list(check_all())
    print("\n".join(places) if places else f"none of {len(INSTEAD)} turns is used")
    sys.exit(bool(places))
