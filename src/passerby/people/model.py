"""How people stand, and how boxes and joints of them are off: noise and priors."""

from __future__ import annotations

from dataclasses import dataclass

from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class Noise:
    """What the residuals are weighed by; shares are of the extent in pixels that the person is expected to have."""

    floor_px: float = 0.5
    """Noise of head, ankles and joints in pixels, independent of the person's size."""
    box_px: float = 0.5
    """The same of the centre of a box; its height is off by twice as much, as where both edges err on their own."""
    centre: float = 0.02
    height: float = 0.10
    lean: float = 0.06
    """The centre of head and ankles, in both directions: bodies lean, and the joints themselves fix the shape."""
    joint: float = 0.01
    kinds: Floats | None = None
    """(C, K) factor on the noise of each joint of the body in each camera; 1 when None."""
    loss: float = 5.0
    """Scale of the Cauchy loss in sigmas; large values make it nearly quadratic for a first descent."""
    broken: float = 0.0
    """Share of the boxes' edges that are not the person's, beyond what clean boxes feign."""


@dataclass(frozen=True)
class Priors:
    """Standard deviations of what people and detectors usually do."""

    low: float = 0.05
    """The lowest point's height above the ground, as a share of the person's height: steps, kerbs, slopes."""
    high: float = 0.06
    """The highest point's distance from standing height, the same: gait, a bent neck, shoes."""
    slack: float = 0.05
    group_slack: float = 0.01
    """Of the mean slack of cameras that were a rig by themselves: one detector differs little from one group to another."""
    foot_shift: float = 0.08
    """How much nearer to the camera the lowest visible point is than the body's axis, as a share of the person's height."""
    foot_shift_sd: float = 0.04
    """Between scenes. What boxes say of it follows one another, so that it would count for little beside thousands of them."""
    stance_loss: float = 2.0
    time: float = 0.3
    """Error of a camera's clock, seconds: whole frames are found before, so that half a frame of 2 a second is left at most."""


JOINED_FOOT_SHIFT_SD = 0.01
"""`Priors.foot_shift_sd` where joints are seen beside boxes: over the root of the design effect of boxes (3 to 16 in simulated
and rendered scenes), so that it counts as they do. Joints fix how cameras are pitched; a detector's bias of a pixel up or
down, which a pitch hides otherwise, would go into the foot shift, and by it into scale and ground. Boxes whose lower edges are
a pixel too low: the ground is wrong by 26 to 31 mm with it, 33 to 42 without (simulated basketball, seeds 12 to 14).
"""

# People who walk are on the mean this share of their standing height: the head bobs between both (Cavagna and Margaria 1966).
GAIT_SHARE = 0.99

# The height of a box is off by this many times what its centre is off by, where both edges err on their own.
HEIGHT_PER_CENTRE = 2.0
