"""What else finds correspondences: matchers of picture points, by name, for comparison with people.

None of them is needed for a calibration. Modules are imported when a matcher is opened, so that a machine without PyTorch, or
without a network's weights, runs the others.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

from baselines.matching import Matcher, Matches, Picture, Unavailable
from passerby.common.errors import InputError

__all__ = ["MATCHERS", "Matcher", "Matches", "Picture", "Unavailable", "open_matcher"]

MATCHERS: Mapping[str, str] = MappingProxyType({
    "sift": "SIFT + brute force", "superpoint": "SuperPoint + brute force",
    "wxbs": "WxBS-style: affine views + SIFT + verification", "superpoint-lightglue": "SuperPoint + LightGlue",
    "xfeat": "XFeat + brute force", "disk-lightglue": "DISK + LightGlue",
})  # fmt: skip
"""The matchers by name, and what they are."""


def open_matcher(name: str, weights: Path | None = None) -> Matcher:
    """A matcher, ready to match.

    `weights` is a folder of one folder a published network, as `transformers` saves it (`superpoint`, `superpoint-lightglue`);
    None: what lies in the hub's cache, or the hub has. Networks that bring their weights in their packages do not look there.

    Raises `InputError` where no matcher has this name, and `Unavailable` where a package or the weights are missing: the
    message says which, and how to get them.
    """
    if name not in MATCHERS:
        raise InputError(f"matcher {name!r} does not exist: choose one of {', '.join(MATCHERS)}")
    module = import_module(f"baselines.{name.partition('-')[0]}")
    matcher: Matcher = (module.open_glue if name == "superpoint-lightglue" else module.open_matcher)(weights)
    return matcher
