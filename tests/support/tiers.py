"""Families of tests of which a few are quick."""

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(
    names: str | tuple[str, ...], values: Iterable[Any], quick: int = 1, every: int = 0, **named: Any
) -> pytest.MarkDecorator:
    """`pytest.mark.parametrize`, but only the first values are of the quick tier, or each so many of them, `every`; the others,
    of the same branch, are slow."""
    rows = [value if isinstance(names, tuple) else (value,) for value in values]
    quickly = range(0, len(rows), every) if every else range(quick)
    params = [pytest.param(*row, marks=() if number in quickly else pytest.mark.slow) for number, row in enumerate(rows)]
    return pytest.mark.parametrize(names, params, **named)
