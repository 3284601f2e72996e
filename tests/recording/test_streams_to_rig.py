"""Three cameras on loopback, recorded and calibrated: one breaks off three times, the clock of another is off by 2 s."""

import json
import time
from contextlib import ExitStack

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from sources.stream_servers import Film, rtsp_camera
from support.scenes.puppet_videos import film, puppets

pytestmark = [pytest.mark.slow, pytest.mark.system]

SECONDS, FPS, RECORDED_S, SEED = 75.0, 12.5, 60.0, 2
CLOCKS_OFF_S = {"C1": 0.0, "C2": 0.0, "C3": 2.0}
"""Of the cameras' own clocks."""
BREAKS_S = {"C1": (), "C2": (15.0, 33.0, 50.0), "C3": ()}


def calibrated(scene, out, truth):
    assert run(["calibrate", str(scene), "-o", str(out), "--no-report"]) in (0, 3)
    rig = read_rig(out / "rig.toml")
    comparison = compare(rig, truth)
    return rig, comparison.similarity.mean_position_mm, json.loads((out / "calibration.json").read_text())


def test_streams_become_a_rig(tmp_path):
    film(puppets(SECONDS, FPS, 3, 6, seed=SEED), tmp_path, key_every=round(FPS))
    truth = read_rig(tmp_path / "truth.toml")
    began = time.time()
    cameras = ""
    with ExitStack() as stack:
        for name in truth.names:
            server = rtsp_camera(
                Film.read(tmp_path / f"{name}.mp4"),
                password="keeper:t0psecret",
                began=began,
                clock_off_s=CLOCKS_OFF_S[name],
                breaks_s=BREAKS_S[name],
            )
            port, _ = stack.enter_context(server)
            cameras += f'[cameras.{name}]\nstream = "rtsp://keeper:t0psecret@127.0.0.1:{port}/"\nintrinsics = "rig.toml"\n'
        (tmp_path / "cameras.toml").write_text(cameras)
        assert run(["record", str(tmp_path / "cameras.toml"), "-o", str(tmp_path / "site"), "--seconds", str(RECORDED_S)]) == 0
    recorded = json.loads((tmp_path / "site" / "recording.json").read_text())
    assert [len(camera["gaps"]) for camera in recorded["cameras"]] == [0, 3, 0]
    scene = tmp_path / "site" / "scene.toml"
    scene.write_text(scene.read_text() + '\n[perception]\ndetector = "background"\nembedder = "stripes"\nkeypoints = "none"\n')
    rig, error_mm, document = calibrated(scene, tmp_path / "out", truth)
    # The same minute of the files gives 45 mm. What is recorded in real time is never quite the same, and in so short a film
    # puppets are missed too often for the verdict to be the same each time.
    assert len(rig.posed()) == 3
    assert error_mm < 150
    offsets = np.array([camera["time_offset_s"] for camera in document["cameras"]])
    np.testing.assert_allclose(offsets - offsets[0], [0, 0, -2], atol=0.05)
    told = "".join(path.read_text() for path in (tmp_path / "site").glob("*.*") if path.is_file()) + json.dumps(document)
    assert "t0psecret" not in told
