"""Matchers on pictures of real data sets, judged by the sets' own cameras.

The sets are the user's own; none is part of the package, and no picture of one is written into a page.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import tomli_w

from baselines import Matcher, Matches, Picture, Unavailable, open_matcher
from baselines.matching import pooled_points
from paper.pixel_rows import MATCH_SIGMA_PX, NOT_RUN, PixelOutcome, Solved, counted, judged, solved
from paper.pixel_stage import LENGTH_NOISE_PX, marked_length
from passerby.calibration.calibrate import calibrate
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.rig_toml import read_rig

SHRINK = 2  # pictures of 1920 x 1080 are looked at in half their size: networks take four times as long otherwise
WILDTRACK_FPS = 2.0
PIPE_HEIGHTS_M = (1.0, 0.5, 1.5)  # the paper's pipe of 1.0 m, held where all cameras of a room see it


@dataclass(eq=False)
class RealViews:
    """Pictures of still cameras whose poses are known."""

    name: str
    truth: Rig
    paths: tuple[Mapping[str, Path], ...]  # by moment and camera
    length_m: float  # of a line that is taken to be known
    heights_m: tuple[float, ...] = (0.0,)  # where it may be: on the ground, or held above it

    @property
    def reference(self) -> str:
        """The first camera."""
        return self.truth.names[0]

    @cached_property
    def pictures(self) -> list[dict[str, Picture]]:
        """By moment and camera, shrunk. Raises `InputError` for a file that is no picture."""
        return [{name: _read(path) for name, path in moment.items()} for moment in self.paths]


def wildtrack(data: Path) -> RealViews | str:
    """The folder `wildtrack` of the real data, or why it is not there. C7 is left out: it had moved when they were taken."""
    folder = data / "wildtrack"
    if not (folder / "pictures").is_dir() or not (folder / "rig.toml").is_file():
        return f"data not here: {folder.name}/pictures"
    rig = Rig(tuple(camera for camera in read_rig(folder / "rig.toml") if camera.name != "C7"))
    return RealViews("WILDTRACK", rig, ({name: folder / "pictures" / f"{name}.jpg" for name in rig.names},), 3.6)


def panoptic(data: Path, moments: int) -> RealViews | str:
    """The folder `panoptic` of the real data, or why it is not there."""
    from passerby.datasets.panoptic import read

    folder = data / "panoptic" / "demo"
    if not (folder / "camera_parameters.json").is_file():
        return "data not here: panoptic/demo"
    found = read(folder)
    count = min(len(paths) for paths in found.pictures.values())
    paths = tuple({name: found.pictures[name][k] for name in found.rig.names} for k in range(min(moments, count)))
    return RealViews("CMU Panoptic", found.rig, paths, 1.0, PIPE_HEIGHTS_M)


def run_matcher(name: str, views: RealViews) -> PixelOutcome:
    """What a matcher makes of the pictures. A want of weights or of evidence is an outcome too."""
    try:
        found = match_all(open_matcher(name), views)
    except Unavailable as error:
        return PixelOutcome(NOT_RUN, str(error), 0, len(views.truth))
    lenses = Rig(tuple(replace(camera, pose=None) for camera in views.truth))
    length = marked_length(views.truth, views.length_m, LENGTH_NOISE_PX, np.random.default_rng(0), views.heights_m)
    points = pooled_points(lenses, views.reference, found, SHRINK * MATCH_SIGMA_PX)
    total, good = counted(views.truth, found)
    return replace(judged(solved(lenses, points, [length]), views.truth), matches=total, right=good)


BOXES = {"geopose": "boxes of annotated people, GeoPose", "people": "boxes of annotated people, **ours**"}
"""Rows beside the matchers, by the solver's name."""


def run_boxes(method: str, data: Path, truth: Rig) -> PixelOutcome:
    """What people give on WILDTRACK's cameras: the boxes of its annotations, identities given, from other moments."""
    rig = data / "wildtrack" / "rig.toml"
    cameras = {
        name: {"intrinsics": str(rig), "tracks": str(data / "wildtrack" / "identities" / f"{name}.txt")} for name in truth.names
    }
    scene = {
        "scene": {"name": "wildtrack", "fps": WILDTRACK_FPS}, "cameras": cameras, "association": {"mode": "given"},
        "solver": {"method": method, "reference": truth.names[0]},
    }  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="passerby-wildtrack-") as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(tomli_w.dumps(scene))
        result = calibrate(path)
    return judged(Solved(result.rig, result.verdict, next(iter(result.reasons), "")), truth)


def match_all(match: Matcher, views: RealViews) -> list[dict[str, Matches]]:
    """Matches of the reference with every other camera, by moment, in pixels of the whole pictures."""
    return [
        {name: _enlarged(match(seen[views.reference], seen[name])) for name in views.truth.names[1:]} for seen in views.pictures
    ]


def _read(path: Path) -> Picture:
    picture = cv2.imread(str(path))
    if picture is None:
        raise InputError(f"{path}: is no picture that can be read: take it from the data set again")
    small = cv2.resize(picture, None, fx=1 / SHRINK, fy=1 / SHRINK, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _enlarged(matches: Matches) -> Matches:
    """The same places in the whole pictures; pixels are counted from the middle of the first."""
    xy_a, xy_b = ((xy + 0.5) * SHRINK - 0.5 for xy in (matches.xy_a, matches.xy_b))
    return replace(matches, xy_a=xy_a, xy_b=xy_b)
