"""Drawing people: their quads, lit and sorted by depth, into a small picture with coverage, and that over a frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.body import body_spheres
from passerby.simulation.observe import whole_in_view
from passerby.simulation.rendering.clothes import Outfit, Wardrobe, dress
from passerby.simulation.rendering.light import Light
from passerby.simulation.rendering.mesh import Template, pose_surface, template

FINE_FROM_PX = 110.0
"""People less tall than this are drawn with the coarse template: its corners are then within a pixel."""
SUPERSAMPLING = 2
SHIFT = 4
"""Fractional bits of the corners that are passed to OpenCV."""
LIMIT_PX = 8000.0
"""Corners farther outside the picture are moved to here: OpenCV's fixed-point numbers end."""
GRAIN = 0.05
"""How much cloth varies in brightness, from fold to fold."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A person who stands before a camera: the quads that face it, from the farthest to the nearest."""

    person: int
    depth: float
    """Mean distance from the camera, metres: people are drawn from the farthest to the nearest."""
    low: Floats
    """(2,) left and top of the whole body in the picture, pixels."""
    high: Floats
    """(2,) right and bottom."""
    polygons: Floats
    """(Q, 4, 2) the quads' corners, pixels."""
    colours: Floats
    """(Q, 3) their colours in the light of the scene."""


class PeoplePainter:
    """Draws the people of one camera's frames."""

    def __init__(
        self, camera: Camera, heights: Floats, outfits: tuple[Outfit, ...], light: Light, grain: NDArray[np.float32]
    ) -> None:
        """Set up.

        Args:
            camera: with a pose.
            heights: (P,) metres.
            outfits: of the P people.
            light: of the scene.
            grain: a field of about unit variance, for folds of cloth.
        """
        self._camera, self._heights, self._light, self._grain = camera, heights, light, grain
        self._builds = np.array([outfit.build for outfit in outfits])
        self._wardrobes: dict[bool, Wardrobe] = {fine: dress(template(fine), outfits) for fine in (True, False)}

    def surfaces(self, joints: Floats, present: NDArray[np.bool_]) -> list[Surface]:
        """Who is drawn, from the farthest to the nearest: those whom `observe.whole_in_view` leaves.

        Args:
            joints: (P, J, 3) world, metres.
            present: (P,) who is there.
        """
        pose = self._camera.pose
        assert pose is not None
        centres, _ = body_spheres(joints[None], self._heights)
        seen = np.einsum("psk,ik->psi", centres[0], pose.R_cw) + pose.t_cw
        here = np.flatnonzero(present & whole_in_view(self._camera, seen))
        if not len(here):
            return []
        depth = np.linalg.norm(seen, axis=-1).mean(axis=-1)
        tall = self._camera.lens.focal * self._heights / depth
        found = []
        for fine in (False, True):
            people = here[(tall[here] >= FINE_FROM_PX) == fine]
            found += self._of_template(template(fine), people, joints, depth)
        return sorted(found, key=lambda surface: -surface.depth)

    def _of_template(self, shape: Template, people: Ints, joints: Floats, depth: Floats) -> list[Surface]:
        """The surfaces of those people who are in the picture at all."""
        if not len(people):
            return []
        points = pose_surface(shape, joints[people], self._heights[people], self._builds[people])
        pixels = self._camera.project(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        corners = points[:, shape.quads]
        normals = np.cross(corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1])
        towards = self._camera.centre - corners.mean(axis=2)
        distance = np.einsum("pfk,pfk->pf", towards, towards)
        wardrobe = self._wardrobes[shape is template(True)]
        shown = (np.einsum("pfk,pfk->pf", normals, towards) > 0) & wardrobe.worn[people]
        normals /= np.maximum(np.sqrt(np.einsum("pfk,pfk->pf", normals, normals)), 1e-12)[..., None]
        colours = np.clip(wardrobe.colours[people] * self._light.on(normals), 0, 255)
        order = np.argsort(np.where(shown, -distance, np.inf), axis=1, kind="stable")
        found = []
        for row in np.flatnonzero((high > 0).all(axis=1) & (low < np.array(self._camera.lens.size)).all(axis=1)):
            person, drawn = int(people[row]), order[row, : np.count_nonzero(shown[row])]
            polygons = pixels[row, shape.quads[drawn]]
            found.append(Surface(person, float(depth[person]), low[row], high[row], polygons, colours[row, drawn]))
        return found

    def paint(self, frame: Picture, surface: Surface) -> None:
        """Draw a person over a frame, in place."""
        width, height = self._camera.lens.size
        left, top = np.maximum(np.floor(surface.low).astype(int) - 1, 0)
        right, bottom = np.minimum(np.ceil(surface.high).astype(int) + 2, (width, height))
        if right <= left or bottom <= top:
            return
        size = int(right - left), int(bottom - top)
        patch = self._patch(surface, (int(left), int(top)), size)
        part = frame[top:bottom, left:right]
        alpha = cv2.cvtColor(patch[..., 3], cv2.COLOR_GRAY2BGR)
        behind = cv2.multiply(part, 255 - alpha, scale=1 / 255)
        frame[top:bottom, left:right] = cv2.add(behind, self._with_grain(patch[..., :3], surface, (int(left), int(top))))

    def _patch(self, surface: Surface, origin: tuple[int, int], size: tuple[int, int]) -> Picture:
        """(h, w, 4) the person alone: colours times coverage, and coverage."""
        # A pixel's middle has whole coordinates, in the finer picture too.
        fine = (surface.polygons - origin) * SUPERSAMPLING + (SUPERSAMPLING - 1) / 2
        polygons = np.round(np.clip(fine, -LIMIT_PX, LIMIT_PX) * (1 << SHIFT)).astype(np.int32)
        canvas = np.zeros((size[1] * SUPERSAMPLING, size[0] * SUPERSAMPLING, 4), dtype=np.uint8)
        for polygon, (blue, green, red) in zip(polygons, surface.colours.tolist(), strict=True):
            cv2.fillConvexPoly(canvas, polygon, (blue, green, red, 255.0), cv2.LINE_8, SHIFT)
        return np.asarray(cv2.resize(canvas, size, interpolation=cv2.INTER_AREA))

    def _with_grain(self, colours: Picture, surface: Surface, origin: tuple[int, int]) -> Picture:
        """The folds of cloth move with the person: the field is tied to the corner of the whole body's box."""
        low, high = surface.low, surface.high
        scale = 56.0 / max(float(high[1] - low[1]), 1.0)
        row = 61 * surface.person % 128
        move = np.array([[scale, 0.0, (origin[0] - low[0]) * scale + row], [0.0, scale, (origin[1] - low[1]) * scale + row]])
        size = colours.shape[1], colours.shape[0]
        field = cv2.warpAffine(
            self._grain, move, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_WRAP
        )
        factor = cv2.cvtColor(1.0 + GRAIN * field, cv2.COLOR_GRAY2BGR)
        return np.asarray(cv2.multiply(colours, factor, dtype=cv2.CV_8U))
