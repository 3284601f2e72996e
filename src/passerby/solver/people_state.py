"""The values of the person model: what was seen, what it is weighed by, and a point in the space of unknowns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from passerby.common.arrays import Columns, Floats, Ints


@dataclass(frozen=True, eq=False)
class UprightObservations(Columns):
    """M upright people seen: the rays of a highest and of a lowest point, as boxes or as head and ankles give them."""

    camera: Ints
    """(M,) camera index, ascending."""
    block: Ints
    """(M,) person-instant."""
    top: Floats
    """(M, 3) unit ray of the highest point, camera frame."""
    bottom: Floats
    """(M, 3) unit ray of the lowest point."""
    top_tangent: Floats
    """(M, 2, 3) from `Lens.tangents`."""
    bottom_tangent: Floats
    """(M, 2, 3)"""
    extent_px: Floats
    """(M,) distance of the two points in the picture, pixels."""
    top_fraction: Floats
    """(M,) where on the body the highest point sits, as a share of its height: 1 for a box."""
    bottom_fraction: Floats
    """(M,) the same of the lowest point: 0 for a box."""
    has_foot: Floats
    """(M,) 1 where the lowest point is the visible foot of a box, which lies nearer to the camera than the axis; else 0."""
    velocity: Floats | None = None
    """(M, 2) how fast the middle of the two points moves through the picture, pixels a second; None where clocks are right."""
    pixels: Floats | None = None
    """(M, 2, 2) pixels of the highest and of the lowest point; this and the next two None where lenses are not refined."""
    lens_at: Floats | None = None
    """(M, L) the camera's lens, as `PeopleState.lens`, that the rays were made with."""
    by_lens: Floats | None = None
    """(M, 2, 2, L) how the two points' pixels move with it."""
    distortion_slope: Floats | None = None
    """(M, 2, 2, 2) how that by the distortion changes with the two pixels; None where the distortion is not refined."""

    def __len__(self) -> int:
        return len(self.camera)


@dataclass(frozen=True, eq=False)
class AdjustmentState:
    """A point in the space of unknowns."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    slack: Floats
    """(C,) boxes are taller than people by this factor, as a logarithm; 0 on the mean."""
    globals: Floats
    """(1,) foot shift, as a share of the height."""
    heights: Floats
    """(P,) standing heights, metres."""
    people: Floats
    """(N, 4): x, y, height of the lowest and of the highest point, metres."""
    joints: Floats
    """(J, 3) 3D joints, metres."""
    time: Floats = field(default_factory=lambda: np.zeros(0))
    """(C,) seconds to be added to the clocks' offsets: a camera shows the world so much later than its clock says. Empty where
    the clocks are right."""
    lens: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(C, L) by how much lenses differ from the stated ones (`LensUnknowns`); no columns where they are not refined."""
    lengths: Floats = field(default_factory=lambda: np.zeros((0, 6)))
    """(K, 6) the two ends of each known length, metres (`CueRows`)."""

    def scaled(self, scale: float) -> AdjustmentState:
        """All lengths of cameras, people and joints times `scale`, the standing heights too."""
        return replace(
            self, centre=self.centre * scale, heights=self.heights * scale, people=self.people * scale,
            joints=self.joints * scale, lengths=self.lengths * scale,
        )  # fmt: skip
