"""What a doubtful rig is still good for, in one line."""

from __future__ import annotations

from collections.abc import Sequence

from passerby.common.text import listed
from passerby.core.measuring_figures import MeasuringFigures
from passerby.findings.finding import Finding
from passerby.findings.ranking import reasons_of
from passerby.findings.texts import subjects_of


def good_for(doubts: Sequence[Finding], posed: Sequence[str], measuring: MeasuringFigures | None) -> str:
    """What a doubtful rig can be used for, as a sentence.

    Doubts about the scale or the up direction alone leave the shape of the rig; doubts about some cameras leave the others.

    Args:
        doubts: the evidence against the rig.
        posed: names of the cameras with a pose.
        measuring: how well the rig measures; None where that is unknown.
    """
    causes = [one for reason in reasons_of(doubts) for one in reason.findings]
    about_shape = [one for one in causes if not subjects_of(one)]
    named = {name for one in about_shape for name in one.cameras}
    sound = [name for name in posed if name not in named]
    if any(not one.cameras for one in about_shape) or (named and len(sound) < 2):
        return "Still good for the rough layout of the cameras and for counting people."
    subjects = {subject for one in causes for subject in subjects_of(one)}
    lacks = [{"scale": "the scale", "vertical": "the up direction and the ground"}[one] for one in sorted(subjects)]
    who = f"what cameras {listed(sound)} see" if named else "what the cameras see"
    text = f"Still good for {who}{_figures(measuring, ground='vertical' not in subjects, metres='scale' not in subjects)}"
    return f"{text}; not for {' and '.join(lacks)}." if lacks else f"{text}."


def _figures(measuring: MeasuringFigures | None, *, ground: bool, metres: bool) -> str:
    """How well points and positions are known, where that can be said in metres."""
    if measuring is None or not metres:
        return ", up to the scale" if not metres else ""
    told = [f"points to {measuring.points.median_mm / 10:.0f} cm"]
    if ground and measuring.ground is not None:
        told.append(f"positions on the ground to {measuring.ground.median_mm / 10:.0f} cm")
    return f": {', '.join(told)} (1 sigma)"
