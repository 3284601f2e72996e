"""Choice of the methods: networks where available, else methods without weights; and of the people with keypoints.

A joint gives a point in space only where two cameras see it at one time. So whole time steps are chosen, the same ones in all
cameras, and not single people. A quarter of all boxes at common times gave 9.6 mm 0.042 degrees, a quarter drawn box by box
17.5 mm 0.161 degrees, and none 33.8 mm 0.329 degrees (rendered terrace, seed 700, networks, MoveNet lightning).

The choice depends on the boxes and the clock alone, never on measured speed: a run that continues after a killed one, or that
takes the boxes from kept results, makes the same choice.
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
"""Replacement of a network that "auto" selects and that is not available."""
CROPS_PER_S = 3.0
"""Average number of crops per second of video. MoveNet thunder takes 25 ms per crop, lightning 7 ms; YOLOX-nano with the re-ID
network takes about 120 ms for the five images of a second with five people in them."""
CROPS_AT_LEAST = 250.0
"""Additional crops, for any length of a video: a recording of ten seconds with five people in view and five images per second
gets keypoints at all its times. Where people walk little, they are needed to register cameras."""
SLOT_S, SLOT_SHIFT_S = 0.4, 0.05
"""Time is cut into slots of this length; all images of a slot are taken or none. With this length, cameras whose clocks differ
by a part of a step have two neighbouring samples to interpolate between. The shift keeps a slot's ends away from the times of
usual frame rates."""
MIN_HEIGHT_PX = 40.0
"""For a smaller person, a joint's uncertainty is as large as its distance from the neighbouring joint."""
MOST_COVERED = 0.3
"""Largest share of a box that the box of a nearer person may cover: behind more of it, legs are hidden, and a network finds the
neighbour's."""
MIN_SCORE = 0.4


@dataclass(frozen=True)
class Plan:
    """Methods with which all cameras' videos are processed."""

    detector: Network | None
    """None: background subtraction."""
    embedder: Network | Literal["stripes"] | None
    """None: no embeddings."""
    keypoints: Network | None
    """None: no joints."""
    keypoints_per_s: float | None = None
    """Number of people per second of video whose joints are found; None: all."""
    min_score: float = 0.25
    tiles: Tiling = "auto"
    notes: tuple[Finding, ...] = ()
    """Networks that were not available."""

    @property
    def figures(self) -> dict[str, Any]:
        """The methods as plain values for JSON."""

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
    """Find the requested networks, and fetch those that are not on this computer.

    Args:
        detector: "auto", "background", a model's name or the path of an ONNX file.
        embedder: "auto", "stripes", "none", a name or a path.
        keypoints: "auto", "none", a name or a path.
        models: a folder of models to look in first.
        base: the folder that relative paths start from.
        tell: called with the progress of a download and, at once, with the replacement of a network that is not available.

    Raises:
        InputError: a network that was requested by name or path is not there, or a file is not as required.
    """
    notes: list[Finding] = []
    boxes = joints = None

    def lack(role: Role, why: str) -> None:
        # Reported at once: the next steps may take an hour.
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
        # Where the detector could not be fetched, a second attempt would also fail.
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
    """Return what `make_plan` would choose, without fetching: choices as plain values for JSON, and networks to be fetched.

    Arguments and errors as in `make_plan`; an empty choice is left out.
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
    """Return the name of the best network for joints on this computer, or of one that can be fetched; None without any.

    `models` is a folder of models to look in first. Of several networks on this computer the largest is the most accurate. If
    `fetched` is True, the catalogue's default may be fetched.
    """
    here = [
        entry for entry in catalogue() if entry.role == "keypoints" and any(copy.right for copy in copies_of(entry, models))
    ]
    if here:
        return max(here, key=lambda entry: entry.bytes).name
    served = default_of("keypoints")
    return served.name if served is not None and served.url is not None and fetched and not offline() else None


def _find_network(wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress) -> Found:
    """Find the network, or the reason why there is none; raises `InputError` where the user requested a particular one."""
    found = _ask_for_model(wanted, role, models, base, tell)
    if found.network is None and wanted != AUTO:
        raise InputError(f"[perception] {role} = {wanted!r}: {found.reason}")
    return found


def _ask_for_model(
    wanted: str, role: Role, models: Path | None, base: Path | None, tell: Progress, *, download: bool = True
) -> Found:
    """Call `find_model`; errors name the key of the scene file."""
    try:
        return find_model(wanted, role, models, base=base, download=download, tell=tell)
    except InputError as error:
        raise InputError(f"[perception] {role} = {wanted!r}: {error}") from None


def _as_plain_values(network: Network) -> dict[str, Any]:
    """Return a network as plain values for JSON."""
    return {"network": network.name, "sha256": network.sha256, "licence": network.licence}


@dataclass(eq=False)
class JointBudget:
    """Chooses boxes image after image, within a budget."""

    per_s: float
    """Crops per second of video."""
    rate: float
    """Images per second of video."""
    images: int | None
    """Total number of images; None where the video does not state its length."""
    share: float = 1.0
    """Share of the recording that they cover."""
    _seen: int = field(default=0, init=False)
    """Number of images so far."""
    _worth: int = field(default=0, init=False)
    """Number of people in them who are suitable for keypoints."""
    _used: int = field(default=0, init=False)
    """Number of those that were chosen."""

    @property
    def at_least(self) -> float:
        """Crops in addition to `per_s`."""
        return CROPS_AT_LEAST * self.share

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that determine the choice, without the boxes."""
        return {"budget": 1, "per_s": self.per_s, "at_least": self.at_least, "rate": self.rate, "images": self.images}

    def choose(self, seconds: float, ltwh: Floats, score: Floats, size: tuple[int, int]) -> Ints:
        """Choose the rows of the boxes in which keypoints are found.

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
        """Return the share of all slots for which the budget suffices, with as many people per image as there were so far."""
        per_image = self.per_s / self.rate + (self.at_least / self.images if self.images else 0.0)
        return per_image * self._seen / self._worth


def choose_for_keypoints(ltwh: Floats, score: Floats, size: tuple[int, int]) -> Bools:
    """Return which people (N,) of an image are large, found with confidence, not hidden behind another, and whole.

    If no person is whole, those that the image's border cuts off count.

    Args:
        ltwh: (N, 4) boxes, pixels.
        score: (N,) confidence.
        size: width and height of the image, pixels.
    """
    good = (ltwh[:, 3] >= MIN_HEIGHT_PX) & (score >= MIN_SCORE) & (_measure_cover(ltwh) <= MOST_COVERED)
    whole = good & find_inside_picture(ltwh, size)
    return whole if whole.any() else good


def _measure_cover(ltwh: Floats) -> Floats:
    """Return the largest share of each box (N,) that the box of one nearer person covers; nearer: feet lower in the image."""
    low, high = ltwh[:, :2], ltwh[:, :2] + ltwh[:, 2:]
    common = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    area = np.maximum(common, 0.0).prod(axis=2)
    nearer = high[None, :, 1] > high[:, None, 1]
    return np.asarray(np.where(nearer, area, 0.0).max(axis=1, initial=0.0) / np.maximum(ltwh[:, 2:].prod(axis=1), 1e-9))


def _draw(seconds: float) -> float:
    """Return a number from 0 to 1 for a time, the same in all cameras and without any period.

    With evenly spaced slots, cameras whose clocks differ by an unfavourable offset would have none in common.
    """
    slot = int((seconds + SLOT_SHIFT_S) // SLOT_S)
    return int.from_bytes(hashlib.blake2b(str(slot).encode(), digest_size=6).digest(), "big") / 2**48
