"""Drawing of people: quads, lit and sorted by depth, give a small picture with coverage, which is drawn over a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera
from passerby.perception.pictures import Picture
from passerby.simulation.body import JOINTS, body_spheres
from passerby.simulation.lenses import before_fold
from passerby.simulation.observe import NEAREST_M, find_whole_in_view
from passerby.simulation.rendering.clothes import Outfit, Wardrobe, dress
from passerby.simulation.rendering.mesh import Template, pose_surface, template
from passerby.simulation.rendering.surroundings import SHADOW, Light

FINE_FROM_PX = 110.0
"""Least height in the picture of people with the fine template. Below it, the coarse template's corners are within a pixel."""
SUPERSAMPLING = 2
SHIFT = 4
"""Fractional bits of the corners that are passed to OpenCV."""
LIMIT_PX = 8000.0
"""Limit of the corners' coordinates in both directions, because OpenCV's fixed-point numbers have a limited range."""
GRAIN = 0.05
"""Relative variation of the brightness of cloth, from fold to fold."""
SCALE = 2
"""Shadows are drawn in a picture that is smaller by this factor, because their edges are soft."""
SHADOW_SHIFT = 4
EDGE_PX = 1.5
"""Sigma of the soft edge, pixels of the full picture: the sun's half degree makes a centimetre per metre of height."""
CONTACT = 0.72
"""Brightness of the ground right under a foot, which hides even the sky, as a share."""
CONTACT_M = 0.16
CONTACT_FADE_M = 0.08
"""Height of the foot at which its contact shadow has only about a third of its darkness."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A person in front of a camera: the quads that face the camera, from the farthest to the nearest."""

    person: int
    depth: float
    """Mean distance from the camera, metres: people are drawn from the farthest to the nearest."""
    low: Floats
    """(2,) left and top of the whole body in the picture, pixels."""
    high: Floats
    """(2,) right and bottom of the whole body, pixels."""
    polygons: Floats
    """(Q, 4, 2) corners of the quads, pixels."""
    colours: Floats
    """(Q, 3) colours of the quads in the light of the scene."""


class PeoplePainter:
    """Draws the people of one camera's frames."""

    def __init__(
        self, camera: Camera, heights: Floats, outfits: tuple[Outfit, ...], light: Light, grain: NDArray[np.float32]
    ) -> None:
        """Set up.

        Args:
            camera: camera with a pose.
            heights: (P,) standing heights, metres.
            outfits: outfits of the P people.
            light: light of the scene.
            grain: a field of about unit variance, for folds of cloth.
        """
        self._camera, self._heights, self._light, self._grain = camera, heights, light, grain
        self._builds = np.array([outfit.build for outfit in outfits])
        self._wardrobes: dict[bool, Wardrobe] = {fine: dress(template(fine), outfits) for fine in (True, False)}

    def surfaces(self, joints: Floats, present: NDArray[np.bool_]) -> list[Surface]:
        """Return the people to draw, selected by `observe.find_whole_in_view`, from the farthest to the nearest.

        Args:
            joints: (P, J, 3) world, metres.
            present: (P,) whether a person is present.
        """
        pose = self._camera.pose
        assert pose is not None
        centres, _ = body_spheres(joints[None], self._heights)
        seen = np.einsum("psk,ik->psi", centres[0], pose.R_cw) + pose.t_cw
        here = np.flatnonzero(present & find_whole_in_view(self._camera, seen))
        if not len(here):
            return []
        depth = np.linalg.norm(seen, axis=-1).mean(axis=-1)
        tall = self._camera.lens.focal * self._heights / depth
        found = []
        for fine in (False, True):
            people = here[(tall[here] >= FINE_FROM_PX) == fine]
            found += self._pose_template(template(fine), people, joints, depth)
        return sorted(found, key=lambda surface: -surface.depth)

    def _pose_template(self, shape: Template, people: Ints, joints: Floats, depth: Floats) -> list[Surface]:
        """Return the surfaces of the people who are at least partly in the picture."""
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
        frame[top:bottom, left:right] = cv2.add(behind, self._add_grain(patch[..., :3], surface, (int(left), int(top))))

    def _patch(self, surface: Surface, origin: tuple[int, int], size: tuple[int, int]) -> Picture:
        """Return a picture (h, w, 4) of the person alone: colours times coverage, and coverage."""
        # The centre of a pixel has integer coordinates, also in the finer picture.
        fine = (surface.polygons - origin) * SUPERSAMPLING + (SUPERSAMPLING - 1) / 2
        polygons = np.round(np.clip(fine, -LIMIT_PX, LIMIT_PX) * (1 << SHIFT)).astype(np.int32)
        canvas = np.zeros((size[1] * SUPERSAMPLING, size[0] * SUPERSAMPLING, 4), dtype=np.uint8)
        for polygon, (blue, green, red) in zip(polygons, surface.colours.tolist(), strict=True):
            cv2.fillConvexPoly(canvas, polygon, (blue, green, red, 255.0), cv2.LINE_8, SHIFT)
        return np.asarray(cv2.resize(canvas, size, interpolation=cv2.INTER_AREA))

    def _add_grain(self, colours: Picture, surface: Surface, origin: tuple[int, int]) -> Picture:
        """Add folds of cloth, which move with the person: the field starts at the corner of the whole body's box."""
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


class ShadowCaster:
    """Draws the shadows of people on the ground of one camera's frames."""

    def __init__(self, camera: Camera, heights: Floats, outfits: tuple[Outfit, ...], light: Light) -> None:
        """Set up.

        Args:
            camera: camera with a pose.
            heights: (P,) standing heights, metres.
            outfits: outfits of the P people.
            light: light of the scene.
        """
        self._camera, self._heights, self._light = camera, heights, light
        width, height = camera.lens.size
        self._size = (-(-width // SCALE), -(-height // SCALE))
        self._builds = np.array([outfit.build for outfit in outfits])
        self._shape = template(False)
        self._pieces = [np.unique(self._shape.piece[worn]).tolist() for worn in dress(self._shape, outfits).worn]

    def cast(self, frame: Picture, joints: Floats, present: NDArray[np.bool_]) -> None:
        """Draw the shadows of all people, in place, including people outside the picture.

        Args:
            frame: the background.
            joints: (P, J, 3) world, metres.
            present: (P,) whether a person is present.
        """
        people = np.flatnonzero(present)
        if not len(people):
            return
        brightness = np.full(self._size[::-1], 255, dtype=np.uint8)
        self._contacts(brightness, joints[people], self._heights[people])
        if self._light.sunny:
            self._sun(brightness, joints[people], people)
        touched = cv2.boundingRect(255 - brightness)
        if touched[2]:
            self._darken_ground(frame, brightness, touched)

    def _darken_ground(self, frame: Picture, brightness: Picture, touched: Sequence[int]) -> None:
        """Darken the part of the frame that shadows touch, with soft edges."""
        pad = 4
        left, top = max(touched[0] - pad, 0), max(touched[1] - pad, 0)
        right, bottom = min(touched[0] + touched[2] + pad, self._size[0]), min(touched[1] + touched[3] + pad, self._size[1])
        soft = cv2.GaussianBlur(brightness[top:bottom, left:right], (0, 0), EDGE_PX / SCALE)
        large = cv2.resize(soft, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
        part = frame[top * SCALE : bottom * SCALE, left * SCALE : right * SCALE]
        large = cv2.cvtColor(large[: part.shape[0], : part.shape[1]], cv2.COLOR_GRAY2BGR)
        part[:] = cv2.multiply(part, large, scale=1 / 255)

    def _sun(self, brightness: Picture, joints: Floats, people: NDArray[np.int64]) -> None:
        """Draw the shadow of each nearly convex piece of a body as the convex hull of its points' shadows."""
        sun = self._light.towards_sun
        points = pose_surface(self._shape, joints, self._heights[people], self._builds[people])
        points -= (np.maximum(points[..., 2:], 0.0) / sun[2]) * sun
        pixels, ahead = self._project(points)
        for row, person in enumerate(people.tolist()):
            whole = bool(ahead[row].all())
            for piece in self._pieces[person]:
                members = self._shape.pieces[piece]
                if whole or ahead[row, members].all():
                    self._fill(brightness, pixels[row, members], SHADOW)

    def _contacts(self, brightness: Picture, joints: Floats, heights: Floats) -> None:
        """Draw a dark contact shadow around each foot on the ground; it fades as the foot rises."""
        ends = [[JOINTS.index(f"{side}_{end}") for side in ("left", "right")] for end in ("heel", "toe")]
        heel, toe = (joints[:, end] for end in ends)
        lifted = np.minimum(heel[..., 2], toe[..., 2]) - 0.02 * heights[:, None]
        strength = (1 - CONTACT) * np.exp(-np.maximum(lifted, 0.0) / CONTACT_FADE_M)
        along = (toe - heel)[..., :2]
        along = along / np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-6)[..., None]
        aside = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)[:, None]
        ring = 1.35 * np.cos(turns) * along[..., None, :] + 0.8 * np.sin(turns) * aside[..., None, :]
        middle = (heel + toe)[..., None, :2] / 2
        for size, share in ((1.0, 0.5), (0.6, 1.0)):
            flat = middle + size * CONTACT_M * ring
            pixels, ahead = self._project(np.concatenate([flat, np.zeros_like(flat[..., :1])], axis=-1))
            for foot in np.argwhere(ahead.all(axis=-1)).tolist():
                self._fill(brightness, pixels[tuple(foot)], 1 - share * float(strength[tuple(foot)]))

    @staticmethod
    def _fill(brightness: Picture, pixels: NDArray[np.int32], level: float) -> None:
        cv2.fillConvexPoly(brightness, cv2.convexHull(pixels), (round(255 * level),), cv2.LINE_8, SHADOW_SHIFT)

    def _project(self, points: Floats) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """Return pixels (..., 2) of the small picture with `SHADOW_SHIFT` fractional bits; (...) whether points are ahead."""
        pose = self._camera.pose
        assert pose is not None
        ahead = np.einsum("...k,k->...", points, pose.R_cw[2]) + pose.t_cw[2] > NEAREST_M
        ahead &= before_fold(self._camera.lens, points @ pose.R_cw.T + pose.t_cw)
        safe = np.where(ahead[..., None], points, self._camera.centre + pose.R_cw[2])
        pixels = (self._camera.project(safe.reshape(-1, 3)).reshape(*points.shape[:-1], 2) - (SCALE - 1) / 2) / SCALE
        return np.round(np.clip(pixels, -LIMIT_PX, LIMIT_PX) * (1 << SHADOW_SHIFT)).astype(np.int32), ahead
