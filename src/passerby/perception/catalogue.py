"""The networks that Passerby knows: names, addresses, checksums, licences and input conventions, from manifest.toml."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from passerby.perception.networks import Colour, Fit, InputConvention, Output, Role

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table of a manifest: frozen, unknown keys rejected."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class InputTable(Table):
    """How pixels enter a network; what is not set is taken from the convention that it is laid over."""

    colour: Colour | None = None
    scale: Positive | None = None
    mean: tuple[Finite, Finite, Finite] | None = None
    std: tuple[Positive, Positive, Positive] | None = None
    fit: Fit | None = None
    padding: Annotated[float, Field(ge=0.0, le=255.0)] | None = None

    def over(self, base: InputConvention) -> InputConvention:
        """`base` with what is set here in place of its own values."""
        return InputConvention(
            base.colour if self.colour is None else self.colour,
            base.scale if self.scale is None else self.scale,
            base.mean if self.mean is None else self.mean,
            base.std if self.std is None else self.std,
            base.fit if self.fit is None else self.fit,
            base.padding if self.padding is None else self.padding,
        )


class ArchiveTable(Table):
    """A zip archive in which a network is published."""

    member: str
    """The name of the network's file ends so in the archive."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(gt=0)]


class ModelEntry(Table):
    """What the manifest says of one network."""

    name: str
    role: Role
    file: str
    """Its name on a user's disk; a file is known by it in the folders where models are looked for."""
    url: str | None = None
    """Where its publisher keeps exactly these bytes; None if there is none."""
    archive: ArchiveTable | None = None
    """What the address serves where it is not the network's file itself."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(gt=0)]
    licence: str
    publisher: str
    output: Output
    note: str
    input: InputTable = InputTable()
    default: bool = False
    """Whether "auto" means this one for its role."""


class Manifest(Table):
    """The file as a whole."""

    models: tuple[ModelEntry, ...]


@cache
def catalogue() -> tuple[ModelEntry, ...]:
    """All networks of the manifest, in its order."""
    text = files("passerby.perception").joinpath("manifest.toml").read_text(encoding="utf-8")
    return Manifest.model_validate(tomllib.loads(text)).models


def default_of(role: Role) -> ModelEntry | None:
    """What "auto" means for a role where no choice is on this computer; None where the manifest names none."""
    return next((entry for entry in catalogue() if entry.role == role and entry.default), None)
