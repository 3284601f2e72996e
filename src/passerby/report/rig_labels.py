"""What the drawings of a rig say of its cameras."""

from __future__ import annotations

import re

import numpy as np

from passerby.core.cameras import Camera, Rig
from passerby.report.sheet import clip_text

ENTITY = re.compile(r"&(?=#?\w+;)")


def told(name: str) -> str:
    """A name as plotly may show it anywhere: it reads tags and entities in some of its texts, and not in others."""
    return ENTITY.sub("& ", clip_text(name).replace("<", "‹").replace(">", "›"))


def unregistered(rig: Rig) -> list[str]:
    """Names of the cameras without a pose."""
    return [told(camera.name) for camera in rig if camera.pose is None]


def posed_cameras(rig: Rig) -> list[tuple[int, Camera]]:
    """The cameras with poses and their places in the rig."""
    return [(place, camera) for place, camera in enumerate(rig) if camera.pose is not None]


def hover_words(camera: Camera) -> str:
    """What hovering over a camera tells."""
    x, y, z = (round(float(value), 2) + 0.0 for value in camera.centre)
    lines = [f"camera {told(camera.name)}", f"x {x:.2f}, y {y:.2f} m", f"height {z:.2f} m"]
    if camera.sigma is not None and np.isfinite(camera.sigma.position_m):
        lines.append(f"± {1000 * camera.sigma.position_m:.0f} mm, ± {camera.sigma.orientation_deg:.2f}°")
    return "<br>".join(lines)


def faint(colour: str, opacity: float) -> str:
    """`#rrggbb` with an opacity."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"
