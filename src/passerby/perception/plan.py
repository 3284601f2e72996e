"""What people are found with: networks where they can be had, methods without weights where not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from passerby.errors import InputError
from passerby.perception.model_files import AUTO, Found, find_model
from passerby.perception.networks import Network, Role
from passerby.perception.tiles import Tiling
from passerby.progress import Progress, silent

BACKGROUND, NONE = "background", "none"
STRIPES: Literal["stripes"] = "stripes"


@dataclass(frozen=True)
class Plan:
    """What all cameras' videos are watched with."""

    detector: Network | None
    """None: background subtraction."""
    embedder: Network | Literal["stripes"] | None
    """None: no embeddings."""
    keypoints: Network | None
    """None: no joints."""
    min_score: float = 0.25
    tiles: Tiling = "auto"
    notes: tuple[str, ...] = ()
    """What could not be had, one sentence each."""

    @property
    def figures(self) -> dict[str, Any]:
        """As plain values for JSON."""

        def told(choice: Network | str | None, without: str) -> dict[str, Any] | str:
            if isinstance(choice, Network):
                return {"network": choice.name, "sha256": choice.sha256, "licence": choice.licence}
            return choice or without

        return {
            "detector": told(self.detector, BACKGROUND),
            "embedder": told(self.embedder, NONE),
            "keypoints": told(self.keypoints, NONE),
        }


def make_plan(
    detector: str, embedder: str, keypoints: str, *, models: Path | None, base: Path | None, tell: Progress = silent
) -> Plan:
    """Find the networks that are asked for, and fetch those that are not here.

    Args:
        detector: "auto", "background", a model's name or the path of an ONNX file.
        embedder: "auto", "stripes", "none", a name or a path.
        keypoints: "none", a name or a path.
        models: a folder of models to look in first.
        base: the folder that relative paths start from.
        tell: told how far a download is.

    Raises:
        InputError: a network that was asked for by name or path is not there, or a file is not what it should be.
    """
    notes = []
    boxes = joints = None
    described: Network | Literal["stripes"] | None = None if embedder == NONE else STRIPES
    if detector != BACKGROUND:
        boxes, reason = _found(detector, "detector", models, base, tell)
        notes += [f"{reason}: people are found by background subtraction, without a network"] if boxes is None else []
    if embedder not in (STRIPES, NONE):
        looks, reason = _found(embedder, "embedder", models, base, tell)
        notes += [f"{reason}: people are told apart by the colours of stripes, without a network"] if looks is None else []
        described = looks or STRIPES
    if keypoints != NONE:
        joints, _ = _found(keypoints, "keypoints", models, base, tell)
    return Plan(boxes, described, joints, notes=tuple(notes))


def _found(wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress) -> Found:
    """The network, or why there is none; `InputError` where that was not left to us."""
    found = find_model(wanted, role, models, base=base, tell=tell)
    if found.network is None and wanted != AUTO:
        raise InputError(f"[perception] {role} = {wanted!r}: {found.reason}")
    return found
