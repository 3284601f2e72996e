"""What a rig can be laid upon, by hand."""

import numpy as np

from passerby.geometry.alignment import SeenPoints
from passerby.geometry.rotations import Similarity


def test_rays_meet_the_plane_of_their_points_in_front_of_the_camera_only() -> None:
    """A camera 2 m up that looks down at 45 degrees: at the ground, at its own height, above it, and along the ground."""
    down, along = np.array([1.0, 0.0, -1.0]) / np.sqrt(2), np.array([1.0, 0.0, -0.01])
    rays = np.array([down, down, down, along])
    targets = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    seen = SeenPoints(np.tile([5.0, 1.0, 2.0], (4, 1)), rays, targets, np.arange(4), np.full(4, 0.01), np.full(4, 0.001))
    met = seen.on_plane(Similarity(1.0, np.eye(3), np.zeros(3)))
    np.testing.assert_allclose(met[0], [7.0, 1.0])
    assert np.isnan(met[1:]).all()
