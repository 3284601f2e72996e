"""Other parts of `make reliability` in small: stated lenses, the monitor, and what counts as a run's result."""

from pathlib import Path

import numpy as np
import pytest

from passerby.calibration.kept_tracklets import FOLDER
from passerby.scene.video_inputs import KEPT_FOLDER
from reliability import lenses, machine, other_inputs, watch
from support.scenes.simulated import scene


@pytest.mark.parametrize("name", ["focal 0.2", "cropped 0.12"])
def test_a_wrong_lens_is_named(name: str) -> None:
    result = lenses.wrong_lens((name, 31))
    assert result["right"]
    assert result["only"]
    assert not result["accepted"]


@pytest.mark.parametrize(
    ("right_lenses", "seed", "spoilt"),
    [(lenses.right_lenses, 30, ""), (lenses.right_lenses, 33, "mirrored"), (lenses.right_lenses_found, 38, "mirrored")],
)
def test_right_lenses_are_not_named_beside_a_mirrored_camera(right_lenses, seed: int, spoilt: str) -> None:
    """In the last scene, where identities are found, other things are noticed: they are not of lenses, and not counted."""
    result = right_lenses(seed)
    assert result["spoilt"] == spoilt
    assert result["named"] == []


def test_the_section_counts_what_was_accused_and_what_was_named() -> None:
    right = {"1": {"spoilt": "", "named": []}, "2": {"spoilt": "", "named": [["focal", "C1"]]}}
    wrong = {"focal 0.2 1": {"right": True, "only": True, "named": [["focal", "C1"]], "accepted": False}}
    accused, named = lenses._lines(right, wrong)
    assert (accused.seen, accused.reached) == ("1 (50.00 %)", False)
    assert (named.seen, named.reached) == ("100.0 %", True)
    assert "one focal length off by 20 %" in str(lenses._tables(right, {}, wrong)["Wrong lenses"])


def test_a_few_cases_of_the_monitor_and_their_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "HOUR_S", 300.0)
    quiet = watch.work(("quiet", 1, 13))
    assert (quiet["alarms"], quiet["minutes"]) == (0, 5)
    # A degree and 10 cm, of cameras of a rig of four.
    knocks = [watch.work(("knock", number, 13)) for number in (6, 7)]
    assert [one["turn"] for one in knocks] == [False, True]
    assert all(one["seen"] and one["among"] and not one["early"] for one in knocks)
    lines = watch._lines([quiet], knocks)
    assert [line.seen[:7] for line in lines[:2]] == ["0 of 1 ", "2 of 2 "]
    text = f"{watch._table(knocks, [])} {watch._note([quiet])}"
    assert "| cheap, 1 degree" in text
    assert "nan" not in text


def test_a_moved_sensor_sees_the_same_rays_and_its_principal_point_is_as_far_off_as_unknown_ones_may_be() -> None:
    made = scene(seconds=4.0, joint_noise_px=1.0)
    moved = other_inputs.with_principal_points(made, np.random.default_rng(0))
    off = []
    for before, after in zip(made.rig, moved.rig, strict=True):
        width, height = after.lens.size
        off.append((after.lens.matrix[:2, 2] - [width / 2, height / 2]) / width)
        old, new = made.observations[before.name], moved.observations[before.name]
        rows = [np.column_stack([one.frame, one.identity]).tolist() for one in (old.boxes, new.boxes)]
        same = [rows[0].index(row) for row in rows[1]]
        assert 0.5 * len(rows[0]) < len(same) <= len(rows[0])
        rays = [
            lens.bearings(boxes.ltwh[:, :2]) for lens, boxes in ((before.lens, old.boxes.take(same)), (after.lens, new.boxes))
        ]
        np.testing.assert_allclose(*rays, atol=1e-9)
        assert new.boxes.inside(after.lens.size).all()
        assert (
            (new.keypoints.xy[new.keypoints.score > 0] >= 0) & (new.keypoints.xy[new.keypoints.score > 0] < (width, height))
        ).all()
    assert 0.01 < np.std(off) < 0.03


def test_what_is_kept_for_the_next_run_is_no_result(tmp_path: Path) -> None:
    """A run that is killed after it was written has changed nothing that a reader sees."""
    results = ("rig.toml", "tracks/C1.txt", f"{FOLDER}.txt", f"tracks/{FOLDER}/C1.txt")
    for name in (*results, f"{FOLDER}/a.npz", f"{KEPT_FOLDER}/C1/boxes-a/0.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    assert machine.tree(tmp_path) == {name: name.encode() for name in results}
