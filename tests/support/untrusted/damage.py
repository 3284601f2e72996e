"""Sound files made into broken ones: what copies that break off, careless editors, other programs and enemies do to files."""

# ruff: noqa: E501 (tables of text that is broken, or read, as it stands)

from __future__ import annotations

import json
import random
import re
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import tomli_w
import yaml

CHOICES = 24
"""Bytes that decide all of a case."""
WORDS = (
    b"", b"0", b"-1", b"1", b"2", b"nan", b"NaN", b"inf", b"-inf", b"Infinity", b"1e308", b"-1e308", b"1e-320", b"0.5", b"1e400",
    b"9223372036854775807", b"9223372036854775808", b"18446744073709551616", b"1" + b"0" * 30, b"1" + b"0" * 400, b"9" * 5000,
    b"1e5", b"1_000", b"0x10", b"true", b"null", b"None", b"~", b"[]", b"{}", b'""', b"''", b"[[[[", b"}}}}", b"[" * 3000,
    b'{"a":' * 3000, b"- " * 2000, b"a" * 5000, b"\0", b"\xef\xbb\xbf", b"\r\n", b"\n\n\n", b"\r", b"\t", b",,,,", b";", b"=", b":",
    b"#", b'"', b"'", b"\\", b"\xff\xfe", b"\xc3\xa9", b"\xe9", b"\xf0\x9f\x98\x80", b"\xe2\x80\xa8", b"\xd9\xa3", b"\xc2\xb2",
    b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"&b;", b"&#0;", b"<a>", b"</a>", b"<![CDATA[", b"]]>", b"!!python/object/apply:os.getcwd []",
    b"&a [*a, *a]", b"*a", b"<<: *a", b"? ", b"---\n", b"%YAML 9.9\n", b"../../x", b"/etc/hostname", b"/dev/zero", b"con", b".",
    b"..", b"\x1b[31m", b"<script>alert(1)</script>", b"$(id)", b"__proto__", b"metadata", b"1,2", b"1 2", b"0001-01-01",
    b"12:30:00", b"-0.0", b"1.5", b"256", b"65536", b"4294967296",
)  # fmt: skip
"""What is put in place of numbers and words, or anywhere."""
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 3, 1.5, -0.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), 10**30, -(10**30), 10**400,
    2**63, 2**53 + 1, "", "a", "a" * 5000, "1", "nan", "\0", "\x1b[31m", "../../x", "/etc/hostname", "metadata", "\u2028",
    [], [[]], {}, [1], [1, 2], [1.0, 2.0, 3.0], [None], ["a"], [[1, 2], [3]], {"a": 1}, {"": {}}, {"data": [1]}, [0.0] * 100,
    [[0.0] * 3] * 3, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
)  # fmt: skip
"""What is put in place of a value of JSON, TOML or YAML."""
NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[^\s,;:=<>\"'\[\]{}]+")
WHOLE_FILES = (
    b"", b"\0", b"\xef\xbb\xbf", b"\n", b"[" * 20_000, b'{"a":' * 20_000, b"9" * 20_000, b"<a>" * 20_000, b"- " * 20_000,
)  # fmt: skip


class Choices:
    """Numbers out of the bytes of a case; 0 when they are used up, so that fewer bytes make a simpler case."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def below(self, count: int) -> int:
        """A number from 0 to `count` - 1."""
        part = self._content[self._at : self._at + 2]
        self._at += 2
        return int.from_bytes(part, "little") * count >> 16 if count > 0 else 0

    def of(self, some: Sequence[Any]) -> Any:
        """One of several things."""
        return some[self.below(len(some))]


def damaged(content: bytes, suffix: str, case: bytes) -> bytes:
    """A file's content after one to three kinds of damage, as the bytes of `case` decide."""
    choices = Choices(case)
    kinds = (*ANYTHING, *TEXT * 2, *(PARSED.get(suffix, ()) * 6)) if suffix not in BINARY else ANYTHING
    for _ in range(1 + choices.below(3)):
        content = choices.of(kinds)(content, choices)
    return content


def _flipped(content: bytes, choices: Choices) -> bytes:
    changed = bytearray(content)
    for _ in range(1 + choices.below(4)):
        if changed:
            changed[choices.below(len(changed))] ^= 1 << choices.below(8)
    return bytes(changed)


def _overwritten(content: bytes, choices: Choices) -> bytes:
    """A number of two, four or eight bytes set to its largest, to nothing, or to any."""
    at, length = choices.below(len(content)), choices.of((1, 2, 4, 8))
    new = choices.of((b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, b"\xff" * 7 + b"\x7f", random.Random(at).randbytes(8)))
    return content[:at] + new[:length] + content[at + length :]


def _cut(content: bytes, choices: Choices) -> bytes:
    return content[: choices.below(len(content) + 1)]


def _without_span(content: bytes, choices: Choices) -> bytes:
    start, length = choices.below(len(content)), choices.below(min(len(content), 200) + 1)
    return content[:start] + content[start + length :]


def _span_twice(content: bytes, choices: Choices) -> bytes:
    start, length, to = choices.below(len(content)), choices.below(min(len(content), 200) + 1), choices.below(len(content) + 1)
    return content[:to] + content[start : start + length] + content[to:]


def _inserted(content: bytes, choices: Choices) -> bytes:
    at = choices.below(len(content) + 1)
    return content[:at] + choices.of(WORDS) + content[at:]


def _arbitrary(content: bytes, choices: Choices) -> bytes:
    """Another file altogether."""
    kind = choices.below(4)
    if kind == 0:
        return choices.of(WHOLE_FILES)
    noise = random.Random(choices.below(65536))
    length = choices.below(300)
    if kind == 1:
        return noise.randbytes(length)
    if kind == 2:
        return bytes(noise.choices(b"0123456789.,-+eE \n\t\"'[]{}:;=<>/abcn#&*!", k=length))
    return b" ".join(noise.choices(WORDS, k=length // 20))


def _replaced(pattern: re.Pattern[bytes], content: bytes, choices: Choices) -> bytes:
    found = list(pattern.finditer(content))
    if not found:
        return _inserted(content, choices)
    match = choices.of(found)
    return content[: match.start()] + choices.of(WORDS) + content[match.end() :]


def _lines_changed(content: bytes, choices: Choices) -> bytes:
    """A line left out, twice, elsewhere, or very often."""
    lines = content.splitlines(keepends=True)
    if not lines:
        return content
    line, to, kind = choices.below(len(lines)), choices.below(len(lines)), choices.below(4)
    if kind == 0:
        del lines[line]
    elif kind == 1:
        lines.insert(to, lines[line])
    elif kind == 2:
        lines[line], lines[to] = lines[to], lines[line]
    else:
        lines[line:line] = [lines[line]] * 50
    return b"".join(lines)


def _recoded(content: bytes, choices: Choices) -> bytes:
    """In another encoding, with other ends of lines, with a mark at its beginning."""
    text = content.decode("utf-8", errors="replace")
    kind = choices.below(7)
    if kind < 3:
        return text.encode(("utf-16", "utf-32", "utf-16-le")[kind])
    if kind == 3:
        return text.encode("latin-1", errors="replace") + b"\xe9"
    if kind == 4:
        return b"\xef\xbb\xbf" + content
    return content.replace(b"\n", b"\r\n" if kind == 5 else b"\r")


def _value_changed(load: Callable[[str], Any], dump: Callable[[Any], str], content: bytes, choices: Choices) -> bytes:
    """One value, key or entry changed by its place in the parsed file."""
    if load is yaml.safe_load:
        content = re.sub(rb"\A%YAML.*|!!opencv-matrix", b"", content)
    try:
        root = load(content.decode())
        places = list(_places(root))
        if not places:
            return _inserted(content, choices)
        owner, key = choices.of(places)
        kind = choices.below(8)
        if kind == 0:
            del owner[key]
        elif kind == 1 and isinstance(owner, dict):
            owner[str(choices.of(VALUES))[:50]] = owner.pop(key)
        elif kind == 1:
            owner.insert(choices.below(len(owner) + 1), owner[key])
        elif kind == 2:
            owner[key] = [owner[key]]
        elif kind == 3 and isinstance(owner[key], list):
            owner[key] = owner[key] * 2
        else:
            owner[key] = choices.of(VALUES)
        return dump(root).encode()
    except (ValueError, TypeError, RecursionError, AttributeError, yaml.YAMLError, OverflowError):
        return _inserted(content, choices)


def _places(value: Any) -> Any:
    """Every (owner, key) of nested tables and lists."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in list(pairs):
        yield value, key
        yield from _places(inner)


Damage = Callable[[bytes, Choices], bytes]
ANYTHING: tuple[Damage, ...] = (
    _flipped, _overwritten, _cut, _without_span, _span_twice, _inserted, _arbitrary,
)  # fmt: skip
_number_replaced, _word_replaced = partial(_replaced, NUMBER), partial(_replaced, WORD)
TEXT: tuple[Damage, ...] = (_number_replaced, _word_replaced, _number_replaced, _lines_changed, _recoded)
_yaml_changed = partial(_value_changed, yaml.safe_load, yaml.safe_dump)
PARSED: dict[str, tuple[Damage, ...]] = {
    ".json": (partial(_value_changed, json.loads, json.dumps),), ".toml": (partial(_value_changed, tomllib.loads, tomli_w.dumps),),
    ".yaml": (_yaml_changed,), ".yml": (_yaml_changed,),
}  # fmt: skip
BINARY = (".npz", ".onnx", ".bin", ".mp4", ".avi", ".mkv", ".png", ".jpg", ".mat", ".pt", ".zip")
