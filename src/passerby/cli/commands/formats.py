"""`passerby formats`: which files of other tools can be read and written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from passerby.interchange.formats import Format


def formats(
    name: Annotated[str | None, typer.Argument(metavar="[FORMAT]", help="Show the details of this format.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the table and the conventions of the formats as Markdown.")
    ] = False,
) -> None:
    """List the formats of other tools that `passerby export` writes and `passerby import` reads."""
    from passerby.interchange.formats import all_formats, find_format
    from passerby.interchange.storage.json_text import to_json

    found = [find_format(name)] if name is not None else list(all_formats())
    if json:
        print(to_json({"formats": [_plain(form) for form in found]}), end="")
    elif markdown:
        print(as_markdown(found), end="")
    elif name is None:
        _list(found)
    else:
        _detail(found[0])


def _plain(form: Format) -> dict[str, Any]:
    return {
        "name": form.name, "title": form.title, "tools": form.tools, "target": form.target, "suffixes": form.suffixes,
        "exports": form.write is not None, "imports_cameras": form.read is not None,
        "imports_people": form.read_people is not None, "conventions": form.conventions,
    }  # fmt: skip


def _can(form: Format) -> str:
    """What can be done with a format."""
    reads = [what for what, reader in (("cameras", form.read), ("people", form.read_people)) if reader is not None]
    return " ".join([*(["export"] if form.write else []), *([f"import ({', '.join(reads)})"] if reads else [])])


def _target(form: Format) -> str:
    """What is written, in words."""
    return "folder or file" if form.write_one else form.target


def _list(found: list[Format]) -> None:
    width, can = max((len(form.name) for form in found), default=0), max((len(_can(form)) for form in found), default=0)
    for form in found:
        print(f"{form.name.ljust(width)}  {_can(form).ljust(can)}  {form.title}")
    print("\npasserby formats FORMAT shows the details of one.")


def as_markdown(found: Sequence[Format]) -> str:
    """Formats as a table and a section each, in Markdown."""
    lines = ["| format | what it is | target | export | import |", "|---|---|---|---|---|"]
    for form in found:
        reads = [what for what, reader in (("cameras", form.read), ("people", form.read_people)) if reader is not None]
        target = " ".join([_target(form), *(f"`{suffix}`" for suffix in form.suffixes)])
        export = "yes" if form.write else ""
        lines.append(f"| [`{form.name}`](#{form.name}) | {_safe(form.title)} | {target} | {export} | {', '.join(reads)} |")
    for form in found:
        lines += ["", f"### {form.name}", "", f"{_safe(form.title)}. For {', '.join(form.tools)}.", "", _safe(form.conventions)]
    return "\n".join(lines) + "\n"


def _safe(text: str) -> str:
    """Text that Markdown takes for neither a tag nor a column's end."""
    return text.replace("<", "&lt;").replace("|", "\\|")


def _detail(form: Format) -> None:
    print(f"{form.name}: {form.title}")
    print(f"for: {', '.join(form.tools)}")
    print(f"a {_target(form)}" + (f" ({', '.join(form.suffixes)})" if form.suffixes else ""))
    print(f"can: {_can(form)}")
    print(form.conventions)
    if form.write is not None:
        print(f"passerby export out/rig.toml --format {form.name} -o {'rig' + (form.suffixes[0] if form.suffixes else '')}")
    if form.read is not None:
        print(f"passerby import PATH --format {form.name} -o rig.toml")
    if form.read_people is not None:
        print(f"passerby import PATH --format {form.name} -o C1.json")
