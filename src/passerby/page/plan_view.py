"""The rig from above, as the page shows and saves it: cameras, their views and sigmas, people, and the plan behind them.

World of the rig: metres, x right and y up in the drawing, ground at z = 0.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Rig
from passerby.core.colours import camera_colour, person_colour
from passerby.interchange.calibration_json import CALIBRATION_FILE, PlanEntry
from passerby.page.plan_pictures import PlanPictures, ShownPlan
from passerby.page.session import Session
from passerby.report.contents import Contents, contents_from
from passerby.report.fitted import FittedTrajectories, fit_people
from passerby.report.rig_geometry import (
    WEDGE_SHARE,
    Stage,
    ellipse,
    ground_covariance,
    magnification,
    semi_axes,
    stage_of,
    thin_parts,
    wedge,
)

MOST_PLACES = 6000
"""Approximate largest number of people's positions that are drawn; of more, every n-th is drawn."""
GEODETIC_ORIGIN = "geodetic_origin"
"""Key in a rig's metadata, if positions in degrees define its world."""


@dataclass(frozen=True, eq=False)
class CameraFromAbove:
    """A camera with a pose."""

    name: str
    colour: str
    centre: Floats
    """(3,) metres."""
    ahead: Floats | None
    """(2,) unit vector of its horizontal viewing direction; None if it looks straight up or down."""
    seen: Floats
    """(N, 2) closed outline of the ground that it sees within `PlanView.reach_m`, metres."""
    covariance: Floats | None
    """(2, 2) covariance of its horizontal position, square metres; None if unknown."""
    is_directed: bool
    """Whether the covariance's directions are known."""
    orientation_sigma_deg: float | None

    @property
    def semi_axes_m(self) -> list[float] | None:
        """Semi-axes of the one-sigma ellipse, the longer first; None if unknown."""
        return None if self.covariance is None else semi_axes(self.covariance)[0].tolist()

    def outline(self, factor: float) -> Floats | None:
        """Return the closed outline (K, 2) of the ellipse at `factor` sigmas; None if the covariance is unknown."""
        return None if self.covariance is None else ellipse(self.centre[:2], self.covariance, factor)


@dataclass(frozen=True, eq=False)
class PersonPath:
    """A stretch of a person's trajectory."""

    identity: int
    colour: str
    begin_s: float
    end_s: float
    xy: Floats
    """(N, 2) positions, metres; N is at least 2."""


@dataclass(frozen=True, eq=False)
class Backdrop:
    """The plan below the drawing."""

    shown: ShownPlan
    entry: PlanEntry

    @property
    def corner(self) -> Floats:
        """(2,) upper left corner, metres."""
        u, v = self.entry.origin
        return np.array([-0.5 - u, v + 0.5]) * self.entry.metres_per_pixel

    @property
    def extent(self) -> Floats:
        """(2,) width and height, metres."""
        return np.array(self.shown.size, dtype=np.float64) * self.entry.metres_per_pixel


@dataclass(frozen=True, eq=False)
class PlanView:
    """All content of the drawing."""

    cameras: tuple[CameraFromAbove, ...]
    paths: tuple[PersonPath, ...]
    backdrop: Backdrop | None
    low: Floats
    """(2,) lowest x and y of the drawn region, metres."""
    high: Floats
    """(2,) highest x and y of the drawn region, metres."""
    spacing: float
    """Distance between the lines of the grid, metres."""
    reach_m: float
    """Length of the drawn fields of view."""
    magnification: int
    """Factor by which ellipses are magnified."""
    missing: tuple[str, ...]
    """Cameras without a pose."""
    notes: tuple[str, ...]
    georeference: Floats | None
    """(3,) latitude, longitude, altitude of the world's origin, degrees and metres; then x is east, y north. None: unknown."""


@dataclass(eq=False)
class PlanViews:
    """The view of a session's rig, which is made again when its files change."""

    session: Session
    pictures: PlanPictures
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _made: tuple[tuple[int, ...], PlanView] | None = None

    def view(self) -> PlanView:
        """Return the view of the rig from above. Raises `InputError` if there is no rig yet, or the folder is broken."""
        with self._lock:
            stamp = tuple(_stamp(self.session.out / name) for name in ("rig.toml", CALIBRATION_FILE))
            if self._made is None or self._made[0] != stamp:
                self._made = stamp, self._view()
            return self._made[1]

    def _view(self) -> PlanView:
        rig, none = self.session.rig(), np.zeros(0, np.int64)
        ways, entry, notes = FittedTrajectories(none, np.zeros(0), np.zeros((0, 2)), none), None, list[str]()
        if (self.session.out / CALIBRATION_FILE).is_file():
            contents = contents_from(self.session.out)
            ways = fit_people(contents).ways
            entry = None if contents.document.world is None else contents.document.world.plan
            backdrop, why = self._backdrop(contents, entry)
        else:
            backdrop, why = None, ""
        notes += [why] if why else []
        return view_of(rig, ways, backdrop, notes)

    def _backdrop(self, contents: Contents, entry: PlanEntry | None) -> tuple[Backdrop | None, str]:
        """Return the plan that defines the rig's world frame, or None and the reason why it is not shown."""
        if entry is None:
            return None, ""
        scene_file = contents.document.scene_file
        folder = self.session.scene_file.parent if scene_file is None else Path(scene_file).parent
        try:
            return Backdrop(self.pictures.shown(folder / entry.image), entry), ""
        except InputError as error:
            return None, f"The plan is not shown: {self.session.public(str(error))}."


def view_of(rig: Rig, ways: FittedTrajectories, backdrop: Backdrop | None, notes: list[str]) -> PlanView:
    """Return the view of a rig and its people, with or without a plan."""
    stage = stage_of(rig, ways.xy)
    low, high = stage.low[:2], stage.high[:2]
    if backdrop is not None:
        low = np.minimum(low, backdrop.corner - (0.0, backdrop.extent[1]))
        high = np.maximum(high, backdrop.corner + (backdrop.extent[0], 0.0))
    cameras = tuple(_camera(camera, place, stage) for place, camera in enumerate(rig) if camera.pose is not None)
    axes = [one.semi_axes_m for one in cameras]
    longest = max((one[0] for one in axes if one is not None), default=0.0)
    return PlanView(
        cameras=cameras, paths=_paths(ways), backdrop=backdrop, low=low, high=high, spacing=stage.spacing,
        reach_m=WEDGE_SHARE * stage.reach, magnification=magnification(longest, stage.extent),
        missing=tuple(camera.name for camera in rig if camera.pose is None), notes=tuple(notes),
        georeference=georeference(rig),
    )  # fmt: skip


def georeference(rig: Rig) -> Floats | None:
    """Return latitude, longitude, altitude (3,) of the world's origin; None if the rig's metadata have no valid ones."""
    try:
        found = np.array([float(one) for one in rig.metadata.get(GEODETIC_ORIGIN, "").split()])
    except ValueError:
        return None
    if len(found) != 3 or not np.isfinite(found).all() or abs(found[0]) > 90 or abs(found[1]) > 180:
        return None
    return found


def _camera(camera: Camera, place: int, stage: Stage) -> CameraFromAbove:
    assert camera.pose is not None
    ahead = np.array(camera.pose.R_cw[2, :2])
    level = float(np.hypot(*ahead))
    known = ground_covariance(camera)
    turn = None if camera.sigma is None else camera.sigma.orientation_deg
    return CameraFromAbove(
        name=camera.name, colour=camera_colour(place), centre=np.array(camera.centre),
        ahead=None if level < 1e-9 else ahead / level, seen=wedge(camera, WEDGE_SHARE * stage.reach),
        covariance=None if known is None else known[0], is_directed=known is not None and known[1],
        orientation_sigma_deg=turn if turn is not None and np.isfinite(turn) else None,
    )  # fmt: skip


def _paths(ways: FittedTrajectories) -> tuple[PersonPath, ...]:
    """Return the stretches of all people's trajectories that have two positions or more."""
    found = []
    for rows in thin_parts(ways, MOST_PLACES):
        if len(rows) < 2:
            continue
        who, seconds = int(ways.identity[rows[0]]), ways.seconds[rows]
        found.append(PersonPath(who, person_colour(who), float(seconds[0]), float(seconds[-1]), ways.xy[rows]))
    return tuple(found)


def _stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
