"""The rig in space and from above, and what each camera sees with the rig drawn in."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

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
from passerby.report.weak_points import residual_px

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
DECODED_AHEAD = 16
"""Images that wait for their drawing at most, 100 kB each."""
VIEWS_LEAD = (
    "In a good calibration the grid lies flat on the ground, the verticals run along the edges of doors and posts, and the "
    "boxes of the model coincide with the observed boxes. "
    "Arrows in the residual map that point in the same direction over a whole region indicate wrong intrinsics or a "
    "camera that moved."
)
RIG_LEAD = (
    "Positions and viewing directions of the cameras, and where people walked. An ellipse contains its camera with a "
    "probability of 39 % (1 sigma). Thin ellipses that point to the middle show an uncertain scale, which one measured "
    "distance fixes. If people walk through walls, or a camera faces away from them, something is wrong."
)


def rig_section(contents: Contents, fit: Fitted) -> Section:
    """The rig from above and in space."""
    posed = contents.rig.posed()
    if not len(posed):
        return Section("rig", "The rig", RIG_LEAD, nothing("No camera has a pose: there is nothing to draw."))
    who = f"{count(len(posed), 'camera')} and the trajectories of the people"
    above = plot("rig-above", rig_from_above(contents, fit), f"The rig from above: {who}")
    space = plot("rig-space", rig_in_space(contents, fit), f"The rig in space: {who}", kind="space")
    return Section("rig", "The rig", RIG_LEAD, element("div", plan_drawing(contents, fit), above, space, class_="stack"))


def pictures_section(contents: Contents, fit: Fitted, seen: Seen, tell: Progress) -> Section:
    """A panel for each camera: its picture with what was seen and what the rig makes of it, and its residuals."""
    panels = []
    for place, (name, behind) in enumerate(decoded_backdrops(contents, tell)):
        panels.append(camera_panel(contents, fit, seen, place, name, behind))
    return Section("views", "Camera views", VIEWS_LEAD, join(layer_switches(contents), panels), "Views")


def decoded_backdrops(contents: Contents, tell: Progress) -> Iterator[tuple[str, Backdrop]]:
    """Each camera's name with the image behind its drawing, in the rig's order; the next ones are decoded meanwhile."""
    names = contents.rig.names
    with ThreadPoolExecutor(DECODERS) as decoders:  # decoding leaves Python to other threads
        waiting = deque[Future[Backdrop]]()
        for place, name in enumerate(names):
            for ahead in names[place + len(waiting) : place + DECODED_AHEAD]:
                waiting.append(decoders.submit(backdrop, contents, ahead))
            tell("report", place, len(names))
            yield name, waiting.popleft().result()
    tell("report", len(names), len(names))


def layer_switches(contents: Contents) -> Html:
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


def camera_panel(
    contents: Contents, fit: Fitted, seen: Seen, place: int, name: str, behind: Backdrop,
    among: Collection[str] | None = None, more: Html | None = None,
) -> Html:  # fmt: skip
    """One camera, on the image behind its drawing.

    Args:
        contents: of the report.
        fit: of the whole sample.
        seen: of all cameras.
        place: in the rig.
        name: of the camera.
        behind: of `decoded_backdrops`.
        among: as of `camera_picture`.
        more: what stands below the pictures.
    """
    entry, residual = contents.document.entry(name), residual_px(contents, name)
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
        element("figure", Html(camera_picture(contents, fit, name, behind, among)), element("figcaption", "View")),
        element("figure", Html(residual_map(contents, fit, name)), element("figcaption", "Residuals over the image")),
    ]
    return element(
        "article", head, element("div", pictures, class_="view-pictures"), more, class_="view", aria_label=f"Camera {name}"
    )
