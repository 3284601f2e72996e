"""Public scenes with a stick: read as they are stated, the stick gives the scale, and the tables have every finished case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from passerby.core.observations import BODY_17
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from peers import public

JOINT_OF = {"neck": "left_shoulder", "head": "nose", "spine": "left_hip", "pelvis": "left_hip"}
"""Of the simulated joints, stand-ins for those that it lacks."""
FRAMES = 40


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of one simulated person with a stick of 1.2 m, who is stated to be of any height."""
    made = simulate(SimulationOptions(seed=5, seconds=10.0, fps=5.0, people=1))
    body = made.joints3d[:FRAMES, 0]
    at = dict(zip(BODY_17, np.moveaxis(body, 1, 0), strict=True))
    at["head_top"] = at["nose"] + (0.0, 0.0, 0.12)
    for side in ("left", "right"):
        at[f"{side}_forearm"] = (at[f"{side}_elbow"] + at[f"{side}_wrist"]) / 2
    joints = np.stack([at[name if name in at else JOINT_OF[name]] for name in public.JOINTS], axis=1)
    turn = np.linspace(0.0, 6.0, FRAMES)
    stick = at["right_wrist"][:, None] + np.stack(
        [np.zeros((FRAMES, 3)), 1.2 * np.column_stack([np.cos(turn) * 0.8, np.sin(turn) * 0.8, np.full(FRAMES, 0.6)])], axis=1
    )
    lens = public.Lens(public.SIZE, np.array([[900.0, 0, 600], [0, 900, 600], [0, 0, 1]]), np.zeros(5))
    cameras = [public.Camera(camera.name, lens, camera.pose) for camera in made.rig]
    folder = tmp_path_factory.mktemp("data") / "stick"
    folder.mkdir()
    marks = np.stack([camera.project(stick.reshape(-1, 3)).reshape(FRAMES, 2, 2) for camera in cameras])
    marks[1, :5] = 0.0
    np.savez(
        folder / "made_noise0.5_cam4.npz",
        K=lens.matrix, R=[camera.pose.R_cw for camera in cameras], t=[camera.pose.t_cw for camera in cameras],
        joints=np.stack([camera.project(joints.reshape(-1, 3)).reshape(FRAMES, -1, 2) for camera in cameras]),
        visible=np.ones((len(cameras), FRAMES, len(public.JOINTS)), dtype=bool), stick=marks, stick_length_m=1.2, noise_px=0.5,
    )  # fmt: skip
    return folder.parent


def test_the_stick_gives_the_scale(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PASSERBY_DATA", str(root))
    cases = public.cases()
    assert len(cases) == 4
    done = {key: public.work(case) for key, case in cases.items() if case.lenses == "known"}
    alone, with_stick = done.values()
    assert with_stick["registered"] == with_stick["cameras"] == 4
    assert with_stick["mm"] < 1.0
    assert with_stick["scale_ratio"] == pytest.approx(1.0, abs=0.002)
    assert abs(alone["scale_ratio"] - 1) > abs(with_stick["scale_ratio"] - 1)
    found = public.tabulate(cases, done)
    text = found.text
    assert found.run.startswith("2 of 4 cases")
    assert text.count("| 4       | 0.5 px |") == 2
    assert "4 of 4" in text


def test_a_scene_that_fails_is_not_averaged_away() -> None:
    cases = {key: public.PublicCase(Path(f"{key}.npz"), "known", "joints") for key in ("a", "b")}
    good = {"cameras": 4, "noise_px": 0.1, "registered": 4, "verdict": "accepted", "mm": 1.0, "deg": 0.01, "metric_mm": 2.0,
            "scale_ratio": 1.0, "focal_percent": None, "cpu_s": 1.0}  # fmt: skip
    lost = {"cameras": 4, "noise_px": 0.1, "registered": 0, "verdict": "refused", "why": "too little", "cpu_s": 3.0}
    line = " | ".join(public.tabulate(cases, {"a": good, "b": lost}).tables["Intrinsics known"].rows[0])
    assert "- mm -°" in line
    assert "4 of 8" in line
    assert "1 accepted, 1 refused" in line
    assert "2.0 s" in line


def test_data_that_are_not_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PASSERBY_DATA", str(tmp_path / "nowhere"))
    assert public.cases() == {}
    assert public.tabulate({}, {}).notes == ["Not run: data not here."]
