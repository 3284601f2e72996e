"""Model of how people stand, and of the errors of their boxes and joints: noise and priors."""

from __future__ import annotations

from dataclasses import dataclass

from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise by which the residuals are weighted. Shares refer to the expected extent of the person in pixels."""

    floor_px: float = 0.5
    """Noise of head, ankles and joints in pixels, independent of the person's size."""
    box_px: float = 0.5
    """The same for the centre of a box. The noise of its height is twice as large, as where both edges err independently."""
    centre: float = 0.02
    height: float = 0.10
    lean: float = 0.06
    """Noise of the centre of head and ankles, in both directions: bodies lean, and the joints themselves fix the shape."""
    joint: float = 0.01
    kinds: Floats | None = None
    """(C, K) factor on the noise of each joint of the body in each camera; 1 when None."""
    loss: float = 5.0
    """Scale of the Cauchy loss in sigmas; large values make it nearly quadratic for a first descent."""
    broken: float = 0.0
    """Share of box edges that are not at the person's ends, in excess of the share that clean boxes seem to have."""


@dataclass(frozen=True)
class Priors:
    """Priors on people and detectors: means and standard deviations."""

    low: float = 0.05
    """Sigma of the lowest point's height above the ground, as a share of the person's height: steps, kerbs, slopes."""
    high: float = 0.06
    """Sigma of the highest point's distance from standing height, in the same unit: gait, a bent neck, shoes."""
    slack: float = 0.05
    group_slack: float = 0.01
    """Sigma of the mean slack of a group of cameras that was a rig of its own: one detector differs little between groups."""
    foot_shift: float = 0.08
    """Distance by which the lowest visible point is nearer to the camera than the body's axis, as a share of the person's
    height."""
    foot_shift_sd: float = 0.04
    """Sigma of the foot shift between scenes. Errors of boxes are correlated: thousands of boxes would outweigh this prior."""
    stance_loss: float = 2.0
    time: float = 0.3
    """Sigma of a camera's time offset, seconds. Whole frames are found before: at most half a frame of 2 a second is left."""


JOINED_FOOT_SHIFT_SD = 0.01
"""`Priors.foot_shift_sd` where joints are seen beside boxes: divided by the square root of the design effect of boxes (3 to 16
in simulated and rendered scenes), so that the prior is weighted as the boxes are. Joints determine the pitch of cameras. A
detector's bias of a pixel up or down, otherwise absorbed by the pitch, would go into the foot shift, and from there into scale
and ground. With lower edges of boxes that are a pixel too low, the ground is wrong by 26 to 31 mm with it, and by 33 to 42 mm
without (simulated basketball, seeds 12 to 14)."""

# Mean height of walking people as a share of their standing height: the head moves up and down (Cavagna and Margaria 1966).
GAIT_SHARE = 0.99

# Ratio of the noise of a box's height to that of its centre, where both edges err independently.
HEIGHT_PER_CENTRE = 2.0
