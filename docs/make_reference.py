"""The pages of reference, made from the code: keys of the scene file, options of the commands, formats and codes of findings.

    python docs/make_reference.py

writes `docs/reference/scene-file.md`; `tests/docs` fails if the committed page differs. The other pages repeat what commands
print, so they are made only when the site is built (`docs/site_pages.py`). A key's reason is the docstring below its field, an
option's reason is the help that `passerby COMMAND --help` prints.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import json
import re
import types
import typing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, time
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

import typer
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from typer.models import ArgumentInfo, OptionInfo

from passerby.cli.commands.formats import write_markdown
from passerby.cli.main import app
from passerby.findings.finding import Finding
from passerby.findings.texts import KINDS, text_of
from passerby.interchange.formats import all_formats
from passerby.interchange.storage.atomic import write_text
from passerby.scene import scene
from passerby.scene import tables as scene_tables

FOLDER = Path(__file__).resolve().parent / "reference"
WRITTEN = "<!-- Written by docs/make_reference.py from the code: change it there. -->"
ABOUT_FINDINGS = """Every message about a calibration or its input, by cause, with example values. `calibration.json` has them
under [`diagnostics`](../output.md#diagnostics) by these codes. A `refusal` leaves no rig, a `doubt` lowers the verdict, and a
`notice` does not change it. [Troubleshooting](../troubleshooting.md) says what to do."""
TROUBLESHOOTING = Path(__file__).resolve().parent / "troubleshooting.md"
EXAMPLES = Path(__file__).resolve().parents[1] / "tests" / "findings" / "finding_texts.json"
"""Findings with values, some for each code."""
WORDS: dict[type, str] = {
    str: "text",
    float: "number",
    int: "whole number",
    bool: "true or false",
    Path: "path",
    datetime: "date and time",
    time: "time of day",
}
SIGNS = {Gt: ("gt", "above"), Ge: ("ge", "from"), Lt: ("lt", "below"), Le: ("le", "to")}
Row = Sequence[str]

OPTIONS = (
    ("people", "passerby.solver.initialisation", "PeopleOptions"),
    ("geopose", "passerby.solver.geopose.geopose", "GeoPoseOptions"),
)
"""`[solver.options]` by method: where its dataclass is defined."""
ELSEWHERE = frozenset({"reference"})
"""Options that have a key of their own."""


# --- words ----------------------------------------------------------------------------------------------------------------


def attribute_docstrings(kind: type) -> dict[str, str]:
    """The string below each field of a class, by the field's name; those of its bases that are its own module's too."""
    found: dict[str, str] = {}
    tree = ast.parse(inspect.getsource(importlib.import_module(kind.__module__)))
    wanted = [base.__name__ for base in reversed(kind.__mro__) if base.__module__ == kind.__module__]
    for name in wanted:
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and node.name == name:
                found |= dict(_documented(node.body))
    return found


def module_constants(module: types.ModuleType) -> dict[str, tuple[Any, str]]:
    """Value and docstring of each constant of a module that has one."""
    texts = dict(_documented(ast.parse(inspect.getsource(module)).body))
    return {name: (getattr(module, name), text) for name, text in texts.items()}


def _documented(body: Sequence[ast.stmt]) -> Iterator[tuple[str, str]]:
    """(name, docstring) of the assignments that a string follows."""
    for node, following in pairwise(body):
        target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0] if isinstance(node, ast.Assign) else None
        said = following.value if isinstance(following, ast.Expr) else None
        if isinstance(target, ast.Name) and isinstance(said, ast.Constant) and isinstance(said.value, str):
            yield target.id, " ".join(said.value.split())


def with_values(text: str, constants: dict[str, tuple[Any, str]]) -> str:
    """The text with the values of the constants that it names, and what is said of these behind it."""
    reasons: list[str] = []

    def value(match: re.Match[str]) -> str:
        if match[1] not in constants:
            return match[0]
        number, why = constants[match[1]]
        reasons.append(why)
        return f"{number:g}"

    return " ".join([re.sub(r"`([A-Z][A-Z_]+)`", value, text), *reasons]).replace("None: ", "Not given: ")


def in_words(annotation: Any) -> str:
    """What may stand for a key of this type."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return in_words(arguments[0]) + limits(arguments[1:])
    if origin is typing.Literal:
        return ", ".join(f"`{shown(value)}`" for value in arguments)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(in_words(one) for one in arguments if one is not types.NoneType)
    if origin is tuple:
        part = next(one for one in arguments if one is not Ellipsis)
        if inspect.isclass(part) and issubclass(part, BaseModel):
            return "tables"
        if part is Path:
            return f"list: {in_words(part)}"
        return f"list of {len(arguments)}: {in_words(part)}"
    if origin is dict:
        return "a table"
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return "a table"
    return WORDS.get(annotation, getattr(annotation, "__name__", str(annotation)))


def limits(metadata: Sequence[Any]) -> str:
    """`, above 0`: the limits among the metadata of a type."""
    flat = [one for item in metadata for one in (item.metadata if isinstance(item, FieldInfo) else [item])]
    said = [f"{word} {getattr(one, name):g}" for one in flat for kind, (name, word) in SIGNS.items() if isinstance(one, kind)]
    return f", {' '.join(said)}" if said else ""


def shown(value: Any) -> str:
    """A value as it is written in a scene file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:g}" if isinstance(value, float) else str(value)


def table(head: Row, rows: Sequence[Row]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


# --- the scene file -------------------------------------------------------------------------------------------------------


def scene_page() -> str:
    """Every key of the scene file, table by table, and the options of the methods."""
    constants = module_constants(scene_tables)
    parts = [
        "# Every key of the scene file",
        WRITTEN,
        "The scene file is TOML. An unknown key, a wrong value or a camera that does not exist is an error that names the "
        "place and the remedy. Paths are relative to the scene file, or absolute. [The scene file](../scene-file.md) shows by "
        "example what to write; `passerby init` writes one with comments.",
    ]
    places: dict[type[BaseModel], list[tuple[str, ...]]] = {}
    for place, kind in scene.TABLES.items():
        if place:
            places.setdefault(kind, []).append(place)
    parts += [_table_of_scene(same, kind, constants) for kind, same in places.items()]
    parts += [
        "## `[solver.options]`",
        "For experiments: nothing needs to be set. Which keys there are depends on `[solver] method`.",
    ]
    for method, module, name in OPTIONS:
        parts.append(_options_of(method, getattr(importlib.import_module(module), name)))
    return "\n\n".join(parts).rstrip() + "\n"


def _heading(place: tuple[str, ...]) -> str:
    if place == ("cameras", "*"):
        return "`[cameras.NAME]`"
    return f"`[[{'.'.join(place[:-1])}]]`" if place[-1] == "*" else f"`[{'.'.join(place)}]`"


def _table_of_scene(places: Sequence[tuple[str, ...]], kind: type[BaseModel], constants: dict[str, tuple[Any, str]]) -> str:
    head = ", ".join(map(_heading, places))
    texts = attribute_docstrings(kind)
    about = re.sub(r"^`[^`]*`: ", "", " ".join((kind.__doc__ or "").split()))
    rows = [
        [
            f"`{field.alias or name}`",
            in_words(field.annotation) + limits(field.metadata),
            _default(field),
            with_values(texts.get(name, ""), constants),
        ]
        for name, field in kind.model_fields.items()
    ]
    return f"## {head}\n\n{about[0].upper()}{about[1:]}\n\n" + table(("key", "value", "default", "meaning and reason"), rows)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.default
    if value is PydanticUndefined or value is None or value == ():
        return ""
    return f"`{shown(value)}`"


def _options_of(method: str, kind: type) -> str:
    texts, types_of = attribute_docstrings(kind), typing.get_type_hints(kind, include_extras=True)
    rows = []
    for field in dataclasses.fields(kind):
        if field.name in ELSEWHERE:
            continue
        default = "" if field.default in (dataclasses.MISSING, None) else f"`{shown(field.default)}`"
        rows.append([f"`{field.name}`", in_words(types_of[field.name]), default, texts.get(field.name, "")])
    return f'### with `method = "{method}"`\n\n' + table(("key", "value", "default", "meaning and reason"), rows)


# --- the commands ---------------------------------------------------------------------------------------------------------


def commands_page() -> str:
    """Every command with its arguments and options."""
    commands = list(_commands(app, "passerby"))
    itself = next(info.callback for info in [app.registered_callback] if info is not None)
    parts = [
        "# Every command and its options",
        WRITTEN,
        "`passerby COMMAND --help` prints the same. All commands take `-h` and `--help`.",
        table(("exit status", "meaning"), EXIT_STATUSES),
        " · ".join(f"[{name.removeprefix('passerby ')}](#{_anchor(name)})" for name, _ in commands),
        "## `passerby` itself { #passerby }",
        _options_table(_parameters(itself)),
        *(_command(name, function) for name, function in commands),
    ]
    return "\n\n".join(part.rstrip() for part in parts).rstrip() + "\n"


EXIT_STATUSES = (
    ("0", "done; a calibration is accepted"),
    ("1", "a bug in Passerby"),
    ("2", "bad input: one line on standard error names the file, the place, the value and the remedy"),
    ("3", "too little evidence: doubtful or refused. What was found is written all the same"),
    ("130", "interrupted"),
)


@dataclass(frozen=True)
class Parameter:
    """An argument or an option of a command."""

    name: str
    kind: Any
    """Its type, without None."""
    default: Any
    """`inspect.Parameter.empty` where it is needed."""
    info: ArgumentInfo | OptionInfo

    @property
    def needed(self) -> bool:
        """Whether it has to be given."""
        return self.default is inspect.Parameter.empty

    @property
    def flag(self) -> bool:
        """Whether it is an option without a value."""
        return self.kind is bool


def _commands(group: typer.Typer, name: str) -> Iterator[tuple[str, Callable[..., Any]]]:
    """(full name, function) of every command of a group and of the groups below it, in the order of `--help`."""
    for info in group.registered_commands:
        if info.callback is not None and not info.hidden:
            yield f"{name} {info.name or info.callback.__name__.rstrip('_').replace('_', '-')}", info.callback
    for below in group.registered_groups:
        if below.typer_instance is not None and not below.hidden:
            yield from _commands(below.typer_instance, f"{name} {below.name or below.typer_instance.info.name}")


def _parameters(function: Callable[..., Any]) -> list[Parameter]:
    found = []
    for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
        annotation, *metadata = typing.get_args(parameter.annotation) or (None,)
        info = next((one for one in metadata if isinstance(one, ArgumentInfo | OptionInfo)), None)
        if info is None or info.hidden:
            continue
        kinds = [one for one in typing.get_args(annotation) if one is not types.NoneType]
        union = typing.get_origin(annotation) in (typing.Union, types.UnionType)
        found.append(Parameter(name, kinds[0] if union else annotation, parameter.default, info))
    return found


def _anchor(name: str) -> str:
    return name.replace(" ", "-")


def _command(name: str, function: Callable[..., Any]) -> str:
    parameters = _parameters(function)
    arguments = [one for one in parameters if isinstance(one.info, ArgumentInfo)]
    about = "\n\n".join(" ".join(part.split()) for part in (inspect.getdoc(function) or "").split("\n\n"))
    usage = " ".join([name, "[OPTIONS]", *map(_argument_name, arguments)])
    text = f"## {name} {{ #{_anchor(name)} }}\n\n{about}\n\n```text\n{usage}\n```\n"
    if arguments:
        text += "\n" + table(("argument", "meaning"), [[f"`{_argument_name(one)}`", _help(one)] for one in arguments])
    return text + "\n" + _options_table(parameters)


def _argument_name(argument: Parameter) -> str:
    name = (argument.info.metavar or argument.name.upper()).strip("[]")
    several = typing.get_origin(argument.kind) in (list, tuple) and not name.endswith("...")
    name += "..." if several else ""
    return name if argument.needed else f"[{name}]"


def _options_table(parameters: Sequence[Parameter]) -> str:
    options = [one for one in parameters if isinstance(one.info, OptionInfo)]
    rows = [[_option_names(one), _value(one), _option_default(one), _help(one)] for one in options]
    return table(("option", "value", "default", "meaning"), rows) if rows else ""


def _option_names(option: Parameter) -> str:
    word = option.name.replace("_", "-")
    # In `Annotated[..., Option("--out", "-o")]` the first name stands where a default would.
    given = [
        name for name in (option.info.default, *(getattr(option.info, "param_decls", None) or ())) if isinstance(name, str)
    ]
    names = [name for name in given if name.startswith("-")]
    return ", ".join(f"`{name}`" for name in names or ([f"--{word}", f"--no-{word}"] if option.flag else [f"--{word}"]))


def _value(option: Parameter) -> str:
    if option.flag:
        return ""
    kind, several = option.kind, ""
    if typing.get_origin(kind) in (list, tuple):
        kind, several = typing.get_args(kind)[0], ", repeatable"
    if inspect.isclass(kind) and issubclass(kind, Enum):
        return ", ".join(f"`{one.value}`" for one in kind)
    low, high = option.info.min, option.info.max
    span = (f", from {low:g}" if low is not None else "") + (f" to {high:g}" if high is not None else "")
    return in_words(kind) + span + several


def _option_default(option: Parameter) -> str:
    value = option.default
    if option.needed:
        return "needed"
    if option.flag:
        return "yes" if value else ""
    if value is None or value == "":
        return ""
    value = value.value if isinstance(value, Enum) else value
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _help(parameter: Parameter) -> str:
    return " ".join((parameter.info.help or "").split())


# --- findings -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cause:
    """A section of the page of troubleshooting that lists codes of findings."""

    title: str
    anchor: str
    codes: tuple[str, ...]


def causes() -> list[Cause]:
    """The sections of the page of troubleshooting with the codes that stand at their ends, in the order of the page."""
    found = []
    for part in re.split(r"^## ", TROUBLESHOOTING.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        listed = re.search(r"^Codes?: (`\w+`(?:,\s`\w+`)*)\.$", part, flags=re.MULTILINE)
        title = re.match(r"(.*) \{ #([\w-]+) \}\n", part)
        if listed and title:
            found.append(Cause(title[1], title[2], tuple(re.findall(r"\w+", listed[1]))))
    return found


def examples() -> dict[str, list[str]]:
    """Sentences of each code, as they are printed."""
    found: dict[str, list[str]] = {}
    for row in json.loads(EXAMPLES.read_text(encoding="utf-8")):
        found.setdefault(row["code"], []).append(text_of(Finding.of_value(row)))
    return found


def findings_page() -> str:
    """Every code of a finding by cause: its severities, sentences with example values, and what it means."""
    sentences = examples()
    parts = [WRITTEN, "# All messages", ABOUT_FINDINGS]
    for cause in causes():
        rows = [
            (f"`{code}`<br>{', '.join(KINDS[code].severities)}", _quoted(sentences[code]), KINDS[code].meaning)
            for code in cause.codes
            if code in KINDS
        ]
        remedy = f"[What to do](../troubleshooting.md#{cause.anchor})"
        parts += [f"## {cause.title}", remedy, table(("code, severity", "message", "meaning"), rows).rstrip()]
    return "\n\n".join(parts) + "\n"


def _quoted(sentences: Sequence[str]) -> str:
    """Sentences as a cell of a table."""
    return "<br><br>".join(re.sub(r"([*<\\])", r"\\\1", " ".join(one.split())) for one in sentences)


# --- formats --------------------------------------------------------------------------------------------------------------


def formats_page() -> str:
    """Every format of other tools, as `passerby formats --markdown` prints them."""
    about = "`passerby formats` prints the same. [Formats of other tools](../formats.md) explains conventions and losses."
    return "\n\n".join(["# Every format", WRITTEN, about, write_markdown(list(all_formats()))])


COMMITTED = "scene-file.md"
"""The page that is read without the site, too. The others are printed by commands."""


def pages() -> dict[str, str]:
    """The text of each page, by its file's name."""
    return {
        COMMITTED: scene_page(),
        "commands.md": commands_page(),
        "formats.md": formats_page(),
        "findings.md": findings_page(),
    }


if __name__ == "__main__":
    write_text(FOLDER / COMMITTED, scene_page())
    print(f"written: docs/reference/{COMMITTED}")
