"""What a function of the package returned while something else ran: figures that no result keeps."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any
from unittest.mock import patch


@contextmanager
def overheard(module: ModuleType, name: str) -> Iterator[list[Any]]:
    """All that a module's function returns meanwhile, in the order of the calls; nothing is changed by it."""
    function, returned = getattr(module, name), list[Any]()

    def listening(*args: Any, **kwargs: Any) -> Any:
        found = function(*args, **kwargs)
        returned.append(found)
        return found

    with patch.object(module, name, listening):
        yield returned
