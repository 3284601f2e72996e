"""What all tables of the scene file have in common, and the numbers in them."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from passerby.common.addresses import plain_without_credentials


def finite(value: float) -> float:
    """The number; an error where it is infinite or NaN."""
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
    def _without_passwords(cls, values: Any) -> Any:
        """No message, and no file that a scene is copied into, repeats the password of an address in it."""
        return plain_without_credentials(values) if isinstance(values, dict) else values
