"""What is wrong with a video file."""

from __future__ import annotations

from pathlib import Path

from passerby.common.errors import InputError


class VideoError(InputError):
    """A video cannot be read, or not as it should be (exit status 2)."""

    def __init__(self, path: Path, what: str) -> None:
        """The message names the file and then says `what` is wrong with it, and what to do."""
        super().__init__(f"{path}: {what}")
        self.path, self.what = path, what

    def __reduce__(self) -> tuple[type[VideoError], tuple[Path, str]]:
        # Between processes an exception is made anew from its arguments.
        return type(self), (self.path, self.what)
