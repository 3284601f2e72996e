"""People found by a YOLOX network (Ge et al., "YOLOX: Exceeding YOLO Series in 2021").

A row has the box, the objectness and the class scores. Some exports have the box in pixels of the input, others as the network
computes it: its centre in cells from its own cell's corner, and the logarithms of width and height in cells.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.perception.networks import Network
from passerby.perception.pictures import Detections, Frame, Identity, Picture
from passerby.perception.sessions import inputs_of, open_session, outputs_of, provider_of, runtime_errors
from passerby.perception.tiles import (
    SEEN_HEIGHT,
    Fitting,
    Tiling,
    Window,
    fit_window,
    hinted,
    is_untruncated,
    merge,
    tile_windows,
)

KINDS = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
HINT = 0.05
"""Score above which there may be a small person, so that tiles are searched. Searching only the tiles with such a place found
the same people on PETS 2009 enlarged to 1920 by 1080 as searching all tiles, with people from 10 to 30 pixels of the input, and
searched 1 to 5.4 of 6 tiles."""
Values = NDArray[np.floating]
STRIDES = (8, 16, 32, 64)
PERSON = 0
"""Index of the class of people, in COCO's order and in networks with that class only."""


@dataclass(frozen=True)
class YoloxOptions:
    """Options of `YoloxDetector`. Raises `InputError` for a value out of range."""

    score: float = 0.25
    """Least score of a box. Most boxes below are false; tracking joins the weak ones to tracklets of strong ones."""
    most_overlap: float = 0.55
    """Intersection over union above which two boxes are one person found twice. On PETS 2009, 0.45 to 0.65 find the same people
    within 2 in 1000. Of two people who overlap more, both are rarely found, and each duplicate is a false box."""
    tiles: Tiling = "auto"
    """Parts of large pictures that are searched in addition to the whole: see `passerby.perception.tiles`."""
    size: int = 640
    """Side of the input for a network with an open input size: a multiple of 32."""
    decoded: bool | None = None
    """Whether the network's boxes are in pixels already; None: determined by its output for a grey picture."""

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
    perhaps 64. Boxes are in pixels or as the network computes them. Class 0 is a person. Raises `InputError` for another file.
    """

    def __init__(self, network: Network, options: YoloxOptions | None = None) -> None:
        self._network = network
        self._options = options or YoloxOptions()
        self._session = open_session(network.path)
        self._input, self._size, self._kind = self._read_input()
        self._cells, self._decoded = self._read_output()

    @property
    def identity(self) -> Identity:
        """Settings that determine its results."""
        options = asdict(self._options)
        if not isinstance(options["tiles"], str):
            options["tiles"] = list(options["tiles"])
        return {"name": "yolox", **self._network.identity, "options": options}

    @property
    def provider(self) -> str:
        """Processor on which the network runs, for the report."""
        return provider_of(self._session)

    def __call__(self, frame: Frame) -> Detections:
        """Find the people in a frame, in order of decreasing score. Boxes end at the picture's edges."""
        picture = frame.picture
        height, width = picture.shape[:2]
        whole, fitting = self._look(picture, (0, 0, width, height))
        parts = [self._sound(whole, fitting, picture)]
        tiles = tile_windows((height, width), self._size, self._options.tiles)
        if tiles and self._options.tiles == "auto":
            tiles = hinted(tiles, self._locate_small_people(whole, fitting))
        parts += [self._sound(*self._look(picture, tile), picture) for tile in tiles]
        ltrb = np.concatenate([boxes for boxes, _ in parts])
        score = np.concatenate([scores for _, scores in parts])
        kept = merge(ltrb, score, self._options.most_overlap)
        ltrb, score = ltrb[kept], np.clip(score[kept], 0.0, 1.0)
        ltwh = np.concatenate([ltrb[:, :2], ltrb[:, 2:] - ltrb[:, :2]], axis=1)
        return Detections(ltwh, score)

    def _look(self, picture: Picture, window: Window) -> tuple[Values, Fitting]:
        """Run the network on a window; return its rows (N, 5 + C), and the window's place in the network's input."""
        values, fitting = fit_window(picture, window, self._size, self._network.input, self._kind)
        return self._session.run(None, {self._input: values})[0][0], fitting

    def _locate_small_people(self, rows: Values, fitting: Fitting) -> Floats:
        """Find places (N, 2) of possible people who are too small for the whole picture, pixels of the picture."""
        boxes, _ = people(rows, self._cells, self._decoded, HINT)
        ltrb = fitting.to_picture(boxes[boxes[:, 3] - boxes[:, 1] < SEEN_HEIGHT])
        return np.asarray((ltrb[:, :2] + ltrb[:, 2:]) / 2)

    def _sound(self, rows: Values, fitting: Fitting, picture: Picture) -> tuple[Floats, Floats]:
        """Return left, top, right, bottom (N, 4), pixels, of boxes that no tile cuts off, within the picture; scores (N,)."""
        boxes, score = people(rows, self._cells, self._decoded, self._options.score)
        height, width = picture.shape[:2]
        ltrb = np.clip(fitting.to_picture(boxes), 0.0, np.array([width, height, width, height], dtype=np.float64))
        kept = is_untruncated(ltrb, fitting.window, (height, width), fitting.scale) & (ltrb[:, 2:] - ltrb[:, :2] >= 1.0).all(
            axis=1
        )
        return ltrb[kept], score[kept]

    def _read_input(self) -> tuple[str, tuple[int, int], np.dtype[Any]]:
        """Return name, height and width, and type of the network's input."""
        ports = inputs_of(self._session)
        wanted = "a YOLOX network takes one input [1, 3, height, width] of float, float16 or uint8, multiples of 32"
        if len(ports) != 1:
            raise self._describe_misfit(f"takes {len(ports)} inputs", wanted)
        port = ports[0]
        side = self._options.size
        if len(port.shape) != 4 or port.shape[0] not in (1, None) or port.shape[1] not in (3, None):
            raise self._describe_misfit(f"takes {port}", wanted)
        height, width = port.shape[2] or side, port.shape[3] or side
        if port.kind not in KINDS or height % STRIDES[2] or width % STRIDES[2]:
            raise self._describe_misfit(f"takes {port}", wanted)
        return port.name, (height, width), np.dtype(KINDS[port.kind])

    def _read_output(self) -> tuple[Cells, bool]:
        """Return the cells of the network's rows, and whether its boxes are in pixels, from its output for a grey picture."""
        grey = np.full((1, 1, 3), 114, dtype=np.uint8)
        values, _ = fit_window(grey, (0, 0, 1, 1), self._size, self._network.input, self._kind)
        try:
            given = np.asarray(self._session.run(None, {self._input: values})[0])
        except runtime_errors() as error:
            raise self._describe_misfit(f"fails on an input of {list(values.shape)}", "a YOLOX network takes that") from error
        port = outputs_of(self._session)[0]
        expected = len(cells_of(self._size, STRIDES[:3]))
        wanted = f"a YOLOX network gives [1, {expected}, 5 + classes] for an input of {self._size[0]} by {self._size[1]}"
        if given.ndim != 3 or given.shape[0] != 1 or given.shape[2] < 6:
            raise self._describe_misfit(f"gives {port.name} {list(given.shape)}", wanted)
        cells = matching_cells(self._size, given.shape[1])
        if cells is None:
            raise self._describe_misfit(f"gives {port.name} {list(given.shape)}", wanted)
        rows = given[0]
        if not (np.isfinite(rows).all() and (rows[:, 4:] >= 0).all() and (rows[:, 4:] <= 1.001).all()):
            raise self._describe_misfit("gives scores that are not within 0 to 1", "export it with the sigmoids of its heads")
        decoded = self._options.decoded
        return cells, is_decoded(rows, cells) if decoded is None else decoded

    def _describe_misfit(self, found: str, wanted: str) -> InputError:
        """Describe the error in the network's input or output."""
        return InputError(f"{self._network.path}: the network {found}: {wanted}; give another file or another kind of output")


@dataclass(frozen=True, eq=False)
class Cells:
    """The N cells of all grids, in the order of the rows."""

    corner: Floats
    """(N, 2) column and row in the cell's own grid."""
    stride: Floats
    """(N,) pixels of the input."""

    def __len__(self) -> int:
        return len(self.stride)


def cells_of(size: tuple[int, int], strides: tuple[int, ...]) -> Cells:
    """Return the cells of grids over an input of this height and width, row by row, the finest grid first."""
    corners, sizes = [], []
    for stride in strides:
        row, column = np.mgrid[: size[0] // stride, : size[1] // stride].reshape(2, -1)
        corners.append(np.stack([column, row], axis=1))
        sizes.append(np.full(len(row), float(stride)))
    return Cells(np.concatenate(corners).astype(np.float64), np.concatenate(sizes))


def matching_cells(size: tuple[int, int], rows: int) -> Cells | None:
    """Return the cells of the three or four grids that have this number of rows; None where neither has."""
    for strides in (STRIDES[:3], STRIDES):
        cells = cells_of(size, strides)
        if len(cells) == rows:
            return cells
    return None


def is_decoded(rows: Values, cells: Cells) -> bool:
    """Check whether the boxes of rows (N, 5 + C) are in pixels of the input, by the positions of their centres.

    A cell's box is near the cell. So either the centres minus the cells' corners are small, or the centres themselves are,
    counted in cells. Across the input the two differ by tens of cells.
    """
    if (rows[:, 2:4] <= 0).any():
        return False
    pixels = np.abs(rows[:, :2] / cells.stride[:, None] - cells.corner)
    return bool(np.median(pixels) < np.median(np.abs(rows[:, :2])))


def people(rows: Values, cells: Cells, decoded: bool, floor: float) -> tuple[Floats, Floats]:
    """Return the boxes of people among the rows of one picture.

    Args:
        rows: (N, 5 + C) box, objectness, class scores.
        cells: the N cells.
        decoded: whether the boxes are in pixels already.
        floor: least score.

    Returns:
        (M, 4) left, top, right, bottom in pixels of the network's input and (M,) scores, objectness times the class's score,
        of the rows whose best class is a person.
    """
    score = rows[:, 4] * rows[:, 5 + PERSON]
    kept = np.flatnonzero(score >= floor)
    kept = kept[rows[kept, 5:].max(axis=1) <= rows[kept, 5 + PERSON]]
    centre, size = rows[kept, :2].astype(np.float64), rows[kept, 2:4].astype(np.float64)
    if not decoded:
        stride = cells.stride[kept, None]
        centre = (centre + cells.corner[kept]) * stride
        size = np.exp(np.minimum(size, 20.0)) * stride
    sound = np.isfinite(centre).all(axis=1) & np.isfinite(size).all(axis=1) & (size > 0).all(axis=1)
    boxes = np.concatenate([centre - size / 2, centre + size / 2], axis=1)
    return boxes[sound], score[kept][sound].astype(np.float64)
