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

from baselines import Matches, Picture
from paper.annotations import marked_length, marked_points, named_by_hand
from passerby.common.arrays import Floats
from passerby.common.progress import silent
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.core.scale_cues import KnownLength
from passerby.perception.video import frames
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from passerby.simulation import SimulatedScene, SimulationOptions, simulate

LENGTH_M = 3.6
"""The known length of all rows without people: the paper's free-throw line."""
LENGTH_NOISE_PX, JUDGE_NOISE_PX, ORACLE_NOISE_PX, JOINT_NOISE_PX = 0.5, 0.5, 1.0, 2.0
PRIOR_HEIGHTS_M: Mapping[str, float] = MappingProxyType({"terrace": 1.75})
PRIOR_LENGTHS_M: Mapping[str, float] = MappingProxyType({"basketball": 3.6, "construction": 1.0})
"""What the paper took the scale of each scene from: the height of people, its free-throw line, and a pipe."""
JUDGED, ANNOTATED = 15, 30
"""Correspondences of RPE, as in the paper, and those of the oracle: others, as many as the paper says suffice."""
PERCEPTION = {"detector": "background", "embedder": "auto"}
"""People are found without a network, which is quick; what they look like, by the default network where it is to be had."""
SALT = 4211
"""Keeps the annotator's hand apart from the scene's own random numbers."""


@dataclass(eq=False)
class Stage:
    """One rendered scene and all that its rows share."""

    folder: Path
    options: SimulationOptions
    moments: int
    """How many instants the matchers see."""
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
