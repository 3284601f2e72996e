"""Keypoints by networks that process one person's crop (heatmaps, SimCC and MoveNet), and rejection of implausible ones.

Such a network always gives joints: those of a neighbour where two people share a crop, or a guess where a person is hidden.

SimCC: Li et al., "SimCC: a simple coordinate classification perspective for human pose estimation", ECCV 2022; RTMPose: Jiang
et al., arXiv 2303.07399.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import BODY_17, MIN_JOINTS
from passerby.perception.crop_network import CropNetwork, crop_rows, enlarge_box, is_recognisable, sample_crop
from passerby.perception.networks import Network
from passerby.perception.pictures import Identity, KeypointEstimator, Picture

# On one core larger batches are not faster, and a keypoint network's activations are large.
BATCH = 8


class TopDownKeypoints(ABC):
    """A network of crops around boxes: its joints are fractions of the crops, and are converted to pixels of the picture."""

    kind: ClassVar[str]
    margin: ClassVar[float]
    """The crop is the box enlarged by this factor, then extended to the input's aspect ratio unless it is to be stretched."""
    outputs_needed: ClassVar[str]

    def __init__(self, network: Network, *, batch: int = BATCH) -> None:
        """Open the network; `batch` is the number of crops at once where the file takes any number of them.

        Raises `InputError` for a file that does not open or is not of this kind.
        """
        self._crops = CropNetwork(network, batch=batch)
        answers = self._crops.probed()
        if not self.fits([answer.shape[1:] for answer in answers]):
            found = "; ".join(
                f"{port.name} {list(answer.shape)}" for port, answer in zip(self._crops.outputs, answers, strict=True)
            )
            raise InputError(f"{network.path}: gives {found}: {self.kind} needs {self.outputs_needed}")

    @staticmethod
    @abstractmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """Check whether outputs of these shapes, without their first dimension, are of this kind."""

    @abstractmethod
    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """Decode joints x, y (N, 17, 2), fractions of the crop's width and height from its outer edge, and scores (N, 17)."""

    @property
    def identity(self) -> Identity:
        """Settings that determine its results: network, its conventions, how crops are cut and which joints are accepted."""
        return {"keypoints": self.kind, "version": 1, **self._crops.network.identity}

    @property
    def joints(self) -> tuple[str, ...]:
        """The 17 joints of COCO."""
        return BODY_17

    def __call__(self, picture: Picture, ltwh: Floats) -> tuple[Floats, Floats]:
        """Find joints (N, 17, 2), pixels of the picture, and confidence (N, 17), 0 if not found, of boxes (N, 4)."""
        boxes = crop_rows(ltwh)
        xy, score = np.zeros((len(boxes), len(BODY_17), 2)), np.zeros((len(boxes), len(BODY_17)))
        rows = np.flatnonzero(is_recognisable(picture, boxes))
        if not len(rows):
            return xy, score
        width, height = self._crops.size
        convention = self._crops.network.input
        areas = np.stack([self._area(box, width / height) for box in boxes[rows]])
        answers = self._crops([sample_crop(picture, area, self._crops.size, convention.padding) for area in areas])
        fractions, confidence = self.decoded(answers)
        sound = np.asarray(np.isfinite(fractions).all(axis=2))
        fractions = np.where(sound[..., None], fractions, 0.0)
        found: Floats = np.asarray(areas[:, None, :2] + fractions * areas[:, None, 2:])
        size = (picture.shape[1], picture.shape[0])
        score[rows] = plausible_joints(found, np.where(sound, confidence, 0.0), boxes[rows], size)
        xy[rows] = found
        return xy, score

    def _area(self, box: Floats, aspect: float) -> Floats:
        """Return the area (4,) of the picture that the network is given for a box (4,)."""
        if self._crops.network.input.fit == "stretch":
            aspect = box[2] / box[3]
        return enlarge_box(box, self.margin, aspect)


class HeatmapKeypoints(TopDownKeypoints):
    """A network with one output [N, J, h, w], a map of the crop with a peak at each joint; its height is the confidence."""

    kind: ClassVar[str] = "heatmaps"
    # The value with which these networks are trained and published.
    margin: ClassVar[float] = 1.25
    outputs_needed: ClassVar[str] = "one output [N, keypoints, height, width] of 17, 26 or 133 keypoints, COCO's 17 first"

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """Check for one map for each of a known number of joints."""
        return len(shapes) == 1 and len(shapes[0]) == 3 and shapes[0][0] in JOINT_COUNTS and min(shapes[0][1:]) >= 3

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """Decode the positions of the peaks, as fractions of the map.

        Families differ in the position of a map's cell on the crop: some use its corner (HRNet), some align corner with corner
        (UDP, ViTPose). Here it is its middle, which is half-way between them and within 1.5 of 256 pixels of both.
        """
        maps = answers[0][:, : len(BODY_17)].astype(np.float64)
        n, joints, height, width = maps.shape
        best = maps.reshape(n, joints, -1).argmax(axis=2)
        row, column = np.divmod(best, width)
        person, joint = np.arange(n)[:, None], np.arange(joints)[None, :]
        across = maps[person, joint, row, :]
        along = maps[person, joint, :, column]
        xy = np.stack([(_top(across, column) + 0.5) / width, (_top(along, row) + 0.5) / height], axis=-1)
        return xy, maps.max(axis=(2, 3))


class MovenetKeypoints(TopDownKeypoints):
    """MoveNet lightning and thunder (Google): output [N, 1, 17, 3], each joint's y, x as fractions of the crop, and score."""

    kind: ClassVar[str] = "movenet"
    # Median distance to OpenPose's joints (44 pictures of one person, boxes 5 % larger than the joints' extent) as a share of
    # the box's height, for lightning and thunder: 1.46 % and 1.26 % at 1.0, 1.51 and 1.28 at 1.1, 1.59 and 1.35 at 1.2, 1.70
    # and 1.42 at 1.3. 1.1 has the most of lightning's joints within 5 % (97 %) and tolerates a box that cuts off the feet. A
    # second pass on a crop around the first one's joints, as without a detector, is no better: 1.59, 1.37 % in twice the time.
    margin: ClassVar[float] = 1.1
    outputs_needed: ClassVar[str] = "one output [N, 1, 17, 3]: y, x and score of COCO's 17 keypoints"

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """Check for one output of 17 joints with three numbers each."""
        return len(shapes) == 1 and shapes[0] in ((1, 17, 3), (17, 3))

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """Return the joints, which are fractions of the crop already."""
        joints = answers[0].reshape(len(answers[0]), 17, 3).astype(np.float64)
        return joints[..., [1, 0]], joints[..., 2]


class SimccKeypoints(TopDownKeypoints):
    """RTMPose and similar: outputs [N, J, k W] and [N, J, k H] for an input W x H, with k (usually 2) bins per pixel."""

    kind: ClassVar[str] = "simcc"
    # The value with which these networks are trained and published.
    margin: ClassVar[float] = 1.25
    outputs_needed: ClassVar[str] = (
        "two outputs [N, keypoints, bins along x] and [N, keypoints, bins along y] of 17, 26 or 133 keypoints, COCO's 17 first"
    )

    @staticmethod
    def fits(shapes: list[tuple[int, ...]]) -> bool:
        """Check for two outputs with the same, known number of joints."""
        return (
            len(shapes) == 2
            and all(len(shape) == 2 and shape[1] >= 2 for shape in shapes)
            and shapes[0][0] == shapes[1][0]
            and shapes[0][0] in JOINT_COUNTS
        )

    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """Decode the best bins: bin b stands for the crop's pixel b / k, counted from the middle of the first pixel.

        The confidence is the smaller one of the two maxima, as in the publisher's code.
        """
        fractions, scores = [], []
        for bins, pixels in zip(answers, self._crops.size, strict=True):
            rows = bins[:, : len(BODY_17)]
            per_pixel = rows.shape[2] / pixels
            fractions.append((rows.argmax(axis=2) / per_pixel + 0.5) / pixels)
            scores.append(rows.max(axis=2).astype(np.float64))
        return np.stack(fractions, axis=-1), np.minimum(*scores)


_KINDS = {kind.kind: kind for kind in (MovenetKeypoints, SimccKeypoints, HeatmapKeypoints)}
# Networks for more joints whose first 17 are COCO's: Halpe (26) and COCO-WholeBody (133).
JOINT_COUNTS = (17, 26, 133)
Answers = list[NDArray[Any]]
# MoveNet (lightning and thunder alike) gives lower scores to 0.5 % of the joints that it finds within 4 % of the person's
# height, and to 73 % of the joints of legs that are not in the crop; at 0.2 it is 0 % and 53 %. 0.3 is usual for RTMPose, too.
MIN_SCORE = 0.3
# A detector cuts off feet, hands and hair by a few percent of the box; a joint farther outside of it is a neighbour's.
OUTSIDE = 0.1
# From eyes to ankles a standing person takes 0.9 of the box's height; a person with only head and torso visible, 0.45.
MIN_EXTENT = 0.3


def open_keypoints(network: Network) -> KeypointEstimator:
    """Return the estimator for a network's kind of output.

    Raises `InputError` for a file that does not open, is not of the stated kind, or finds no joints.
    """
    kind = _KINDS.get(network.output)
    if kind is None:
        raise InputError(f"{network.path}: its output is {network.output}: keypoints need one of {', '.join(_KINDS)}")
    return kind(network)


def plausible_joints(xy: Floats, score: Floats, ltwh: Floats, picture_size: tuple[int, int]) -> Floats:
    """Return the scores, set to 0 for joints that are not plausible.

    A joint is dropped below `MIN_SCORE`, outside of the picture, and farther from the box than `OUTSIDE` of the box's size in
    that direction. A whole person is dropped when fewer than `MIN_JOINTS` are left or they extend over less than `MIN_EXTENT`
    of the box's height.

    Args:
        xy: (N, J, 2) joints, pixels of the whole picture.
        score: (N, J) confidence.
        ltwh: (N, 4) the people's boxes, pixels.
        picture_size: width and height, pixels.

    Returns:
        (N, J) confidence, 0 to 1.
    """
    score = np.clip(np.where(np.isfinite(score), score, 0.0), 0.0, 1.0)
    margin = OUTSIDE * ltwh[:, None, 2:]
    low = ltwh[:, None, :2]
    near = ((xy >= low - margin) & (xy <= low + ltwh[:, None, 2:] + margin)).all(axis=2)
    inside = ((xy >= -0.5) & (xy <= np.asarray(picture_size) - 0.5)).all(axis=2)
    found = near & inside & (score >= MIN_SCORE)
    height = np.where(found, xy[..., 1], -np.inf).max(axis=1) - np.where(found, xy[..., 1], np.inf).min(axis=1)
    person = (found.sum(axis=1) >= MIN_JOINTS) & (height >= MIN_EXTENT * ltwh[:, 3])
    return np.asarray(np.where(found & person[:, None], score, 0.0))


def _top(line: Floats, place: NDArray[np.int64]) -> Floats:
    """Find the peak (N, J) near the largest value of lines (N, J, L): that of the parabola through three logarithms."""
    length = line.shape[2]
    near = np.clip(place, 1, length - 2)[..., None] + np.array([-1, 0, 1])
    before, at, after = np.moveaxis(np.log(np.maximum(np.take_along_axis(line, near, axis=2), 1e-12)), 2, 0)
    bend = 2.0 * at - before - after
    inner = (place > 0) & (place < length - 1) & (bend > 1e-9)
    shift = np.where(inner, 0.5 * (after - before) / np.where(inner, bend, 1.0), 0.0)
    return np.asarray(place + np.clip(shift, -0.5, 0.5))
