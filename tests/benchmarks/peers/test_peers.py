"""The comparison with peers: the same points for all, spoilt as stated; processes that end, break or hang; the page."""

from __future__ import annotations

import ast
import json
import math
import sys
import textwrap
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from support.paths import BENCHMARKS

LENS = Lens((1920, 1080), np.array([[1000.0, 0, 960], [0, 1000.0, 540], [0, 0, 1]]), np.array([-0.2, 0.1, 0.001, 0.002, -0.05]))


def boxes_of(rows: list[tuple[int, int, float, float, float, float]]) -> Boxes:
    table = np.array(rows, dtype=float)
    return Boxes(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], np.ones(len(table)))


def rig_of_three() -> Rig:
    poses = [Pose(np.eye(3), np.array([x, 0.5 * x * x, 5.0])) for x in (-1.0, 0.0, 2.0)]
    return Rig(tuple(Camera(f"C{index + 1}", LENS, pose) for index, pose in enumerate(poses)))


def crowd(n_people: int, n_frames: int) -> CameraObservations:
    frame, who = (grid.ravel() for grid in np.meshgrid(np.arange(1, n_frames + 1), np.arange(n_people), indexing="ij"))
    ltwh = np.column_stack([700.0 + 40 * who, 400.0 + 0.1 * frame, np.full(len(who), 30.0), np.full(len(who), 100.0)])
    xy = np.repeat(ltwh[:, None, :2], 17, axis=1) + np.linspace(0, 100, 17)[None, :, None] * (0.0, 1.0)
    return CameraObservations(Boxes(frame, who, ltwh, np.ones(len(who))), Keypoints(frame, who, xy, np.ones((len(who), 17))))


class TestPoints:
    def test_what_two_whole_boxes_show_becomes_points(self, bench: Callable[[str], ModuleType]) -> None:
        seen = {
            "C1": CameraObservations(boxes_of([(1, 7, 100, 200, 40, 120), (1, 8, 500, 300, 50, 100), (2, 7, 1, 200, 40, 120)])),
            "C2": CameraObservations(boxes_of([(1, 7, 300, 250, 30, 90), (2, 7, 320, 250, 30, 90), (2, 8, 600, 250, 30, 90)])),
            "C3": CameraObservations(boxes_of([(3, 7, 300, 250, 30, 90)])),
        }
        points_of = bench("peers.observations").points_of
        centre = points_of(rig_of_three(), seen, "centre")
        # Person 8 has no instant in two cameras, and in instant 2 camera C1 has cut person 7 off.
        assert centre.camera.tolist() == [0, 1]
        assert centre.pixel.tolist() == [[120, 260], [315, 295]]
        assert (centre.person.tolist(), centre.instant.tolist(), centre.part.tolist()) == ([7, 7], [1, 1], [0, 0])
        edges = points_of(rig_of_three(), seen, "top+bottom")
        assert {(row, *pixel) for row, pixel in zip(edges.camera.tolist(), edges.pixel.tolist(), strict=True)} == {
            (0, 120, 200), (0, 120, 320), (1, 315, 250), (1, 315, 340)
        }  # fmt: skip
        assert sorted(edges.point_numbers().tolist()) == [0, 0, 1, 1]

    def test_undistorted_pixels_lie_on_the_same_ray(self, bench: Callable[[str], ModuleType]) -> None:
        world = np.random.default_rng(0).uniform((-1.5, -1, -1), (1.5, 1, 1), (40, 3))
        rig = rig_of_three()
        seen = {}
        for camera in rig:
            middle = camera.project(world)
            table = [(1, row, x - 5, y - 10, 10.0, 20.0) for row, (x, y) in enumerate(middle) if np.isfinite(x)]
            seen[camera.name] = CameraObservations(boxes_of(table))
        points = bench("peers.observations").points_of(rig, seen, "centre")
        assert len(points.camera) > 60
        for index, camera in enumerate(rig):
            assert camera.pose is not None
            rows = points.camera == index
            inside = world[points.person[rows]] @ camera.pose.R_cw.T + camera.pose.t_cw
            ideal = inside[:, :2] / inside[:, 2:] * 1000 + (960, 540)
            assert np.abs(points.undistorted[rows] - ideal).max() < 0.01
            assert np.abs(points.pixel[rows] - ideal).max() > 1

    def test_joints_carry_their_scores(self, bench: Callable[[str], ModuleType]) -> None:
        camera = crowd(2, 3)
        score = np.tile(np.linspace(0.1, 0.9, 17), (6, 1))
        people = replace(camera.keypoints, score=score)
        seen = {name: CameraObservations(keypoints=people) for name in ("C1", "C2", "C3")}
        points = bench("peers.observations").points_of(rig_of_three(), seen, "joints")
        sure = np.flatnonzero(score[0] >= 0.3)
        assert len(points.camera) == 3 * 6 * len(sure)
        assert np.array_equal(points.score, score[0][points.part])

    def test_a_file_holds_all(self, bench: Callable[[str], ModuleType], tmp_path: Path) -> None:
        seen = {name: crowd(3, 4) for name in ("C1", "C2", "C3")}
        points = bench("peers.observations").points_of(rig_of_three(), seen, "top+bottom")
        points.write(tmp_path / "points.npz")
        again = bench("peers.protocol").Points.read(tmp_path / "points.npz")
        for name in points.__dataclass_fields__:
            assert np.array_equal(getattr(points, name), getattr(again, name))
        assert len(set(points.point_numbers().tolist())) == 3 * 4 * 2


class TestConditions:
    def test_swaps_exchange_the_share_and_lose_nobody(self, bench: Callable[[str], ModuleType]) -> None:
        camera = crowd(10, 200)
        swapped = bench("peers.cases").swapped(camera, 0.3, np.random.default_rng(1))
        for before, after in ((camera.boxes, swapped.boxes), (camera.keypoints, swapped.keypoints)):
            assert np.mean(before.identity != after.identity) == pytest.approx(0.3, abs=0.01)
            for frame in (1, 77, 200):
                assert sorted(after.identity[after.frame == frame]) == list(range(10))
        assert np.array_equal(swapped.boxes.ltwh, camera.boxes.ltwh)

    def test_noise_is_a_share_of_the_person(self, bench: Callable[[str], ModuleType]) -> None:
        camera = crowd(10, 300)
        noisy = bench("peers.cases").noisy(camera, np.random.default_rng(1))
        moved = noisy.boxes.ltwh - camera.boxes.ltwh
        assert np.std(moved[:, 0]) == pytest.approx(3.0, rel=0.05)
        assert np.std(moved[:, 1]) == pytest.approx(3.0, rel=0.05)
        assert np.std(moved[:, 3]) == pytest.approx(3.0 * math.sqrt(2), rel=0.05)
        assert np.std(noisy.keypoints.xy - camera.keypoints.xy) == pytest.approx(1.0, rel=0.05)

    def test_instants_are_thinned_for_all_cameras_alike(self, bench: Callable[[str], ModuleType]) -> None:
        cases = bench("peers.cases")
        kept = cases.thinned({"C1": crowd(3, 500), "C2": crowd(2, 400)}, 100)
        frames = np.unique(kept["C1"].boxes.frame)
        assert len(frames) == 100
        assert (frames[0], frames[-1]) == (1, 500)
        assert set(kept["C2"].boxes.frame) == {frame for frame in frames if frame <= 400}
        assert set(kept["C2"].keypoints.frame) == set(kept["C2"].boxes.frame)
        few = {"C1": crowd(3, 50)}
        assert cases.thinned(few, 100) is few

    def test_one_person_alone(self, bench: Callable[[str], ModuleType]) -> None:
        people = crowd(3, 20).keypoints
        kept = people.take((people.identity == 2) | (people.frame < 5))
        alone = bench("peers.cases").busiest({"C1": CameraObservations(keypoints=kept)})["C1"].keypoints
        assert set(alone.identity) == {2}
        assert len(alone) == 20

    def test_the_same_case_gives_the_same_observations(self, bench: Callable[[str], ModuleType]) -> None:
        cases = bench("peers.cases")
        data = cases.Data("crowd", False, lambda seed: cases.Seen(rig_of_three(), {"C1": crowd(6, 30)}, None))
        first, second = (cases.observed(cases.Case(data, "30 % swaps")).cameras["C1"].boxes for _ in range(2))
        assert np.array_equal(first.identity, second.identity)
        assert not np.array_equal(
            first.identity, cases.observed(cases.Case(data, "30 % swaps", 1)).cameras["C1"].boxes.identity
        )
        gone = cases.Data("gone", False, lambda seed: None)
        assert cases.observed(cases.Case(gone, "clean")) is None

    def test_passerby_gets_the_same_as_a_scene(self, bench: Callable[[str], ModuleType], tmp_path: Path) -> None:
        cases = bench("peers.cases")
        seen = cases.Seen(rig_of_three(), {name: crowd(3, 4 + k) for k, name in enumerate(("C1", "C2", "C3"))}, 5.0)
        scene = Scene.load(cases.write_scene(seen, tmp_path / "scene"))
        assert scene.association.given
        inputs = read_inputs(scene)
        assert all(camera.pose is None for camera in inputs.rig)
        for name in inputs.rig.names:
            assert np.array_equal(inputs.observations[name].boxes.ltwh, seen.cameras[name].boxes.ltwh)
            assert np.array_equal(inputs.observations[name].keypoints.identity, seen.cameras[name].keypoints.identity)


def fake_engine(bench: Callable[[str], ModuleType], folder: Path, body: str) -> Any:
    """An engine in this interpreter whose `solve(source, option)` has the given body."""
    script = folder / "fake_runner.py"
    head = f"import sys\nsys.path.insert(0, {str(BENCHMARKS / 'peers')!r})\nfrom protocol import run\nimport json, os\n"
    script.write_text(
        f"{head}def solve(source, option):\n{textwrap.indent(textwrap.dedent(body), '    ')}\nrun(solve, 'numpy')\n"
    )
    return bench("peers.runners").Engine("fake", str(script), option="wide")


class TestRunners:
    def test_poses_are_judged_up_to_a_similarity(self, bench: Callable[[str], ModuleType], tmp_path: Path) -> None:
        rig = rig_of_three()
        moved = rig.moved(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 2, 3]), 4.0)
        source = tmp_path / "poses.json"
        poses = {camera.name: (camera.pose.R_cw.tolist(), camera.pose.t_cw.tolist()) for camera in moved if camera.pose}
        source.write_text(json.dumps(poses))
        engine = fake_engine(bench, tmp_path, "assert option == 'wide'\nreturn json.loads(source.read_text())")
        outcome = bench("peers.runners").run_engine(engine, source, tmp_path / "out.json", 30.0)
        assert outcome.failure is None
        assert outcome.version.startswith("numpy ")
        assert 0 <= outcome.solve_seconds < outcome.whole_seconds
        assert outcome.peak_mb > 1
        judge = bench("peers.judging").judge
        result = judge(outcome, rig)
        assert result.failure is None
        assert result.mm == pytest.approx(0, abs=1e-6)
        partial = replace(outcome, poses={name: outcome.poses[name] for name in ("C1", "C2")})
        assert judge(partial, rig).failure == "2 of 3 cameras"
        about = Pose.from_centre(np.diag([-1.0, 1, -1]) @ outcome.poses["C3"].R_cw, outcome.poses["C3"].centre)
        turned = judge(replace(outcome, poses=dict(outcome.poses) | {"C3": about}), rig)
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
    def test_what_goes_wrong_is_a_failure(
        self, bench: Callable[[str], ModuleType], tmp_path: Path, body: str, failure: str
    ) -> None:
        engine = fake_engine(bench, tmp_path, body)
        limit = 1.0 if "while" in body else 30.0
        outcome = bench("peers.runners").run_engine(engine, tmp_path, tmp_path / "out.json", limit)
        result = bench("peers.judging").judge(outcome, rig_of_three())
        assert result.failure is not None
        assert result.failure.startswith(failure)
        assert result.mm is None

    def test_an_environment_that_is_not_there(
        self, bench: Callable[[str], ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("PASSERBY_PEERS", str(tmp_path))
        runners, page = bench("peers.runners"), bench("peers.page")
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

    def test_runners_of_peers_import_nothing_of_passerby(self) -> None:
        scripts = [*BENCHMARKS.glob("peers/*_runner.py"), BENCHMARKS / "peers" / "protocol.py"]
        assert len(scripts) == 5
        for script in scripts:
            if script.name == "passerby_runner.py":
                continue
            for node in ast.walk(ast.parse(script.read_text())):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not any(name.split(".")[0] in ("passerby", "peers") for name in names), script.name


class TestTables:
    def rows(self, bench: Callable[[str], ModuleType]) -> tuple[list[Any], ModuleType]:
        table, result = bench("peers.table"), bench("peers.judging").Result
        good = result(10.0, 0.05, None, 4, 1.0, 2.5, 200.0, "")
        worse = result(20.0, 0.06, None, 4, 2.0, 3.0, 300.0, "")
        mixed = result(9.0, 0.10, None, 4, 0.5, 2.0, 300.0, "")
        failed = result(None, None, "timed out (60 s)", 0, math.nan, 60.0, math.nan, "")
        return [
            table.Row("A", "clean", "centre", {"Passerby": good, "caliscope": worse, "COLMAP": mixed}),
            table.Row("A", "noisy", "centre", {"Passerby": good, "caliscope": failed, "COLMAP": worse}),
            table.Row("B", "clean", "centre", {"Passerby": failed, "caliscope": failed, "COLMAP": worse}),
        ], table

    def test_failures_are_marked_and_better_peers_named(self, bench: Callable[[str], ModuleType]) -> None:
        rows, table = self.rows(bench)
        cells = table.errors_table(rows, ["caliscope", "COLMAP"]).rows
        assert cells[0][3:] == ["10.0 mm 0.050°", "20.0 mm 0.060°", "9.0 mm 0.100°", "COLMAP (mm)"]
        assert cells[1][4] == "fails: timed out (60 s)"
        assert cells[1][6] == "none"
        assert cells[2][3] == "fails: timed out (60 s)"
        assert cells[2][6] == "COLMAP"

    def test_goals_are_missed_by_what_misses_them(self, bench: Callable[[str], ModuleType]) -> None:
        rows, table = self.rows(bench)
        lower, failures, time = table.goal_lines(rows, ["caliscope", "COLMAP"]).splitlines()
        assert "**no**, 3 of 6" in lower
        assert "**no**: COLMAP on B, clean, centre" in failures
        assert "yes for the whole process, 3 of 3" in time
        assert "yes for the solver alone, 3 of 3" in time
        fine = [row for row in rows if row.data == "A"][1:]
        lower, failures, _ = table.goal_lines(fine, ["caliscope", "COLMAP"]).splitlines()
        assert "yes, 2 of 2" in lower
        assert failures.endswith("yes.")

    def test_medians_leave_out_failures_that_have_no_error(self, bench: Callable[[str], ModuleType]) -> None:
        rows, table = self.rows(bench)
        cells = table.summary_table(rows, ["caliscope", "COLMAP"]).rows[0]
        assert cells == ["caliscope", "3", "2", "1", "2 of 3", "2 of 3", "0.50", "0.50", "0.83", "300 MB"]


def test_a_seed_that_fails_is_not_averaged_away(bench: Callable[[str], ModuleType]) -> None:
    result, mean = bench("peers.judging").Result, bench("peers.judging").mean_result
    good, better = result(10.0, 0.5, None, 4, 1.0, 2.0, 90.0, "x 1"), result(20.0, 0.1, None, 4, 2.0, 6.0, 80.0, "x 1")
    whole = mean([good, better])
    assert (whole.mm, whole.degrees, whole.failure) == (15.0, 0.3, None)
    assert (whole.solve_seconds, whole.whole_seconds, whole.peak_mb) == (1.5, 4.0, 90.0)
    assert mean([good]) is good
    broken = mean([good, result(None, None, "3 of 4 cameras", 3, 1.0, 2.0, 90.0, "x 1"), better])
    assert broken.failure == "1 of 3: 3 of 4 cameras"
    assert broken.mm is None
    table = bench("peers.table")
    rows = [table.Row("A", "clean", points, {"Passerby": one}) for one in (good, better) for points in ("centre", "joints")]
    merged = bench("peers.page").merged(rows)
    assert [row.points for row in merged] == ["centre", "joints"]
    assert merged[0].ours == whole


def test_the_page_runs_from_a_case_to_text(bench: Callable[[str], ModuleType], tmp_path: Path) -> None:
    """One short simulated scene, Passerby and a peer that breaks: the whole way, in processes of their own."""
    cases, page = bench("peers.cases"), bench("peers.page")
    made = simulate(SimulationOptions(seed=3, seconds=8.0, fps=4.0, box_noise=0.01))
    cameras = {name: CameraObservations(made.observations[name].boxes) for name in made.rig.names}
    data = cases.Data("short scene", False, lambda seed: cases.Seen(made.rig, cameras, 4.0))
    engine = fake_engine(bench, tmp_path, "raise RuntimeError('I am no engine')")
    rows = page.run_case(cases.Case(data, "clean"), tmp_path, [engine])
    assert [row.points for row in rows] == ["centre", "top+bottom"]
    assert rows[0].ours.failure is None
    assert rows[0].ours.mm is not None
    assert rows[0].ours.mm < 300
    text = page.tabulate_engines(rows, (), [engine]).text
    assert "fails: RuntimeError: I am no engine" in text
    assert "| short scene | clean " in text
