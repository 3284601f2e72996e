"""`passerby models`: list the networks and their locations, fetch and verify them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.perception.networks import ModelEntry

models_app = typer.Typer(
    name="models",
    help="The neural networks that detect, re-identify and measure people: list, fetch and verify them. Default command: list.",
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
Folder = Annotated[Path | None, typer.Option("--models", metavar="FOLDER", help="A folder of models to search first.")]

ABSENT = "not here"


@models_app.callback()
def models_command(context: typer.Context) -> None:
    """List the models where no command is given."""
    if context.invoked_subcommand is None:
        list_models()


@models_app.command("list")
def list_models(models: Folder = None, json: AsJson = False) -> None:
    """List the known models, and where they are on this computer."""
    from passerby.cli.terminal import show_table
    from passerby.perception.model_files import model_folders
    from passerby.perception.networks import catalogue

    folders = model_folders(models)
    places = [
        next((folder / entry.file for folder in folders if (folder / entry.file).is_file()), None) for entry in catalogue()
    ]
    if json:
        listed = [{**_facts(entry), "path": place} for entry, place in zip(catalogue(), places, strict=True)]
        _print_json({"models": listed, "folders": folders})
        return
    rows = [
        [entry.name, entry.role, _megabytes(entry), entry.licence, "auto" if entry.default else "", str(place or ABSENT)]
        for entry, place in zip(catalogue(), places, strict=True)
    ]
    show_table("models", ["name", "role", "size", "licence", "default", "where"], rows)
    print(f"searched in {', '.join(map(str, folders))}")


@models_app.command("fetch")
def fetch_models(
    context: typer.Context,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Names of models; default: those that `auto` uses.")
    ] = None,
    all_models: Annotated[bool, typer.Option("--all", help="All models that have a download address.")] = False,
    models: Folder = None,
    json: AsJson = False,
) -> None:
    """Fetch models into the cache; models that are already on this computer are only verified."""
    from passerby.cli.terminal import stages
    from passerby.perception.fetching import UnreachableError
    from passerby.perception.model_files import copies_of, entry_of, fetch_model
    from passerby.perception.networks import catalogue

    if names and all_models:
        raise InputError("names and --all contradict each other: give one of them")
    if names:
        entries = [entry_of(name) for name in names]
    else:
        entries = [entry for entry in catalogue() if entry.url is not None and (all_models or entry.default)]
    done: list[dict[str, Any]] = []
    with stages(verbose=not json) as tell:
        for entry in entries:
            copy = next(copies_of(entry, models), None)
            if copy is not None:
                copy.check()
            try:
                path = copy.path if copy is not None else fetch_model(entry, tell)
            except UnreachableError as error:
                raise InputError(f"{entry.name}: cannot be fetched: {error}") from error
            done.append({"name": entry.name, "path": path, "fetched": copy is None})
    if json:
        _print_json({"models": done})
        return
    for item in done:
        print(f"{item['name']}: {'fetched to' if item['fetched'] else 'already in'} {item['path']}")


@models_app.command("verify")
def verify_models(models: Folder = None, json: AsJson = False) -> None:
    """Check the SHA-256 of every model on this computer. Exit status 2 if one is wrong; absent models are ignored."""
    from passerby.cli.terminal import show_table
    from passerby.perception.model_files import copies_of
    from passerby.perception.networks import catalogue

    copies = {entry.name: list(copies_of(entry, models)) for entry in catalogue()}
    absent = [name for name, found in copies.items() if not found]
    all_copies = [copy for found in copies.values() for copy in found]
    if json:
        checked = [
            {"name": copy.entry.name, "path": copy.path, "right": copy.right, "sha256": copy.sha256} for copy in all_copies
        ]
        _print_json({"checked": checked, "absent": absent})
    else:
        rows = [[copy.entry.name, "right" if copy.right else "WRONG", str(copy.path)] for copy in all_copies]
        show_table("models", ["name", "checksum", "where"], [*rows, *([name, ABSENT, ""] for name in absent)])
    for copy in all_copies:
        copy.check()


def _facts(entry: ModelEntry) -> dict[str, Any]:
    """Return an entry of the catalogue as values for JSON."""
    return entry.model_dump(exclude={"input"}, exclude_none=False)


def _megabytes(entry: ModelEntry) -> str:
    """Write the size of a model's file, for example 3.7 MB."""
    return f"{entry.bytes / 1e6:.1f} MB"


def _print_json(value: object) -> None:
    """Print one JSON object on standard output."""
    from passerby.interchange.storage.text_formats import to_json

    print(to_json(value), end="")
