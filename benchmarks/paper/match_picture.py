"""Two views side by side with what was matched between them: green what lies near its epipolar line, red what does not."""

from __future__ import annotations

import cv2
import numpy as np

from baselines.matching import Matches, Picture, bgr
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera
from passerby.geometry.two_view import essential_matrix

RIGHT_PX = 5.0
"""A match this near its epipolar line counts as right. Along the line it may still be wrong: about one wrong match in fifty is
counted as right by chance in a picture of 500 rows."""


def epipolar_distances(a: Camera, b: Camera, xy_a: Floats, xy_b: Floats) -> Floats:
    """How far each match lies from the epipolar line of its first place in the second picture.

    The distance is the angle between the second ray and the epipolar plane, times the focal length: pixels, also under a
    distortion, which bends the line.

    Returns (N,) pixels; infinite where a lens has no ray. Raises `InputError`: a camera without a pose.
    """
    for camera in (a, b):
        if camera.pose is None:
            raise InputError(f"camera {camera.name} has no pose, and so no epipolar lines: give the true rig")
    assert a.pose is not None
    assert b.pose is not None
    R_ba = b.pose.R_cw @ a.pose.R_cw.T
    normal = a.lens.bearings(xy_a) @ essential_matrix(R_ba, b.pose.t_cw - R_ba @ a.pose.t_cw).T
    length = np.linalg.norm(normal, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = (normal * b.lens.bearings(xy_b)).sum(axis=1) / length
    angle = np.arcsin(np.clip(np.abs(sine), 0, 1))
    return np.where(np.isfinite(angle), angle * b.lens.focal, np.inf)


GREEN, RED, WHITE = (60, 200, 40), (40, 40, 230), (255, 255, 255)  # BGR
MOST_DRAWN = 120  # lines beyond this many hide the picture, and each other; the counts are of all
GAP_PX, LETTER_PX = 6, 22


def right(a: Camera, b: Camera, matches: Matches) -> np.ndarray:
    """(N,) which matches lie within `RIGHT_PX` of their epipolar lines, by the true cameras."""
    return np.asarray(epipolar_distances(a, b, matches.xy_a, matches.xy_b) <= RIGHT_PX)


def draw_matches(pictures: tuple[Picture, Picture], cameras: tuple[Camera, Camera], matches: Matches, title: str) -> Picture:
    """Both views, a line for each match, and above them the title and the counts.

    Args:
        pictures: of the two cameras, of one height.
        cameras: with their true poses.
        matches: between them; at most `MOST_DRAWN` are drawn, the others' draw is the same every time.
        title: what found them.

    Returns:
        (H, W, 3) BGR.

    Raises:
        InputError: pictures of different heights, or a camera without a pose.
    """
    first, second = (bgr(picture) for picture in pictures)
    if first.shape[0] != second.shape[0]:
        raise InputError(
            f"pictures of {first.shape[0]} and {second.shape[0]} rows cannot stand side by side: give them one height"
        )
    good = right(*cameras, matches)
    gap = np.full((first.shape[0], GAP_PX, 3), 255, dtype=np.uint8)
    drawn = np.hstack([first, gap, second])
    order = np.random.default_rng(0).permutation(len(matches))[:MOST_DRAWN]
    shift = np.array([first.shape[1] + GAP_PX, 0])
    # Right ones last: they are the fewer where it matters, and must not lie below the wrong ones.
    for row in order[np.argsort(good[order], kind="stable")]:
        ends = [tuple(np.round(xy).astype(int).tolist()) for xy in (matches.xy_a[row], matches.xy_b[row] + shift)]
        colour = GREEN if good[row] else RED
        cv2.line(drawn, ends[0], ends[1], colour, 1, cv2.LINE_AA)
        for end in ends:
            cv2.circle(drawn, end, 3, colour, -1, cv2.LINE_AA)
    head = np.full((LETTER_PX + 12, drawn.shape[1], 3), 40, dtype=np.uint8)
    names = " and ".join(camera.name for camera in cameras)
    text = f"{title}, {names}: {good.sum()} of {len(matches)} within {RIGHT_PX:g} px"
    cv2.putText(head, text, (8, LETTER_PX), cv2.FONT_HERSHEY_SIMPLEX, 0.6, WHITE, 1, cv2.LINE_AA)
    return np.asarray(np.vstack([head, drawn]), dtype=np.uint8)


def as_jpeg(picture: Picture, most_bytes: int = 150_000, most_columns: int = 1000) -> bytes:
    """A picture as JPEG, made smaller until it is no larger than this."""
    if picture.shape[1] > most_columns:
        scale = most_columns / picture.shape[1]
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    for quality in range(88, 10, -6):
        data = bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])
        if len(data) <= most_bytes:
            return data
    return as_jpeg(picture, most_bytes, 3 * most_columns // 4)
