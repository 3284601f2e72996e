"""One rendered scene, and all that the rows of Tables 1 and 2 share of it: its views, its marks, the people found in it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from baselines import Matches, Picture
from metrics.detections import paired
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.progress import silent
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import BODY_17, UNKNOWN, Boxes
from passerby.core.scale_cues import KnownLength
from passerby.perception.video import frames
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

MARKED = ("ground", "nose", "left_shoulder", "right_hip", "left_ankle", "ground", "right_wrist", "right_ankle")
"""In turn: the ground between the feet, and joints. A point is marked where the person's box is seen."""
BORDER_PX = 3.0
SAME_PERSON_IOU = 0.5
NEAR_M, STEP_M = 12.0, 0.5  # a known length is looked for this far around the place that the cameras look at, and so finely


def marked_points(scene: SimulatedScene, count: int, noise_px: float, rng: np.random.Generator) -> dict[str, Floats]:
    """Points of people and of the ground below them, as marked in all views that show them.

    Those that most cameras see are taken first, by lot among equals, each of another person or instant; the first camera sees
    all of them, since it is the reference.

    Returns camera -> (count, 2) pixels, NaN where a point is not seen.
    """
    seen = np.stack([_visible(scene, name) for name in scene.rig.names], axis=-1)
    frame, person = np.nonzero(seen.sum(axis=-1) >= 2)
    chance = rng.uniform(size=len(frame))
    views = np.where(seen[frame, person, 0], seen[frame, person].sum(axis=-1), 0)
    chosen = np.lexsort((chance, -views))[:count]
    frame, person = frame[chosen], person[chosen]
    places = np.stack(
        [
            _place(scene, MARKED[k % len(MARKED)], f, p)
            for k, (f, p) in enumerate(zip(frame.tolist(), person.tolist(), strict=True))
        ]
    )
    marks = {}
    for index, camera in enumerate(scene.rig):
        pixels = camera.project(places) + noise_px * rng.standard_normal((len(places), 2))
        marks[camera.name] = np.where((seen[frame, person, index] & _inside(camera, pixels))[:, None], pixels, np.nan)
    return marks


def _visible(scene: SimulatedScene, camera: str) -> NDArray[np.bool_]:
    """(T, P) who has a box in this camera, and so is not hidden by more than half."""
    boxes = scene.truth[camera]
    seen = np.zeros((len(scene.frames), len(scene.identities)), dtype=bool)
    seen[np.searchsorted(scene.frames, boxes.frame), np.searchsorted(scene.identities, boxes.identity)] = True
    return seen


def _place(scene: SimulatedScene, what: str, frame: int, person: int) -> Floats:
    """(3,) world, metres."""
    if what == "ground":
        return np.array([*scene.ground_positions[frame, person], 0.0])
    return np.asarray(scene.joints3d[frame, person, BODY_17.index(what)])


def marked_length(
    rig: Rig, metres: float, noise_px: float, rng: np.random.Generator, heights_m: tuple[float, ...] = (0.0,)
) -> KnownLength:
    """A level line of known length, marked in as many views as can see one.

    Raises `InputError`: no such line lies in the first camera's view and in another's.
    """
    middle = _looked_at(rig)
    steps = np.arange(-NEAR_M, NEAR_M + STEP_M, STEP_M)
    x, y, turn, z = (part.ravel() for part in np.meshgrid(steps, steps, np.radians([0, 45, 90, 135]), heights_m, indexing="ij"))
    near = np.argsort(np.hypot(x, y), kind="stable")
    centre = np.column_stack([x, y, z])[near] + [*middle, 0.0]
    half = metres / 2 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])[near]
    lines = np.stack([centre - half, centre + half], axis=1)
    seen = np.stack([_inside(camera, camera.project(lines.reshape(-1, 3))).reshape(-1, 2).all(axis=1) for camera in rig])
    best = int(np.argmax(np.where(seen[0], seen.sum(axis=0), 0)))
    if not seen[0, best] or seen[:, best].sum() < 2:
        raise InputError(f"no line of {metres:g} m lies in the views of {rig.names[0]} and of another camera")
    marks = {
        camera.name: camera.project(lines[best]) + noise_px * rng.standard_normal((2, 2))
        for camera, sees in zip(rig, seen[:, best], strict=True)
        if sees
    }
    # A pixel's noise at either end is no more than a few thousandths of the line: the weight matters to nobody, it is alone.
    return KnownLength(metres, 0.01 * metres, marks)


def _looked_at(rig: Rig) -> Floats:
    """(2,) where the ground lies nearest to all optical axes, world, metres."""
    normal, right = np.zeros((2, 2)), np.zeros(2)
    for camera in rig:
        assert camera.pose is not None
        axis = camera.pose.R_cw[2, :2] / np.linalg.norm(camera.pose.R_cw[2, :2])
        across = np.eye(2) - np.outer(axis, axis)
        normal += across
        right += across @ camera.centre[:2]
    return np.asarray(np.linalg.lstsq(normal, right)[0])


def _inside(camera: Camera, pixels: Floats) -> NDArray[np.bool_]:
    """(N,) which pixels lie inside the picture, and where its lens has rays."""
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((pixels > BORDER_PX) & (pixels < np.array(camera.lens.size) - BORDER_PX)).all(axis=1))
    inside[inside] = np.isfinite(camera.lens.bearings(pixels[inside])).all(axis=1)
    return inside


def named_by_hand(found: Mapping[str, Boxes], truth: Mapping[str, Boxes]) -> dict[str, Boxes]:
    """Boxes that a detector found, with the identities that somebody who knows the people would give them.

    A box gets the identity of the true box that it stands for, -1 where it stands for none.
    """
    named = {}
    for name, boxes in found.items():
        boxes, true = (some.take(np.argsort(some.frame, kind="stable")) for some in (boxes, truth[name]))
        rows, columns = paired(true, boxes, SAME_PERSON_IOU)
        identity = np.full(len(boxes), UNKNOWN)
        identity[columns] = true.identity[rows]
        named[name] = replace(boxes, identity=identity)
    return named


LENGTH_M = 3.6  # the known length of all rows without people: the paper's free-throw line
LENGTH_NOISE_PX, JUDGE_NOISE_PX, ORACLE_NOISE_PX, JOINT_NOISE_PX = 0.5, 0.5, 1.0, 2.0
PRIOR_HEIGHTS_M: Mapping[str, float] = MappingProxyType({"terrace": 1.75})
PRIOR_LENGTHS_M: Mapping[str, float] = MappingProxyType({"basketball": 3.6, "construction": 1.0})
"""What the paper took the scale of each scene from: the height of people, its free-throw line, and a pipe."""
JUDGED, ANNOTATED = 15, 30
"""Correspondences of RPE, as in the paper, and those of the oracle: others, as many as the paper says suffice."""
PERCEPTION = {"detector": "background", "embedder": "auto"}
"""People are found without a network, which is quick; what they look like, by the default network where it is to be had."""
SALT = 4211  # keeps the annotator's hand apart from the scene's own random numbers


@dataclass(eq=False)
class Stage:
    """One rendered scene and all that its rows share."""

    folder: Path
    options: SimulationOptions
    moments: int  # how many instants the matchers see
    scratch: Path
    found_matches: dict[str, list[dict[str, Matches]]] = field(default_factory=dict)
    """What each matcher found, by moment and camera, for the pictures of the page."""

    @cached_property
    def truth(self) -> SimulatedScene:
        """The scene, with joints as a network might find them."""
        return simulate(replace(self.options, unrelated_ids=True, joint_noise_px=JOINT_NOISE_PX))

    @cached_property
    def rig(self) -> Rig:
        """What is known before: lenses, no poses."""
        return Rig(tuple(replace(camera, pose=None) for camera in self.truth.rig))

    @property
    def reference(self) -> str:
        """The paper's camera 0."""
        return self.rig.names[0]

    @cached_property
    def instants(self) -> list[int]:
        """Frame numbers that the matchers see, spread over the scene."""
        n = self.options.n_frames
        return [round(n * (2 * k + 1) / (2 * self.moments)) for k in range(self.moments)]

    @cached_property
    def pictures(self) -> list[dict[str, Picture]]:
        """The views at these instants, by camera."""
        views: list[dict[str, Picture]] = [{} for _ in self.instants]
        for name in self.rig.names:
            for frame in frames(self.folder / "videos" / f"{name}.mp4"):
                if frame.number in self.instants:
                    views[self.instants.index(frame.number)][name] = frame.picture
        return views

    def generator(self, use: int) -> np.random.Generator:
        """Of the annotator's hand, or of RANSAC."""
        return np.random.default_rng((SALT, self.options.seed, use))

    @cached_property
    def length(self) -> KnownLength:
        """Marked in the views."""
        return marked_length(self.truth.rig, LENGTH_M, LENGTH_NOISE_PX, self.generator(0))

    @property
    def prior_knowledge(self) -> dict[str, Any]:
        """What the paper knew of this scene's scale, as the table `[scale]`; ends of a length marked to `ORACLE_NOISE_PX`."""
        preset = self.options.preset
        known: dict[str, Any] = {}
        if preset in PRIOR_HEIGHTS_M:
            known["person_height_m"] = PRIOR_HEIGHTS_M[preset]
        if preset in PRIOR_LENGTHS_M:
            metres = PRIOR_LENGTHS_M[preset]
            length = marked_length(self.truth.rig, metres, ORACLE_NOISE_PX, self.generator(3))
            known["lengths"] = [{"metres": metres, "points": {name: ends.tolist() for name, ends in length.points.items()}}]
        return known

    @cached_property
    def judged(self) -> dict[str, Floats]:
        """The correspondences of RPE."""
        return marked_points(self.truth, JUDGED, JUDGE_NOISE_PX, self.generator(1))

    @cached_property
    def seen(self) -> Path:
        """Where what was found in the videos is kept, for all rows."""
        return self.scratch / "seen"

    @cached_property
    def found(self) -> dict[str, Boxes]:
        """The boxes that the detector found in the videos."""
        inputs = read_inputs(Scene.load(self.scene("found", {})), SceneVideoProcessor(self.seen, None, silent))
        return {name: seen.boxes for name, seen in inputs.observations.cameras.items()}

    @cached_property
    def by_hand(self) -> dict[str, Boxes]:
        """The same boxes, named."""
        return named_by_hand(self.found, self.truth.truth)

    def scene(self, name: str, tables: Mapping[str, Any], sightings: Mapping[str, dict[str, str]] | None = None) -> Path:
        """Write a scene file of the videos, or of other sightings by camera, with tables of its own."""
        content = tomllib.loads((self.folder / "scene.toml").read_text())
        for camera, table in content["cameras"].items():
            seen = {"video": str(self.folder / table["video"])} if sightings is None else sightings[camera]
            content["cameras"][camera] = {"intrinsics": str(self.folder / table["intrinsics"]), **seen}
        if sightings is None:
            content["perception"] = PERCEPTION
        else:
            content["scene"]["fps"] = float(self.options.fps)
        for table, chosen in tables.items():
            content[table] = content.get(table, {}) | chosen
        path = self.scratch / f"{name}.toml"
        path.write_text(tomli_w.dumps(content))
        return path
