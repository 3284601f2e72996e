"""What a re-identification network would make of the people: one unit vector for each box.

A vector is the person's own look, a shift that is the camera's (its light, its colours), the side from which this camera sees
the person, and noise of the box. The three sizes were chosen together: the nearest of another camera's vectors is the right
person's for 76, 66 and 61 % of single boxes among 7, 14 and 20 people, and for 94, 91 and 88 % of the means of eight boxes
(60 draws with four cameras), about what networks reach on people whom they were not trained for.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import UNKNOWN, Vectors

DIMENSIONS = 128
CAMERA_SHIFT = 0.6
"""Length of a camera's shift; a person's look has length 1."""
SIDE = 1.5
"""Root mean square length of what one camera makes of one person, in all its boxes alike: an average does not remove it."""
BOX_NOISE = 1.4
"""Root mean square length of the noise of a box: pose, light, occlusion."""


def people_looks(n_people: int, rng: np.random.Generator) -> Floats:
    """(P, D) one random unit vector for each person."""
    appearance = rng.standard_normal((n_people, DIMENSIONS))
    return np.asarray(appearance / np.linalg.norm(appearance, axis=1, keepdims=True))


def box_embeddings(identity: Ints, appearance: Floats | None, rng: np.random.Generator) -> Vectors:
    """Embeddings of one camera's boxes.

    Args:
        identity: (N,) true identities from 1, -1 for a box without a person, which gets noise.
        appearance: (P, D) from `people_looks`; None where everybody is dressed alike, and every box gets noise.
        rng: the camera's.

    Returns:
        (N, D) unit vectors.
    """
    shifting, siding, noising = rng.spawn(3)
    vectors = noising.standard_normal((len(identity), DIMENSIONS)) / np.sqrt(DIMENSIONS)
    if appearance is not None:
        shift = shifting.standard_normal(DIMENSIONS)
        side = siding.standard_normal(appearance.shape) / np.sqrt(DIMENSIONS)
        known = identity != UNKNOWN
        vectors[known] *= BOX_NOISE
        vectors[known] += (appearance + SIDE * side)[identity[known] - 1] + CAMERA_SHIFT * shift / np.linalg.norm(shift)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), dtype=np.float32)
