"""Simulated scenes whose lenses are withheld: varied ones, one model for all, with keypoints, and half of them known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from lenses.outcomes import off_centre_deg, timed_outcome
from passerby.calibration.in_memory import calibrate_observations
from passerby.core.cameras import Lens
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate

FIRST_SEED = 300_000
SECONDS = 60.0
BOX_NOISE, MISSING = 0.02, 0.1
LARGEST_OFFSET_S = 2.0
KEYPOINT_NOISE_PX = 2.0
MODEL = "one model"


@dataclass(frozen=True)
class SimulatedCase:
    """One scene, and what is known of it."""

    preset: str
    seed: int
    identities_known: bool
    """Then the clocks agree; otherwise both are to be found."""
    shared: bool = False
    """All cameras have one lens, and the calibration knows that they do."""
    keypoints: bool = False
    half_known: bool = False
    """Every second camera's lens is stated."""

    @property
    def key(self) -> str:
        """A name within its part."""
        return f"{self.preset} {self.seed} {'identities known' if self.identities_known else 'identities unknown'}"

    @property
    def options(self) -> SimulationOptions:
        """Of the simulation."""
        return SimulationOptions(
            preset=self.preset,
            seed=self.seed,
            seconds=SECONDS,
            box_noise=BOX_NOISE,
            missing=MISSING,
            unrelated_ids=not self.identities_known,
            clock_offsets=0.0 if self.identities_known else LARGEST_OFFSET_S,
            joint_noise_px=KEYPOINT_NOISE_PX if self.keypoints else 0.0,
            lenses="shared" if self.shared else "varied",
        )


def cases(part: str, count: int, known: tuple[bool, ...] = (True, False)) -> dict[str, SimulatedCase]:
    """The cases of a part by key: `count` seeds of each preset, those with known identities, which are quick, first."""
    drawn = [
        SimulatedCase(preset, FIRST_SEED + seed, identities_known, part == "shared", part == "keypoints", part == "mixed")
        for identities_known in known
        for seed in range(count)
        for preset in PRESETS
    ]
    return {case.key: case for case in drawn}


def work(case: SimulatedCase) -> dict[str, Any]:
    """The scene calibrated with the true lenses, then with those of some or all cameras withheld."""
    scene = simulate(case.options)
    withheld = scene.rig.names[1::2] if case.half_known else scene.rig.names
    group = MODEL if case.shared else None
    true = {camera.name: camera.lens for camera in scene.rig}
    stated = true | {name: Lens.unknown(true[name].size, group=group) for name in withheld}
    return {
        "about": {"preset": case.preset, "identities_known": case.identities_known},
        "cameras": len(scene.rig),
        "withheld": list(withheld),
        "off_centre_deg": off_centre_deg(scene.rig, withheld),
        "known": timed_outcome(partial(_calibrate, scene, case, true), scene.rig),
        "estimated": timed_outcome(partial(_calibrate, scene, case, stated), scene.rig, withheld),
    }


def _calibrate(scene: SimulatedScene, case: SimulatedCase, lenses: Mapping[str, Lens]) -> Any:
    """What a user gets who has the boxes (and keypoints) in memory."""
    seen = scene.observations.cameras
    return calibrate_observations(
        lenses,
        {name: camera.boxes for name, camera in seen.items()},
        keypoints={name: camera.keypoints for name, camera in seen.items()} if case.keypoints else None,
        fps=case.options.fps,
        association={"mode": "given" if case.identities_known else "combined"},
    )
