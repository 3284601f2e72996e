"""People in the pictures of a static camera, found without a network: everything that differs from the empty scene.

The recording is read twice. `learn_background` takes a few pictures all over it, and learns the empty scene and the apparent
height of people at each place. `BackgroundDetector` then compares every picture with it. OpenCV's subtractors, trained with the
same pictures and followed by the same shapes, find fewer people with their defaults; with a background ratio of 0.6 MOG2 finds
slightly more. CONTRIBUTING.md has the figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError, InputError
from passerby.perception.foreground import (
    Levels,
    Reference,
    ShadowOptions,
    find_usual_colours,
    foreground,
    prepare_reference,
    shadow_tone,
)
from passerby.perception.people_shapes import Stature, find_people, find_upright, learn_stature, least_height, silhouettes
from passerby.perception.pictures import Detections, Frame, Identity, Picture

VERSION = 2
"""Version of the detector's results: raised when the same options give other boxes."""
LEAST_PICTURES = 5
"""With fewer pictures a person who passes may become background."""
SHADOW_PIXELS, SHADOWS_EVERY = 1000, 3
"""Largest number of pixels per picture from which the tone of shadows is learnt; every third picture is used."""


@dataclass(frozen=True)
class BackgroundOptions:
    """Options of the background's learning and of the detector. Raises `InputError` for a value out of range."""

    working_width: int = 960
    """Pixels: wider pictures are compared at this width. A person who is too small at it is also too small for the solver."""
    pictures: int = 60
    """Number of pictures from which a background is learnt."""
    window_s: float = 300.0
    """Seconds after which a new background is learnt: the light changes."""
    windows: int = 12
    """Largest number of backgrounds; windows are longer then, so that memory is bounded."""
    shadows: ShadowOptions = field(default_factory=ShadowOptions)

    def __post_init__(self) -> None:
        for name, least in (("working_width", 64), ("pictures", LEAST_PICTURES), ("window_s", 1e-3), ("windows", 1)):
            if not getattr(self, name) >= least:
                raise InputError(f"background: {name} = {getattr(self, name)} is out of range: give {least} or more")


@dataclass(frozen=True)
class Sampling:
    """The pictures of a recording from which the background is learnt."""

    interval_s: float
    window_s: float


def plan_sampling(duration_s: float, options: BackgroundOptions | None = None) -> Sampling:
    """Return the sampling for a recording of `duration_s` seconds; 1 / interval_s is the rate at which to decode it."""
    options = options or BackgroundOptions()
    if not duration_s > 0:
        raise InputError(
            f"background: a recording of {duration_s} s is too short to learn a background model: give a longer one"
        )
    count = int(min(max(round(duration_s / options.window_s), 1), options.windows))
    window = duration_s / count
    return Sampling(window / options.pictures, window)


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """The empty scene of one camera."""

    size: tuple[int, int]
    """(width, height) of the whole pictures, pixels."""
    seconds: Floats
    """(W,) middles of the windows, ascending."""
    colour: Picture
    """(W, h, w, 3) BGR at the working size."""
    noise: Levels
    """(W, h, w, 3) standard deviations as from `find_usual_colours`."""
    tone: Floats | None
    """(3,) tone of the shadows, as in `find_shadows`."""
    stature: Stature | None
    """Apparent height of people, working pixels; None where too few people stood alone."""

    @property
    def scale(self) -> float:
        """Working pixels per pixel of the whole picture."""
        return float(self.colour.shape[2] / self.size[0])

    def turned(self, degrees: int) -> BackgroundModel:
        """Return the model of the pictures after they are turned clockwise by a multiple of 90 degrees, without stature."""
        size = self.size if degrees % 180 == 0 else self.size[::-1]
        colour, noise = (np.rot90(part, -degrees // 90, axes=(1, 2)).copy() for part in (self.colour, self.noise))
        return replace(self, size=size, colour=colour, noise=noise, stature=None)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the model as named arrays, for numpy.savez."""
        tone = np.zeros((0, 3)) if self.tone is None else self.tone[None]
        stature = self.stature
        plane = np.zeros((0, 5)) if stature is None else np.array([[*stature.plane, stature.spread, stature.boxes]])
        return {
            "size": np.array(self.size),
            "seconds": self.seconds,
            "colour": self.colour,
            "noise": self.noise,
            "tone": tone,
            "stature": plane,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> BackgroundModel:
        """Return the model from the arrays of `to_arrays`."""
        row = np.asarray(arrays["stature"], dtype=np.float64)
        stature = Stature(row[0, :3], float(row[0, 3]), int(row[0, 4])) if len(row) else None
        tone = np.asarray(arrays["tone"], dtype=np.float64)
        width, height = (int(value) for value in arrays["size"])
        seconds, known_tone = np.asarray(arrays["seconds"], dtype=np.float64), tone[0] if len(tone) else None
        colour, noise = (np.asarray(arrays[name], np.uint8) for name in ("colour", "noise"))
        return cls((width, height), seconds, colour, noise, known_tone, stature)


def learn_background(
    frames: Iterable[Frame], sampling: Sampling, options: BackgroundOptions | None = None, seed: int = 0
) -> BackgroundModel:
    """Learn the empty scene of a static camera.

    Args:
        frames: pictures all over the recording in order of time, of one size; those beyond `sampling` are skipped.
        sampling: from `plan_sampling`.
        options: options; None: the defaults.
        seed: seed of the random numbers in the fit of people's heights.

    Returns:
        The model. Memory: the working pictures of one window and the backgrounds. Raises `EvidenceError` where there are fewer
        than `LEAST_PICTURES` pictures, `InputError` where their sizes differ.
    """
    options = options or BackgroundOptions()
    learner = _Learner(options)
    window, step, held = 0, -1, 0
    for frame in frames:
        now = int(frame.seconds / sampling.interval_s + 1e-6)
        if now <= step:
            continue
        step = now
        number = int(frame.seconds / sampling.window_s + 1e-9)
        if number != window and held >= LEAST_PICTURES:
            learner.close()
            window, held = number, 0
        learner.add(frame)
        held += 1
    return learner.finish(np.random.default_rng(seed))


class _Learner:
    """Collects the pictures of a window and learns from them at its end."""

    def __init__(self, options: BackgroundOptions) -> None:
        self.options = options
        self.size: tuple[int, int] | None = None
        self.pictures: list[Picture] = []
        self.times: list[float] = []
        self.backgrounds: list[tuple[float, Picture, Levels]] = []
        self.boxes: list[Floats] = []
        self.ratios: list[Levels] = []
        self.tone: Floats | None = None

    def add(self, frame: Frame) -> None:
        """Keep a picture of the window, at the working size."""
        size = (frame.picture.shape[1], frame.picture.shape[0])
        if self.size is None:
            self.size = size
        if size != self.size:
            raise InputError(
                f"frame {frame.number} has {size[0]} x {size[1]} pixels, the first {self.size[0]} x {self.size[1]}"
            )
        self.pictures.append(working_picture(frame.picture, self.options.working_width))
        self.times.append(frame.seconds)

    def close(self) -> None:
        """Learn the window's background, and the boxes of people who stood alone."""
        if self.size is None or len(self.pictures) < LEAST_PICTURES:
            return
        colour, noise = find_usual_colours(self.pictures)
        self.backgrounds.append((float(np.mean(self.times)), colour, noise))
        reference = prepare_reference(colour, noise)
        least = least_height(colour.shape[0], colour.shape[1] / self.size[0])
        self._learn_tone(reference)
        for picture in self.pictures:
            found = silhouettes(foreground(picture, reference, self.options.shadows, self.tone).body, least)
            self.boxes.append(found.ltwh[find_upright(found, least)].astype(np.float64))
        self.pictures.clear()
        self.times.clear()

    def _learn_tone(self, reference: Reference) -> None:
        """Learn the tone of shadows from the pictures of this window and those before."""
        for picture in self.pictures[::SHADOWS_EVERY]:
            shadows = foreground(picture, reference, self.options.shadows, None).shadows
            pixels = shadows.ratio[shadows.core > 0]
            self.ratios.append(pixels[:: max(len(pixels) // SHADOW_PIXELS, 1)])
        self.tone = shadow_tone(self.ratios)

    def finish(self, rng: np.random.Generator) -> BackgroundModel:
        """Return the model of all windows."""
        self.close()
        if self.size is None or not self.backgrounds:
            raise EvidenceError(
                f"{len(self.pictures)} frames are too few to learn a background model: give a recording with {LEAST_PICTURES} "
                "or more"
            )
        stature = learn_stature(np.concatenate(self.boxes), rng)
        seconds, colour, noise = zip(*self.backgrounds, strict=True)
        return BackgroundModel(self.size, np.array(seconds), np.stack(colour), np.stack(noise), self.tone, stature)


def working_picture(picture: Picture, working_width: int) -> Picture:
    """Reduce the picture to the working width and smooth it: dark hair before dark leaves shows over several pixels."""
    height, width = picture.shape[:2]
    if width > working_width:
        rows = max(round(height * working_width / width), 1)
        picture = cast(Picture, cv2.resize(picture, (working_width, rows), interpolation=cv2.INTER_AREA))
    return cast(Picture, cv2.blur(picture, (3, 3)))


class BackgroundDetector:
    """A `Detector` that needs no network."""

    def __init__(self, model: BackgroundModel, options: BackgroundOptions | None = None) -> None:
        self._model = model
        self._options = options or BackgroundOptions()
        self._prepared: tuple[tuple[int, int, int], Reference] | None = None

    def turned(self, degrees: int) -> BackgroundDetector:
        """Return the detector for the pictures after they are turned clockwise by a multiple of 90 degrees."""
        model = self._model.turned(degrees)
        return BackgroundDetector(model, replace(self._options, working_width=model.colour.shape[2]))

    @property
    def identity(self) -> Identity:
        """Settings that determine its results, without the model, which follows from the recording and the options."""
        return {"detector": "background", "version": VERSION, **asdict(self._options)}

    def __call__(self, frame: Frame) -> Detections:
        """Find the people in a frame, boxes in pixels of the whole picture. The score is 1.0 for a person who stands alone.

        Raises `InputError` for a picture of another size than the background's.
        """
        size = (frame.picture.shape[1], frame.picture.shape[0])
        if size != self._model.size:
            width, height = self._model.size
            raise InputError(f"frame {frame.number} has {size[0]} x {size[1]} pixels, its background {width} x {height}")
        picture = working_picture(frame.picture, self._options.working_width)
        found = foreground(picture, self._reference(frame.seconds), self._options.shadows, self._model.tone)
        scale = self._model.scale
        ltwh, score = find_people(found, self._model.stature, least_height(picture.shape[0], scale))
        # Edges keep their position as a share of the working picture's width and height.
        factor = np.array([size[0] / picture.shape[1], size[1] / picture.shape[0]])
        return Detections(ltwh * np.tile(factor, 2), score)

    def _reference(self, seconds: float) -> Reference:
        """Return the background at a time: between the middles of two windows a mixture, in steps of an eighth."""
        times = self._model.seconds
        after = int(np.searchsorted(times, seconds))
        low, high = max(after - 1, 0), min(after, len(times) - 1)
        share = 0.0 if low == high else (seconds - times[low]) / (times[high] - times[low])
        key = (low, high, round(8 * share))
        if self._prepared is None or self._prepared[0] != key:
            model = self._model
            part = key[2] / 8
            colour = cast(Picture, cv2.addWeighted(model.colour[low], 1 - part, model.colour[high], part, 0.0))
            noise = cast(Levels, cv2.max(model.noise[low], model.noise[high]))
            self._prepared = key, prepare_reference(colour, noise)
        return self._prepared[1]
