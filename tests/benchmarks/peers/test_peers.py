"""The comparison with peers: the same points for all, spoilt as stated; processes that end, break or hang; the page."""

from __future__ import annotations

import ast
import json
import math
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from peers import cases, page, runners, table
from peers.cases import points_of
from peers.protocol import Points
from peers.table import Result, Row, judge, mean_result
from support.paths import BENCHMARKS

LENS = Lens((1920, 1080), np.array([[1000.0, 0, 960], [0, 1000.0, 540], [0, 0, 1]]), np.array([-0.2, 0.1, 0.001, 0.002, -0.05]))
RIG = Rig(
    tuple(
        Camera(f"C{number}", LENS, Pose(np.eye(3), np.array([x, 0.5 * x * x, 5.0])))
        for number, x in ((1, -1.0), (2, 0.0), (3, 2.0))
    )
)


def boxes_of(rows: list[tuple[int, int, float, float, float, float]]) -> CameraObservations:
    columns = np.array(rows, dtype=float)
    boxes = Boxes(columns[:, 0].astype(int), columns[:, 1].astype(int), columns[:, 2:], np.ones(len(columns)))
    return CameraObservations(boxes)


def crowd(n_people: int, n_frames: int) -> CameraObservations:
    frame, who = (grid.ravel() for grid in np.meshgrid(np.arange(1, n_frames + 1), np.arange(n_people), indexing="ij"))
    ltwh = np.column_stack([700.0 + 40 * who, 400.0 + 0.1 * frame, np.full(len(who), 30.0), np.full(len(who), 100.0)])
    xy = np.repeat(ltwh[:, None, :2], 17, axis=1) + np.linspace(0, 100, 17)[None, :, None] * (0.0, 1.0)
    return CameraObservations(Boxes(frame, who, ltwh, np.ones(len(who))), Keypoints(frame, who, xy, np.ones((len(who), 17))))


def test_what_two_whole_boxes_show_becomes_points() -> None:
    seen = {
        "C1": boxes_of([(1, 7, 100, 200, 40, 120), (1, 8, 500, 300, 50, 100), (2, 7, 1, 200, 40, 120)]),
        "C2": boxes_of([(1, 7, 300, 250, 30, 90), (2, 7, 320, 250, 30, 90), (2, 8, 600, 250, 30, 90)]),
        "C3": boxes_of([(3, 7, 300, 250, 30, 90)]),
    }
    centre = points_of(RIG, seen, "centre")
    # Person 8 has no instant in two cameras, and in instant 2 camera C1 has cut person 7 off.
    assert centre.camera.tolist() == [0, 1]
    assert centre.pixel.tolist() == [[120, 260], [315, 295]]
    assert (centre.person.tolist(), centre.instant.tolist(), centre.part.tolist()) == ([7, 7], [1, 1], [0, 0])
    edges = points_of(RIG, seen, "top+bottom")
    assert {(row, *pixel) for row, pixel in zip(edges.camera.tolist(), edges.pixel.tolist(), strict=True)} == {
        (0, 120, 200), (0, 120, 320), (1, 315, 250), (1, 315, 340)
    }  # fmt: skip
    assert sorted(edges.point_numbers().tolist()) == [0, 0, 1, 1]


def test_undistorted_pixels_lie_on_the_same_ray() -> None:
    world = np.random.default_rng(0).uniform((-1.5, -1, -1), (1.5, 1, 1), (40, 3))
    seen = {}
    for camera in RIG:
        middle = enumerate(camera.project(world))
        seen[camera.name] = boxes_of([(1, row, x - 5, y - 10, 10.0, 20.0) for row, (x, y) in middle if np.isfinite(x)])
    points = points_of(RIG, seen, "centre")
    assert len(points.camera) > 60
    for index, camera in enumerate(RIG):
        rows = points.camera == index
        inside = world[points.person[rows]] @ camera.pose.R_cw.T + camera.pose.t_cw
        ideal = inside[:, :2] / inside[:, 2:] * 1000 + (960, 540)
        assert np.abs(points.undistorted[rows] - ideal).max() < 0.01
        assert np.abs(points.pixel[rows] - ideal).max() > 1


def test_joints_carry_their_scores_and_a_file_holds_all(tmp_path: Path) -> None:
    score = np.tile(np.linspace(0.1, 0.9, 17), (6, 1))
    people = replace(crowd(2, 3).keypoints, score=score)
    points = points_of(RIG, dict.fromkeys(RIG.names, CameraObservations(keypoints=people)), "joints")
    assert len(points.camera) == 3 * 6 * np.count_nonzero(score[0] >= 0.3)
    assert np.array_equal(points.score, score[0][points.part])
    points = points_of(RIG, dict.fromkeys(RIG.names, crowd(3, 4)), "top+bottom")
    points.write(tmp_path / "points.npz")
    again = Points.read(tmp_path / "points.npz")
    assert all(np.array_equal(getattr(points, name), getattr(again, name)) for name in points.__dataclass_fields__)
    assert len(set(points.point_numbers().tolist())) == 3 * 4 * 2


def test_swaps_exchange_the_share_and_lose_nobody() -> None:
    camera = crowd(10, 200)
    swapped = cases.swapped(camera, 0.3, np.random.default_rng(1))
    for before, after in ((camera.boxes, swapped.boxes), (camera.keypoints, swapped.keypoints)):
        assert np.mean(before.identity != after.identity) == pytest.approx(0.3, abs=0.01)
        for frame in (1, 77, 200):
            assert sorted(after.identity[after.frame == frame]) == list(range(10))
    assert np.array_equal(swapped.boxes.ltwh, camera.boxes.ltwh)


def test_noise_is_a_share_of_the_person() -> None:
    camera = crowd(10, 300)
    noisy = cases.noisy(camera, np.random.default_rng(1))
    moved = np.std(noisy.boxes.ltwh - camera.boxes.ltwh, axis=0)
    assert moved[[0, 1, 3]] == pytest.approx([3.0, 3.0, 3.0 * math.sqrt(2)], rel=0.05)
    assert np.std(noisy.keypoints.xy - camera.keypoints.xy) == pytest.approx(1.0, rel=0.05)


def test_instants_are_thinned_for_all_cameras_alike_and_the_busiest_person_stands_alone() -> None:
    kept = cases.thinned({"C1": crowd(3, 500), "C2": crowd(2, 400)}, 100)
    frames = np.unique(kept["C1"].boxes.frame)
    assert (len(frames), frames[0], frames[-1]) == (100, 1, 500)
    assert set(kept["C2"].boxes.frame) == {frame for frame in frames if frame <= 400}
    assert set(kept["C2"].keypoints.frame) == set(kept["C2"].boxes.frame)
    few = {"C1": crowd(3, 50)}
    assert cases.thinned(few, 100) is few
    people = crowd(3, 20).keypoints
    seen = CameraObservations(keypoints=people.take((people.identity == 2) | (people.frame < 5)))
    alone = cases.busiest({"C1": seen})["C1"].keypoints
    assert set(alone.identity) == {2}
    assert len(alone) == 20


def test_the_same_case_gives_the_same_observations() -> None:
    data = cases.Data("crowd", False, lambda seed: cases.Seen(RIG, {"C1": crowd(6, 30)}, None))
    first, again, other = (
        cases.observed(cases.Case(data, "30 % swaps", seed)).cameras["C1"].boxes.identity for seed in (0, 0, 1)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert cases.observed(cases.Case(cases.Data("gone", False, lambda seed: None), "clean")) is None


def test_passerby_gets_the_same_as_a_scene(tmp_path: Path) -> None:
    seen = cases.Seen(RIG, {name: crowd(3, 4 + k) for k, name in enumerate(RIG.names)}, 5.0)
    scene = Scene.load(cases.write_scene(seen, tmp_path / "scene"))
    assert scene.association.given
    inputs = read_inputs(scene)
    assert all(camera.pose is None for camera in inputs.rig)
    for name in inputs.rig.names:
        assert np.array_equal(inputs.observations[name].boxes.ltwh, seen.cameras[name].boxes.ltwh)
        assert np.array_equal(inputs.observations[name].keypoints.identity, seen.cameras[name].keypoints.identity)


def fake_engine(folder: Path, body: str) -> Any:
    """An engine in this interpreter whose `solve(source, option)` has the given body."""
    script = folder / "fake_runner.py"
    head = f"import sys\nsys.path.insert(0, {str(BENCHMARKS / 'peers')!r})\nfrom protocol import run\nimport json, os\n"
    script.write_text(f"{head}def solve(source, option):\n{textwrap.indent(body, '    ')}\nrun(solve, 'numpy')\n")
    return runners.Engine("fake", str(script), option="wide")


def test_poses_are_compared_up_to_a_similarity(tmp_path: Path) -> None:
    moved = RIG.moved(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 2, 3]), 4.0)
    source = tmp_path / "poses.json"
    source.write_text(json.dumps({one.name: (one.pose.R_cw.tolist(), one.pose.t_cw.tolist()) for one in moved}))
    engine = fake_engine(tmp_path, "assert option == 'wide'\nreturn json.loads(source.read_text())")
    outcome = runners.run_engine(engine, source, tmp_path / "out.json", 30.0)
    assert outcome.failure is None
    assert outcome.version.startswith("numpy ")
    assert 0 <= outcome.solve_seconds < outcome.whole_seconds
    assert outcome.peak_mb > 1
    result = judge(outcome, RIG)
    assert result.failure is None
    assert result.mm == pytest.approx(0, abs=1e-6)
    assert judge(replace(outcome, poses={name: outcome.poses[name] for name in ("C1", "C2")}), RIG).failure == "2 of 3 cameras"
    about = Pose.from_centre(np.diag([-1.0, 1, -1]) @ outcome.poses["C3"].R_cw, outcome.poses["C3"].centre)
    turned = judge(replace(outcome, poses=dict(outcome.poses) | {"C3": about}), RIG)
    assert turned.failure is not None
    assert turned.failure.endswith("°")
    assert turned.mm is None


@pytest.mark.parametrize(
    ("body", "failure"),
    [
        ("raise ValueError('too few\\n points')", "ValueError: too few points"),
        ("os._exit(3)", "broke: exit status 3"),
        ("while True: pass", "timed out (1 s)"),
        ("return {'C1': ([[float('nan')] * 3] * 3, [0, 0, 0])}", "poses that are no numbers (C1)"),
        ("return {}", "0 of 3 cameras"),
    ],
)
def test_what_goes_wrong_is_a_failure(tmp_path: Path, body: str, failure: str) -> None:
    limit = 1.0 if "while" in body else 30.0
    result = judge(runners.run_engine(fake_engine(tmp_path, body), tmp_path, tmp_path / "out.json", limit), RIG)
    assert result.failure is not None
    assert result.failure.startswith(failure)
    assert result.mm is None


def test_an_environment_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PASSERBY_PEERS", str(tmp_path))
    assert all(peer.interpreter() is None for peer in runners.PEERS)
    with pytest.raises(FileNotFoundError, match="caliscope"):
        runners.run_engine(runners.CALISCOPE, tmp_path, tmp_path, 1.0)
    text = page.tabulate_engines([], ["PETS2009, clean"]).text
    for peer in runners.PEERS:
        assert f"- {peer.name}: not run: environment not made, `make bench-peers`" in text
    assert "- PETS2009, clean: not run: data not here" in text
    (tmp_path / ".venv-peer-colmap" / "bin").mkdir(parents=True)
    (tmp_path / ".venv-peer-colmap" / "bin" / "python").symlink_to(sys.executable)
    assert [peer.name for peer in runners.PEERS if peer.interpreter()] == ["COLMAP", "COLMAP x3", "GLOMAP"]


def test_runners_of_peers_import_nothing_of_passerby() -> None:
    scripts = {*BENCHMARKS.glob("peers/*_runner.py"), BENCHMARKS / "peers" / "protocol.py"}
    assert len(scripts) == 5
    for script in scripts - {BENCHMARKS / "peers" / "passerby_runner.py"}:
        for node in ast.walk(ast.parse(script.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] in ("passerby", "peers") for name in names), script.name


GOOD = Result(10.0, 0.05, None, 4, 1.0, 2.5, 200.0, "")
WORSE = Result(20.0, 0.06, None, 4, 2.0, 3.0, 300.0, "")
MIXED = Result(9.0, 0.10, None, 4, 0.5, 2.0, 300.0, "")
FAILED = Result(None, None, "timed out (60 s)", 0, math.nan, 60.0, math.nan, "")
ROWS = [
    Row("A", "clean", "centre", {"Passerby": GOOD, "caliscope": WORSE, "COLMAP": MIXED}),
    Row("A", "noisy", "centre", {"Passerby": GOOD, "caliscope": FAILED, "COLMAP": WORSE}),
    Row("B", "clean", "centre", {"Passerby": FAILED, "caliscope": FAILED, "COLMAP": WORSE}),
]
PEERS = ["caliscope", "COLMAP"]


def test_failures_are_marked_and_better_peers_named() -> None:
    cells = table.errors_table(ROWS, PEERS).rows
    assert cells[0][3:] == ["10.0 mm 0.050°", "20.0 mm 0.060°", "9.0 mm 0.100°", "COLMAP (mm)"]
    assert (cells[1][4], cells[1][6]) == ("fails: timed out (60 s)", "none")
    assert (cells[2][3], cells[2][6]) == ("fails: timed out (60 s)", "COLMAP")
    # Medians leave out failures that have no error.
    summary = table.summary_table(ROWS, PEERS).rows[0]
    assert summary == ["caliscope", "3", "2", "1", "2 of 3", "2 of 3", "0.50", "0.50", "0.83", "300 MB"]


def test_goals_are_missed_by_what_misses_them() -> None:
    lower, failures, time = table.goal_lines(ROWS, PEERS).splitlines()
    assert "**no**, 3 of 6" in lower
    assert "**no**: COLMAP on B, clean, centre" in failures
    assert "yes for the whole process, 3 of 3" in time
    assert "yes for the solver alone, 3 of 3" in time
    lower, failures, _ = table.goal_lines(ROWS[1:2], PEERS).splitlines()
    assert "yes, 2 of 2" in lower
    assert failures.endswith("yes.")


def test_a_seed_that_fails_is_not_averaged_away() -> None:
    good, better = Result(10.0, 0.5, None, 4, 1.0, 2.0, 90.0, "x 1"), Result(20.0, 0.1, None, 4, 2.0, 6.0, 80.0, "x 1")
    whole = mean_result([good, better])
    assert (whole.mm, whole.degrees, whole.failure) == (15.0, 0.3, None)
    assert (whole.solve_seconds, whole.whole_seconds, whole.peak_mb) == (1.5, 4.0, 90.0)
    assert mean_result([good]) is good
    broken = mean_result([good, Result(None, None, "3 of 4 cameras", 3, 1.0, 2.0, 90.0, "x 1"), better])
    assert (broken.failure, broken.mm) == ("1 of 3: 3 of 4 cameras", None)
    merged = page.merged(
        [Row("A", "clean", kind, {"Passerby": one}) for one in (good, better) for kind in ("centre", "joints")]
    )
    assert [row.points for row in merged] == ["centre", "joints"]
    assert merged[0].ours == whole


def test_the_page_runs_from_a_case_to_text(tmp_path: Path) -> None:
    """One short simulated scene, Passerby and a peer that breaks: the whole way, in processes of their own."""
    made = simulate(SimulationOptions(seed=3, seconds=8.0, fps=4.0, box_noise=0.01))
    cameras = {name: CameraObservations(made.observations[name].boxes) for name in made.rig.names}
    data = cases.Data("short scene", False, lambda seed: cases.Seen(made.rig, cameras, 4.0))
    engine = fake_engine(tmp_path, "raise RuntimeError('I am no engine')")
    rows = page.run_case(cases.Case(data, "clean"), tmp_path, [engine])
    assert [row.points for row in rows] == ["centre", "top+bottom"]
    assert rows[0].ours.failure is None
    assert rows[0].ours.mm < 300
    text = page.tabulate_engines(rows, (), [engine]).text
    assert "fails: RuntimeError: I am no engine" in text
    assert "| short scene | clean " in text
