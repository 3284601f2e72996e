"""Tables 1 and 2 of the paper, from pixels: matchers of picture points, annotations, boxes and people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

from baselines import MATCHERS
from metrics.epipolar import RIGHT_PX
from pages.page import Page, number, table, yes
from paper.match_picture import MOST_DRAWN
from paper.paper_figures import POSES, REPROJECTIONS, SCENES
from paper.pixel_jobs import DRAWN_CAMERA, REAL, Done, jobs, run_job
from paper.pixel_real import BOXES
from paper.pixel_rows import NOT_RUN, ROWS, PixelOutcome
from paper.pixel_stage import (
    JOINT_NOISE_PX,
    JUDGE_NOISE_PX,
    JUDGED,
    LENGTH_M,
    LENGTH_NOISE_PX,
    ORACLE_NOISE_PX,
    PRIOR_HEIGHTS_M,
    PRIOR_LENGTHS_M,
)
from paper.rendered import FPS, SECONDS
from paper.spread import FAILS, failures, median, median_errors, verdicts
from paper.wanted import Wanted
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.solver.geopose.pairs import GeoPoseOptions

PRESETS, QUICK_PRESETS = ("terrace", "basketball", "construction"), ("terrace", "basketball")
SEEDS, QUICK_SEEDS = 3, 1
QUICK_SECONDS = 25.0
MOMENTS, QUICK_MOMENTS = 2, 1
"""Instants that the matchers see: the cameras stand still, so that more of them add little but people who moved."""
DEFAULT, WITH_PRIOR = "people", "people-prior"
PEOPLE = ("boxes-by-hand", "boxes-re-id", "trajectories", "people", "people-prior", "people-by-hand", "keypoints")
COLLAPSED_DEG = 10.0
"""Means over the cameras beyond this say that at least one camera points elsewhere."""


@dataclass(frozen=True)
class Measured:
    """Outcomes by preset, row and seed; those of the real sets by set and row."""

    presets: tuple[str, ...]
    seeds: int
    rows: Mapping[tuple[str, str], tuple[PixelOutcome, ...]]
    real: Mapping[str, Done]


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Page:
    """Three rendered scenes, three seeds, and the pictures of two real sets; two shorter scenes and one seed in a quick run."""
    presets = QUICK_PRESETS if wanted.quick else PRESETS
    seeds = wanted.seeds or (QUICK_SEEDS if wanted.quick else SEEDS)
    seconds, moments = (QUICK_SECONDS, QUICK_MOMENTS) if wanted.quick else (SECONDS, MOMENTS)
    data = None if wanted.quick else wanted.data
    work = jobs(presets, seeds, seconds, moments, wanted.kept, wanted.scenes, data)
    done = dict(zip(work, side_by_side(run_job, work, executor, tell, "paper"), strict=True))
    films = {(job.name, job.seed): result for job, result in done.items() if job.data is None}
    rows = {
        (preset, row.name): tuple(films[preset, seed].outcomes[row.name] for seed in range(seeds))
        for preset in presets
        for row in ROWS
    }
    real = {job.name: result for job, result in done.items() if job.data is not None}
    measured = Measured(presets, seeds, rows, real)
    plots = {
        f"paper-{job.name}-{name}.jpg": picture for job, result in done.items() for name, picture in result.pictures.items()
    }
    scene_tables = (f"### {preset} (the paper: {SCENES[preset]})\n\n{_poses(measured, preset)}" for preset in presets)
    text = _TEXT.format(
        seeds=f"{seeds} seed{'s' if seeds > 1 else ''}", seconds=f"{seconds:g}", fps=f"{FPS:g}", length=f"{LENGTH_M:g}",
        length_noise=f"{LENGTH_NOISE_PX:g}", prior=_prior(presets), marked=f"{ORACLE_NOISE_PX:g}", judged=JUDGED,
        judge_noise=f"{JUDGE_NOISE_PX:g}", joints=f"{JOINT_NOISE_PX:g}",
        moments=f"{moments} instant{'s' if moments > 1 else ''}", claim=_claim(measured), collapsed=f"{COLLAPSED_DEG:g}",
        goals=_goals(measured), poses="\n\n".join(scene_tables), reprojections=_reprojections(measured),
        real=_real(measured, wanted.quick), pictures=_pictures(plots), camera=DRAWN_CAMERA, not_run=_not_run(measured),
        appearance=_looks(measured), right=RIGHT_PX, drawn=MOST_DRAWN, least=GeoPoseOptions.min_correspondences,
        left_out="" if presets == PRESETS else "; construction, whose pictures are the largest, is left out of a quick run",
    )  # fmt: skip
    return Page("paper", text, plots)


_TEXT = """# The paper's Tables 1 and 2, from pixels

Three rendered scenes stand for the paper's three real ones: `passerby simulate --preset ... --video`, {seconds} s at {fps}
pictures a second, four cameras, {seeds}{left_out}. Every row makes correspondences of its own; all but those called *ours* then
go through the same solver, GeoPose as in the paper. Lenses are known, poses are not.

- *Matchers* see the reference, C1, with each other camera at {moments}; what they find goes into one solve. Their scale, and
  the oracle's, is one line of {length} m marked in the views to {length_noise} px, the paper's free-throw line. A camera gets
  a pose where {least} matches or more agree on it.
- *oracle*: true points of people and of the ground, as marked by hand.
- *boxes*: what the detector without a network finds in the videos. *named by hand*: each box has the identity of the true box
  that it stands for. *by re-identification*: by looks alone ({appearance}). Their scale is the height of people.
- *ours*: the same boxes, and the person model. *trajectories*: who is who by how they move; *the default*: by looks too.
  *joints*: those of the simulation, moved by {joints} px, without identities. Their scale is the height of people, as the
  population has it.
- *with the paper's prior knowledge*: the default, given what the paper took the scale of that scene from: {prior}. The ends of
  a length are marked in the views to {marked} px. The simulated people are 1.72 m tall on average.

A figure is the median over the seeds. **fails**: a camera is missing, or the calibration was refused, in half of the seeds; no
mean is taken over what is left. A row that could not run here is *not run*, with the reason below; nothing is estimated.
SuperGlue's weights are for research that is not commercial, so LightGlue, by the same authors, stands in its place; XFeat and
DISK, which the paper does not have, bring their weights with their packages.

## Do matchers collapse where people do not?

The best picture matcher and the worst row with people, by the orientation error (similarity). *collapsed*: matchers that fail
or are off by more than {collapsed}° on average.

{claim}

## Against the paper

Metric errors of the default method, without and with the paper's prior knowledge, and the best of all rows of the paper's
Table 1 on the real scene.

{goals}

## Table 1: camera poses

*metric*: the reference camera held and the scale as found, the paper's measure. *similarity*: scale and place set by the truth.
*right*: matches within {right:g} px of their epipolar lines by the true cameras, and all matches, over pairs and seeds.

{poses}

## Table 2: reprojection of annotated correspondences

{judged} other points a scene, marked by hand to {judge_noise} px in all views that show them, triangulated with the estimated
cameras and projected again: RPE is the mean distance in pixels, ERR is RPE over the shorter side of the picture. A small RPE
says nothing of the scale, and little of a rig that is bent as a whole. No mark's error counts for more than the picture's
diagonal.

{reprojections}

## Matchers on real pictures

WILDTRACK: six cameras, one instant, 1920 x 1080 (C7 had moved and is left out); CMU Panoptic: five cameras of a dome,
{moments}. Pictures are looked at in half their size; the sets' own cameras are the truth. The scale is a line of {length} m on
the ground, or a pipe of 1 m in the dome, marked in the views. *boxes of annotated people*: those of WILDTRACK's annotations, at
200 other instants, who is who given, the scale from the height of people; the dome's pictures have no annotations.

{real}

## What the matches look like

Rendered terrace, C1 and {camera}, which look from opposite sides: green within {right:g} px of the epipolar line, red
otherwise. At most {drawn} are drawn; the counts are of all. Those of *ours* are the box centres of the same people at all
instants, of which the picture shows one. Green is not yet right, for the place along the line is free: cameras of one height
see their horizons on one line, so that a tree matched with another tree may be green.

{pictures}
{not_run}"""


def _ran(outcomes: Sequence[PixelOutcome]) -> bool:
    return all(outcome.verdict != NOT_RUN for outcome in outcomes)


def _claim(measured: Measured) -> str:
    rows = []
    for preset in measured.presets:
        by_row = {row.name: measured.rows[preset, row.name] for row in ROWS}
        matchers = [name for name in MATCHERS if _ran(by_row[name])]
        best = min(matchers, key=lambda name: median(by_row[name], "similarity_deg"))
        worst = max(PEOPLE, key=lambda name: median(by_row[name], "similarity_deg"))
        collapsed = sum(median(by_row[name], "similarity_deg") > COLLAPSED_DEG for name in matchers)
        rows.append([
            preset, MATCHERS[best], median_errors(by_row[best], "similarity"), f"{collapsed} of {len(matchers)}",
            _label(worst), median_errors(by_row[worst], "similarity"),
        ])  # fmt: skip
    return table(("scene", "best matcher", "similarity", "collapsed", "worst row with people", "similarity"), rows)


def _label(name: str) -> str:
    return next(row.label for row in ROWS if row.name == name)


def _prior(presets: Sequence[str]) -> str:
    """What the paper knew of each scene's scale."""
    known = {
        **{preset: f"people of {metres:g} m" for preset, metres in PRIOR_HEIGHTS_M.items()},
        **{preset: f"a line of {metres:.1f} m on the ground" for preset, metres in PRIOR_LENGTHS_M.items()},
    }
    return ", ".join(f"{known[preset]} ({preset})" for preset in presets)


def _goals(measured: Measured) -> str:
    rows = []
    for preset in measured.presets:
        best = tuple(min(figures[preset][k] for figures in POSES.values()) for k in (0, 1))
        cells = []
        for name in (DEFAULT, WITH_PRIOR):
            found = measured.rows[preset, name]
            mm, degrees = median(found, "metric_mm"), median(found, "metric_deg")
            cells += [median_errors(found, "metric"), yes(mm < best[0] and degrees < best[1])]
        rows.append([preset, f"{best[0]:.0f} mm {best[1]:.2f}°", *cells])
    return table(("scene", "the paper's best", _label(DEFAULT), "better", _label(WITH_PRIOR), "better"), rows)


def _poses(measured: Measured, preset: str) -> str:
    rows = []
    for row in ROWS:
        outcomes = measured.rows[preset, row.name]
        paper = POSES.get(row.name, {}).get(preset)
        cells = [NOT_RUN, "", "", "", ""]
        if _ran(outcomes):
            cells = [median_errors(outcomes, "metric"), median_errors(outcomes, "similarity"), failures(outcomes),
                     _right(outcomes), verdicts(outcomes)]  # fmt: skip
        rows.append([row.label, "-" if paper is None else f"{paper[0]:.0f} mm {paper[1]:.2f}°", *cells])
    return table(("row", "paper, metric", "metric", "similarity", "failed", "right", "verdicts"), rows)


def _looks(measured: Measured) -> str:
    """What told people apart."""
    used = {
        outcome.appearance
        for outcomes in measured.rows.values()
        for outcome in outcomes
        if outcome.appearance not in ("", "none")
    }
    return ", ".join("colours of horizontal stripes" if name == "stripes" else name for name in sorted(used))


def _right(outcomes: Sequence[PixelOutcome]) -> str:
    """Right matches of all, over the seeds."""
    if any(outcome.matches is None for outcome in outcomes):
        return ""
    return f"{sum(outcome.right or 0 for outcome in outcomes)} of {sum(outcome.matches or 0 for outcome in outcomes)}"


def _reprojections(measured: Measured) -> str:
    rows = []
    for row in ROWS:
        cells = [row.label]
        for preset in measured.presets:
            paper = REPROJECTIONS.get(row.name, {}).get(preset)
            cells.append("-" if paper is None else f"{paper[0]:g} px {paper[1]:g} %")
            outcomes = measured.rows[preset, row.name]
            rpe, err = median(outcomes, "rpe_px"), median(outcomes, "err_percent")
            found = f"{number(rpe, 2)} px {number(err, 2)} %" if math.isfinite(rpe) else FAILS
            cells.append(found if _ran(outcomes) else NOT_RUN)
        rows.append(cells)
    return table(("row", *(cell for preset in measured.presets for cell in (f"{preset}, paper", preset))), rows)


def _real(measured: Measured, quick: bool) -> str:
    if not measured.real:
        return "*not run*: left out of a quick run." if quick else "*not run*: data not here; name their folder with `--data`."
    rows, labels = [], {**MATCHERS, **BOXES}
    for name in REAL:
        done = measured.real[name]
        if done.missing is not None:
            rows.append([name, "all", f"{NOT_RUN}: {done.missing}", "", "", ""])
        for matcher, outcome in done.outcomes.items():
            cells = [NOT_RUN, "", "", ""]
            if outcome.verdict != NOT_RUN:
                registered = f"{outcome.registered} of {outcome.cameras}"
                cells = [median_errors([outcome], "metric"), median_errors([outcome], "similarity"), registered,
                         _right([outcome])]  # fmt: skip
            rows.append([name, labels[matcher], *cells])
    return table(("pictures", "row", "metric", "similarity", "cameras", "right"), rows)


def _pictures(plots: Mapping[str, object]) -> str:
    return "\n\n".join(f"![Matches between two views: {name.rsplit('-', 1)[-1][:-4]}]({name})" for name in plots)


def _not_run(measured: Measured) -> str:
    """Why rows could not run, one line each."""
    why = {
        row.label: outcome.reason
        for row in ROWS
        for preset in measured.presets
        for outcome in measured.rows[preset, row.name]
        if outcome.verdict == NOT_RUN
    }
    if not why:
        return ""
    return "\n## Not run\n\n" + "\n".join(f"- {label}: {reason}" for label, reason in why.items()) + "\n"
