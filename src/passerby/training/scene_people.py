"""People of a calibrated scene, cut out of its videos, that geometry confirms: labels without any manual work.

A calibration estimates identities. They are checked here again, by the rig itself and without appearance: see
`verify_boxes` and `pseudo_labels`. Nearly all remaining labels are right. This is more important than their number, because
training with the hardest pairs amplifies each wrong label.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Ints
from passerby.common.errors import EvidenceError, InputError
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, Clock
from passerby.interchange.output_folder import RIG_FILE, read_output, scene_of
from passerby.people.ground_positions import Places, places_of
from passerby.perception.video import probe
from passerby.scene.scene import Scene
from passerby.training.agreement import ALONE, AMBIGUOUS, BEHIND, MISFIT, NEAR, REASONS, SURE, GeometricAgreement, verify_boxes
from passerby.training.crops import CropSet
from passerby.training.data.cutting import PER_PERSON, WantedCrops, cut_crops, find_clear_boxes, one_file, spread_rows
from passerby.training.sure_spans import PseudoLabels, pseudo_labels

FEWEST_PEOPLE, FEWEST_CROPS = 4, 100
"""Minimum numbers of people and crops from which a network can learn the differences between people."""
REMEDIES = {
    ALONE: "let the cameras' views overlap more",
    MISFIT: "check the calibration: its poses or clocks may be wrong",
    AMBIGUOUS: "record with fewer people at a time, or with more cameras",
    BEHIND: "record with fewer people at a time, or hang the cameras higher",
    NEAR: "record with fewer people at a time",
}
"""Reason for which most boxes are left out -> remedy."""


@dataclass(frozen=True, eq=False)
class ScenePeople:
    """Pictures of people with confirmed labels."""

    scene: Scene
    """The scene that was calibrated."""
    crops: CropSet
    """People are spans of identities, named SCENE/IDENTITY@SPAN; `apart` states which of them are known to be different."""
    figures: dict[str, Any] = field(default_factory=dict)
    """Counts and shares, JSON-ready."""
    notes: tuple[str, ...] = ()
    """Notes to report, one sentence each."""


def scene_people(
    out: Path, cache: Path, scene: Path | None = None, tell: Progress = silent, executor: Executor | None = None
) -> ScenePeople:
    """Cut the people of a calibrated scene that geometry confirms out of its videos.

    Args:
        out: the output folder of `passerby calibrate`.
        cache: folder in which crops are kept.
        scene: the scene file; None: the path that the output folder states.
        tell: called with the stages.
        executor: cuts the cameras in parallel.

    Raises:
        InputError: as `read_calibrated` and `cut_crops`.
        EvidenceError: the calibration was refused, or fewer than `FEWEST_PEOPLE` people or `FEWEST_CROPS` crops remain.
    """
    tell("reading")
    calibrated = read_calibrated(out, scene)
    tell("checking identities")
    person_height_m = calibrated.scene.scale.person_height_m
    places = places_of(calibrated.rig, calibrated.boxes, calibrated.clocks, person_height_m)
    agreed = verify_boxes(places)
    spans = pseudo_labels(places, agreed)
    wanted = [
        _choose_boxes(calibrated, number, name, places, spans)
        for number, name in enumerate(calibrated.rig.names)
        if name in calibrated.videos
    ]
    figures = _figures(calibrated, places, agreed, spans)
    planned = sum(len(one.frame) for one in wanted)
    _check_enough(out, figures, len(spans.identity), planned)
    people = [f"{who}@{number}" for who, number in zip(spans.identity.tolist(), spans.number.tolist(), strict=True)]
    name = calibrated.scene.name
    cut = cut_crops(wanted, people, cache, name=name, executor=executor, tell=tell)
    crops = replace(cut.crops, apart=spans.apart)
    # People with crops of only one camera do not show how cameras differ.
    crops = crops.of_people(_cameras_of_people(crops) > 1)
    _check_enough(out, figures, len(crops.people), len(crops))
    figures |= {
        "people": len(crops.people),
        "identities": len(np.unique(spans.identity)),
        "crops": len(crops),
        "crops_by_camera": dict(
            zip(
                (one.camera for one in wanted),
                np.bincount(crops.camera, minlength=len(wanted)).tolist(),
                strict=True,
            )
        ),
        "surely_two": float(_share_apart(crops)),
    }
    return ScenePeople(calibrated.scene, crops, figures, (*_notes(out, calibrated), *cut.notes))


def _choose_boxes(calibrated: CalibratedScene, number: int, name: str, places: Places, spans: PseudoLabels) -> WantedCrops:
    """Choose the boxes of a camera to cut: confirmed, clear, and spread over the time of each span."""
    boxes = calibrated.boxes[name]
    span = np.full(len(boxes), -1)
    mine = (places.camera == number) & (spans.span >= 0)
    span[places.row[mine]] = spans.span[mine]
    rows: Ints = np.zeros(0, dtype=np.int64)
    if len(boxes):
        clear = find_clear_boxes(boxes.frame, boxes.ltwh, calibrated.rig[name].lens.size)
        rows = spread_rows(boxes.frame, span, clear, PER_PERSON)
    return WantedCrops(name, calibrated.videos[name], boxes.frame[rows], boxes.ltwh[rows], span[rows])


def _cameras_of_people(crops: CropSet) -> Ints:
    """Count the cameras that show each person, (P,)."""
    pairs = np.unique(np.column_stack([crops.person, crops.camera]), axis=0)
    return np.asarray(np.bincount(pairs[:, 0], minlength=len(crops.people)), dtype=np.int64)


def _share_apart(crops: CropSet) -> float:
    """Compute the share of the pairs of people who are known to be different."""
    n = len(crops.people)
    return float(crops.apart.sum() / (n * (n - 1))) if crops.apart is not None and n > 1 else 0.0


def _figures(calibrated: CalibratedScene, places: Places, agreed: GeometricAgreement, spans: PseudoLabels) -> dict[str, Any]:
    """Return counts of the confirmed and the rejected boxes at the instants of `places`, by reason and by camera."""
    identified = places.identity >= 0
    kept = spans.span >= 0
    count = np.bincount(agreed.reason[identified & ~kept], minlength=len(REASONS))
    left_out = {REASONS[why]: int(n) for why, n in enumerate(count) if n and why != SURE}
    left_out |= {"too short, or beside a doubt": int(count[SURE])} if count[SURE] else {}
    seconds = spans.seconds[:, 1] - spans.seconds[:, 0]
    return {
        "boxes": len(places),
        "identified": int(identified.sum()),
        "sure": int(kept.sum()),
        "sure_share": float(kept.sum() / max(identified.sum(), 1)),
        "left_out": left_out,
        "spans": len(spans.identity),
        "span_seconds_median": float(np.median(seconds)) if len(seconds) else None,
        "spread": agreed.spread,
        "cameras": {
            name: {"identified": int(identified[places.camera == c].sum()), "sure": int(kept[places.camera == c].sum())}
            for c, name in enumerate(calibrated.rig.names)
        },
    }


def _check_enough(out: Path, figures: dict[str, Any], people: int, crops: int) -> None:
    """Raise `EvidenceError` if too little is confirmed, with the reasons for which boxes were left out."""
    if people >= FEWEST_PEOPLE and crops >= FEWEST_CROPS:
        return
    left_out: dict[str, int] = figures["left_out"]
    causes = sorted(left_out.items(), key=lambda item: -item[1])
    told = [f"{why}: {count}" for why, count in causes]
    worst = next((number for why, _ in causes for number in REMEDIES if REASONS[number] == why), None)
    remedy = REMEDIES[worst] if worst is not None else "record for longer"
    reasons = (
        f"{people} people and {crops} crops are reliable, {FEWEST_PEOPLE} and {FEWEST_CROPS} are needed",
        f"{figures['sure']} of {figures['identified']} identified boxes are reliable",
        *(f"left out, {line}" for line in told),
    )
    raise EvidenceError(
        f"{out}: the calibration identifies too few people reliably: {reasons[0]}; {reasons[1]} "
        f"(left out: {', '.join(told) or 'none'}): {remedy}",
        reasons,
    )


def _notes(out: Path, calibrated: CalibratedScene) -> list[str]:
    """Return notes about a calibration that is not accepted, and about cameras without a video."""
    notes = []
    if calibrated.verdict != "accepted":
        notes.append(f"{out}: the calibration is {calibrated.verdict}: its labels may be wrong more often than usual")
    without = [name for name in calibrated.rig.names if name not in calibrated.videos]
    if without:
        notes.append(f"{calibrated.scene.place}: no video of camera{'s' if len(without) > 1 else ''} {', '.join(without)}: "
                     "no crops of it, but it helps to determine identities")  # fmt: skip
    return notes


@dataclass(frozen=True, eq=False)
class CalibratedScene:
    """A calibrated scene: the cameras that have poses, and their boxes."""

    scene: Scene
    rig: Rig
    """The cameras with poses, two or more."""
    boxes: Mapping[str, Boxes]
    """Boxes of each of these cameras, with identities that are the same in all cameras."""
    clocks: Mapping[str, Clock]
    verdict: str
    videos: Mapping[str, Path]
    """Videos of these cameras; some may have none."""


def read_calibrated(out: Path, scene: Path | None = None) -> CalibratedScene:
    """Read an output folder.

    Args:
        out: the folder.
        scene: its scene file; None: the path that `calibration.json` states.

    Raises:
        InputError: a file is missing or broken; the message has its name and a remedy.
        EvidenceError: the calibration was refused, or registered fewer than two cameras.
    """
    found = read_output(out)
    posed = found.rig
    if len(posed) < 2:
        raise EvidenceError(
            f"{out / RIG_FILE}: {len(posed)} of {found.all_cameras} cameras have a pose: identities need two cameras or more"
        )
    loaded = Scene.load(scene or scene_of(out, found.document, "give the new path of the scene file"))
    for camera in posed:
        if camera.name not in loaded.cameras:
            raise InputError(
                f"{loaded.place}: has no [cameras.{camera.name}], which {out / RIG_FILE} has: give the scene file that was "
                "calibrated"
            )
    videos = {
        name: one_file([loaded.resolve(path) for path in table.videos], name)
        for name, table in loaded.cameras.items()
        if table.videos and name in posed.names
    }
    if not videos:
        raise InputError(f"{loaded.place}: no calibrated camera has a video: crops of people are cut from videos")
    clocks = found.clocks or _align_clocks(loaded, posed, videos)
    return CalibratedScene(loaded, posed, found.boxes, clocks, found.verdict, videos)


def _align_clocks(scene: Scene, rig: Rig, videos: Mapping[str, Path]) -> dict[str, Clock]:
    """Return clocks for frames with the same numbers in all cameras, at the frame rate of the scene or of a video."""
    rates = [scene.fps_of(name) for name in rig.names]
    rate = next((rate for rate in rates if rate), None) or probe(next(iter(videos.values()))).clock_fps
    return {name: Clock(rate) for name in rig.names}
