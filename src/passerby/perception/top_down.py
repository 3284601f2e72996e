"""What the keypoint networks that look at one person's crop have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.observations import BODY_17
from passerby.perception.crop_network import CropNetwork, crop_rows
from passerby.perception.crops import enlarge_box, is_recognisable, sample_crop
from passerby.perception.joint_checks import plausible_joints
from passerby.perception.networks import Network
from passerby.perception.pictures import Identity, Picture

# On one core larger batches bring nothing, and a keypoint network's activations are large.
BATCH = 8
# Networks for more joints whose first 17 are COCO's: Halpe (26) and COCO-WholeBody (133).
JOINT_COUNTS = (17, 26, 133)

Answers = list[NDArray[Any]]


class TopDownKeypoints(ABC):
    """Crops about boxes in, joints as fractions of the crops out, and back to pixels of the whole picture."""

    kind: ClassVar[str]
    margin: ClassVar[float]
    """The crop is the box enlarged so many times, then to the input's aspect ratio unless it is to be stretched."""
    outputs_needed: ClassVar[str]

    def __init__(self, network: Network, *, batch: int = BATCH) -> None:
        """Open the network; `batch`: crops at once where the file takes any number of them.

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
        """Whether outputs of these shapes, without their first dimension, are of this kind."""

    @abstractmethod
    def decoded(self, answers: Answers) -> tuple[Floats, Floats]:
        """(N, 17, 2) joints x, y as fractions of the crop's width and height, 0 at its outer edge, and (N, 17) scores."""

    @property
    def identity(self) -> Identity:
        """What decides its results: the network, its conventions, how crops are cut and which joints are believed."""
        return {"keypoints": self.kind, "version": 1, **self._crops.network.identity}

    @property
    def joints(self) -> tuple[str, ...]:
        """COCO's 17."""
        return BODY_17

    def __call__(self, picture: Picture, ltwh: Floats) -> tuple[Floats, Floats]:
        """(N, 17, 2) pixels of the whole picture and (N, 17) confidence, 0 where a joint was not found, of the boxes (N, 4)."""
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
        """(4,) what of the picture is shown to the network for a box (4,)."""
        if self._crops.network.input.fit == "stretch":
            aspect = box[2] / box[3]
        return enlarge_box(box, self.margin, aspect)
