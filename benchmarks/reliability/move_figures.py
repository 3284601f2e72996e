"""What `BORNE_OUT` and `ZOOM_BORNE_OUT` are held against: cameras that move or zoom, and people who are taken for others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pages.cases import Outcomes
from pages.page import table
from passerby.calibration.diagnostics.correspondences import Correspondences, instants_compared, match_people
from passerby.calibration.diagnostics.pose_change import BORNE_OUT, ZOOM_BORNE_OUT, PoseChange, detect_pose_change
from passerby.calibration.diagnostics.zoom import detect_zoom
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.people.body_centres import BodyCentres, PeopleRays, identified_body_centres
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
LEAST_TRIED, MOST_TRIED = (0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.9), (1.2, 1.4, 1.6, 1.8, 2.0, 3.0)


@dataclass(frozen=True)
class Change:
    """A change of pose that is sure but for how far it is borne out."""

    moved: bool
    """Whether the camera is the one that moved or zoomed."""
    least: float
    """The smaller share by which its two poses are borne out,"""
    most: float
    """and the larger one."""
    gain: float
    zoom: bool
    """Whether it is told as a zoom."""


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
    changes = []
    for name, found in changes_of(rig, seen).items():
        is_moved = name == MOVED and case.kind not in (STILL, CONFUSED)
        changes += [Change(is_moved, min(one.borne_out), max(one.borne_out), one.gain, zoom=one.zoom != 1.0) for one in found]
    return {"changes": [asdict(one) for one in changes]}


def changes_of(rig: Rig, seen: Observations) -> dict[str, list[PoseChange]]:
    """By camera, the change of pose and the zoom that all other limits let pass; identities are known, clocks agree."""
    middles = identified_body_centres(rig, seen)
    rays = PeopleRays.of(rig, middles)
    out: dict[str, list[PoseChange]] = {}
    for c, (camera, own) in enumerate(zip(rig, middles, strict=True)):
        if camera.pose is None or own is None:
            continue
        m = _matched(c, own, rays)
        found = detect_pose_change(m, camera.pose, FPS), detect_zoom(m, camera.pose, FPS)
        out[camera.name] = [one for one in found if one is not None and replace(one, borne_out=(1.0, 1.0)).sure]
    return out


def _matched(c: int, own: BodyCentres, rays: PeopleRays) -> Correspondences:
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


def section(outcomes: Outcomes, wanted: Mapping[str, MoveCase]) -> str:
    """Tables of how far changes are borne out, and of what other limits would do; `outcomes` of `measure`, by key."""
    by_kind: dict[str, list[list[Change]]] = {}
    for key, outcome in outcomes.items():
        by_kind.setdefault(wanted[key].kind, []).append([Change(**one) for one in outcome["changes"]])
    zooming = {case.kind for case in wanted.values() if case.zoom != 1.0}
    moves = {kind: scenes for kind, scenes in by_kind.items() if kind not in zooming}
    zooms = {kind: scenes for kind, scenes in by_kind.items() if kind in (STILL, CONFUSED, *zooming)}
    head = ("still scenes with one told", "confused scenes with one told")
    low = [[_bold(limit, BORNE_OUT[0]), *_told(moves, limit, BORNE_OUT[1], zoom=False)] for limit in LEAST_TRIED]
    high = [[_bold(limit, BORNE_OUT[1]), *_told(moves, BORNE_OUT[0], limit, zoom=False)] for limit in MOST_TRIED]
    least = [[_bold(limit, ZOOM_BORNE_OUT), *_told(zooms, limit, BORNE_OUT[1], zoom=True)] for limit in LEAST_TRIED]
    return f"""### BORNE_OUT in `calibration/diagnostics/pose_change.py`: {BORNE_OUT[0]:g}, {BORNE_OUT[1]:g}

A change of pose half-way is told where both poses are that much better in their time than the other's, as a share of what the
change would make of it. Scenes of {SECONDS:g} s, four cameras, six people, identities given, seeds from {FIRST_SEED}. The
table has the smaller and the larger of the two shares: of the camera that moved, and in still scenes of any camera. In confused
scenes one camera takes three people for one another from half-time on.

{_seen(moves, zoom=False)}

{table(("lower limit", "moved cameras told", *head), low)}

{table(("upper limit", "moved cameras told", *head), high)}

### ZOOM_BORNE_OUT in `calibration/diagnostics/pose_change.py`: {ZOOM_BORNE_OUT:g}

The lower limit for a change of focal length half-way, by the factor; people who are taken for others seldom resemble one.

{_seen(zooms, zoom=True)}

{table(("lower limit", "zooming cameras told", *head), least)}
"""


def _seen(by_kind: Mapping[str, list[list[Change]]], *, zoom: bool) -> str:
    """How far changes of one sort are borne out, by kind of scene."""
    rows = []
    for kind, scenes in by_kind.items():
        moved = kind not in (STILL, CONFUSED)
        some = [one for scene in scenes for one in scene if (one.moved, one.zoom) == (moved, zoom)]
        spans = [
            f"{f([getattr(one, end) for one in some]):.2f}" if some else "-" for end in ("least", "most") for f in (min, max)
        ]
        rows.append([kind, str(len(scenes)), str(len(some)), *spans])
    return table(("scenes", "number", "changes", "smaller: from", "to", "larger: from", "to"), rows)


def _bold(limit: float, in_force: float) -> str:
    return f"**{limit:g}**" if limit == in_force else f"{limit:g}"


def _told(by_kind: Mapping[str, list[list[Change]]], least: float, most: float, *, zoom: bool) -> list[str]:
    """Of moved cameras, still scenes and confused scenes, those in which a change of one sort would be told."""

    def told(change: Change) -> bool:
        return change.zoom == zoom and least < change.least <= change.most < most

    moved = [scene for kind, scenes in by_kind.items() if kind not in (STILL, CONFUSED) for scene in scenes]
    out = [f"{sum(any(one.moved and told(one) for one in scene) for scene in moved)} of {len(moved)}"]
    for kind in (STILL, CONFUSED):
        scenes = by_kind.get(kind, [])
        out.append(f"{sum(any(told(one) for one in scene) for scene in scenes)} of {len(scenes)}")
    return out
