"""The three scenes that can be simulated: stand-ins for those of the paper (Xu et al., CVPR 2021, section 5).

An activity is a range for each quantity, drawn anew for every episode; a preset is a mix of activities in an area.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

Range = tuple[float, float]

ZERO: Range = (0.0, 0.0)


@dataclass(frozen=True)
class Activity:
    """What a person does for a while; every pair is the range from which an episode's value is drawn."""

    name: str
    share: float
    """Share of a person's time, relative to the other activities of the preset."""
    seconds: Range
    """Length of an episode."""
    speed: Range = ZERO
    """Metres per second along the path."""
    crouch: Range = ZERO
    """0 stands, 1 squats with the hips at a fifth of the body height."""
    lean: Range = ZERO
    """Forward lean of the trunk, radians."""
    seat: Range = ZERO
    """0 keeps the hips above the feet, 1 moves them behind the feet as on a chair."""
    raised: Range = ZERO
    """0 lets the right arm hang, 1 stretches it overhead."""
    both_arms: bool = False
    """Raise the left arm as well."""
    carry: Range = ZERO
    """1 holds a load in front of the body with both arms."""
    jump: Range = ZERO
    """Height of the jumps, metres; one jump about every two seconds."""


@dataclass(frozen=True)
class Preset:
    """Area, cameras and people of a scene."""

    area_m: tuple[float, float]
    """Extent along x and y, centred on the world's origin."""
    cameras: int
    camera_height_m: float
    standoff_m: float
    """How far outside the area the cameras stand."""
    picture: tuple[int, int]
    """(width, height), pixels."""
    people: int
    entering: float
    """Share of the people who come in after the start."""
    activities: tuple[Activity, ...]


_STAND = Activity("stand", 0.15, (1.5, 4.0))
_WALK = Activity("walk", 0.85, (5.0, 15.0), speed=(0.8, 1.6))

PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "terrace": Preset(
            area_m=(7.0, 11.0),
            cameras=4,
            camera_height_m=2.0,
            standoff_m=1.5,
            picture=(720, 576),
            people=7,
            entering=0.3,
            activities=(_WALK, _STAND),
        ),
        "basketball": Preset(
            area_m=(17.5, 22.0),
            cameras=4,
            camera_height_m=2.0,
            standoff_m=2.0,
            picture=(720, 576),
            people=14,
            entering=0.0,
            activities=(
                Activity("run", 0.40, (2.0, 5.0), speed=(2.0, 4.0)),
                Activity("walk", 0.20, (2.0, 6.0), speed=(0.8, 1.6)),
                Activity("stand", 0.10, (1.0, 3.0)),
                Activity("jump", 0.08, (2.0, 4.0), raised=(0.5, 1.0), both_arms=True, jump=(0.25, 0.5)),
                Activity("shoot", 0.10, (2.0, 3.0), raised=(0.8, 1.0), jump=(0.1, 0.35)),
                Activity("crouch", 0.12, (1.5, 4.0), crouch=(0.3, 0.6), lean=(0.2, 0.6)),
            ),
        ),
        "construction": Preset(
            area_m=(22.0, 28.0),
            cameras=4,
            camera_height_m=3.0,
            standoff_m=2.0,
            picture=(1352, 760),
            people=20,
            entering=0.1,
            activities=(
                Activity("stand", 0.20, (2.0, 6.0)),
                Activity("walk", 0.30, (4.0, 12.0), speed=(0.8, 1.5)),
                Activity("carry", 0.15, (4.0, 10.0), speed=(0.7, 1.2), lean=(0.0, 0.15), carry=(0.8, 1.0)),
                Activity("squat", 0.20, (3.0, 10.0), crouch=(0.6, 1.0), lean=(0.4, 0.8)),
                Activity("bend", 0.10, (2.0, 5.0), crouch=(0.1, 0.4), lean=(0.7, 1.2)),
                Activity("sit", 0.05, (5.0, 10.0), crouch=(0.7, 0.85), lean=(0.0, 0.3), seat=(1.0, 1.0)),
            ),
        ),
    }
)
"""The presets by name: terrace (80 m2), basketball (350 m2), construction (600 m2)."""
