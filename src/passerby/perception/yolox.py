"""People found by a YOLOX network (Ge et al., "YOLOX: Exceeding YOLO Series in 2021")."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.perception.letterbox import Fitting, Window, fit_window
from passerby.perception.networks import Network
from passerby.perception.pictures import Detections, Frame, Identity, Picture
from passerby.perception.sessions import inputs_of, open_session, outputs_of, provider_of, runtime_errors
from passerby.perception.tiles import SEEN_HEIGHT, Tiling, hinted, is_untruncated, merge, tile_windows
from passerby.perception.yolox_output import STRIDES, Cells, Values, cells_of, is_decoded, matching_cells, people

KINDS = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}

HINT = 0.05
"""Score of what may be a small person, so that tiles are worth their time. Looking only at the tiles that hold such a place
found the same people on PETS 2009 enlarged to 1920 by 1080 as looking at all, with people from 10 to 30 pixels of the input,
and looked at 1 to 5.4 of 6 tiles."""


@dataclass(frozen=True)
class YoloxOptions:
    """Options of `YoloxDetector`. Raises `InputError` for a value out of range."""

    score: float = 0.25
    """Least score of a box. Most boxes below are false; tracking joins the weak ones to tracklets of the strong."""
    most_overlap: float = 0.55
    """Intersection over union above which two boxes are one person found twice. On PETS 2009, 0.45 to 0.65 find the same people
    within 2 in 1000; of two who overlap more, both are rarely found, and each duplicate is a false box."""
    tiles: Tiling = "auto"
    """Parts of large pictures that are looked at besides the whole: see `passerby.perception.tiles`."""
    size: int = 640
    """Side of the input of a network that takes any: a multiple of 32."""
    decoded: bool | None = None
    """Whether the network's boxes are in pixels already; None: determined by what it gives for a grey picture."""

    def __post_init__(self) -> None:
        for name in ("score", "most_overlap"):
            value = getattr(self, name)
            if not 0 < value < 1:
                raise InputError(f"detector: {name} = {value} is out of range: give a number between 0 and 1")
        if self.size < 64 or self.size % 32:
            raise InputError(f"detector: size = {self.size} is out of range: give a multiple of 32 from 64 on")
        if isinstance(self.tiles, str):
            if self.tiles not in ("auto", "none"):
                raise InputError(f"detector: tiles = {self.tiles!r} is unknown: give auto, none, or columns and rows")
        elif len(self.tiles) != 2 or min(self.tiles) < 1 or max(self.tiles) > 16:
            raise InputError(f"detector: tiles = {self.tiles} is out of range: give columns and rows, each from 1 to 16")


class YoloxDetector:
    """Finds people with a YOLOX network in an ONNX file; a `passerby.perception.pictures.Detector`.

    The input is [1, 3, height, width], the output [1, N, 5 + C] with a row for each cell of grids of stride 8, 16, 32 and
    perhaps 64, its boxes in pixels or as the network gives them. Class 0 is a person. Raises `InputError` for another file.
    """

    def __init__(self, network: Network, options: YoloxOptions | None = None) -> None:
        self._network = network
        self._options = options or YoloxOptions()
        self._session = open_session(network.path)
        self._input, self._size, self._kind = self._read_input()
        self._cells, self._decoded = self._read_output()

    @property
    def identity(self) -> Identity:
        """What decides its results."""
        options = asdict(self._options)
        if not isinstance(options["tiles"], str):
            options["tiles"] = list(options["tiles"])
        return {"name": "yolox", **self._network.identity, "options": options}

    @property
    def provider(self) -> str:
        """What the network runs on, for the report."""
        return provider_of(self._session)

    def __call__(self, frame: Frame) -> Detections:
        """The people in a frame, the most certain first. Boxes end at the picture's edges."""
        picture = frame.picture
        height, width = picture.shape[:2]
        whole, fitting = self._look(picture, (0, 0, width, height))
        parts = [self._sound(whole, fitting, picture)]
        tiles = tile_windows((height, width), self._size, self._options.tiles)
        if tiles and self._options.tiles == "auto":
            tiles = hinted(tiles, self._small_people(whole, fitting))
        parts += [self._sound(*self._look(picture, tile), picture) for tile in tiles]
        ltrb = np.concatenate([boxes for boxes, _ in parts])
        score = np.concatenate([scores for _, scores in parts])
        kept = merge(ltrb, score, self._options.most_overlap)
        ltrb, score = ltrb[kept], np.clip(score[kept], 0.0, 1.0)
        ltwh = np.concatenate([ltrb[:, :2], ltrb[:, 2:] - ltrb[:, :2]], axis=1)
        return Detections(ltwh, score)

    def _look(self, picture: Picture, window: Window) -> tuple[Values, Fitting]:
        """(N, 5 + C) rows of a window, and where it lies in the network's input."""
        values, fitting = fit_window(picture, window, self._size, self._network.input, self._kind)
        return self._session.run(None, {self._input: values})[0][0], fitting

    def _small_people(self, rows: Values, fitting: Fitting) -> Floats:
        """(N, 2) where there may be people who are too small for the whole picture, pixels of the picture."""
        boxes, _ = people(rows, self._cells, self._decoded, HINT)
        ltrb = fitting.to_picture(boxes[boxes[:, 3] - boxes[:, 1] < SEEN_HEIGHT])
        return np.asarray((ltrb[:, :2] + ltrb[:, 2:]) / 2)

    def _sound(self, rows: Values, fitting: Fitting, picture: Picture) -> tuple[Floats, Floats]:
        """(N, 4) left, top, right, bottom in pixels of the picture, within it and not cut by a tile, and (N,) scores."""
        boxes, score = people(rows, self._cells, self._decoded, self._options.score)
        height, width = picture.shape[:2]
        ltrb = np.clip(fitting.to_picture(boxes), 0.0, np.array([width, height, width, height], dtype=np.float64))
        kept = is_untruncated(ltrb, fitting.window, (height, width), fitting.scale) & (ltrb[:, 2:] - ltrb[:, :2] >= 1.0).all(
            axis=1
        )
        return ltrb[kept], score[kept]

    def _read_input(self) -> tuple[str, tuple[int, int], np.dtype[Any]]:
        """Name, height and width, and type of the network's input."""
        ports = inputs_of(self._session)
        wanted = "a YOLOX network takes one input [1, 3, height, width] of float, float16 or uint8, multiples of 32"
        if len(ports) != 1:
            raise self._unfit(f"takes {len(ports)} inputs", wanted)
        port = ports[0]
        side = self._options.size
        if len(port.shape) != 4 or port.shape[0] not in (1, None) or port.shape[1] not in (3, None):
            raise self._unfit(f"takes {port}", wanted)
        height, width = port.shape[2] or side, port.shape[3] or side
        if port.kind not in KINDS or height % STRIDES[2] or width % STRIDES[2]:
            raise self._unfit(f"takes {port}", wanted)
        return port.name, (height, width), np.dtype(KINDS[port.kind])

    def _read_output(self) -> tuple[Cells, bool]:
        """The cells of the network's rows, and whether its boxes are in pixels, from what it gives for a grey picture."""
        grey = np.full((1, 1, 3), 114, dtype=np.uint8)
        values, _ = fit_window(grey, (0, 0, 1, 1), self._size, self._network.input, self._kind)
        try:
            given = np.asarray(self._session.run(None, {self._input: values})[0])
        except runtime_errors() as error:
            raise self._unfit(f"fails on an input of {list(values.shape)}", "a YOLOX network takes that") from error
        port = outputs_of(self._session)[0]
        expected = len(cells_of(self._size, STRIDES[:3]))
        wanted = f"a YOLOX network gives [1, {expected}, 5 + classes] for an input of {self._size[0]} by {self._size[1]}"
        if given.ndim != 3 or given.shape[0] != 1 or given.shape[2] < 6:
            raise self._unfit(f"gives {port.name} {list(given.shape)}", wanted)
        cells = matching_cells(self._size, given.shape[1])
        if cells is None:
            raise self._unfit(f"gives {port.name} {list(given.shape)}", wanted)
        rows = given[0]
        if not (np.isfinite(rows).all() and (rows[:, 4:] >= 0).all() and (rows[:, 4:] <= 1.001).all()):
            raise self._unfit("gives scores that are not within 0 to 1", "export it with the sigmoids of its heads")
        decoded = self._options.decoded
        return cells, is_decoded(rows, cells) if decoded is None else decoded

    def _unfit(self, found: str, wanted: str) -> InputError:
        """What is wrong with the network's shape."""
        return InputError(f"{self._network.path}: the network {found}: {wanted}; give another file or another kind of output")
