"""What every request of a browser is made of and how it is checked; messages without the folders of this machine."""

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
    """What a browser asks for, with the version of the scene file that it saw."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    version: Annotated[str, Field(max_length=40)]


def read_as(kind: Any, content: Any) -> Any:
    """A value that a browser sent. Raises `InputError` where it is not of its kind."""
    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        fault = error.errors()[0]
        why = fault["msg"].removeprefix("Value error, ")
        raise InputError(f"{'.'.join(map(str, fault['loc'])) or 'the request'}: {why}") from None


def remove_folders(text: str, folders: Iterable[Path]) -> str:
    """A message in which paths begin below these folders."""
    for folder in folders:
        for form in (str(folder.absolute()), str(folder)):
            if form not in ("", ".", "/"):
                text = text.replace(form.rstrip("/") + "/", "")
    return text
