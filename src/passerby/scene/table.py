"""Base of all tables of the scene file, the tables about identities, and the messages of wrong values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from passerby.common.text import remove_all_credentials, shortened, suggest_name

LONGEST_KEY = 80
"""Maximum number of characters of a key, or of a camera's name, that are shown."""
HEADER = re.compile(r"\[\s*([^\[\]]+?)\s*\]\s*(?:#.*)?")
LIST_HEADER = re.compile(r"\[\[.*\]\]\s*(?:#.*)?")
KEY = re.compile(r"([\w-]+)\s*=")
Tables = Mapping[tuple[str, ...], type[BaseModel]]
"""The model of each table by its place in the file; "*" stands for a camera's name or a number in a list."""


def finite(value: float) -> float:
    """Return the number. Raises `ValueError` if it is infinite or NaN."""
    if not math.isfinite(value):
        raise ValueError("a finite number is needed")
    return value


Positive = Annotated[float, Field(gt=0), AfterValidator(finite)]
Metres = Annotated[float, Field(gt=0), AfterValidator(finite)]
Pixel = Annotated[float, AfterValidator(finite)]
FramesPerSecond = Annotated[float, Field(gt=0), AfterValidator(finite)]
Seconds = Annotated[float, Field(ge=0), AfterValidator(finite)]


class Table(BaseModel):
    """A table of the scene file: frozen, unknown keys rejected."""

    model_config = ConfigDict(extra="forbid", frozen=True, serialize_by_alias=True)

    @model_validator(mode="before")
    @classmethod
    def _remove_passwords(cls, values: Any) -> Any:
        """Remove the passwords of addresses, so that no message repeats them, and no file into which a scene is copied."""
        return remove_all_credentials(values) if isinstance(values, dict) else values


class PersonAtTable(Table):
    """A person, named by a pixel of one camera at one time."""

    camera: str
    """A camera that sees the person."""
    time_s: Seconds | None = None
    """When: seconds from the beginning of this camera's own recording, which frame 1 is."""
    frame: int | None = Field(default=None, ge=0)
    """When, as a frame number of this camera, in place of `time_s`."""
    at: tuple[Pixel, Pixel]
    """[u, v], a pixel on the person then. Of people who overlap there it is the nearest, whose box reaches lowest."""

    @model_validator(mode="after")
    def _has_one_time(self) -> Self:
        if self.time_s is not None and self.frame is not None:
            raise ValueError("has time_s and frame: delete one of them")
        if self.time_s is None and self.frame is None:
            raise ValueError("has no time_s and no frame: add one of them")
        return self


class TogetherTable(Table):
    """`[[association.same]]` or `[[association.different]]`: two boxes or more."""

    boxes: Annotated[tuple[PersonAtTable, ...], Field(min_length=2)]
    """Each `{ camera = "north", time_s = 12.4, at = [812, 440] }`; of different cameras, or of one at different times."""


def explain_fault(fault: dict[str, Any], tables: Tables) -> str:
    """Return one line with place, value and remedy for a fault that pydantic found.

    `tables` has the models of the file by their place.
    """
    location = tuple(fault["loc"])
    message = str(fault["msg"]).removeprefix("Value error, ")
    if not location:
        return message
    if fault["type"] == "extra_forbidden":
        table, key = location[:-1], str(location[-1])[:LONGEST_KEY]
        known = [field.alias or name for name, field in tables[_pattern(table)].model_fields.items()]
        return f"{_place(table, tables) + ': unknown key' if table else 'unknown table'} '{key}': {suggest_name(key, known)}"
    place = _place(location, tables)
    if fault["type"] == "missing":
        return f"{place}: is missing: add it"
    if fault["type"] == "value_error":
        return f"{place}: {message}"
    value = fault["input"]
    shown = f" is {shortened(value)}" if isinstance(value, (str, int, float, bool)) else ""
    return f"{place}{shown}: {message[0].lower()}{message[1:]}"


def _pattern(table: tuple[str | int, ...]) -> tuple[str, ...]:
    if table[:1] == ("cameras",) and len(table) == 2:
        return ("cameras", "*")
    return tuple("*" if isinstance(part, int) else part for part in table)


def _place(location: tuple[str | int, ...], tables: Tables) -> str:
    """Return a location as it appears in the file: `[cameras.V1] tracks`, `[[scale.people]] 2 height_m`."""
    for length in range(len(location), 0, -1):
        pattern = _pattern(location[:length])
        if pattern in tables:
            key = " ".join(str(part)[:LONGEST_KEY] for part in location[length:])
            numbered = [place for place, part in enumerate(location[:length]) if isinstance(part, int)]
            if numbered:
                rest = [str(part + 1 if isinstance(part, int) else part) for part in location[numbered[0] : length]]
                head = f"[[{'.'.join(map(str, location[: numbered[0]]))}]] {' '.join(rest)}"
            else:
                head = f"[{'.'.join(str(part)[:LONGEST_KEY] for part in location[:length])}]"
            return f"{head} {key}".strip()
    return f"[{'.'.join(str(part)[:LONGEST_KEY] for part in location)}]"


def find_repeated_key(text: str) -> str | None:
    """Find a table, or a key of a table, that occurs twice in a scene file, which makes it invalid TOML.

    Return its lines and the remedy; None if there is none. Tables in lists, `[[scale.distances]]`, may occur repeatedly.
    """
    tables: dict[str, int] = {}
    keys: dict[str, int] = {}
    table, depth = "", 0
    for number, line in enumerate(map(str.strip, text.splitlines()), start=1):
        # A list may extend over several lines.
        inside, depth = depth > 0, max(0, depth + line.count("[") - line.count("]"))
        if inside or line.startswith("#"):
            continue
        if LIST_HEADER.fullmatch(line):
            table, keys = line, {}
        elif header := HEADER.fullmatch(line):
            table, keys = f"[{'.'.join(part.strip() for part in header[1].split('.'))[:LONGEST_KEY]}]", {}
            if table in tables:
                return (
                    f"{table} occurs twice, in lines {tables[table]} and {number}: merge the two into one, because a table "
                    f"may occur only once"
                )
            tables[table] = number
        elif stated := KEY.match(line):
            key = stated[1][:LONGEST_KEY]
            if key in keys:
                return f"{table} {key} occurs twice, in lines {keys[key]} and {number}: keep one of them".strip()
            keys[key] = number
    return None
