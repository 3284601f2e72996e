"""The work behind the page of Tables 1 and 2, in jobs that can be done side by side: a rendered scene, a real data set."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from baselines import MATCHERS, Matches
from pages.kept import Kept
from paper.match_picture import as_jpeg, draw_matches
from paper.pixel_real import BOXES, RealViews, panoptic, run_boxes, run_matcher, wildtrack
from paper.pixel_rows import ROWS, PixelOutcome, run_row
from paper.pixel_stage import Stage
from paper.rendered import FPS, rendered
from passerby.simulation import SimulationOptions

DRAWN = ("sift", "superpoint-lightglue", "wxbs", "xfeat", "disk-lightglue", "people")
"""Rows whose matches are drawn, where they ran."""
DRAWN_CAMERA = "C3"
"""Drawn with the reference: the two look from opposite sides."""


@dataclass(frozen=True)
class Job:
    """One rendered scene (preset and seed), or one real data set (data)."""

    name: str
    """Of the preset, or of the data set."""
    moments: int
    kept: Path | None
    seed: int = 0
    seconds: float = 0.0
    scenes: Path | None = None
    data: Path | None = None
    drawn: bool = False
    """Whether the matches of this scene are drawn."""

    @property
    def what(self) -> str:
        """All that the outcome depends on but the code."""
        return repr(replace(self, kept=None, scenes=None, data=None if self.data is None else self.data.resolve()))


@dataclass(frozen=True)
class Done:
    """What became of a job."""

    outcomes: dict[str, PixelOutcome]
    """By row."""
    pictures: dict[str, bytes]
    """JPEGs by row."""
    missing: str | None = None
    """Why there is nothing: the data set is not at hand."""


def run_job(job: Job) -> Done:
    """Do a job, unless it was done before and kept."""
    kept = Kept(job.kept)
    known = kept.get(job.what)
    if known is not None:
        outcomes = {name: PixelOutcome(**outcome) for name, outcome in known["outcomes"].items()}
        pictures = {name: base64.b64decode(picture) for name, picture in known["pictures"].items()}
        return Done(outcomes, pictures, known["missing"])
    done = _rendered(job) if job.data is None else _real(job, job.data.resolve())
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


def _real(job: Job, data: Path) -> Done:
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
