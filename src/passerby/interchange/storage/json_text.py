"""JSON that every reader accepts: numpy values as plain ones, null where a figure is undefined."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from passerby.common.arrays import ABSENT


def to_json(value: Any) -> str:
    """`value` as JSON text with a line end; NaN and infinity become null."""
    return json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def plain(value: Any) -> Any:
    """Dataclasses, mappings, sequences, numpy arrays and numbers as what `json` writes; other values as their text."""
    if is_dataclass(value) and not isinstance(value, type):
        hidden = {one.name for one in fields(value) if one.metadata == ABSENT and getattr(value, one.name) is None}
        # `vars` has the keys of a file that no field was declared for as well.
        return {name.removesuffix("_"): plain(item) for name, item in vars(value).items() if name not in hidden}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
