"""Tables 1 and 2 of the paper, from pixels: matchers of picture points, annotations, boxes and people."""

from __future__ import annotations

import base64
import math
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from baselines import MATCHERS, Matches
from pages.kept import Kept
from pages.records import Found
from pages.tables import Table, number, table, yes
from paper.match_picture import as_jpeg, draw_matches
from paper.paper_figures import POSES, REPROJECTIONS
from paper.parts import Wanted
from paper.pixel_real import BOXES, RealViews, panoptic, run_boxes, run_matcher, wildtrack
from paper.pixel_rows import NOT_RUN, ROWS, PixelOutcome, run_row
from paper.pixel_stage import Stage
from paper.plots import FAILS, failures, median, median_errors, verdicts
from paper.rendered import FPS, SECONDS, rendered
from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress
from passerby.simulation import SimulationOptions

DRAWN = ("sift", "superpoint-lightglue", "wxbs", "xfeat", "disk-lightglue", "people")
"""Rows whose matches are drawn, where they ran."""
DRAWN_CAMERA = "C3"  # drawn with the reference: the two look from opposite sides


@dataclass(frozen=True)
class Job:
    """One rendered scene (preset and seed), or one real data set (data)."""

    name: str  # of the preset, or of the data set
    moments: int
    kept: Path | None
    seed: int = 0
    seconds: float = 0.0
    scenes: Path | None = None
    data: Path | None = None
    drawn: bool = False  # whether the matches of this scene are drawn

    @property
    def what(self) -> str:
        """All that the outcome depends on but the code."""
        return repr(replace(self, kept=None, scenes=None, data=None if self.data is None else self.data.resolve()))


@dataclass(frozen=True)
class Done:
    """What became of a job."""

    outcomes: dict[str, PixelOutcome]  # by row
    pictures: dict[str, bytes]  # JPEGs by row
    missing: str | None = None  # why there is nothing: the data set is not at hand


def run_job(job: Job) -> Done:
    """Do a job, unless it was done before and kept."""
    kept = Kept(job.kept)
    known = kept.get(job.what)
    if known is not None:
        outcomes = {name: PixelOutcome(**outcome) for name, outcome in known["outcomes"].items()}
        pictures = {name: base64.b64decode(picture) for name, picture in known["pictures"].items()}
        return Done(outcomes, pictures, known["missing"])
    done = _rendered(job) if job.data is None else _real_set(job, job.data.resolve())
    told = {
        "outcomes": {name: asdict(outcome) for name, outcome in done.outcomes.items()},
        "pictures": {name: base64.b64encode(picture).decode() for name, picture in done.pictures.items()},
        "missing": done.missing,
    }
    kept.put(job.what, told)
    return done


def _rendered(job: Job) -> Done:
    with tempfile.TemporaryDirectory(prefix="passerby-pixels-") as scratch:
        # Scene files in another folder name its files: a relative path would lead elsewhere.
        folder = rendered((job.scenes or Path(scratch) / "scenes").resolve(), job.name, job.seed, job.seconds)
        options = SimulationOptions(preset=job.name, seed=job.seed, seconds=job.seconds, fps=FPS)
        stage = Stage(folder, options, job.moments, Path(scratch))
        outcomes = {row.name: run_row(row, stage) for row in ROWS}
        return Done(outcomes, _pictures(stage) if job.drawn else {})


def _pictures(stage: Stage) -> dict[str, bytes]:
    """The matches of the first moment, by row."""
    views, cameras = stage.pictures[0], (stage.truth.rig[stage.reference], stage.truth.rig[DRAWN_CAMERA])
    labels = {row.name: row.label.replace("*", "") for row in ROWS}
    drawn = {}
    for name in DRAWN:
        if name not in stage.found_matches:
            continue
        matches = stage.found_matches[name][0].get(DRAWN_CAMERA, Matches.none())
        both = (views[stage.reference], views[DRAWN_CAMERA])
        drawn[name] = as_jpeg(draw_matches(both, cameras, matches, labels[name]))
    return drawn


def _real_set(job: Job, data: Path) -> Done:
    views: RealViews | str = wildtrack(data) if job.name == "WILDTRACK" else panoptic(data, job.moments)
    if isinstance(views, str):
        return Done({}, {}, views)
    outcomes = {name: run_matcher(name, views) for name in MATCHERS}
    if job.name == "WILDTRACK":
        outcomes |= {method: run_boxes(method, data, views.truth) for method in BOXES}
    return Done(outcomes, {})


def jobs(
    presets: Sequence[str], seeds: int, seconds: float, moments: int, kept: Path | None, scenes: Path | None, data: Path | None
) -> list[Job]:
    """All jobs, the longest first."""
    films = [
        Job(preset, moments, kept, seed, seconds, scenes, drawn=(preset, seed) == ("terrace", 0))
        for preset in reversed(presets)
        for seed in range(seeds)
    ]
    real = [] if data is None else [Job(name, moments, kept, data=data) for name in REAL]
    return [*films, *real]


REAL = ("WILDTRACK", "CMU Panoptic")


PRESETS, QUICK_PRESETS = ("terrace", "basketball", "construction"), ("terrace", "basketball")
SEEDS, QUICK_SEEDS = 3, 1
QUICK_SECONDS = 25.0
MOMENTS, QUICK_MOMENTS = 2, 1
"""Instants that the matchers see: the cameras stand still, so that more of them add little but people who moved."""
DEFAULT, WITH_PRIOR = "people", "people-prior"
PEOPLE = ("boxes-by-hand", "boxes-re-id", "trajectories", "people", "people-prior", "people-by-hand", "keypoints")
COLLAPSED_DEG = 10.0  # means over the cameras beyond this say that at least one camera points elsewhere


@dataclass(frozen=True)
class Measured:
    """Outcomes by preset, row and seed; those of the real sets by set and row."""

    presets: tuple[str, ...]
    seeds: int
    rows: Mapping[tuple[str, str], tuple[PixelOutcome, ...]]
    real: Mapping[str, Done]


def run(wanted: Wanted, executor: Executor | None, tell: Progress) -> Found:
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
    files: dict[str, str | bytes] = {
        f"paper-{job.name}-{name}.jpg": picture for job, result in done.items() for name, picture in result.pictures.items()
    }
    tables = {
        "Matchers": _claim(measured), "Against the paper": _goals(measured),
        **{preset: _poses(measured, preset) for preset in presets}, "Reprojection": _reprojections(measured),
        **({"Real pictures": _real(measured)} if real else {}),
    }  # fmt: skip
    notes = [f"Re-identification used {used}."] if (used := _looks(measured)) else []
    return Found(tables, [*notes, *_not_run(measured)], f"{seeds} seeds", files)


def _ran(outcomes: Sequence[PixelOutcome]) -> bool:
    return all(outcome.verdict != NOT_RUN for outcome in outcomes)


def _claim(measured: Measured) -> Table:
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


def _goals(measured: Measured) -> Table:
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


def _poses(measured: Measured, preset: str) -> Table:
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


def _reprojections(measured: Measured) -> Table:
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


def _real(measured: Measured) -> Table:
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


def _not_run(measured: Measured) -> list[str]:
    """Why rows could not run, one line each."""
    why = {
        row.label: outcome.reason
        for row in ROWS
        for preset in measured.presets
        for outcome in measured.rows[preset, row.name]
        if outcome.verdict == NOT_RUN
    }
    return ["\n".join(f"- {label}: {reason}" for label, reason in why.items())] if why else []
