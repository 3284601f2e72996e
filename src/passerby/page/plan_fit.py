"""A draft of a plan tried on the rig as it is: where all cameras would be on it, and how far off each placement is."""

from __future__ import annotations

from typing import Any

import numpy as np

from passerby.calibration.alignment.plan import align_to_plan
from passerby.calibration.alignment.world import Aligned
from passerby.common.arrays import Floats
from passerby.core.colours import camera_colour
from passerby.core.floor_plan import FloorPlan
from passerby.page.plan_acts import PlanDraft, plan_table
from passerby.page.plan_pictures import PlanPictures
from passerby.page.requests import read_as
from passerby.page.session import Session
from passerby.report.rig_geometry import WEDGE_SHARE, stage_of, wedge
from passerby.scene.floor_plan import floor_plan


def try_plan(session: Session, pictures: PlanPictures, content: Any) -> dict[str, Any]:
    """Lay the rig upon a draft, with the plan's scale, and tell the outcome in pixels of the plan, JSON-ready.

    Nothing is written, and people are not fitted again: after the next calibration the rig differs by what they say.

    Raises `InputError` for what is no plan, or a pixel that a camera cannot see; `EvidenceError` where the placements fix
    nothing, or there is no rig.
    """
    draft = read_as(PlanDraft, content)
    rig, table = session.rig(), plan_table(session, draft)
    plan = floor_plan(table, pictures.shown(table.image).size)
    aligned = align_to_plan(rig, plan, table.image, with_scale=True)
    return {
        "cameras": _cameras(aligned, plan),
        "placements": _placements(aligned, plan),
        "notes": [session.public(one) for one in aligned.notes],
        "scale_percent": 100 * (aligned.motion.scale - 1),
        "scale_sigma_percent": 100 * aligned.figures["scale_sigma"],
        "turn_sigma_deg": aligned.figures["turn_sigma_deg"],
        "place_sigma_m": aligned.figures["place_sigma_mm"] / 1000,
    }


def to_plan(plan: FloorPlan, xy: Floats) -> Floats:
    """(N, 2) pixels of a plan of places (N, 2) in its world, metres."""
    return np.asarray(np.asarray(xy, dtype=np.float64) / plan.metres_per_pixel * (1.0, -1.0) + plan.origin)


def _cameras(aligned: Aligned, plan: FloorPlan) -> list[dict[str, Any]]:
    """Each camera that has a pose: its pixel of the plan, and what it sees of the ground nearby."""
    reach = WEDGE_SHARE * stage_of(aligned.rig, np.zeros((0, 2))).reach
    return [
        {
            "name": camera.name,
            "colour": camera_colour(place),
            "at": to_plan(plan, camera.centre[None, :2])[0].round(1).tolist(),
            "seen": to_plan(plan, wedge(camera, reach)).round(1).tolist(),
        }
        for place, camera in enumerate(aligned.rig)
        if camera.pose is not None
    ]


def _placements(aligned: Aligned, plan: FloorPlan) -> list[dict[str, Any]]:
    """Each camera on the plan and each observation of a point: how far off it is, and where the rig has it."""
    return [
        {
            "point": row.get("point"), "camera": row["camera"], "off_m": row["off_m"], "used": row["used"],
            "found": None if row["found_m"] is None else to_plan(plan, np.array([row["found_m"]]))[0].round(1).tolist(),
        }
        for row in aligned.residuals
    ]  # fmt: skip
