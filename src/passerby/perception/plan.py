"""How people are found: networks where available, methods without weights otherwise; and whose keypoints are measured.

A joint is a point in space only where two cameras see it at one time. So whole time steps are chosen, the same ones in all
cameras, and not people by themselves: a quarter of all boxes at times drawn alike gave 9.6 mm 0.042 degrees, a quarter drawn
box by box 17.5 mm 0.161 degrees, and none 33.8 mm 0.329 degrees (rendered terrace, seed 700, networks, MoveNet lightning).

The choice depends on the boxes and the clock alone, never on measured speed: a run that goes on where another was killed, or
that takes the boxes from what is kept, chooses the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent, tell_warning
from passerby.core.observations import find_inside_picture
from passerby.findings.finding import Finding, notice
from passerby.findings.texts import text_of
from passerby.perception.fetching import offline
from passerby.perception.model_files import AUTO, Found, copies_of, find_model
from passerby.perception.networks import Network, Role, catalogue, default_of
from passerby.perception.tiles import Tiling

BACKGROUND, NONE = "background", "none"
STRIPES: Literal["stripes"] = "stripes"
_OTHERWISE: Mapping[Role, str] = {"detector": BACKGROUND, "embedder": STRIPES, "keypoints": NONE}
"""What takes the place of a network that "auto" means and that cannot be had."""
CROPS_PER_S = 3.0
"""Crops a second of video, on average. MoveNet thunder takes 25 ms a crop, lightning 7 ms; YOLOX-nano with the re-ID network
takes about 120 ms for the five images of a second with five people in them."""
CROPS_AT_LEAST = 250.0
"""Crops beyond that, whatever a video's length: a recording of ten seconds with five people in view, looked at five times a
second, gives keypoints at all its times; cameras are registered by these where people barely walk."""
SLOT_S, SLOT_SHIFT_S = 0.4, 0.05
"""Time is cut into slots, of which all images are taken or none. So long, cameras whose clocks differ by a part of a step have
two samples next to each other to interpolate between. The shift keeps a slot's ends away from the times of usual frame
rates."""
MIN_HEIGHT_PX = 40.0
"""Below this, a joint of a person is as uncertain as a joint's distance from its neighbour."""
MOST_COVERED = 0.3
"""The share of a box that the box of a nearer person may cover: legs are hidden behind more of it, and a network finds the
neighbour's."""
MIN_SCORE = 0.4


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
                return _as_plain_values(choice)
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
        boxes, reason = _find_network(detector, "detector", models, base, tell)
        if boxes is None:
            lack("detector", reason)
    if embedder not in (STRIPES, NONE):
        appearance, reason = _find_network(embedder, "embedder", models, base, tell)
        if appearance is None:
            lack("embedder", reason)
        described = appearance or STRIPES
    if keypoints == AUTO:
        # Where the detector could not be fetched, a second attempt would fail as the first did.
        keypoints = keypoints_to_be_had(models, fetched=boxes is not None) or NONE
        if keypoints != NONE:
            joints, reason = _ask_for_model(keypoints, "keypoints", models, base, tell)
            if joints is None:
                lack("keypoints", reason)
    elif keypoints != NONE:
        joints = _find_network(keypoints, "keypoints", models, base, tell).network
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
        network, reason = _ask_for_model(named, role, models, base, silent, download=False)
        entry = default_of(role) if named == AUTO else None
        choices[role] = _as_plain_values(network) if network else {"network": entry.name if entry else named}
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


def _find_network(wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress) -> Found:
    """The network, or why there is none; `InputError` where that was not left to us."""
    found = _ask_for_model(wanted, role, models, base, tell)
    if found.network is None and wanted != AUTO:
        raise InputError(f"[perception] {role} = {wanted!r}: {found.reason}")
    return found


def _ask_for_model(
    wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress, *, download: bool = True
) -> Found:
    """As `find_model`; errors name the key."""
    try:
        return find_model(wanted, role, models, base=base, download=download, tell=tell)
    except InputError as error:
        raise InputError(f"[perception] {role} = {wanted!r}: {error}") from None


def _as_plain_values(network: Network) -> dict[str, Any]:
    """A network as plain values for JSON."""
    return {"network": network.name, "sha256": network.sha256, "licence": network.licence}


@dataclass(eq=False)
class JointBudget:
    """Chooses boxes, image after image, as they come."""

    per_s: float
    """Crops a second of video."""
    rate: float
    """Images a second of video."""
    images: int | None
    """How many there will be; None where the video does not tell its length."""
    share: float = 1.0
    """The part of the recording that they are."""
    _seen: int = field(default=0, init=False)
    """Images so far,"""
    _worth: int = field(default=0, init=False)
    """people in them whose keypoints are worth it,"""
    _used: int = field(default=0, init=False)
    """and those of them that were chosen."""

    @property
    def at_least(self) -> float:
        """Crops beyond `per_s`."""
        return CROPS_AT_LEAST * self.share

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the choice, the boxes aside."""
        return {"budget": 1, "per_s": self.per_s, "at_least": self.at_least, "rate": self.rate, "images": self.images}

    def choose(self, seconds: float, ltwh: Floats, score: Floats, size: tuple[int, int]) -> Ints:
        """The rows of the boxes to measure keypoints in.

        Args:
            seconds: time of the image by the video's clock; later than that of the call before.
            ltwh: (N, 4) boxes, pixels.
            score: (N,) their confidence.
            size: width and height of the image, pixels.
        """
        rows = np.flatnonzero(choose_for_keypoints(ltwh, score, size))
        self._seen += 1
        self._worth += len(rows)
        allowed = self.at_least + self.per_s * self._seen / self.rate
        if not len(rows) or _draw(seconds) >= self._share() or self._used + len(rows) > allowed:
            return rows[:0]
        self._used += len(rows)
        return rows

    def _share(self) -> float:
        """The share of all slots that the budget lasts for, with as many people in each image as there were so far."""
        per_image = self.per_s / self.rate + (self.at_least / self.images if self.images else 0.0)
        return per_image * self._seen / self._worth


def choose_for_keypoints(ltwh: Floats, score: Floats, size: tuple[int, int]) -> Bools:
    """(N,) the people of an image that are large, found with confidence, not hidden behind another, and whole.

    Those whom the image's border cuts off count where no person is whole.

    Args:
        ltwh: (N, 4) boxes, pixels.
        score: (N,) confidence.
        size: width and height of the image, pixels.
    """
    good = (ltwh[:, 3] >= MIN_HEIGHT_PX) & (score >= MIN_SCORE) & (_measure_cover(ltwh) <= MOST_COVERED)
    whole = good & find_inside_picture(ltwh, size)
    return whole if whole.any() else good


def _measure_cover(ltwh: Floats) -> Floats:
    """(N,) the largest share of each box that one box of a nearer person, whose feet are lower in the image, covers."""
    low, high = ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]
    common = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    area = np.maximum(common, 0.0).prod(axis=2)
    nearer = high[None, :, 1] > high[:, None, 1]
    return np.asarray(np.where(nearer, area, 0.0).max(axis=1, initial=0.0) / np.maximum(ltwh[:, 2:].prod(axis=1), 1e-9))


def _draw(seconds: float) -> float:
    """A number from 0 to 1 for a time, the same in all cameras and without any period.

    Of slots at even distances, cameras whose clocks differ by an unlucky offset would have none in common.
    """
    slot = int((seconds + SLOT_SHIFT_S) // SLOT_S)
    return int.from_bytes(hashlib.blake2b(str(slot).encode(), digest_size=6).digest(), "big") / 2**48
