"""Published networks of `transformers`: from a folder that the user names, this computer, or the hub."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from baselines.matching import Unavailable

WEIGHTS = "PASSERBY_BASELINES"
"""Environment variable: a folder of networks as `transformers` saves them, one folder each."""


def load(kind: str, source: str, folder_name: str, weights: Path | None) -> Any:
    """A network in evaluation mode.

    Args:
        kind: name of the class in `transformers`.
        source: its name on the hub.
        folder_name: name of its folder in the user's folder of weights.
        weights: the user's folder; None: `$PASSERBY_BASELINES`. Looked into first, then this computer's cache, then the hub.

    Raises:
        Unavailable: a package is missing, or the weights are nowhere to be had.
    """
    try:
        import transformers

        from passerby.training.network import UNAVAILABLE, had
    except ImportError as error:
        raise Unavailable(f"the package {error.name} is not installed: pip install 'passerby[baselines]'") from None
    named = weights or (Path(os.environ[WEIGHTS]) if os.environ.get(WEIGHTS) else None)
    own = named / folder_name if named is not None else None
    try:
        network = had(getattr(transformers, kind).from_pretrained, str(own) if own and own.is_dir() else source)
    except UNAVAILABLE as error:
        why = " ".join(str(error).split())[:160]
        raise Unavailable(
            f"the weights of {source} cannot be had ({why}): go online, or give a folder with {folder_name}/ in ${WEIGHTS}"
        ) from None
    return network.eval()
