"""Figures of the solver's stages: the entry `figures` of `calibration.json`, field by field under the same names.

A field that is None is not known, or does not apply. A field with the metadata `ABSENT` has no key in a file while it is None.
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
    """Vertical and ground of a camera, estimated from its own people alone."""

    height_m: float
    residual: float | None
    """Median misfit, as a share of the people's height in the picture."""


@dataclass(frozen=True, kw_only=True)
class SolvedCamera:
    """Results of the adjustment for a registered camera."""

    name: str
    sightings: int | None = None
    """Sightings of people that two cameras share."""
    agreeing: int | None = None
    """Those of them that agree with the rig."""
    joints: int | None = None
    """Joints that agree with the rig."""
    median_residual_px: float | None = None
    """Median residual of the centres of its boxes."""
    slack: float | None = None
    """Logarithm of the factor by which its boxes are taller than the people."""
    focal_change: float | None = None
    """Logarithm of the factor on a stated focal length that fits people best, with all other intrinsics as stated. The next
    field is its one sigma. None where intrinsics were refined or estimated."""
    focal_change_sigma: float | None = None
    shape_position_sigma_mm: float | None = None
    """Sigmas of position and orientation, without those of scale, vertical and ground."""
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
    """Agreement of the paths through other cameras with it, 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class TreeFigures:
    """A start of the adjustment that was tried."""

    tree: str
    agreeing: int
    """Sightings and joints that agree with the rig."""
    contradicted: int = 0
    """Registrations of pairs of cameras that the rig contradicts."""


@dataclass(frozen=True, kw_only=True)
class ZoneFigures:
    """A part of a large rig that was solved separately for the first guess."""

    cameras: tuple[str, ...]
    agreeing: int
    """Sightings that agree with the rig."""


@dataclass(frozen=True, kw_only=True)
class SeamFigures:
    """The common cameras of two zones."""

    zones: tuple[int, int]
    """Numbers of the zones, from 1."""
    cameras: tuple[str, ...]
    """Cameras that both have."""
    apart_m: float
    """Largest distance between the positions of a common camera in the two first guesses."""
    turned_deg: float
    """Largest angle between its orientations in them."""
    heading_sigma_deg: float | None
    """One sigma of the relative rotation of the two about the vertical in the adjusted rig."""


@dataclass(frozen=True, kw_only=True)
class AdjustmentRound:
    """One adjustment of all evidence that agrees."""

    sightings: int
    renamed: int
    """Number of identities that were changed."""
    joints: int
    iterations: int
    converged: bool
    cost: float | None


@dataclass(frozen=True, kw_only=True)
class NoiseFigures:
    """Errors of boxes and joints, estimated from the data."""

    floor_px: float
    box_px: float
    centre: float
    """As a share of a person's height in the picture; the next two likewise."""
    height: float
    joint: float
    broken_edges: float
    """Share of the boxes' edges."""


@dataclass(frozen=True, kw_only=True)
class PeopleFigures:
    """The people that the rig is computed from."""

    identities: int
    instants: int | None = None
    standing: float | None = None
    """Share of the instants."""
    heights_m: Mapping[str, float] = field(default_factory=dict)
    """Standing heights by identity, metres."""
    unusual: tuple[int, ...] | None = field(default=None, metadata=ABSENT)
    """Identities of people so much taller or shorter than most that the scale does not use them; None if there are none."""


@dataclass(frozen=True, kw_only=True)
class CueFigures:
    """Result of one cue of the scale."""

    cue: str
    """`population of N`, `height of person IDENTITY`, `body segments of N people (trunks, ...)`, `walking speed of N`, `width
    of the boxes of N`, or the name of a measured length or of known places."""
    kind: str | None = field(default=None, metadata=ABSENT)
    """population, person, length, distance, camera_height, plan, segments, walking_speed (lengths are metres in a second),
    body_width or world (known places; lengths are the size of the rig); None in files of an older Passerby."""
    count: int | None = field(default=None, metadata=ABSENT)
    """Number of people in the population, or of those that the cue was measured on."""
    identity: int | None = field(default=None, metadata=ABSENT)
    """Identity of the person."""
    stated_m: float
    measured_m: float
    sd_m: float
    residual_sigmas: float
    share: float
    """Share of the weight of all cues in the adjustment, 0 to 1; 0 where the cue is only compared with the others."""
    own_scale: float | None = field(default=None, metadata=ABSENT)
    """Factor on all lengths if this cue alone were used; None where it gives no scale, and in older files."""
    own_sigma: float | None = field(default=None, metadata=ABSENT)
    """Relative one sigma of `own_scale`."""
    disagrees_with: tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """The cues that this one contradicts; None where it contradicts none."""


@dataclass(frozen=True, kw_only=True)
class ScaleFigures:
    """The uncertainty of all lengths, and the cues that they depend on."""

    relative_sigma: float | None = None
    """Relative one sigma of all lengths; None where no evidence determines the scale."""
    cues: tuple[CueFigures, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DistanceFigures:
    """Distance between two cameras."""

    cameras: tuple[str, str]
    metres: float
    """The distance before any `[world]` with a scale of its own."""
    sigma_m: float | None
    """One sigma, including that of the scale."""


@dataclass(frozen=True, kw_only=True)
class ClockCorrection:
    """Correction of a camera's clock offset by the adjustment."""

    correction_s: float
    sigma_s: float
    """0 for the camera whose clock is held fixed."""


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
    """First and last frame of the part that was left out, in the camera's own numbering."""
    seconds: tuple[float, float] | None
    """The same in seconds."""
    left_out: Literal["before", "after", "between"]
    metres: float
    degrees: float
    sigmas: float
    """Mean gain of the change in the prediction of held-out people, in standard errors of the gain."""
    shift: float
    """Shift of people in the picture, as a share of their extent."""
    zoom: float | None = field(default=None, metadata=ABSENT)
    """Focal length during the change over that of the rest; None for a camera that moved and did not zoom."""


@dataclass(frozen=True, kw_only=True)
class DriftFigures:
    """A camera that kept turning during its recording; the rotation was removed from its observations."""

    camera: str
    degrees: float
    """The largest rotation between two times."""
    pixels: float
    """Median distance by which the rotation moves people in the image."""
    minutes: float | None
    """Time for which the camera was observed; None where the frame rate is not known."""
    steady: bool
    """Whether it turned at a constant rate all the time."""


@dataclass(frozen=True, kw_only=True)
class GroundFigures:
    """Deviation of the people's ground from one plane."""

    rise_m: float
    sigma_m: float | None
    low: tuple[float, float]
    """Its lowest place, x and y in the solver's world."""
    high: tuple[float, float]
    """Its highest place."""
    chance_sigmas: float | None
    slope_deg: float | None = field(default=None, metadata=ABSENT)
    """Slope of the ground below people's own trajectories, against the world's z; None in files of an older Passerby."""
    slope_sigma_deg: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True, kw_only=True)
class UpFigures:
    """Direction that the world's z stands for in the solver's world, and its uncertainty relative to gravity."""

    direction: str
    """`ground normal`: that of the ground that people walk on; or the upright parts of the body, such as `trunks`, where no
    person is seen whole."""
    gravity_sigma_deg: float
    """One sigma of the angle between z and gravity. For a ground normal it includes the slope that a ground may have."""
    tilt_deg: float | None = field(default=None, metadata=ABSENT)
    """Angle between the ground's normal and people's trunks; None where keypoints do not show them."""
    tilt_sigma_deg: float | None = field(default=None, metadata=ABSENT)
    """One sigma of `tilt_deg`, in its own direction."""


@dataclass(frozen=True, kw_only=True)
class ResidualFigures:
    """Residuals of the people in each camera against their positions from the other cameras."""

    sightings: int
    median_px: float | None
    """None where people's positions lie behind the camera in half of the cases; likewise the others."""
    p90_px: float | None
    median_share: float | None
    """Median of the residual as a share of the person's size in the picture."""
    ground_50_m: float | None
    """Half of the people are no farther than this from their positions on the ground; the next field is the same for 90 %."""
    ground_90_m: float | None


@dataclass(frozen=True, kw_only=True)
class HeldOutFigures:
    """Residuals of people who were held out, in a rig that was adjusted without them."""

    stretches: int
    """Number of stretches with enough people; of all held-out stretches where none has enough."""
    stretch_s: float
    """Length of each of the stretches whose people were held out."""
    held_out: ResidualFigures
    fit: ResidualFigures
    """Residuals of the people who were fitted, with the same rig."""
    least_share: float | None = None
    """`median_share` of the held-out people in the stretch that fits best; None where they lie behind the cameras, and in files
    of an older Passerby."""


@dataclass(frozen=True, kw_only=True)
class CheckedLength:
    """A known length that was not used in the calibration, measured with the finished rig."""

    number: int
    """Number of the table `[[scale.checks]]`, from 1."""
    cameras: tuple[str, ...]
    stated_m: float
    measured_m: float | None
    """None where fewer than two of the cameras have a pose, or the marks of an end do not meet."""
    sigma_m: float | None = None
    """One sigma of the difference, from the statement, clicks, cameras and scale. None where no evidence fixes the scale."""


@dataclass(frozen=True, kw_only=True)
class SolverFigures:
    """Figures of every method; for a solve without a resulting rig, only these."""

    clock_rates: Mapping[str, FittedRate] | None = field(default=None, metadata=ABSENT)
    """By camera; None where rates were not refined."""
    moved: tuple[MotionFigures, ...] = ()
    drifts: tuple[DriftFigures, ...] | None = field(default=None, metadata=ABSENT)
    """None where no camera drifts."""
    ground: GroundFigures | None = None
    """None where there are too few places."""
    up: UpFigures | None = field(default=None, metadata=ABSENT)
    """None where the up direction is not known, and in files of an older Passerby."""
    held_out: HeldOutFigures | None = field(default=None, metadata=ABSENT)
    """None where too few people could be held out."""
    checks: tuple[CheckedLength, ...] | None = field(default=None, metadata=ABSENT)
    """None where there are no check lengths."""


@dataclass(frozen=True, kw_only=True)
class AdjustedFigures(SolverFigures):
    """Figures of the method `people`."""

    cameras: tuple[SolvedCamera, ...] = ()
    """The registered cameras."""
    pairs: tuple[PairFigures, ...] = ()
    trees: tuple[TreeFigures, ...] = ()
    tree: str | None = None
    """The start that was used."""
    zones: tuple[ZoneFigures, ...] | None = field(default=None, metadata=ABSENT)
    """None where the rig was solved as one."""
    seams: tuple[SeamFigures, ...] | None = field(default=None, metadata=ABSENT)
    rounds: tuple[AdjustmentRound, ...] = ()
    noise: NoiseFigures | None = None
    people: PeopleFigures | None = None
    foot_shift: float | None = None
    """Distance by which the visible foot is nearer than the body's axis, as a share of the height."""
    scale: ScaleFigures = field(default_factory=ScaleFigures)
    vertical_sigma_deg: float | None = None
    covariance_inflation: float | None = None
    distances: tuple[DistanceFigures, ...] = ()
    clocks: Mapping[str, ClockCorrection] = field(default_factory=dict)
    """By camera; empty where clocks were not refined."""
    undetermined: tuple[str, ...] | None = field(default=None, metadata=ABSENT)
    """Parts that no evidence determines; None where all are determined."""
    lenses: Mapping[str, LensFigures] = field(default_factory=dict)
    """By camera; empty where no lens was refined."""
    measuring: MeasuringFigures | None = field(default=None, metadata=ABSENT)
    """None where no two cameras see the places where people walked, or where a camera is undetermined."""
    refinement: LensRefinement | None = field(default=None, metadata=ABSENT)
    """None where stated lenses were not to be refined."""


@dataclass(frozen=True, kw_only=True)
class StarScale:
    """The basis of the scale in the method `geopose`."""

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
    """Figures of the method `geopose`."""

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
    """Return the figures of the method `people`; empty ones for another method, or for a solve without a resulting rig."""
    return figures if isinstance(figures, AdjustedFigures) else AdjustedFigures()


def heights_of(figures: SolverFigures) -> Mapping[str, float]:
    """Return standing heights by identity, as the solver estimated them, metres; empty where it has none."""
    people = adjusted(figures).people
    return {} if people is None else people.heights_m
