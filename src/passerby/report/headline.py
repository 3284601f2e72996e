"""The first screen: the verdict, why, what to do, and the figures that matter most."""

from __future__ import annotations

from collections.abc import Sequence

from passerby.common.text import shortened_text
from passerby.core.figures import HeldOutFigures
from passerby.core.measuring import MeasuringFigures
from passerby.findings.ranking import MOST_SHOWN
from passerby.interchange.calibration_json import GroupEntry
from passerby.interchange.output_folder import REPORT_FILE
from passerby.report.contents import Contents
from passerby.report.distances import weak_points
from passerby.report.html import Html, Section, element
from passerby.report.recommendations import Point, good_for, points_of, reported_doubts, sentence
from passerby.report.seen import Seen, Spells
from passerby.report.tables import MISSING, UNKNOWN, count

WORDS = {"accepted": "Accepted", "doubtful": "Doubtful", "refused": "Refused"}
MEANINGS = {
    "accepted": "The calibration is reliable within the uncertainties stated here.",
    "doubtful": "There is a rig, but it is unreliable until the problems below are fixed.",
    "refused": "The calibration failed: there is too little evidence for a reliable rig. Fix the problems below and calibrate "
    "again.",
}
# A tick, an exclamation mark, a cross: the verdict must not hang on its colour.
ICONS = {
    "accepted": "M7 16.5l6 6L25 10",
    "doubtful": "M16 7v12M16 24.2v.6",
    "refused": "M9 9l14 14M23 9L9 23",
}
SHOWN_REASONS = MOST_SHOWN
"""The rest can be opened."""


def headline_section(contents: Contents, seen: Seen) -> Section:
    """The verdict and all that explains it."""
    verdict = contents.verdict
    reasons = points_of(reported_doubts(contents.document))
    banner = element(
        "div",
        icon(verdict),
        element(
            "div",
            element("h1", element("span", "Calibration ", class_="unseen"), WORDS[verdict], id="verdict"),
            element("p", MEANINGS[verdict], class_="meaning"),
            element("p", _describe_usability(contents), class_="meaning") if verdict == "doubtful" else None,
        ),
        class_="banner",
    )
    parts = [
        banner,
        _figures(contents, seen.spells),
        _points("Problems", "reasons", reasons),
        _points("Possible improvements", "weak", weak_points(contents, seen)) if verdict != "refused" else None,
        _findings(contents.document.findings),
        _groups(contents.document.groups or ()),
    ]
    return Section("summary", "", "", element("div", parts, class_=f"summary verdict-{verdict}"), "Verdict")


def _describe_usability(contents: Contents) -> str:
    """What a doubtful rig is still good for."""
    doubts = [one.finding for one in reported_doubts(contents.document) if one.finding is not None]
    return good_for(doubts, contents.rig.posed().names, contents.figures.measuring)


def icon(verdict: str, size: int = 32) -> Html:
    """The verdict as a sign; its word stands beside it."""
    sign = element("path", d=ICONS.get(verdict, ICONS["refused"]))
    disc = element("circle", cx=16, cy=16, r=16)
    return element("svg", disc, sign, class_="icon", viewBox="0 0 32 32", width=size, height=size, aria_hidden="true")


def _figures(contents: Contents, spells: Spells) -> Html:
    """The key figures, a dash where one is undefined, a word where nothing fixes what it is of."""
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
    told = [
        ("cameras with a pose", f"{posed} of {every}"),
        *_measuring(figures.measuring),
        ("scale uncertainty (1 sigma)", scale_told if scale is None else f"± {100 * scale:.1f} %"),
        ("worst camera position uncertainty", UNKNOWN if free else MISSING if worst is None else f"± {_length(worst)}"),
        ("up direction uncertainty (1 sigma)", vertical_told if vertical is None else f"± {vertical:.1f}°"),
        ("median error on people held out", _describe_held_out(figures.held_out)),
        (_people_label(contents, used is not None), str(people) if people else MISSING),
        ("recording length", lasted if len(spells) else MISSING),
    ]
    return element(
        "dl",
        [element("div", element("dt", name), element("dd", value)) for name, value in told],
        class_="key-figures",
    )


def _measuring(measuring: MeasuringFigures | None) -> list[tuple[str, str]]:
    """How well the rig measures where people walked."""
    if measuring is None:
        return []
    ground = MISSING if measuring.ground is None else f"± {_length(measuring.ground.median_mm)}"
    points = f"± {_length(measuring.points.median_mm)}"
    return [("points by several cameras (1 sigma)", points), ("positions on the ground by one camera (1 sigma)", ground)]


def _describe_held_out(held_out: HeldOutFigures | None) -> str:
    """How far off each camera sees people who were not fitted."""
    if held_out is None or held_out.held_out.median_px is None:
        return MISSING
    metres = held_out.held_out.ground_50_m
    return f"{held_out.held_out.median_px:.1f} px" + ("" if metres is None else f", {_length(1000 * metres)}")


def _people_label(contents: Contents, used: bool) -> str:
    """What the count counts: people where identities were given; tracks where they were found, several of which may be one
    person's.
    """
    given = contents.document.scene.association.mode in (None, "given")
    if used:
        return "people used" if given else "tracks used"
    return "people" if given else "tracks"


def _length(millimetres: float) -> str:
    """12 mm, 38 cm, 1.2 m."""
    if millimetres < 100:
        return f"{millimetres:.0f} mm"
    return f"{millimetres / 10:.0f} cm" if millimetres < 1000 else f"{millimetres / 1000:.1f} m"


def _duration(seconds: float) -> str:
    """60 s, 12 min 5 s, 1 h 2 min."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    hours, minutes, rest = whole // 3600, whole % 3600 // 60, whole % 60
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def _points(title: str, kind: str, points: list[Point]) -> Html | None:
    """What is wrong beside what to do; nothing where nothing is."""
    if not points:
        return None
    rows = [element("li", element("p", point.problem, class_="what"), _remedy(point)) for point in points]
    shown, more = rows[:SHOWN_REASONS], rows[SHOWN_REASONS:]
    rest = element("details", element("summary", count(len(more), "more point")), element("ul", more)) if more else None
    return element("div", element("h2", title), element("ul", shown), rest, class_=f"points {kind}")


def _remedy(point: Point) -> Html:
    """What to do."""
    return element("p", element("span", "To do ", class_="to-do"), point.remedy, class_="remedy")


def _findings(findings: Sequence[str]) -> Html | None:
    """What is odd about the input."""
    if not findings:
        return None
    rows = [element("li", sentence(text)) for text in findings]
    shown, more = rows[:SHOWN_REASONS], rows[SHOWN_REASONS:]
    rest = element("details", element("summary", count(len(more), "more note")), element("ul", more)) if more else None
    return element("div", element("h2", "Warnings"), element("ul", shown), rest, class_="points findings")


def _groups(groups: Sequence[GroupEntry]) -> Html | None:
    """The further groups of cameras, each with a link to its own report; nothing where there are none."""
    if not groups:
        return None
    rows = [
        element(
            "li", element("a", f"Group {one.group}", href=f"{one.folder}/{REPORT_FILE}"),
            f": {WORDS[one.verdict].lower()}, {one.registered} of {len(one.cameras)} cameras with a pose "
            f"({shortened_text(', '.join(one.cameras))})",
        )
        for one in groups
    ]  # fmt: skip
    return element("div", element("h2", "Groups with a rig of their own"), element("ul", rows), class_="points groups")


def scene_name(contents: Contents) -> str:
    """What the scene is called."""
    return contents.document.name or "scene"


def verdict_pill(contents: Contents) -> Html:
    """The verdict in small, for the bar at the top."""
    verdict = contents.verdict
    return element("a", icon(verdict, 16), WORDS[verdict], href="#summary", class_=f"pill verdict-{verdict}")
