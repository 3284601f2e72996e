"""The tables of the scene file that correct identities: a person named by a pixel, and boxes of one person or of several."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from passerby.scene.table import Pixel, Seconds, Table


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
