"""What changes of a camera are found: cameras that move or zoom, and people who are taken for others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.hypotheses.changes import FoundChange, suspect_change
from passerby.hypotheses.comparison import LOG_ODDS
from passerby.hypotheses.correspondences import Correspondences, instants_compared, match_people
from passerby.people.body_centres import PeopleRays, identified_body_centres
from passerby.people.sightings import Sightings
from passerby.simulation import PRESETS
from passerby.solver.people import PeopleOptions, solve_people
from reliability.staging import HandedIn, staged, turned, zoomed

FIRST_SEED = 942_000
FPS = 5.0
SECONDS = 30.0
MOVED = "C2"
STILL, CONFUSED = "nobody moves", "people taken for others"
TURNS_DEG, SHIFTS_M = (1.0, 2.0, 4.0, 10.0), (0.1, 0.2, 0.5)
ZOOMS = (0.8, 0.95, 1.05, 1.25)
ODDS_TRIED = (10.0, 100.0, 1000.0)


@dataclass(frozen=True)
class Change:
    """A change of one camera that is more probable than a camera that stays as it is."""

    moved: bool
    """Whether the camera is the one that moved or zoomed."""
    kind: str
    gain: float
    """How much better people who were held out are predicted, nats."""
    log_odds: float


@dataclass(frozen=True)
class MoveCase:
    """One scene."""

    kind: str
    preset: str
    seed: int
    pan_deg: float = 0.0
    shift_m: float = 0.0
    zoom: float = 1.0


def cases(seeds: int) -> dict[str, MoveCase]:
    """Scenes of each preset and kind, by key: eight still ones and as many confused ones for each four seeds."""
    out: dict[str, MoveCase] = {}
    for number, preset in enumerate(PRESETS):
        first = FIRST_SEED + 100 * number
        for seed in range(first, first + 2 * seeds):
            for kind in (STILL, CONFUSED):
                out[f"{kind} {preset} {seed}"] = MoveCase(kind, preset, seed)
        for seed in range(first, first + max(1, seeds // 2)):
            for degrees in TURNS_DEG:
                out[f"pan {degrees:g} {preset} {seed}"] = MoveCase(f"turned by {degrees:g} degrees", preset, seed, degrees)
            for metres in SHIFTS_M:
                kind = f"shifted by {metres:g} m"
                out[f"{kind} {preset} {seed}"] = MoveCase(kind, preset, seed, shift_m=metres)
            for factor in ZOOMS:
                kind = f"zoomed by {factor:g}"
                out[f"{kind} {preset} {seed}"] = MoveCase(kind, preset, seed, zoom=factor)
    return out


def measure(case: MoveCase) -> dict[str, Any]:
    """The changes of pose that a scene's cameras seem to have made, as plain values."""
    scene = _scene(case)
    seen = Observations(
        {name: CameraObservations(boxes, Keypoints.empty()) for name, boxes in scene.boxes.items()}, FPS
    )  # fmt: skip
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in scene.lenses))
    try:
        rig = solve_people(blind, seen, ScaleCues(), PeopleOptions(), rng=np.random.default_rng(case.seed)).rig
    except EvidenceError:
        return {"changes": []}
    return {
        "changes": [
            asdict(Change(name == MOVED and case.kind not in (STILL, CONFUSED), one.kind, one.over_base.gain, one.log_odds))
            for name, one in changes_of(rig, seen).items()
        ]
    }


def changes_of(rig: Rig, seen: Observations) -> dict[str, FoundChange]:
    """The changes that are found, by camera; identities are known, clocks agree."""
    middles = identified_body_centres(rig, seen)
    rays = PeopleRays.of(rig, middles)
    out: dict[str, FoundChange] = {}
    for c, (camera, own) in enumerate(zip(rig, middles, strict=True)):
        if camera.pose is None or own is None:
            continue
        suspect = suspect_change(_matched(c, own, rays), camera.pose, FPS, len(rig))
        found = None if suspect is None else suspect.compared()
        if found is not None:
            out[camera.name] = found
    return out


def _matched(c: int, own: Sightings, rays: PeopleRays) -> Correspondences:
    """A camera's sightings with the people whom the others place."""
    others = rays.camera != c
    placed = np.bincount(rays.person[others], minlength=len(rays.instant)) > 0
    instants = instants_compared(own, rays.instant[placed])
    people = rays.triangulated(PERSON_HEIGHT_M, others & np.isin(rays.instant, instants)[rays.person])
    return match_people(own, people, PERSON_HEIGHT_M, given=True, instants=instants)


def _scene(case: MoveCase) -> HandedIn:
    if case.kind == CONFUSED:
        return _confused(staged(case.seed, preset=case.preset, seconds=SECONDS))
    if case.kind == STILL:
        return staged(case.seed, preset=case.preset, seconds=SECONDS)
    return staged(case.seed, preset=case.preset, seconds=SECONDS, later=(SECONDS / 2, lambda rig, rng: _moved(rig, case)))


def _moved(rig: Rig, case: MoveCase) -> Rig:
    shift = case.shift_m * np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0])
    poses = turned(rig, MOVED, pan=case.pan_deg, shift=shift)
    return Rig(tuple(replace(one, lens=zoomed(one.lens, case.zoom)) if one.name == MOVED else one for one in poses))


def _confused(scene: HandedIn) -> HandedIn:
    """One camera takes three people for one another from half-time on."""
    boxes = scene.boxes[MOVED]
    late = boxes.frame > SECONDS / 2 * FPS
    identity = np.where(late & np.isin(boxes.identity, (1, 2, 3)), boxes.identity % 3 + 1, boxes.identity)
    return scene.with_boxes(MOVED, replace(boxes, identity=identity))


def tabulate(outcomes: Outcomes, wanted: Mapping[str, MoveCase]) -> Found:
    """Tables of the changes that are found; `outcomes` of `measure`, by key."""
    by_kind: dict[str, list[list[Change]]] = {}
    for key, outcome in outcomes.items():
        by_kind.setdefault(wanted[key].kind, []).append([Change(**one) for one in outcome["changes"]])
    found = [_found(kind, scenes) for kind, scenes in by_kind.items()]
    limits = [[f"**{odds:g}**" if np.isclose(np.log(odds), LOG_ODDS) else f"{odds:g}", *_counts(by_kind, odds)]
              for odds in ODDS_TRIED]  # fmt: skip
    scenes = ("scenes", "number", "the camera found", "with the largest gain", "least odds of it, log", "another one found")
    head = ("least odds", "changed cameras found", "still scenes with one found", "confused scenes with one found")
    return Found({"Scenes": table(scenes, found), "Least odds": table(head, limits)})


def _found(kind: str, scenes: list[list[Change]]) -> list[str]:
    """A row of what is found in scenes of a kind."""
    right = [one for scene in scenes for one in scene if one.moved]
    first = sum(max(scene, key=lambda one: one.gain).moved for scene in scenes if scene)
    others = sum(any(not one.moved for one in scene) for scene in scenes)
    least = f"{min(one.log_odds for one in right):.1f}" if right else "-"
    return [kind, str(len(scenes)), str(len(right)), str(first), least, str(others)]


def _counts(by_kind: Mapping[str, list[list[Change]]], odds: float) -> list[str]:
    """Of changed cameras, still scenes and confused scenes, those in which a change is found."""

    def counts(scenes: list[list[Change]], *, moved: bool) -> int:
        return sum(any((one.moved or not moved) and one.log_odds >= np.log(odds) for one in scene) for scene in scenes)

    changed = [scene for kind, scenes in by_kind.items() if kind not in (STILL, CONFUSED) for scene in scenes]
    out = [f"{counts(changed, moved=True)} of {len(changed)}"]
    for kind in (STILL, CONFUSED):
        scenes = by_kind.get(kind, [])
        out.append(f"{counts(scenes, moved=False)} of {len(scenes)}")
    return out
