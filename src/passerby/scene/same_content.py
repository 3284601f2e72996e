"""Test whether two cameras show the same images: one file under two names, a sub-stream, a second encoding, a later copy.

Such a pair fits perfectly at any pose, and distorts the rig. The rows show it: converted to one time and to one scale, the
boxes of the first are those of the second, frame by frame. Two cameras that stand side by side also see the same people. But
they see each person shifted by a share of the height in the picture (the baseline over the person's height), at any place.
"""

from __future__ import annotations

import hashlib
import os
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations, extents_of
from passerby.findings.finding import Finding, doubt
from passerby.geometry.groups import NORMAL_BY_MAD
from passerby.perception.kept import fingerprint
from passerby.perception.video import VideoInfo
from passerby.scene.camera_input import CameraInput
from passerby.scene.content_matching import MIN_FRAMES, BinnedBoxes, Overlap, PictureMap, SharedBoxes, likely_lags
from passerby.scene.scene import Scene

MIN_MATCHES = 60
"""Minimum number of boxes that agree; fewer are no evidence."""
MOST_FRAMES = 150
"""Maximum number of frames that are compared, at even steps."""
FIRST_FRAMES, FIRST_BOXES, FIRST_MARGIN = 30, 150, 0.7
"""Number of frames that are compared first. If each of the two cameras has this many boxes in them, and the match does not
reach even this share of the limits for the same content, the cameras show different people. This test saves most of the time
with many cameras, which have many pairs."""
LEAST_SHARE = 0.6
"""Minimum share of the boxes of one of the two cameras that are found in the other."""
SAME_NUMBERS = 0.004
"""Maximum difference of the edges of matched boxes, as a share of the height, for copied rows: rounding to whole pixels
causes it."""
SAME_PICTURE = 0.07
"""The same limit for people who were detected twice in the same pictures, by detectors of 4 % noise."""
LOOSELY_SAME = 0.12
"""The same limit for poorer detectors: it is sufficient only if the rig puts both cameras at one place."""
ONE_PLACE, ONE_VIEW_DEG = 0.05, 5.0
"""Limits for two cameras at one place with one view: their distance over that of the people they see, and the angle between
their views."""
SHIFT = 0.03
"""Maximum shift between the corners of the same picture, as a share of its size: encoders cut off rows and columns."""
BASELINE, BASELINE_SIGMA = 0.02, 0.007
"""A shift of people by this share of their height in the picture indicates a second camera, 3.5 cm away. The second value is
the maximum standard deviation of the shift."""
NEARER, NEARER_SIGMA = 0.03, 0.01
"""Change of the boxes' size ratio from people far away to people at half the distance, and its maximum standard deviation:
the change of a camera that is 0.3 m nearer to people who are 10 m away."""
FEWEST_ROWS = 10
"""Minimum rows of files that are compared. Fewer may be equal by chance: a detector may find the same false person in the
first, empty images of two cameras."""


@dataclass(frozen=True)
class SameContent:
    """Two cameras that show the same images."""

    first: str
    second: str
    share: float
    """Share of the boxes of one of the two that are in the other."""
    scale: float
    """Ratio of the second's pixels to the first's."""
    later: float
    """Delay of the second behind the first: seconds, or frames if no frame rate is known."""
    timed: bool

    @property
    def finding(self) -> Finding:
        """The doubt that reports this pair."""
        values = {"share": self.share, "scale": self.scale, "later": self.later, "timed": self.timed}
        return doubt("same_recording", self.first, self.second, **values)


@dataclass(frozen=True, eq=False)
class _Shown:
    """The boxes of one camera, with their times."""

    frame: Ints
    """(N,) frame numbers in order."""
    extent: Floats
    """(N, 4) left, top, right, bottom, pixels."""
    size: tuple[int, int]
    seconds: Floats
    """(N,) times by the camera's own clock; frames if no rate is known."""
    step: float
    """Median time between frames with people, in the same unit."""


def find_same_contents(
    rig: Rig, observations: Observations, *, sure: bool = True, pairs: Collection[tuple[str, str]] | None = None
) -> list[SameContent]:
    """Find the pairs of cameras that show the same images.

    Args:
        rig: the cameras, for the sizes of their pictures.
        observations: boxes and keypoints, in frames of each camera; clocks give the frame rates.
        sure: True: only pairs with well constrained, equal content count. False: also pairs that may show the same images
            within the uncertainty.
        pairs: the pairs of cameras that are compared; None: all.
    """
    rates = {name: clock.fps for name, clock in observations.clocks.items()}
    shown = {
        camera.name: one
        for camera in rig
        if (one := _collect_boxes(observations[camera.name], camera.lens.size, rates.get(camera.name) or observations.fps))
        is not None
    }
    timed = bool(rates) or observations.fps is not None
    binned = _Binned()
    found = []
    for first, second in combinations(shown, 2) if pairs is None else pairs:
        if first not in shown or second not in shown:
            continue
        pair = _compare(shown[first], shown[second], binned, sure)
        if pair is not None:
            found.append(SameContent(first, second, pair.share, float(np.sqrt(pair.map.scale.prod())), pair.later, timed))
    return found


def doubts_of_same_content(
    rig: Rig, observations: Observations, pairs: Collection[tuple[str, str]] | None = None
) -> list[Finding]:
    """Return a doubt for each pair of cameras that show the same images, of the given pairs or of all."""
    return [pair.finding for pair in find_same_contents(rig, observations, pairs=pairs)]


def doubts_of_same_place(rig: Rig, observations: Observations) -> list[Finding]:
    """Return a doubt for each pair of cameras at one place, with one viewing direction, that people do not distinguish.

    Two cameras side by side are no reason for a doubt: their images differ. Pairs known to show the same images are left out.

    Args:
        rig: cameras with poses, metres.
        observations: boxes and keypoints, in frames of each camera.
    """
    posed = [camera for camera in rig if camera.pose is not None]
    out = []
    for one, other in combinations(posed, 2):
        assert one.pose is not None
        assert other.pose is not None
        between = float(np.degrees(np.arccos(np.clip(one.pose.R_cw[2] @ other.pose.R_cw[2], -1.0, 1.0))))
        apart = float(np.linalg.norm(one.pose.centre - other.pose.centre))
        if between > ONE_VIEW_DEG or apart > ONE_PLACE * max(_reach(rig, camera.name) for camera in (one, other)):
            continue
        pair = Rig((one, other))
        if find_same_contents(pair, observations) or not find_same_contents(pair, observations, sure=False):
            continue
        out.append(doubt("same_place", one.name, other.name, distance_m=apart))
    return out


def _reach(rig: Rig, name: str) -> float:
    """Compute the distance from a camera to the farthest other one, metres: about the distance to the people between them."""
    at = rig[name].pose
    assert at is not None
    return max(float(np.linalg.norm(camera.pose.centre - at.centre)) for camera in rig if camera.pose is not None)


def _collect_boxes(seen: CameraObservations, size: tuple[int, int], fps: float | None) -> _Shown | None:
    part = seen.boxes if len(seen.boxes) else seen.keypoints
    extent = extents_of(part)
    order = np.argsort(part.frame, kind="stable")
    order = order[(extent[order, 2:] > extent[order, :2]).all(axis=1)]
    frames = np.unique(part.frame[order])
    if len(frames) < MIN_FRAMES:
        return None
    rate = fps or 1.0
    frame = np.asarray(part.frame[order])
    return _Shown(frame, extent[order], size, (frame - 1) / rate, float(np.median(np.diff(frames))) / rate)


@dataclass(frozen=True, eq=False)
class _Pair:
    share: float
    map: PictureMap
    later: float


@dataclass(frozen=True, eq=False)
class _Binned:
    """The boxes of each camera by steps of a common time, as last binned: usually the next pair has the same time."""

    last: dict[int, tuple[float, float, BinnedBoxes]] = field(default_factory=dict)

    def of(self, shown: _Shown, start: float, step: float) -> BinnedBoxes:
        """Return the boxes by steps of `step` from `start`, both in seconds."""
        last = self.last.get(id(shown))
        if last is None or last[:2] != (start, step):
            last = start, step, BinnedBoxes.of(shown.seconds, shown.frame, shown.extent, start, step)
            self.last[id(shown)] = last
        return last[2]


def _compare(first: _Shown, second: _Shown, binned: _Binned, sure: bool) -> _Pair | None:
    """Find the time shift and the map at which two cameras show the same images; None if they do not."""
    step = max(first.step, second.step)
    start = min(first.seconds[0], second.seconds[0])
    a, b = binned.of(first, start, step), binned.of(second, start, step)
    aspects = np.array([1.0, second.size[1] / first.size[1] / (second.size[0] / first.size[0])])
    for lag in likely_lags(a, b):
        overlap = Overlap(a, b, lag)
        if len(overlap.steps) < MIN_FRAMES:
            continue
        for begin in _propose_maps(first, second, overlap):
            found = _match_boxes(overlap, begin, second.size, aspects, sure)
            if found is not None:
                return _Pair(found[0], found[1], lag * step)
    return None


def _propose_maps(first: _Shown, second: _Shown, overlap: Overlap) -> Iterator[PictureMap]:
    """Yield initial maps: by the sizes of the pictures, by equal pixels, and by equal spreads of the boxes."""
    none = np.zeros(2)
    yield PictureMap(np.array(second.size) / np.array(first.size), none)
    if first.size != second.size:
        yield PictureMap(np.ones(2), none)
    if (by_spread := overlap.map_of_spread()) is not None:
        yield by_spread


def _match_boxes(
    overlap: Overlap, begin: PictureMap, size: tuple[int, int], aspects: Floats, sure: bool
) -> tuple[float, PictureMap] | None:
    """Compute the share of boxes that are also in the other camera, and the map between them; None if they are not the same."""
    if len(overlap.steps) > 2 * FIRST_FRAMES and _shows_others(overlap.boxes(FIRST_FRAMES), begin, sure):
        return None
    fit = overlap.boxes(MOST_FRAMES).fit(begin, MIN_MATCHES)
    if fit is None:
        return None
    shares = fit.shares
    if max(shares) < LEAST_SHARE or min(shares) < 0.5 * LEAST_SHARE or fit.off > (SAME_PICTURE if sure else LOOSELY_SAME):
        return None
    alike = _share_corner(fit.map, size) and _share_place(fit.mine, fit.theirs, aspects, sure)
    return (max(shares), fit.map) if fit.off <= SAME_NUMBERS or alike else None


def _shows_others(shared: SharedBoxes, begin: PictureMap, sure: bool) -> bool:
    """Return whether a few frames with many boxes show clearly that the two cameras see different people."""
    if min(shared.count_a, shared.count_b) < FIRST_BOXES:
        return False
    fit = shared.fit(begin, 2)
    if fit is None:
        return True
    least, most = FIRST_MARGIN * LEAST_SHARE, (SAME_PICTURE if sure else LOOSELY_SAME) / FIRST_MARGIN
    return max(fit.shares) < least or min(fit.shares) < 0.5 * least or fit.off > most


def _share_corner(change: PictureMap, size: tuple[int, int]) -> bool:
    """Return whether the corners of the two pictures coincide, and neither picture is strongly stretched along one axis."""
    drawn = float(change.scale[0] / change.scale[1])
    return bool((np.abs(change.shift) <= SHIFT * np.array(size)).all()) and 0.7 < drawn < 1.43


def _share_place(mine: Floats, theirs: Floats, aspects: Floats, sure: bool) -> bool:
    """Return whether near and far people have the same shift and the same size ratio, as cameras at one place show them.

    With `sure`, these must also be well constrained; otherwise, they only must be possible within 2 sigma. Boxes are (4, K)
    edges, left, top, right, bottom, pixels.

    Across the picture, the scale comes from the positions of the people. Down the picture, positions depend on the size of
    people too. So there the scale is that across, times one of the `aspects` (for pictures that were squeezed).
    """
    tall, tall_before = theirs[3] - theirs[1], mine[3] - mine[1]
    (x, y), (x_there, y_there) = (0.5 * (each[:2] + each[2:]) for each in (mine, theirs))
    one = np.ones(len(x))
    (scale, _, across), sigma_across = _robust(np.column_stack([x - x.mean(), one, tall - tall.mean()]), x_there)
    drawn = np.median(tall / tall_before) / scale
    down_scale = scale * aspects[np.argmin(np.abs(aspects - drawn))]
    (_, down), sigma_down = _robust(np.column_stack([one, tall - tall.mean()]), y_there - down_scale * y)
    size = tall / tall.mean()
    (_, larger), sigma_larger = _robust(np.column_stack([one, size - size.mean()]), np.log(tall / tall_before))
    found, sigma = np.abs([across, down, larger]), np.array([sigma_across[-1], sigma_down[-1], sigma_larger[-1]])
    most, well = np.array([BASELINE, BASELINE, NEARER]), np.array([BASELINE_SIGMA, BASELINE_SIGMA, NEARER_SIGMA])
    return bool((found <= most).all() and (sigma <= well).all()) if sure else bool((found - 2 * sigma <= most).all())


def _robust(design: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Fit parameters (K,) by least squares without outliers, and their sigmas (K,), infinite if the system is singular."""
    use = np.ones(len(values), dtype=bool)
    found: Floats = np.zeros(design.shape[1])
    miss: Floats = np.zeros(len(values))
    for _ in range(3):
        found = np.asarray(np.linalg.lstsq(design[use], values[use], rcond=None)[0])
        miss = np.abs(design @ found - values)
        use = miss <= 4 * np.median(miss) + 1e-9
    square = design[use].T @ design[use]
    if np.linalg.matrix_rank(square) < len(square):
        return found, np.full(len(found), np.inf)
    return found, NORMAL_BY_MAD * float(np.median(miss)) * np.sqrt(np.diag(np.linalg.inv(square)))


def faults_of_same_video(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return a fault for each camera whose video is the file of another camera, or a copy: usually a mistake in the scene."""
    first: dict[Path, str] = {}
    copied: dict[tuple[int, str], tuple[str, Path]] = {}
    faults = []
    for reading in readings:
        if reading.video is None:
            continue
        owners = {first.setdefault(path.resolve(), reading.name): path for path in reading.video.files}
        other = next((name for name in owners if name != reading.name), None)
        if other is not None:
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] video {owners[other].name} is camera {other}'s too: give each "
                "camera its own"
            )
            continue
        own = reading.video.files[0]
        name, path = copied.setdefault(_content(reading.video), (reading.name, own))
        if name != reading.name:
            faults.append(
                f"{scene.place}: [cameras.{reading.name}] video {own.name} has the same content as {path.name} of camera "
                f"{name}: give each camera its own"
            )
    return faults


@dataclass(frozen=True)
class _Named:
    """A file that a camera names."""

    camera: str
    key: str
    """Key in the scene file."""
    written: Path
    """Path as the scene file states it."""
    path: Path
    rows: int
    """Number of rows; 0 if they are not used."""


def faults_of_same_file(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return a fault for each camera that names another camera's file of boxes, joints or embeddings, or a copy of it."""
    first: dict[Path, _Named] = {}
    faults = []
    for one in _list_named_files(scene, readings):
        # Unlike `Path.resolve`, it does not fail on links that form a loop; the reading has reported these.
        other = first.setdefault(Path(os.path.realpath(one.path)), one)
        if other.camera != one.camera:
            faults.append(
                f"{scene.place}: [cameras.{one.camera}] {one.key} {one.path.name} is camera {other.camera}'s too: give each "
                "camera its own"
            )
    for one, other in _copies([one for one in first.values() if one.rows >= FEWEST_ROWS]):
        faults.append(
            f"{scene.place}: [cameras.{one.camera}] {one.key} {one.written} has the same content as {other.written} of camera "
            f"{other.camera}: give each camera its own"
        )
    return faults


def _list_named_files(scene: Scene, readings: Sequence[CameraInput]) -> Iterator[_Named]:
    """Yield the existing files that cameras name; arrays in memory have none."""
    for reading in readings:
        table = scene.cameras[reading.name]
        for key in ("tracks", "detections", "keypoints", "embeddings"):
            written: Path | None = getattr(table, key)
            if written is None or not (path := scene.resolve(written)).is_file():
                continue
            used = path == reading.keypoints_path if key == "keypoints" else path == reading.boxes_path or key == "embeddings"
            rows = reading.keypoints if key == "keypoints" else reading.boxes
            yield _Named(reading.name, key, written, path, len(rows) if used else 0)


def _copies(files: Sequence[_Named]) -> Iterator[tuple[_Named, _Named]]:
    """Yield each file that has the content of another camera's file, with the first file of this content."""
    by_size: dict[int, list[_Named]] = defaultdict(list)
    for one in files:
        by_size[one.path.stat().st_size].append(one)
    for same in by_size.values():
        first: dict[str, _Named] = {}
        for one in same if len(same) > 1 else ():
            with one.path.open("rb") as file:
                other = first.setdefault(hashlib.file_digest(file, "blake2b").hexdigest(), one)
            if other.camera != one.camera:
                yield one, other


def _content(video: VideoInfo) -> tuple[int, str]:
    """Return size and digest of a video's first file; 0 and the path for images: two cameras may begin with equal images."""
    path = video.files[0]
    if video.pieces and video.pieces[0].info is None:
        return 0, str(path)
    try:
        found = fingerprint(path)
    except OSError:
        return 0, str(path)
    return found["bytes"], found["digest"]
