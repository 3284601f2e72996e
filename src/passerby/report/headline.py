"""The first screen: the verdict, its reasons and remedies, and the most important figures."""

from __future__ import annotations

from passerby.core.figures import HeldOutFigures
from passerby.core.measuring import MeasuringFigures
from passerby.findings.ranking import MOST_SHOWN
from passerby.report.contents import Contents
from passerby.report.distances import weak_points
from passerby.report.recommendations import good_for, points_of, reported_doubts, sentence
from passerby.report.rendering import Section, section
from passerby.report.seen import Seen, Spells
from passerby.report.tables import MISSING, UNKNOWN

SHOWN_REASONS = MOST_SHOWN
"""Number of reasons that are shown at first; a reader can open the rest."""


def headline_section(contents: Contents, seen: Seen) -> Section:
    """Return the section with the verdict, the problems and their remedies, and the findings about the input."""
    verdict, document = contents.verdict, contents.document
    return section(
        "summary", "Verdict", verdict=verdict, shown=SHOWN_REASONS,
        good_for=_describe_usability(contents) if verdict == "doubtful" else "",
        figures=_figures(contents, seen.spells), reasons=points_of(reported_doubts(document)),
        weak=weak_points(contents, seen) if verdict != "refused" else [],
        warnings=[sentence(text) for text in document.findings], groups=document.groups or (),
    )  # fmt: skip


def _describe_usability(contents: Contents) -> str:
    """Describe what a doubtful rig can still be used for."""
    doubts = [one.finding for one in reported_doubts(contents.document) if one.finding is not None]
    return good_for(doubts, contents.rig.posed().names, contents.figures.measuring)


def _figures(contents: Contents, spells: Spells) -> list[tuple[str, str]]:
    """Return the key figures with labels; a dash if a figure is undefined, `UNKNOWN` if no evidence constrains it."""
    figures = contents.figures
    scale, used = figures.scale.relative_sigma, figures.people
    vertical = figures.vertical_sigma_deg if figures.up is None else figures.up.gravity_sigma_deg
    people = len(spells.people) if used is None else used.identities
    posed, every = len(contents.rig.posed()), len(contents.rig)
    begin, end = spells.span
    lasted = _duration(end - begin) if spells.in_seconds else f"{end - begin:.0f} frames"
    sigmas = [one.position_sigma_mm for one in contents.cameras.values()]
    worst = max((sigma for sigma in sigmas if sigma is not None), default=None)
    free = figures.undetermined or ()
    scale_told, vertical_told = (UNKNOWN if one in free else MISSING for one in ("scale", "vertical"))
    return [
        ("cameras with a pose", f"{posed} of {every}"),
        *_measuring(figures.measuring),
        ("scale uncertainty (1 sigma)", scale_told if scale is None else f"± {100 * scale:.1f} %"),
        ("worst camera position uncertainty", UNKNOWN if free else MISSING if worst is None else f"± {_length(worst)}"),
        ("up direction uncertainty (1 sigma)", vertical_told if vertical is None else f"± {vertical:.1f}°"),
        ("median error on people held out", _describe_held_out(figures.held_out)),
        (_people_label(contents, used is not None), str(people) if people else MISSING),
        ("recording length", lasted if len(spells) else MISSING),
    ]


def _measuring(measuring: MeasuringFigures | None) -> list[tuple[str, str]]:
    """Return the rig's measuring accuracy where people walked, with labels."""
    if measuring is None:
        return []
    ground = MISSING if measuring.ground is None else f"± {_length(measuring.ground.median_mm)}"
    points = f"± {_length(measuring.points.median_mm)}"
    return [("points by several cameras (1 sigma)", points), ("positions on the ground by one camera (1 sigma)", ground)]


def _describe_held_out(held_out: HeldOutFigures | None) -> str:
    """Write the median error on people who were held out, in pixels and on the ground."""
    if held_out is None or held_out.held_out.median_px is None:
        return MISSING
    metres = held_out.held_out.ground_50_m
    return f"{held_out.held_out.median_px:.1f} px" + ("" if metres is None else f", {_length(1000 * metres)}")


def _people_label(contents: Contents, used: bool) -> str:
    """Return the label of the count: people if identities were given, otherwise tracks, as one person may have several."""
    given = contents.document.scene.association.mode in (None, "given")
    if used:
        return "people used" if given else "tracks used"
    return "people" if given else "tracks"


def _length(millimetres: float) -> str:
    """Write a length: 12 mm, 38 cm, 1.2 m."""
    if millimetres < 100:
        return f"{millimetres:.0f} mm"
    return f"{millimetres / 10:.0f} cm" if millimetres < 1000 else f"{millimetres / 1000:.1f} m"


def _duration(seconds: float) -> str:
    """Write a duration: 60 s, 12 min 5 s, 1 h 2 min."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    hours, minutes, rest = whole // 3600, whole % 3600 // 60, whole % 60
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def scene_name(contents: Contents) -> str:
    """Return the name of the scene."""
    return contents.document.name or "scene"
