"""Types of a browser's requests and their validation, and removal of this machine's folders from messages."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from passerby.common.errors import InputError

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Pixel = tuple[Coordinate, Coordinate]
Frame = Annotated[int, Field(ge=0, le=10**10)]
Name = Annotated[str, Field(min_length=1, max_length=100)]


class Act(BaseModel):
    """A change that a browser requests, with the version of the scene file that it saw."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    version: Annotated[str, Field(max_length=40)]


def read_as(kind: Any, content: Any) -> Any:
    """Return the value that a browser sent as a value of a type. Raises `InputError` if it is not valid."""
    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        fault = error.errors()[0]
        why = fault["msg"].removeprefix("Value error, ")
        raise InputError(f"{'.'.join(map(str, fault['loc'])) or 'the request'}: {why}") from None


def remove_folders(text: str, folders: Iterable[Path]) -> str:
    """Return a message in which paths are relative to these folders."""
    for folder in folders:
        for form in (str(folder.absolute()), str(folder)):
            if form not in ("", ".", "/"):
                text = text.replace(form.rstrip("/") + "/", "")
    return text
