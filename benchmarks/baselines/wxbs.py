"""Matching of views as from far apart: features of affine views of each picture, then geometric verification.

As WxBS and MODS do it (Mishkin, Matas, Perdoch, Lenc, "WxBS: Wide Baseline Stereo Generalizations", BMVC 2015; "MODS", CVIU
2015): each picture is also seen as if its camera stood to the side, by the tilts and turns of ASIFT (Morel, Yu, SIAM J. Imaging
Sciences 2009); features of all views are matched, and a fundamental matrix in RANSAC keeps what agrees. Of MODS' detectors and
descriptors this has SIFT alone, and all of its views at once instead of step by step.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import poselib

from baselines.matching import MAX_FEATURES, Features, Matcher, Matches, Picture, Remembered, grey, nearest_matches
from baselines.sift import describe
from passerby.common.arrays import Floats

RATIO = 0.85  # MODS' for SIFT on views: verification follows, so that more may come in than with Lowe's
TILTS = (2**0.5, 2.0, 2 * 2**0.5)
"""ASIFT's without the last two, which have more views than these together: to 69 degrees from the normal of a surface."""
TURN_DEG = 72.0  # turns of a tilted view lie this many degrees over the tilt apart: ASIFT's
VIEW_FEATURES = MAX_FEATURES // 4  # features of a tilted view; there are 17 of them
ANTI_ALIASING = 0.8  # blur along the direction that is squeezed, in pixels a tilt: ASIFT's
APART_PX = 10.0  # MODS': features of several views this close together may show one place
SAME_PX = 2.0  # matches whose ends both lie in one cell of this width are one match, found in several views
VERIFY_PX = 3.0
MIN_MATCHES = 8


def open_matcher(weights: Path | None = None) -> Matcher:
    """There are no weights."""
    return ViewMatcher()


class ViewMatcher:
    """Matches by affine views; see the module."""

    def __init__(self) -> None:
        self._describe = Remembered(describe_views)

    def __call__(self, a: Picture, b: Picture) -> Matches:
        """See `baselines.Matcher`; only those that agree on one fundamental matrix."""
        found = single(nearest_matches(self._describe(a), self._describe(b), RATIO, APART_PX))
        return verified(found)


def describe_views(picture: Picture) -> Features:
    """Features of the picture and of its tilted views, all in the picture's own pixels."""
    whole = grey(picture)
    parts = [describe(whole, MAX_FEATURES)]
    for tilt in TILTS:
        for turn in np.arange(0.0, 180.0, TURN_DEG / tilt):
            view, back = tilted(whole, tilt, float(turn))
            seen = describe(view, VIEW_FEATURES)
            xy = seen.xy @ back[:, :2].T + back[:, 2]
            inside = ((xy >= 0) & (xy <= (whole.shape[1] - 1, whole.shape[0] - 1))).all(axis=1)
            parts.append(Features(xy[inside], seen.descriptor[inside]))
    return Features(np.concatenate([part.xy for part in parts]), np.concatenate([part.descriptor for part in parts]))


def tilted(picture: Picture, tilt: float, turn_deg: float) -> tuple[Picture, Floats]:
    """A picture as from a camera to the side: turned, then squeezed along x by the tilt.

    Returns the view, and the affine map (2, 3) from its pixels back to the picture's.
    """
    height, width = picture.shape[:2]
    forward = cv2.getRotationMatrix2D((0.0, 0.0), turn_deg, 1.0)
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float64) @ forward[:, :2].T
    low, high = corners.min(axis=0), corners.max(axis=0)
    forward[:, 2] = -low
    size = np.ceil(high - low).astype(int)
    turned = cv2.warpAffine(picture, forward, (int(size[0]), int(size[1])), flags=cv2.INTER_LINEAR)
    # Blurred before every tilt-th column is taken, as a sensor farther to the side would blur it.
    blurred = cv2.GaussianBlur(turned, (0, 0), sigmaX=ANTI_ALIASING * np.sqrt(tilt**2 - 1), sigmaY=0.01)
    forward[0] /= tilt
    squeeze = np.array([[1 / tilt, 0, 0], [0, 1, 0]])
    view = cv2.warpAffine(blurred, squeeze, (int(size[0] / tilt), int(size[1])), flags=cv2.INTER_LINEAR)
    return np.asarray(view, dtype=np.uint8), np.asarray(cv2.invertAffineTransform(forward), dtype=np.float64)


def single(matches: Matches) -> Matches:
    """The best of the matches whose two ends fall into the same cells of `SAME_PX`."""
    order = np.argsort(-matches.score, kind="stable")
    cells = np.round(np.column_stack([matches.xy_a, matches.xy_b]) / SAME_PX)[order]
    return matches.take(np.sort(order[np.unique(cells, axis=0, return_index=True)[1]]))


def verified(matches: Matches) -> Matches:
    """The matches that agree with one fundamental matrix: PoseLib's LO-RANSAC; none where it finds none."""
    if len(matches) < MIN_MATCHES:
        return Matches.none()
    options = {"max_epipolar_error": VERIFY_PX, "min_iterations": 1000, "max_iterations": 20_000, "seed": 0}
    _, told = poselib.estimate_fundamental(matches.xy_a, matches.xy_b, options, {"loss_type": "CAUCHY"})
    good = np.array(told["inliers"], dtype=bool)
    return matches.take(good) if good.sum() >= MIN_MATCHES else Matches.none()
