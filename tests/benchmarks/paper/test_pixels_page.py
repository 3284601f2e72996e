"""The page of Tables 1 and 2: nothing that failed or did not run gets a figure; the rows that need no pictures are right."""

from __future__ import annotations

from pathlib import Path

import pytest

from pages.records import Found
from pages.render import TEMPLATES
from paper import pixels
from paper.paper_figures import POSES, REPROJECTIONS, SCENES
from paper.parts import Wanted
from paper.pixel_real import panoptic, wildtrack
from paper.pixel_rows import NOT_RUN, ROWS, PixelOutcome, run_row
from paper.pixel_stage import Stage
from paper.pixels import Done, Job, jobs, run_job
from passerby.common.progress import silent
from passerby.simulation import SimulationOptions

WRONG = PixelOutcome(
    "doubtful", "", 4, 4, similarity_mm=5000.0, similarity_deg=60.0, metric_mm=9000.0, metric_deg=80.0, rpe_px=300.0,
    err_percent=52.0, matches=200, right=30,
)  # fmt: skip
RIGHT = PixelOutcome(
    "accepted", "", 4, 4, similarity_mm=12.0, similarity_deg=0.1, metric_mm=90.0, metric_deg=0.2, rpe_px=0.7, err_percent=0.12,
    appearance="stripes",
)  # fmt: skip
LOST = PixelOutcome("doubtful", "camera C3 could not be registered", 3, 4, matches=90, right=40)
ABSENT = PixelOutcome(NOT_RUN, "the weights of somebody cannot be had", 0, 4)


def made_up(job: Job) -> Done:
    if job.data is not None:
        return Done({}, {}, "data not here: wildtrack/pictures") if job.name == "WILDTRACK" else Done({"sift": LOST}, {})
    rows = {"sift": LOST, "wxbs": WRONG, "xfeat": WRONG, "disk-lightglue": WRONG}
    outcomes = {row.name: rows.get(row.name, ABSENT if "superpoint" in row.name else RIGHT) for row in ROWS}
    return Done(outcomes, {"sift": b"jpeg"} if job.drawn else {})


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Found:
    monkeypatch.setattr(pixels, "run_job", made_up)
    return pixels.run(Wanted(seeds=1, data=tmp_path), None, silent)


def line(page: Found, start: str, which: int = 0) -> str:
    return [row for row in page.text.splitlines() if row.startswith(f"| {start}")][which]


def test_nothing_that_failed_or_did_not_run_gets_a_figure(page: Found) -> None:
    row = line(page, "SuperPoint + brute force")
    assert "not run" in row
    assert "358 mm 54.70°" in row
    assert "- SuperPoint + brute force: the weights of somebody cannot be had" in page.text
    row = line(page, "SIFT + brute force")  # a camera is missing
    assert row.count("fails") == 2
    assert "1 of 1" in row
    assert "40 of 90" in row
    assert "not run: data not here: wildtrack/pictures" in line(page, "WILDTRACK")
    assert "3 of 4" in line(page, "CMU Panoptic")


def test_figures_stand_beside_the_papers_and_pictures_belong_to_the_page(page: Found) -> None:
    assert "| 1302 mm 54.10° | 9000.0 mm 80.000° | 5000.0 mm 60.000° |" in line(page, "WxBS")
    assert "2.3 px 0.4 %" in line(page, "boxes, people by re-id", -1)
    assert "0.70 px 0.12 %" in line(page, "boxes, people by re-id", -1)
    assert "4 of 4" in line(page, "terrace"), "the claim counts what ran"
    assert page.files == {"paper-terrace-sift.jpg": b"jpeg"}
    assert "](paper-terrace-sift.jpg)" in (TEMPLATES / "paper.md").read_text()


def test_a_run_without_data_and_a_quick_one_leave_out_real_pictures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pixels, "run_job", made_up)
    assert "Real pictures" not in pixels.run(Wanted(seeds=1), None, silent).tables
    tables = pixels.run(Wanted(quick=True, data=tmp_path), None, silent).tables
    assert "Real pictures" not in tables
    assert "basketball" in tables
    assert "construction" not in tables


def test_every_figure_of_the_paper_has_a_row_and_a_scene() -> None:
    names = {row.name for row in ROWS}
    for figures in (POSES, REPROJECTIONS):
        assert set(figures) <= names
        assert all(set(of_row) == set(SCENES) for of_row in figures.values())


def test_real_sets_that_are_not_there_are_named(tmp_path: Path) -> None:
    assert wildtrack(tmp_path) == "data not here: wildtrack/pictures"
    assert panoptic(tmp_path, 1) == "data not here: panoptic/demo"


def test_jobs_are_done_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def rendered(job: Job) -> Done:
        asked.append(job.name)
        return made_up(job)

    monkeypatch.setattr("paper.pixels._rendered", rendered)
    job = jobs(("terrace",), 1, 5.0, 1, tmp_path, None, None)[0]
    first, second = run_job(job), run_job(job)
    assert asked == ["terrace"]
    assert first == second


def test_the_oracle_is_right(tmp_path: Path) -> None:
    stage = Stage(tmp_path, SimulationOptions(preset="terrace", seed=0, seconds=8.0), 1, tmp_path)
    outcome = run_row(next(row for row in ROWS if row.name == "oracle"), stage)
    assert outcome.registered == 4
    assert outcome.similarity_deg < 1.0
    assert outcome.metric_mm < 300
    assert 0.3 < outcome.rpe_px < 2.0
    assert outcome.err_percent == pytest.approx(100 * outcome.rpe_px / 576)


def test_the_moved_camera_of_wildtrack_is_left_out(data_root: Path) -> None:
    views = wildtrack(data_root)
    assert not isinstance(views, str)
    assert "C7" not in views.truth.names
    dome = panoptic(data_root, 2)
    assert not isinstance(dome, str)
    assert (len(dome.paths), len(dome.truth)) == (2, 5)


def test_a_relative_folder_of_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene files that are written elsewhere name its files."""
    folders = []

    def run_nothing(row: object, stage: Stage) -> PixelOutcome:
        folders.append(stage.folder)
        return LOST

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("paper.pixels.rendered", lambda scenes, *_: scenes / "terrace-0")
    monkeypatch.setattr("paper.pixels.run_row", run_nothing)
    run_job(Job("terrace", 1, None, seconds=5.0, scenes=Path("scenes")))
    assert set(folders) == {tmp_path.resolve() / "scenes" / "terrace-0"}
