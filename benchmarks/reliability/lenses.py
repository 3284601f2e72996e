"""Stated lenses: are right ones accused, and are wrong ones named? Simulated scenes with a lens stated wrongly, and without."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from pages.records import Found
from pages.tables import Table, table
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.findings.finding import Finding
from passerby.hypotheses.lenses import LensResult, examine_lenses
from passerby.hypotheses.observations import examine_readings
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate
from passerby.solver.people import PeopleOptions, PeopleSolution, solve_people
from reliability.judging import calibrated
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept, percent, seeds
from reliability.staging import HandedIn, zoomed

SOUND_SEEDS, FOUND_SEEDS, WRONG_SEEDS = seeds(2_000, 300), seeds(2_600, 6), seeds(2_800, 5)
"""Scenes with right lenses whose identities are given, those whose identities are found beside a camera that has to be left
out, and scenes of each wrong lens. Constants were set with seeds 1000 to 1100."""
QUICK = 3
MOST_ACCUSED = 0.01
"""Share of the scenes with right lenses in which one may be accused."""
SEVERE = 0.8
"""Share of the focal lengths that are off by 15 % and more, and of the pictures cropped by 12 % and more, to be named."""
CODES = ("lens_corrected", "lens_differs", "lens_doubtful")
SPOILT = ("", "", "", "mirrored", "gone")
"""What is the matter with a camera of the scenes with right lenses, by seed; mostly nothing."""
FOUND_SPOILT = ("mirrored", "upside down", "late")
CAMERAS, CAMERA_SHARES = (3, 4, 5, 6, 7, 8), (0.35, 0.35, 0.15, 0.07, 0.04, 0.04)
LATE_S = 12.0


@dataclass(frozen=True)
class WrongLens:
    """How lenses are stated wrongly."""

    part: str
    """"focal", "all focals" or "cropped"."""
    share: float
    """Of the focal length, or of the width: what is cut off is twice that."""

    @property
    def says(self) -> str:
        """As the table names it."""
        what = {
            "focal": "one focal length off by {:.0f} %",
            "all focals": "all focal lengths off by {:.0f} %",
            "cropped": "one principal point off by {:.0f} % of the width",
        }
        return what[self.part].format(100 * self.share)


WRONG: Mapping[str, WrongLens] = MappingProxyType(
    {
        f"{part} {share}": WrongLens(part, share)
        for part, shares in (
            ("focal", (0.05, 0.1, 0.15, 0.2, 0.3)), ("all focals", (0.05, 0.1, 0.15, 0.2, 0.3)), ("cropped", (0.03, 0.06, 0.12))
        )
        for share in shares
    }
)  # fmt: skip


def run(wanted: Wanted) -> Found:
    """All scenes; a few of each kind in a quick run."""

    def some(all_seeds: Sequence[int]) -> Sequence[int]:
        return all_seeds[:QUICK] if wanted.quick else all_seeds

    cases = {f"{name} {seed}": (name, seed) for name in WRONG for seed in some(WRONG_SEEDS)}
    wrong = kept(wanted, "wrong lenses", cases, wrong_lens)
    found = kept(wanted, "right lenses found", {str(seed): seed for seed in some(FOUND_SEEDS)}, right_lenses_found)
    sound = kept(wanted, "right lenses", {str(seed): seed for seed in some(SOUND_SEEDS)}, right_lenses)
    return part_found(_lines(sound | found, wrong), _tables(sound, found, wrong))


def right_lenses(seed: int) -> dict[str, Any]:
    """A scene with right lenses whose identities are given; in some of them a camera is mirrored, or not there."""
    scene, seen = _scene(seed)
    rig, spoilt = scene.rig, SPOILT[seed % len(SPOILT)]
    last = rig.names[-1]
    if spoilt == "mirrored":
        own = seen.cameras[last]
        changed = CameraObservations(_mirrored(own.boxes, rig[last].lens), Keypoints.empty())
        seen = Observations({**seen.cameras, last: changed}, seen.fps)
    elif spoilt == "gone" and len(rig) > 3:
        rig = Rig(rig.cameras[:-1])
        seen = Observations({name: seen.cameras[name] for name in rig.names}, seen.fps)
    return _solved(rig, seen, seed) | {"spoilt": spoilt}


def right_lenses_found(seed: int) -> dict[str, Any]:
    """A scene with right lenses whose identities are found, beside a camera that fits no other."""
    rng, spoilt = np.random.default_rng((seed, 1)), FOUND_SPOILT[seed // len(PRESETS) % len(FOUND_SPOILT)]
    scene = simulate(
        SimulationOptions(
            preset=list(PRESETS)[seed % len(PRESETS)], seed=seed, cameras=4, people=int(rng.integers(5, 9)),
            seconds=float(rng.uniform(25, 40)), box_noise=float(rng.uniform(0.01, 0.03)), missing=0.05, false_boxes=0.03,
            unrelated_ids=True, tracklet_seconds=10.0,
        )
    )  # fmt: skip
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    own, lens = boxes["C2"], scene.rig["C2"].lens
    change: Mapping[str, Callable[[], Boxes]] = {
        "mirrored": lambda: _mirrored(own, lens),
        "upside down": lambda: _upside_down(own, lens),
        "late": lambda: replace(own, frame=own.frame + round(LATE_S * scene.options.fps)),
    }
    handed_in = HandedIn(scene.rig, boxes | {"C2": change[spoilt]()}, scene.rig, scene.options.fps)
    return _named(calibrated(handed_in).diagnostics) | {"spoilt": spoilt}


def wrong_lens(case: tuple[str, int]) -> dict[str, Any]:
    """A scene with a lens stated wrongly: what is named, and whether that is it."""
    name, seed = case
    wrong = WRONG[name]
    scene, seen = _scene(seed)
    rng = np.random.default_rng((seed, 2))
    camera, longer = str(rng.choice(scene.rig.names)), bool(rng.integers(2))
    change = partial(_cropped if wrong.part == "cropped" else _zoomed, share=wrong.share, up=longer)
    all_of_them = wrong.part == "all focals"
    stated = Rig(tuple(replace(c, lens=change(c.lens)) if all_of_them or c.name == camera else c for c in scene.rig))
    out = _solved(stated, seen, seed)
    right = ["principal_point" if wrong.part == "cropped" else "focal", "" if all_of_them else camera]
    return out | {"right": right in out["named"], "only": len(out["named"]) == 1}


def _scene(seed: int) -> tuple[SimulatedScene, Observations]:
    """A scene whose identities are given: boxes, in one of four with keypoints."""
    rng = np.random.default_rng((seed, 0))
    scene = simulate(
        SimulationOptions(
            preset=list(PRESETS)[seed % len(PRESETS)], seed=seed, cameras=int(rng.choice(CAMERAS, p=CAMERA_SHARES)),
            people=int(rng.integers(3, 9)), seconds=float(rng.uniform(10, 25)), box_noise=float(rng.uniform(0.01, 0.04)),
            joint_noise_px=float(rng.uniform(1, 3)), false_boxes=float(rng.uniform(0, 0.1)),
            missing=float(rng.uniform(0, 0.1)),
        )
    )  # fmt: skip
    joints = seed % 4 == 0
    cameras = {
        name: CameraObservations(own.boxes, own.keypoints if joints else Keypoints.empty())
        for name, own in scene.observations.cameras.items()
    }
    return scene, Observations(cameras, scene.observations.fps)


def _solved(stated: Rig, seen: Observations, seed: int) -> dict[str, Any]:
    """What the solver says of the lenses of a rig."""
    blind = Rig(tuple(Camera(camera.name, camera.lens) for camera in stated))
    began = time.process_time()
    try:
        solution = solve_people(blind, seen, ScaleCues(), PeopleOptions(max_joints=3000), rng=np.random.default_rng(seed))
    except EvidenceError:
        return {"named": [], "accepted": False, "seconds": time.process_time() - began}
    assert isinstance(solution, PeopleSolution)
    misread = [one for one in examine_readings(solution, seen, clocks=False) if one.effect > 1]
    result = LensResult("doubt") if misread else examine_lenses(solution)
    found = [one.alternative for one in result.suspects]
    return {
        "named": [[one.code, "" if one.alike else stated.names[one.cameras[0]]] for one in found],
        "accepted": solution.verdict == "accepted" and not found and not misread, "seconds": time.process_time() - began,
    }  # fmt: skip


def _named(findings: Sequence[Finding]) -> dict[str, Any]:
    """The lenses that are named, by code and camera."""
    return {"named": [[item.code, item.cameras[0] if item.cameras else ""] for item in findings if item.code in CODES]}


def _zoomed(lens: Lens, *, share: float, up: bool) -> Lens:
    """Another focal length: longer, or shorter by the same factor."""
    return zoomed(lens, (1 + share) if up else 1 / (1 + share))


def _cropped(lens: Lens, *, share: float, up: bool) -> Lens:
    """Another principal point: off to one side by a share of the width."""
    matrix = np.array(lens.matrix)
    matrix[0, 2] += (share if up else -share) * lens.size[0]
    return replace(lens, matrix=matrix)


def _mirrored(boxes: Boxes, lens: Lens) -> Boxes:
    """Left and right exchanged."""
    ltwh = boxes.ltwh.copy()
    ltwh[:, 0] = lens.size[0] - ltwh[:, 0] - ltwh[:, 2]
    return replace(boxes, ltwh=ltwh)


def _upside_down(boxes: Boxes, lens: Lens) -> Boxes:
    """The picture turned by half a turn."""
    ltwh = _mirrored(boxes, lens).ltwh.copy()
    ltwh[:, 1] = lens.size[1] - ltwh[:, 1] - ltwh[:, 3]
    return replace(boxes, ltwh=ltwh)


def _lines(right: Mapping[str, Mapping[str, Any]], wrong: Mapping[str, Mapping[str, Any]]) -> list[Line]:
    """What goes into the table over all parts."""
    accused = sum(bool(result["named"]) for result in right.values())
    severe = [
        result for key, result in wrong.items()
        if (lens := WRONG[key.rpartition(" ")[0]]).share >= (0.12 if lens.part == "cropped" else 0.15)
    ]  # fmt: skip
    named = sum(result["right"] for result in severe)
    return [
        Line(f"right lenses accused, {len(right)} scenes", f"{accused} ({100 * accused / len(right):.2f} %)",
             f"under {100 * MOST_ACCUSED:.0f} %", accused < MOST_ACCUSED * len(right)),
        Line(f"focal lengths 15 % off or more, and cropped pictures, named, {len(severe)} scenes",
             percent(named, len(severe)), f"{100 * SEVERE:.0f} % or more", named >= SEVERE * len(severe)),
    ]  # fmt: skip


def _tables(
    sound: Mapping[str, Mapping[str, Any]], found: Mapping[str, Mapping[str, Any]], wrong: Mapping[str, Mapping[str, Any]]
) -> dict[str, Table]:
    """How often right lenses are reported, and wrong ones named."""
    kinds = Counter(result["spoilt"] for result in sound.values())
    accused = Counter(result["spoilt"] for result in sound.values() if result["named"])
    right = table(
        ("scenes with right lenses", "scenes", "accused"),
        [
            *([f"identities given{f', a camera {kind}' if kind else ''}", str(count), str(accused[kind])]
              for kind, count in sorted(kinds.items())),
            ["identities found, a camera left out", str(len(found)), str(sum(bool(item["named"]) for item in found.values()))],
        ],
    )  # fmt: skip
    rows = []
    for name, lens in WRONG.items():
        own = [result for key, result in wrong.items() if key.rpartition(" ")[0] == name]
        if own:
            rows.append([
                lens.says, percent(sum(item["right"] for item in own), len(own)),
                percent(sum(item["right"] and item["only"] for item in own), len(own)),
                percent(sum(bool(item["named"]) for item in own), len(own)),
                percent(sum(item["accepted"] for item in own), len(own)),
            ])  # fmt: skip
    head = ("stated wrongly", "named", "and nothing else", "any lens named", "rig accepted, no lens named")
    return {"Right lenses": right, "Wrong lenses": table(head, rows)}
