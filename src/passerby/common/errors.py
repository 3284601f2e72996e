"""The exceptions of Passerby: each carries the exit status that a command line ends with.

A message names the file, the camera, the value and the remedy, in one line that a person can act on.
"""

from __future__ import annotations

import re

from passerby.common.text import remove_credentials

LONGEST = 2000
"""Characters of a message: a file may hold a name of a million characters, and no file is shown at length."""
LONG_WORD = re.compile(r"([^\s/]{80})[^\s/]{176,}([^\s/]{20})")
"""A word of more characters than a file's name may have, 255 bytes: it comes out of a file."""
LONG_RUN = re.compile(r"([^\n,;:()/]{180})[^\n,;:()/]{300,}([^\n,;:()/]{100})")
"""Words without any punctuation, longer than sentences are: they come out of a file, too."""


class PasserbyError(Exception):
    """Base of every error that Passerby raises on purpose."""

    exit_status = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(cut(message))


def cut(message: str) -> str:
    """A message, or a part of it, that is too long without its middle, and without the passwords of addresses in it."""
    message = LONG_RUN.sub(r"\1 ... \2", LONG_WORD.sub(r"\1...\2", remove_credentials(message)))
    return message if len(message) <= LONGEST else f"{message[: LONGEST - 400]} ... {message[-390:]}"


class InputError(PasserbyError):
    """Something that was handed in is missing, broken or contradicts itself (exit status 2)."""

    exit_status = 2


class EvidenceError(PasserbyError):
    """The input is sound, but too little for a calibration (exit status 3).

    `reasons` lists what was found wanting, one sentence each.
    """

    exit_status = 3

    def __init__(self, message: str, reasons: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.reasons = tuple(map(remove_credentials, reasons or (message,)))
