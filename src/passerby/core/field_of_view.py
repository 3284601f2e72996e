"""How much of the world a lens shows, as data sheets state it."""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens


def field_of_view_deg(lens: Lens) -> tuple[float | None, float | None]:
    """Horizontal and vertical field of view, degrees: between the rays through the middles of opposite borders of the image.

    None where the lens model has no ray there: its distortion turns over before the border.
    """
    (width, height), middle = lens.size, (np.array(lens.size) - 1) / 2
    ends = np.array([(-0.5, middle[1]), (width - 0.5, middle[1]), (middle[0], -0.5), (middle[0], height - 0.5)])
    left, right, top, bottom = lens.bearings(ends)
    return _between(left[[0, 2]], right[[0, 2]]), _between(top[1:], bottom[1:])


def _between(one: Floats, other: Floats) -> float | None:
    """The angle between rays (2,) across and along the optical axis, over that axis, degrees; None where a ray is missing."""
    angles = np.degrees(np.arctan2([one[0], other[0]], [one[1], other[1]]))
    return float(angles[1] - angles[0]) if np.isfinite(angles).all() else None
