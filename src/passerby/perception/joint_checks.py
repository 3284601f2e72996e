"""Which joints of a top-down network to believe.

Such a network always answers: with a neighbour's joints where two people share a crop, with a guess where a person is hidden.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.observations import MIN_JOINTS

# MoveNet (lightning and thunder alike) scores 0.5 % of the joints that it finds within 4 % of the person's height below this,
# but 73 % of the joints of legs that are not in the crop; at 0.2 it is 0 % and 53 %. 0.3 is usual for RTMPose, too.
MIN_SCORE = 0.3
# A detector cuts feet, hands and hair by a few percent of the box; a joint farther outside of it is a neighbour's.
OUTSIDE = 0.1
# From eyes to ankles a standing person fills 0.9 of the box; one with only head and torso visible, 0.45.
MIN_EXTENT = 0.3


def plausible_joints(xy: Floats, score: Floats, ltwh: Floats, picture_size: tuple[int, int]) -> Floats:
    """Scores with 0 for what is not to be believed.

    A joint is dropped below `MIN_SCORE`, outside of the picture, and farther from the box than `OUTSIDE` of the box's size in
    that direction; a person whole when fewer than `MIN_JOINTS` are left or they reach over less than `MIN_EXTENT` of the box in
    height.

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
