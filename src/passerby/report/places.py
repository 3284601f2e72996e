"""The rig in space and from above, and what each camera sees with the rig drawn in."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from passerby.common.progress import Progress
from passerby.report.backdrop import Backdrop, backdrop
from passerby.report.camera_table import swatch
from passerby.report.contents import Contents
from passerby.report.fitted import Fitted
from passerby.report.floor_plan import plan_drawing
from passerby.report.html import Html, Section, element, join, nothing, plot
from passerby.report.pictures import camera_picture, residual_map
from passerby.report.rig_plots import rig_from_above, rig_in_space
from passerby.report.seen import Seen
from passerby.report.values import count, figure
from passerby.report.weak_points import residuals_px

LAYERS = (
    ("grid", "ground grid"),
    ("lines", "horizon and verticals"),
    ("cameras", "other cameras"),
    ("boxes", "observed boxes"),
    ("model", "boxes of the model"),
    ("joints", "keypoints"),
)


DECODERS = 2
"""Videos of which an image is decoded at a time, beside the drawing."""


def rig_section(contents: Contents, fit: Fitted) -> Section:
    """The rig from above and in space."""
    lead = (
        "Positions and viewing directions of the cameras, and where people walked. An ellipse contains its camera with a "
        "probability of 39 % (1 sigma). Thin ellipses that point to the middle show an uncertain scale, which one measured "
        "distance fixes. If people walk through walls, or a camera faces away from them, something is wrong."
    )
    posed = contents.rig.posed()
    if not len(posed):
        return Section("rig", "The rig", lead, nothing("No camera has a pose: there is nothing to draw."))
    who = f"{count(len(posed), 'camera')} and the trajectories of the people"
    above = plot("rig-above", rig_from_above(contents, fit), f"The rig from above: {who}")
    space = plot("rig-space", rig_in_space(contents, fit), f"The rig in space: {who}", kind="space")
    return Section("rig", "The rig", lead, element("div", plan_drawing(contents, fit), above, space, class_="stack"))


def pictures_section(contents: Contents, fit: Fitted, seen: Seen, tell: Progress) -> Section:
    """A panel for each camera: its picture with what was seen and what the rig makes of it, and its residuals."""
    lead = (
        "In a good calibration the grid lies flat on the ground, the verticals run along the edges of doors and posts, and the "
        "boxes of the model coincide with the observed boxes. "
        "Arrows in the residual map that point in the same direction over a whole region indicate wrong intrinsics or a "
        "camera that moved."
    )
    panels = []
    with ThreadPoolExecutor(DECODERS) as decoders:  # decoding leaves Python to other threads
        behind = [decoders.submit(backdrop, contents, name) for name in contents.rig.names]
        for place, name in enumerate(contents.rig.names):
            tell("report", place, len(contents.rig))
            panels.append(_panel(contents, fit, seen, place, name, behind[place].result()))
    tell("report", len(contents.rig), len(contents.rig))
    return Section("views", "Camera views", lead, join(_switches(contents), panels), "Views")


def _switches(contents: Contents) -> Html:
    """A box for each layer that a picture has, for all pictures at once."""
    seen, posed = contents.observations.cameras.values(), len(contents.rig.posed()) > 0
    with_boxes, with_joints = any(len(one.boxes) for one in seen), any(len(one.keypoints) for one in seen)
    there = {
        "grid": posed,
        "lines": posed,
        "cameras": posed,
        "boxes": with_boxes,
        "model": posed and with_boxes,
        "joints": with_joints,
    }
    boxes = [
        element("label", element("input", type="checkbox", checked=True, data_layer=layer), name)
        for layer, name in LAYERS
        if there[layer]
    ]
    return element("fieldset", element("legend", "Overlays"), boxes, class_="layers") if boxes else Html("")


def _panel(contents: Contents, fit: Fitted, seen: Seen, place: int, name: str, behind: Backdrop) -> Html:
    """One camera, on the image behind its drawing."""
    entry, residual = contents.cameras[name], residuals_px(contents)[name]
    boxes, joints = entry.boxes, entry.keypoints
    facts = [
        count(seen.people[name], "person", "people"),
        *([f"{figure(boxes, 0)} boxes"] if boxes or not joints else []),
        *([f"{joints:.0f} observations with keypoints"] if joints else []),
        f"residual {figure(residual, 1, ' px')}",
    ]
    if contents.rig[name].pose is None:
        facts.append("no pose")
    head = element("h3", element("span", swatch(place), name), element("small", ", ".join(facts)))
    pictures = [
        element("figure", Html(camera_picture(contents, fit, name, behind)), element("figcaption", "View")),
        element("figure", Html(residual_map(contents, fit, name)), element("figcaption", "Residuals over the image")),
    ]
    return element(
        "article", head, element("div", pictures, class_="view-pictures"), class_="view", aria_label=f"Camera {name}"
    )
