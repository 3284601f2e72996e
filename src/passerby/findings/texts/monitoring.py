"""Texts about a rig in use."""

from __future__ import annotations

from collections.abc import Mapping

from passerby.findings.texts.kinds import NOTICE, Fields, Kind

__all__ = ["MONITORING"]


def _as_of(v: Fields) -> str:
    if v["first"] is None:
        return ""
    span = v["first"] if v["first"] == v["last"] else f"{v['first']} to {v['last']}"
    return f" (files of {span})"


def _thinned(v: Fields) -> str:
    parts = [f"samples {v['every_s']:g} s apart"] if v["every_s"] else []
    parts += [f"one window in {v['one_window_in']}"] if v["one_window_in"] > 1 else []
    what = f"of the footage only {' of '.join(parts)} {'are' if v['every_s'] else 'is'} used"
    within = v["predicted_s"] <= v["budget_s"]
    said = "to stay within" if within else f"and yet it takes about {v['predicted_s']:.2g} s, more than"
    return f"{what}, {said} {v['budget_s']:g} s of processor time for each camera and minute"


MONITORING: Mapping[str, Kind] = {
    "no_news": Kind(
        NOTICE, "Cameras have no new footage since an earlier run of the monitor: they were not read again.",
        lambda v: f"{v['count']} camera{'s have' if v['count'] > 1 else ' has'} no new footage since the last run: "
        f"{'their states are' if v['count'] > 1 else 'its state is'} taken over from there{_as_of(v)}",
    ),
    "news_alone": Kind(
        NOTICE, "A camera has new footage that nothing can be compared with, because none of its neighbours has any.",
        "{who}: no neighbour has new footage, too: tested as soon as one has; until then the last run's state is taken over",
        common=True,
    ),
    "news_without_people": Kind(
        NOTICE, "A camera had moved in an earlier run, and its new footage tells nothing.",
        "{who}: too few people in the new footage: what the last run found is taken over", common=True,
    ),
    "monitoring_thinned": Kind(
        NOTICE, "The monitor uses only a part of the footage, to stay within its budget of processor time.", _thinned,
        "give a larger --budget to use more of it",
    ),
    "earlier_run_broken": Kind(
        NOTICE, "What an earlier run of the monitor wrote cannot be read: all cameras are monitored.",
        "what the last run wrote there cannot be read or is not complete: all cameras are monitored",
    ),
}  # fmt: skip
