"""What people are found with: networks where they can be had, methods without weights where not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent, tell_warning
from passerby.findings.finding import Finding, notice
from passerby.findings.texts import text_of
from passerby.perception.catalogue import catalogue, default_of
from passerby.perception.fetching import offline
from passerby.perception.model_files import AUTO, Found, copies_of, find_model
from passerby.perception.networks import Network, Role
from passerby.perception.tiles import Tiling

BACKGROUND, NONE = "background", "none"
STRIPES: Literal["stripes"] = "stripes"
_OTHERWISE: Mapping[Role, str] = {"detector": BACKGROUND, "embedder": STRIPES, "keypoints": NONE}
"""What takes the place of a network that "auto" means and that cannot be had."""


@dataclass(frozen=True)
class Plan:
    """What all cameras' videos are watched with."""

    detector: Network | None
    """None: background subtraction."""
    embedder: Network | Literal["stripes"] | None
    """None: no embeddings."""
    keypoints: Network | None
    """None: no joints."""
    keypoints_per_s: float | None = None
    """People whose joints are found, in a second of video; None: everybody."""
    min_score: float = 0.25
    tiles: Tiling = "auto"
    notes: tuple[Finding, ...] = ()
    """What could not be had."""

    @property
    def figures(self) -> dict[str, Any]:
        """As plain values for JSON."""

        def told(choice: Network | str | None, without: str) -> dict[str, Any] | str:
            if isinstance(choice, Network):
                return _told(choice)
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
        keypoints: "auto", "none", a name or a path.
        models: a folder of models to look in first.
        base: the folder that relative paths start from.
        tell: called with the progress of a download and, at once, what is used in place of a network that cannot be had.

    Raises:
        InputError: a network that was asked for by name or path is not there, or a file is not what it should be.
    """
    notes: list[Finding] = []
    boxes = joints = None

    def lack(role: Role, why: str) -> None:
        # Reported at once: what comes next may take an hour.
        notes.append(notice("network_missing", role=role, why=why))
        tell_warning(tell, text_of(notes[-1]))

    described: Network | Literal["stripes"] | None = None if embedder == NONE else STRIPES
    if detector != BACKGROUND:
        boxes, reason = _found(detector, "detector", models, base, tell)
        if boxes is None:
            lack("detector", reason)
    if embedder not in (STRIPES, NONE):
        appearance, reason = _found(embedder, "embedder", models, base, tell)
        if appearance is None:
            lack("embedder", reason)
        described = appearance or STRIPES
    if keypoints == AUTO:
        # Where the detector could not be fetched, a second attempt would fail as the first did.
        keypoints = keypoints_to_be_had(models, fetched=boxes is not None) or NONE
        if keypoints != NONE:
            joints, reason = _asked(keypoints, "keypoints", models, base, tell)
            if joints is None:
                lack("keypoints", reason)
    elif keypoints != NONE:
        joints = _found(keypoints, "keypoints", models, base, tell).network
    return Plan(boxes, described, joints, notes=tuple(notes))


def foresee(
    detector: str, embedder: str, keypoints: str, *, models: Path | None, base: Path | None
) -> tuple[dict[str, Any], list[Finding]]:
    """What `make_plan` would choose, with nothing fetched: choices as plain values for JSON, and what is to be fetched.

    Arguments and errors as of `make_plan`; an empty choice is left out.
    """
    choices: dict[str, Any] = {}
    notes = []
    roles: tuple[tuple[Role, str], ...] = (("detector", detector), ("embedder", embedder), ("keypoints", keypoints))
    for role, wanted in roles:
        named = wanted
        if role == "keypoints" and wanted == AUTO:
            named = keypoints_to_be_had(models, fetched=detector != BACKGROUND) or NONE
        if named in ("", BACKGROUND, STRIPES, NONE):
            choices |= {role: named} if named else {}
            continue
        network, reason = _asked(named, role, models, base, silent, download=False)
        entry = default_of(role) if named == AUTO else None
        choices[role] = _told(network) if network else {"network": entry.name if entry else named}
        if network is None:
            notes.append(
                notice("network_to_fetch", role=role, why=reason, otherwise=_OTHERWISE[role] if wanted == AUTO else None)
            )
    return choices, notes


def keypoints_to_be_had(models: Path | None, *, fetched: bool = True) -> str | None:
    """The name of the best network for joints that is on this computer, or that can be fetched; None where there is none.

    `models` is a folder of models to look in first. Of several on this computer the largest is the most accurate one. What is
    `fetched`, unless it shall not be, is the catalogue's default.
    """
    here = [
        entry for entry in catalogue() if entry.role == "keypoints" and any(copy.right for copy in copies_of(entry, models))
    ]
    if here:
        return max(here, key=lambda entry: entry.bytes).name
    served = default_of("keypoints")
    return served.name if served is not None and served.url is not None and fetched and not offline() else None


def _found(wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress) -> Found:
    """The network, or why there is none; `InputError` where that was not left to us."""
    found = _asked(wanted, role, models, base, tell)
    if found.network is None and wanted != AUTO:
        raise InputError(f"[perception] {role} = {wanted!r}: {found.reason}")
    return found


def _asked(wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress, *, download: bool = True) -> Found:
    """As `find_model`; errors name the key."""
    try:
        return find_model(wanted, role, models, base=base, download=download, tell=tell)
    except InputError as error:
        raise InputError(f"[perception] {role} = {wanted!r}: {error}") from None


def _told(network: Network) -> dict[str, Any]:
    """A network as plain values for JSON."""
    return {"network": network.name, "sha256": network.sha256, "licence": network.licence}
