"""Rigs and people's ways for the formats that draw them: places and directions that can be told by hand."""

import numpy as np

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Clock
from passerby.core.trajectories import Trajectories

NASTY = 'C"1\n</script><b>\x01\\ é'
"""A camera's name with all that could break out of a file."""

SIZE = (640, 480)
CENTRED = Lens(SIZE, np.array([[500.0, 0, 319.5], [0, 400.0, 239.5], [0, 0, 1]]), np.zeros(5))
"""What a perspective camera with its axis in the middle of the picture can be: also pixels that are not square."""
SKEWED = Lens(SIZE, np.array([[500.0, 30, 330], [0, 500, 230], [0, 0, 1]]), np.zeros(0))
BENT = Lens(SIZE, np.array([[500.0, 0, 330], [0, 500, 230], [0, 0, 1]]), np.array([-0.25, 0.08, 0.001, -0.002, 0.01]))
FISHEYE = Lens(SIZE, np.array([[220.0, 0, 319], [0, 220, 241], [0, 0, 1]]), np.array([0.02, -0.01, 0.0, 0.0]), fisheye=True)

ALONG_Y = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""R_cw of a level camera that looks along the world's +y: its right is +x, its down -z."""


def rig(first: Lens = CENTRED, second: Lens = CENTRED) -> Rig:
    """A level camera at (1, 2, 3) that looks along +y, and one at (0, 10, 4) that looks along -y, and down."""
    back = np.array([[-1.0, 0, 0], [0, 0.6, -0.8], [0, -0.8, -0.6]])
    return Rig(
        (
            Camera(NASTY, first, Pose.from_centre(ALONG_Y, np.array([1.0, 2.0, 3.0]))),
            Camera("C2", second, Pose.from_centre(back, np.array([0.0, 10.0, 4.0]))),
        )
    )


def ways() -> Trajectories:
    """Person 3 in two stretches, the second of one place only; person 11 in one."""
    clock = Clock(10.0, 0.25)
    frame = np.array([1, 2, 3, 60, 5, 6])
    return Trajectories(
        identity=np.array([3, 3, 3, 3, 11, 11]),
        frame=frame,
        time_s=clock.seconds(frame),
        xyz=np.array([[0, 5, 0.9], [0.5, 5, 0.9], [1, 5.5, 0.9], [3, 6, 0.8], [-2, 4, 1], [-2, 4.5, 1.0]]),
        sigma_m=np.array([0.1, np.nan, 0.2, 0.3, 0.1, 0.1]),
        cameras=np.array([2, 0, 1, 2, 2, 2]),
        part=np.array([1, 1, 1, 2, 1, 1]),
        clock=clock,
    )
