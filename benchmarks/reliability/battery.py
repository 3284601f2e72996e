"""Does the verdict let a wrong rig pass, and does it let right ones pass? Hostile cases and ordinary scenes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pages.page import Page, table
from pages.sections import Found
from reliability import hostile, ordinary
from reliability.hostile import EVERY
from reliability.judging import MOST_M, MOST_SIGMAS
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept, percent, seeds

HOSTILE_SEEDS = seeds(106_000, 1)
ORDINARY_SEEDS = seeds(107_000, 200)
QUICK_CASES = ("line-given", "court-confused", "flipped", "focal-20-all", "moved-pan-15", "drift-4", "slope-10", "apart-found")
QUICK_ORDINARY = 6
CASES_PAGE = "results/hostile"
"""Name of the page of all hostile cases, beside the page of reliability."""
MOST_REFUSED = 0.03
"""Share of the ordinary scenes that may be turned down."""


def run(wanted: Wanted) -> Found:
    """All hostile cases and all ordinary scenes; a few of each in a quick run."""
    names = QUICK_CASES if wanted.quick else tuple(EVERY)
    cases = {f"{name} {seed}": (name, seed) for seed in HOSTILE_SEEDS for name in names}
    found = kept(wanted, "hostile", cases, hostile.work)
    scenes = {str(seed): seed for seed in (ORDINARY_SEEDS[:QUICK_ORDINARY] if wanted.quick else ORDINARY_SEEDS)}
    usual = kept(wanted, "ordinary", scenes, ordinary.work)
    pages = (_cases_page(cases, found),)
    return part_found(_lines(found, usual), _text(cases, found, usual), quick=wanted.quick, further=pages)


def false_accepts(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The cases that were accepted although a camera is off."""
    return [key for key, result in found.items() if result["verdict"] == "accepted" and result["wrong"]]


def _lines(found: Mapping[str, Mapping[str, Any]], usual: Mapping[str, Mapping[str, Any]]) -> list[Line]:
    """What goes into the table over all parts."""
    wrong = false_accepts(found)
    wrong_usual = false_accepts(usual)
    lines = [Line(f"wrong rigs accepted, {len(found)} hostile cases", str(len(wrong)), "0", not wrong)]
    for kind, results in _by_kind(usual).items():
        passed = sum(result["verdict"] == "accepted" for result in results)
        lines.append(
            Line(f"rigs accepted, {len(results)} ordinary scenes of {kind}", percent(passed, len(results)), "97 % or more",
                 passed >= (1 - MOST_REFUSED) * len(results))
        )  # fmt: skip
    return [*lines, Line(f"wrong rigs accepted, {len(usual)} ordinary scenes", str(len(wrong_usual)), "0", not wrong_usual)]


def _by_kind(usual: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The results of ordinary scenes by what is handed in."""
    out: dict[str, list[Mapping[str, Any]]] = {}
    for result in usual.values():
        out.setdefault(result["kind"], []).append(result)
    return {kind: out[kind] for kind in sorted(out)}


def _text(
    cases: Mapping[str, tuple[str, int]], found: Mapping[str, Mapping[str, Any]], usual: Mapping[str, Mapping[str, Any]]
) -> str:
    """The section."""
    counts = table(
        ("verdict", "rig right", "rig wrong", "no rig"),
        [[verdict, *_rigs([one for one in found.values() if one["verdict"] == verdict])] for verdict in _VERDICTS],
    )
    wrong = {key: found[key] for key in false_accepts(found)}
    turned_down = [result for result in usual.values() if result["verdict"] != "accepted"]
    why = Counter(_kind(reason) for result in turned_down for reason in result["reasons"])
    reasons = table(("reason", "scenes"), [[reason, str(count)] for reason, count in why.most_common()])
    verdicts = table(
        ("handed in", "scenes", "accepted", "doubtful", "refused", "wrong and accepted"),
        [
            [kind, str(len(results)), *(str(sum(one["verdict"] == verdict for one in results)) for verdict in _VERDICTS),
             str(sum(one["verdict"] == "accepted" and one["wrong"] for one in results))]
            for kind, results in _by_kind(usual).items()
        ],
    )  # fmt: skip
    return f"""
{_HEAD}

{len(found)} [hostile cases]({CASES_PAGE}.md), by verdict. The calibration does not know the truth:

{counts}

Wrong rigs that were accepted:

{_case_table(cases, wrong) if wrong else "None."}

### Ordinary scenes

{len(usual)} scenes of all three presets, 3 to 8 cameras, 4 to 14 people, 20 to 60 s, boxes off by 1 to 4 % of their height, up
to 10 % false and 10 % missing, half of them without identities and with time offsets up to 2 s. Of a part there are joints (off
by 1 to 3 px), or videos alone, in which people are detected (at most four cameras, eight people and 30 s); of some the lenses
are unknown. How tall people are is known of none.

{verdicts}

The reasons why scenes were not accepted:

{reasons if turned_down else "None was turned down."}
"""


def _cases_page(cases: Mapping[str, tuple[str, int]], found: Mapping[str, Mapping[str, Any]]) -> Page:
    """The page of all hostile cases."""
    return Page(CASES_PAGE, f"# Hostile cases\n\n{_CASES_HEAD}\n\n{_case_table(cases, found)}\n")


def _case_table(cases: Mapping[str, tuple[str, int]], found: Mapping[str, Mapping[str, Any]]) -> str:
    """One row for each case."""
    head = ("case", "verdict", "worst camera, mm", "degrees", "placed, mm", "first reason")
    return table(
        head,
        [
            [EVERY[cases[key][0]][0], result["verdict"], *_errors(result), _first(result["reasons"])]
            for key, result in found.items()
        ],
    )


def _rigs(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many of the results are right rigs, wrong rigs, and none."""
    wrong, none = sum(one["wrong"] for one in results), sum("similarity_mm" not in one for one in results)
    return [str(len(results) - wrong - none), str(wrong), str(none)]


_VERDICTS = ("accepted", "doubtful", "refused")
_CASES_HEAD = """Each case of the battery behind [the verdict](../reliability.md#the-verdict), which explains the columns. The
errors of wrong rigs are bold."""
_HEAD = f"""A rig counts as wrong by what it measures where people walked: after the best similarity of the whole rig, one
of ten points above the ground that cameras share is off by more than {MOST_M:g} m, or one camera's positions on the ground (the
median) by more than {MOST_M:g} m and {MOST_SIGMAS:g} of their stated sigmas, or the scale by more than {MOST_SIGMAS:g} of its
stated sigmas (it depends on the assumed height of people, and the sigma includes this). Pixels are those of the images that
were handed in: where an image was cropped or is smaller than stated, a rig with the right intrinsics for it is right. The three
columns of errors are those of the worst camera: after similarity alignment, and after the best placement along the ground. A
camera that moves has to be right before and after. A hostile case may be accepted if its rig is right.

Some cases cannot be detected by any rule, because all observations fit:

- *All* images are mirrored left to right. Then the rig is the mirror image of the true one: mirrored cameras that look at a
  mirrored world show just these images, and people have no sides that boxes show.
- One camera stands in another place, in which people do the same at the same times under the same names. As far as they do, its
  images are those of a camera in the first place.
- People move exactly point-symmetrically, and one camera's given identities are those of the opponents. That camera on the
  opposite side would see just these boxes under these names. (If identities are found, that is `arrangement_ambiguous`.)
- All that the boxes show is larger or smaller by one factor, and nothing else is known of the scale. A world and its copy at
  another scale have the same images, so only how tall, how wide and how fast people are speaks about the metre. People with
  umbrellas or crates, or on stilts, who are not too wide and do not walk too fast for it, are people of a smaller world.
  Lengths that are all stated in another unit are likewise the lengths of a larger world, if people may be as tall as that.
- A lens so long that people all appear equally large is stated too long, and the camera is taken to be farther away by as
  much. In the limit of parallel rays an image depends on the focal length and the distance by their ratio alone. (The figures
  `focal_change` and `focal_change_sigma` say how little is known; a refined one makes it a part of the sigma.)"""


def _errors(result: Mapping[str, Any]) -> list[str]:
    """The columns of errors; bold where they are too large."""
    if "similarity_mm" not in result:
        return ["-", "-", "-"]
    mark = "**" if result["wrong"] else ""
    return [f"{mark}{result[key]:{form}}{mark}" for key, form in
            (("similarity_mm", ".0f"), ("similarity_deg", ".2f"), ("placed_mm", ".0f"))]  # fmt: skip


def _first(reasons: Sequence[str]) -> str:
    """The first reason, short."""
    if not reasons:
        return "-"
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return reasons[0].replace("|", "/") + more


def _kind(reason: str) -> str:
    """A reason without its names and numbers."""
    return re.sub(r"\bC\d+\b", "C", re.sub(r"-?\d+(\.\d+)?", "N", reason))
