"""Full disks, folders that may not be written, clocks that jump, bits that rot."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pages.kept import Kept
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.perception import watching
from passerby.perception.plan import make_plan
from passerby.perception.video import expected_count
from passerby.perception.video_probe import probe
from passerby.perception.watching import CameraJob, watch_camera, work_of
from support.scenes.handmade_files import write_scene
from support.scenes.puppet_videos import film, puppets


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", [["formats"], ["--version"]])
def test_output_that_takes_no_more_is_one_line_of_error(arguments):
    command = [sys.executable, "-m", "passerby", *arguments]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith("error: standard output or a temporary file: cannot be written or read (No space left")


@pytest.fixture
def read_only(tmp_path):
    """A folder that no user may write, root neither."""
    folder = tmp_path / "read_only"
    folder.mkdir()
    (folder / "mine").write_text("mine")
    if os.geteuid():
        folder.chmod(0o555)
        yield folder
        folder.chmod(0o755)
        return
    mounted = [["mount", "--bind", str(folder), str(folder)], ["mount", "-o", "remount,bind,ro", str(folder)]]
    if shutil.which("mount") is None or any(
        subprocess.run(one, capture_output=True, check=False).returncode for one in mounted
    ):
        subprocess.run(["umount", str(folder)], capture_output=True, check=False)
        pytest.skip("root may write everywhere, and may not mount here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=False)


def test_a_folder_that_may_not_be_written_is_an_error_before_anything_is_computed(read_only, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("passerby.calibration.calibrate.calibrate", None)
    scene = write_scene(tmp_path)
    for command in (["calibrate", str(scene), "-o", str(read_only)], ["report", str(read_only)],
                    ["simulate", "-o", str(read_only / "in"), "--seconds", "2"]):  # fmt: skip
        assert run(command) == 2
        (error,) = capsys.readouterr().err.splitlines()
        assert error.startswith(f"error: {read_only}")
        assert "cannot be written" in error
    assert [path.name for path in read_only.iterdir()] == ["mine"]


@pytest.mark.slow
def test_damaged_outcomes_of_a_benchmark_are_made_again(tmp_path):
    Kept(tmp_path).put("a", {"mm": 12.5, "inf": float("inf")})
    [path] = tmp_path.iterdir()
    content = path.read_bytes()
    known = Kept(tmp_path).get("a")
    assert known == {"mm": 12.5, "inf": float("inf")}
    for place in range(len(content) - 1):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        assert Kept(tmp_path).get("a") == (known if content[place : place + 1] == b"\n" else None), place


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A second and a half of one camera."""
    folder = tmp_path_factory.mktemp("filmed")
    made = puppets(3.0, 5.0, 2, 3)
    film(made, folder, made.rig.names[:1])
    return folder / f"{made.rig.names[0]}.mp4"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda path: os.utime(path, (1.0, 1.0)), "was changed while it was processed: run the same command again$"),
        (lambda path: path.write_bytes(path.read_bytes() + bytes(1000)), "has grown while it was processed: .* has ended$"),
    ],
)
def test_a_video_that_changes_while_it_is_watched_is_an_error(video, tmp_path, monkeypatch, change, said):
    copy = tmp_path / video.name
    shutil.copy2(video, copy)
    monkeypatch.setattr(watching, "SEGMENT", 4)
    plan = make_plan("background", "none", "none", models=None, base=tmp_path)
    job = CameraJob("C1", probe(copy), 5.0, plan, tmp_path / "shelf")
    learning = work_of(job) - expected_count(job.info, job.rate)

    def touch(done, total):
        if done == learning + 6:
            change(copy)

    with pytest.raises(InputError, match=f"camera C1: {said}"):
        watch_camera(job, touch)
    kept = [path.name for path in (tmp_path / "shelf").glob("people-*/*")]
    assert kept == ["000000.npz"], "of what was seen before"


JUMPING = "import random, time\nrng, true = random.Random(0), time.time\ntime.time = lambda: true() + rng.uniform(-1e9, 1e9)\n"


@pytest.mark.slow
def test_a_clock_that_jumps_changes_nothing(tmp_path):
    outs = []
    for name, site in (("steady", ""), ("jumping", JUMPING)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "sitecustomize.py").write_text(site)
        command = [sys.executable, "-m", "passerby", "simulate", "-o", "scene", "--seconds", "2", "--people", "2"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}
        subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
        files = (path for path in (folder / "scene").rglob("*") if path.is_file())
        outs.append({path.relative_to(folder): path.read_bytes() for path in files})
    assert outs[0] == outs[1]
    assert len(outs[0]) > 5


def test_interrupted_json_is_never_half_of_it(tmp_path):
    """Reading a calibration that was cut off is an error, not a crash."""
    text = json.dumps({"verdict": "accepted", "reasons": [], "cameras": []})
    for length in range(0, len(text), 7):
        (tmp_path / "calibration.json").write_text(text[:length])
        assert run(["report", str(tmp_path)]) == 2


FULL = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
from passerby.cli.main import run
sys.exit(run(sys.argv[1:]))
"""
"""A command on a disk that takes no byte."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of a file's size")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["calibrate", "scene/scene.toml", "-o", "new"], "new/"),
        (["simulate", "-o", "new", "--seconds", "2", "--people", "2"], "new"),
        (["simulate", "--preset", "airport", "--cameras", "8", "--seconds", "2", "-o", "new"], "new"),
        (["export", "scene/truth.toml", "--format", "opencv", "-o", "new"], "new/"),
        (["export", "scene/truth.toml", "--format", "pose2sim", "-o", "new"], "new"),
        (["align", "out", "-o", "new", "--camera", "C2"], "new"),
        (["track", "out", "-o", "new"], "new/"),
        (["report", "out", "-o", "new"], "new"),
        (["monitor", "out", "scene/scene.toml", "-o", "new"], "new/"),
    ],
)
def test_a_full_disk_is_one_line_with_the_file_and_leaves_nothing(calibrated_folder, arguments, names):
    ended = subprocess.run(
        [sys.executable, "-c", FULL, *arguments], cwd=calibrated_folder, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    last = ended.stderr.splitlines()[-1]
    assert last.startswith("error: ")
    assert names in last.split(": cannot be written")[0]
    assert "File too large" in last
    assert len(last) < 300
    assert sorted(path.name for path in calibrated_folder.iterdir()) == ["out", "scene"]
    left = sorted(path.name for path in (calibrated_folder / "out").iterdir())
    assert left == ["calibration.json", "report.html", "rig.toml", "tracks"]


@pytest.fixture(scope="module")
def calibrated_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full")
    assert run(["simulate", "-o", str(folder / "scene"), "--seconds", "20"]) == 0
    assert run(["calibrate", str(folder / "scene" / "scene.toml"), "-o", str(folder / "out")]) in (0, 3)
    return folder
