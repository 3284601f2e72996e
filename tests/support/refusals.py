"""What every refusal of a file has in common."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from passerby.common.errors import InputError


@contextmanager
def refused(told: str, place: object) -> Iterator[None]:
    """The block raises an `InputError` of one line that names a file or folder and matches an expression."""
    with pytest.raises(InputError, match=told) as error:
        yield
    assert str(place) in str(error.value)
    assert "\n" not in str(error.value)
