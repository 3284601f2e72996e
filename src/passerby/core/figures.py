"""Figures of the solver's stages: what `calibration.json` has as `figures`, field by field under the same names.

A field that is None is not known, or does not apply. One whose metadata are `ABSENT` has no key in a file while it is None.
A name that Python reserves ends in an underscore here, and has none in a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from passerby.common.arrays import ABSENT
from passerby.core.lens_figures import LensFigures, LensRefinement
from passerby.core.measuring import MeasuringFigures


@dataclass(frozen=True, kw_only=True)
class LevelFigures:
    """A camera's vertical and ground by its own people."""

    height_m: float
    residual: float | None
    """Median misfit, as a share of the people's height in the picture."""


@dataclass(frozen=True, kw_only=True)
class SolvedCamera:
    """What the adjustment says of a registered camera."""

    name: str
    sightings: int | None = None
    """Of people whom two cameras share;"""
    agreeing: int | None = None
    """those of them that agree with the rig;"""
    joints: int | None = None
    """likewise joints."""
    median_residual_px: float | None = None
    """Of the centres of its boxes."""
    slack: float | None = None
    """Logarithm of how much taller its boxes are than the people."""
    focal_change: float | None = None
    """Logarithm of the factor on a stated focal length that fits people best, all other intrinsics as they are stated, and one
    sigma of it; None where intrinsics were refined or estimated."""
    focal_change_sigma: float | None = None
    shape_position_sigma_mm: float | None = None
    """Sigmas without scale, vertical and ground."""
    shape_orientation_sigma_deg: float | None = None
    own_level: LevelFigures | None = None


@dataclass(frozen=True, kw_only=True)
class PairFigures:
    """A guess of the relative pose of two cameras."""

    cameras: tuple[str, str]
    route: str
    inliers: int
    matches: int
    support: float | None
    """By the ways through other cameras, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class TreeFigures:
    """A start that was tried."""

    tree: str
    agreeing: int
    """Sightings."""
    contradicted: int = 0
    """Registrations of pairs of cameras that the rig contradicts."""


@dataclass(frozen=True, kw_only=True)
class ZoneFigures:
    """A part of a large rig that was solved apart for the first guess."""

    cameras: tuple[str, ...]
    agreeing: int
    """Sightings."""


@dataclass(frozen=True, kw_only=True)
class SeamFigures:
    """Two zones that have cameras in common."""

    zones: tuple[int, int]
    """Their numbers, from 1."""
    cameras: tuple[str, ...]
    """In common."""
    apart_m: float
    """How far apart the first guesses of the two have a common camera at most."""
    turned_deg: float
    """The same of orientations."""
    heading_sigma_deg: float | None
    """One sigma of the turn about the vertical between the two in the adjusted rig."""


@dataclass(frozen=True, kw_only=True)
class AdjustmentRound:
    """One adjustment of all that agrees."""

    sightings: int
    renamed: int
    """Identities."""
    joints: int
    iterations: int
    converged: bool
    cost: float | None


@dataclass(frozen=True, kw_only=True)
class NoiseFigures:
    """The boxes' and joints' errors as they were learnt."""

    floor_px: float
    box_px: float
    centre: float
    """Shares of a person's height in the picture."""
    height: float
    joint: float
    broken_edges: float
    """Share of the edges."""


@dataclass(frozen=True, kw_only=True)
class PeopleFigures:
    """The people that the rig is computed from."""

    identities: int
    instants: int | None = None
    standing: float | None = None
    """Share of the instants."""
    heights_m: Mapping[str, float] = field(default_factory=dict)
    """By identity."""
    unusual: tuple[int, ...] | None = field(default=None, metadata=ABSENT)
    """Identities of those so much taller or shorter than most that the scale does not use them; None if there are none."""


@dataclass(frozen=True, kw_only=True)
class CueFigures:
    """What one cue says of the scale."""

    cue: str
    """`population of N`, `height of person IDENTITY`, `body segments of N people (trunks, ...)`, `walking speed of N`, `width
    of the boxes of N`, or the name of a measured length or of known places."""
    kind: str | None = field(default=None, metadata=ABSENT)
    """population, person, length, distance, camera_height, plan, segments, walking_speed (lengths are metres in a second),
    body_width or world (known places; lengths are the size of the rig); None in files of an older Passerby."""
    count: int | None = field(default=None, metadata=ABSENT)
    """Of the population's people, or of those that the cue was measured on."""
    identity: int | None = field(default=None, metadata=ABSENT)
    """Of the person."""
    stated_m: float
    measured_m: float
    sd_m: float
    residual_sigmas: float
    share: float
    """Of the weight of all cues in the adjustment, 0 to 1; 0 where the cue is only compared with the others."""
    own_scale: float | None = field(default=None, metadata=ABSENT)
    """By this cue alone, all lengths would be so many times as long; None where it tells no scale, and in older files."""
    own_sigma: float | None = field(default=None, metadata=ABSENT)
    """Relative one sigma of `own_scale`."""
    disagrees_with: tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """The cues that this one contradicts; None where it contradicts none."""


@dataclass(frozen=True, kw_only=True)
class ScaleFigures:
    """The uncertainty of all lengths, and what they depend on."""

    relative_sigma: float | None = None
    """None where nothing fixes the scale."""
    cues: tuple[CueFigures, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DistanceFigures:
    """Between two cameras."""

    cameras: tuple[str, str]
    metres: float
    """Before any `[world]` with a scale of its own."""
    sigma_m: float | None
    """With the scale's share."""


@dataclass(frozen=True, kw_only=True)
class ClockCorrection:
    """What the adjustment adds to a camera's clock offset."""

    correction_s: float
    sigma_s: float
    """0 for the camera whose clock is held."""


@dataclass(frozen=True, kw_only=True)
class FittedRate:
    """A camera's frame rate, frames per second."""

    fps: float
    stated: float
    sigma: float


@dataclass(frozen=True, kw_only=True)
class MotionFigures:
    """A camera that stood elsewhere, or had another focal length, for a part of its recording."""

    camera: str
    frames: tuple[int, int]
    """First and last frame of what was left out, of the camera's own;"""
    seconds: tuple[float, float] | None
    """the same in seconds."""
    left_out: Literal["before", "after", "between"]
    metres: float
    degrees: float
    sigmas: float
    """How much better the change predicts people who were held out: the mean gain in its standard errors;"""
    shift: float
    """of people in the picture, as a share of their extent."""
    zoom: float | None = field(default=None, metadata=ABSENT)
    """The focal length during it, in that of the rest; None for a camera that moved and did not zoom."""


@dataclass(frozen=True, kw_only=True)
class DriftFigures:
    """A camera that kept turning during its recording; the rotation was taken out of its observations."""

    camera: str
    degrees: float
    """The largest rotation between two times."""
    pixels: float
    """How far it moves people in the image (median)."""
    minutes: float | None
    """How long the camera was observed; None where the frame rate is not known."""
    steady: bool
    """Whether it turned at one rate all the time."""


@dataclass(frozen=True, kw_only=True)
class GroundFigures:
    """How far the people's ground is from one plane."""

    rise_m: float
    sigma_m: float | None
    low: tuple[float, float]
    """Where it is lowest, x and y in the solver's world,"""
    high: tuple[float, float]
    """and where it is highest."""
    chance_sigmas: float | None
    slope_deg: float | None = field(default=None, metadata=ABSENT)
    """Of the ground below people's own ways, against the world's z; None in files of an older Passerby."""
    slope_sigma_deg: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class UpFigures:
    """What the world's z is in the solver's world, and how far it may be from gravity."""

    direction: str
    """`ground normal`: of the ground that people walk on; or the upright parts of the body, such as `trunks`, where no
    person is seen whole."""
    gravity_sigma_deg: float
    """One sigma of the angle between z and gravity; for a ground normal with the slope that a ground may have."""
    tilt_deg: float | None = field(default=None, metadata=ABSENT)
    """Angle between the ground's normal and people's trunks; None where keypoints do not show them."""
    tilt_sigma_deg: float | None = field(default=None, metadata=ABSENT)
    """One sigma of it, along it."""


@dataclass(frozen=True, kw_only=True)
class ResidualFigures:
    """How far each camera sees people from where the other cameras put them."""

    sightings: int
    median_px: float | None
    """None: people's places lie behind the camera in half of the cases; likewise the others."""
    p90_px: float | None
    median_share: float | None
    """As a share of the person's size in the picture."""
    ground_50_m: float | None
    """Of so many people in a hundred no more than this on the ground."""
    ground_90_m: float | None


@dataclass(frozen=True, kw_only=True)
class HeldOutFigures:
    """A rig that was adjusted without some of the people, compared with these."""

    stretches: int
    """Those with people enough, where there is one."""
    stretch_s: float
    """Length of each of the stretches whose people were held out."""
    held_out: ResidualFigures
    fit: ResidualFigures
    """Of the people who were fitted, by the same rig."""
    least_share: float | None = None
    """`median_share` of the people of that stretch held out which fits best; None where they lie behind the cameras, and in
    files of an older Passerby."""


@dataclass(frozen=True, kw_only=True)
class CheckedLength:
    """A known length that had no part in the calibration, by the finished rig."""

    number: int
    """Of the table `[[scale.checks]]`, from 1."""
    cameras: tuple[str, ...]
    stated_m: float
    measured_m: float | None
    """None where fewer than two of the cameras have a pose, or the marks of an end do not meet."""
    sigma_m: float | None = None
    """One sigma of the difference: of the statement, clicks, cameras and scale. None where nothing fixes the scale."""


@dataclass(frozen=True, kw_only=True)
class SolverFigures:
    """What every method has; by itself, of a solve that came to no rig."""

    clock_rates: Mapping[str, FittedRate] | None = field(default=None, metadata=ABSENT)
    """By camera; None where rates were not refined."""
    moved: tuple[MotionFigures, ...] = ()
    drifts: tuple[DriftFigures, ...] | None = field(default=None, metadata=ABSENT)
    """None where no camera drifts."""
    ground: GroundFigures | None = None
    """None where too few places tell."""
    up: UpFigures | None = field(default=None, metadata=ABSENT)
    """None where the up direction is not known, and in files of an older Passerby."""
    held_out: HeldOutFigures | None = field(default=None, metadata=ABSENT)
    """None where too few people could be held out."""
    checks: tuple[CheckedLength, ...] | None = field(default=None, metadata=ABSENT)
    """None where there are no check lengths."""


@dataclass(frozen=True, kw_only=True)
class AdjustedFigures(SolverFigures):
    """Of the method `people`."""

    cameras: tuple[SolvedCamera, ...] = ()
    """Of the registered cameras."""
    pairs: tuple[PairFigures, ...] = ()
    trees: tuple[TreeFigures, ...] = ()
    tree: str | None = None
    """The one that was taken."""
    zones: tuple[ZoneFigures, ...] | None = field(default=None, metadata=ABSENT)
    """None where the rig was solved as one."""
    seams: tuple[SeamFigures, ...] | None = field(default=None, metadata=ABSENT)
    rounds: tuple[AdjustmentRound, ...] = ()
    noise: NoiseFigures | None = None
    people: PeopleFigures | None = None
    foot_shift: float | None = None
    """How much nearer than the body's axis the visible foot is, as a share of the height."""
    scale: ScaleFigures = field(default_factory=ScaleFigures)
    vertical_sigma_deg: float | None = None
    covariance_inflation: float | None = None
    distances: tuple[DistanceFigures, ...] = ()
    clocks: Mapping[str, ClockCorrection] = field(default_factory=dict)
    """By camera; empty where clocks were not refined."""
    undetermined: tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """What nothing fixes; None where all is fixed."""
    lenses: Mapping[str, LensFigures] = field(default_factory=dict)
    """By camera; empty where no lens was refined."""
    measuring: MeasuringFigures | None = field(default=None, metadata=ABSENT)
    """None where no two cameras see where people walked, or cameras are free to go anywhere."""
    refinement: LensRefinement | None = field(default=None, metadata=ABSENT)
    """None where stated lenses were not to be refined."""


@dataclass(frozen=True, kw_only=True)
class StarScale:
    """What the scale of the method `geopose` depends on."""

    from_: str
    """`person height`, or `known lengths`."""
    factor: float
    relative_sd: float
    height_m: float | None = field(default=None, metadata=ABSENT)
    sightings: int | None = field(default=None, metadata=ABSENT)
    people: int | None = field(default=None, metadata=ABSENT)
    lengths: int | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class StarPair:
    """A camera that was registered with the reference."""

    camera: str
    correspondences: int
    inliers: int
    rms_px: float | None
    parallax_deg: float | None


@dataclass(frozen=True, kw_only=True)
class StarFigures(SolverFigures):
    """Of the method `geopose`."""

    points: str
    """`boxes` or `joints`; `given` for points of any origin."""
    reference: str
    scale: StarScale
    pairs: tuple[StarPair, ...] = ()
    merged_points: int
    pair_disagreement: float | None
    rms_px: float | None
    iterations: int
    converged: bool


def adjusted(figures: SolverFigures) -> AdjustedFigures:
    """The figures of the method `people`; empty ones of another method, or of a solve that came to no rig."""
    return figures if isinstance(figures, AdjustedFigures) else AdjustedFigures()


def heights_of(figures: SolverFigures) -> Mapping[str, float]:
    """By identity, standing heights as the solver has them, metres; empty where it has none."""
    people = adjusted(figures).people
    return {} if people is None else people.heights_m
