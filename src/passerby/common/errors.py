"""The exceptions of Passerby. Each has the exit status with which the command line ends.

A message names the file, the camera, the value and the remedy, in one line.
"""

from __future__ import annotations

import re

from passerby.common.text import remove_credentials

LONGEST = 2000
"""Maximum number of characters of a message. A file may hold a name of a million characters, which no message must repeat."""
LONG_WORD = re.compile(r"([^\s/]{80})[^\s/]{176,}([^\s/]{20})")
"""A word that is longer than a file name may be (255 bytes): it comes from the content of a file."""
LONG_RUN = re.compile(r"([^\n,;:()/]{180})[^\n,;:()/]{300,}([^\n,;:()/]{100})")
"""Words without punctuation that are longer than a sentence: they come from the content of a file, too."""


class PasserbyError(Exception):
    """Base of every error that Passerby raises on purpose."""

    exit_status = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(cut(message))


def cut(message: str) -> str:
    """Shorten a message, or a part of it, that is too long by its middle, and remove the passwords of addresses from it."""
    message = LONG_RUN.sub(r"\1 ... \2", LONG_WORD.sub(r"\1...\2", remove_credentials(message)))
    return message if len(message) <= LONGEST else f"{message[: LONGEST - 400]} ... {message[-390:]}"


class InputError(PasserbyError):
    """An input is missing or broken, or contradicts itself (exit status 2)."""

    exit_status = 2


class EvidenceError(PasserbyError):
    """The input is valid, but insufficient for a calibration (exit status 3).

    `reasons` lists what is insufficient, one sentence each.
    """

    exit_status = 3

    def __init__(self, message: str, reasons: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.reasons = tuple(map(remove_credentials, reasons or (message,)))
