"""A calibration from videos that is stopped at any moment, and goes on to the same bits."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from support.faults import killed_calibration as killed
from support.faults.killed_calibration import calibrate, content
from support.scenes.puppet_videos import film, puppets, scene_file


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Two cameras, half a minute, 90 pictures each."""
    folder = tmp_path_factory.mktemp("resume")
    made = puppets(30.0, 3.0, 2, 4)
    film(made, folder)
    return scene_file(folder, {name: f"{name}.mp4" for name in made.rig.names})


@pytest.fixture(scope="module")
def whole(scene):
    """A run that nothing stopped."""
    out = scene.parent / "whole"
    ended = calibrate(scene, out)
    assert ended.status == 0, ended.errors
    assert not ended.errors
    return ended, content(out)


def halves(out):
    """Temporary files."""
    return [path for path in out.rglob("*") if path.name.endswith(".part")]


def test_killed_again_and_again_it_ends_in_the_same_bits(scene, whole, tmp_path):
    _, files = whole
    assert set(files) == {"rig.toml", "calibration.json", "tracks/C1.txt", "tracks/C2.txt"}
    moments = [("background", 1), ("file", 1), ("detection", 40), ("file", 3), ("name", 4), ("picture", 100), ("embedding", 5),
               ("tracking in each camera", 2), ("solving", 1), ("tracks", 2), ("rig", 1), ("file", 3)]  # fmt: skip
    for moment in moments:
        assert calibrate(scene, tmp_path, moment).killed, f"{moment} does not come"
        assert not (tmp_path / "calibration.json").exists()
    last = calibrate(scene, tmp_path)
    assert last.seen["detection"] == 0, "all was kept"
    assert last.seen["picture"] == 2, "the report shows one of each camera"
    assert content(tmp_path) == files


def test_no_more_than_a_segment_is_made_twice(scene, whole, tmp_path):
    ended, files = whole
    assert calibrate(scene, tmp_path, ("detection", 40)).killed
    rest = calibrate(scene, tmp_path)
    assert rest.seen["background"] == 1, "that of the first camera was learnt"
    # Of the first camera, 39 pictures were done.
    assert rest.seen["detection"] == ended.seen["detection"] - 39 // killed.SEGMENT * killed.SEGMENT
    assert content(tmp_path) == files
    assert not halves(tmp_path)


@pytest.mark.parametrize("moment", [("detection", 100), pytest.param(("solving", 1), marks=pytest.mark.slow)], ids=str)
def test_interrupted_it_says_so_and_goes_on(scene, whole, tmp_path, moment):
    stopped = calibrate(scene, tmp_path, moment, signal.SIGINT)
    assert stopped.status == 130
    assert stopped.errors == "error: interrupted\n"
    assert not content(tmp_path)
    assert not halves(tmp_path)
    assert calibrate(scene, tmp_path).status == 0
    assert content(tmp_path) == whole[1]


@pytest.mark.parametrize(
    ("changed", "looks_anew"),
    [
        ("[association]\nmax_offset_s = 1\n[solver.options]\nmax_sightings = 500\n[scale]\nperson_height_m = 1.8", False),
        ("[perception]\ndetector = 'background'\nembedder = 'none'", False),
        ("[perception]\ndetector = 'background'\nembedder = 'stripes'\nfps = 1.5", True),
    ],
)
def test_an_option_makes_again_what_depends_on_it(scene, whole, tmp_path, changed, looks_anew):
    shutil.copytree(scene.parent / "whole", tmp_path, dirs_exist_ok=True)
    text = scene.read_text()
    head = text[: text.index("[perception]" if "[perception]" in changed else "[association]")]
    tail = "\n[association]\nmax_offset_s = 0" if "[perception]" in changed else ""
    other = scene.parent / "other.toml"
    other.write_text(head + changed + tail)
    again = calibrate(other, tmp_path)
    assert again.status in (0, 3), again.errors
    assert again.seen["detection"] == again.seen["embedding"] == (whole[0].seen["detection"] / 2 if looks_anew else 0)
    # The background is learnt from pictures of its own, whatever is looked at afterwards.
    assert again.seen["background"] == (2 if looks_anew else 0)
    for camera in ("C1", "C2"):
        kept = sorted(path.name.split("-")[0] for path in (tmp_path / "perception" / camera).iterdir())
        assert kept == ["background", "people"] + ["looks"] * ("none" not in changed) or kept == [
            "background",
            "looks",
            "people",
        ]


def test_two_runs_in_one_folder(scene, whole, tmp_path):
    """The second is refused at once, and changes nothing."""
    plain = scene.parent / "plain.toml"
    plain.write_text(scene.read_text().replace("stripes", "none"))
    out, gate = tmp_path / "out", tmp_path / "gate"
    with ThreadPoolExecutor(1) as thread:
        first = thread.submit(calibrate, scene, out, ("background", 1), gate=gate)
        try:
            while not gate.exists():
                assert not first.done()
                time.sleep(0.02)
            turned_away = [calibrate(which, out) for which in (plain, scene)]
        finally:
            gate.unlink(missing_ok=True)
        assert first.result().status == 0
    for ended in turned_away:
        assert ended.status == 2
        assert re.fullmatch(rf"error: {out}: process \d+ on .+ \(passerby calibrate\) is running there .+\n", ended.errors)
        assert not ended.seen, "nothing was done in vain"
    assert content(out) == whole[1]
    assert calibrate(scene, out).status == 0
    assert content(out) == whole[1]


def processes_of(session):
    """The processes that belong to a session: a command and all that it started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


QUIET = """
import math
from passerby.cli import terminal
from passerby.cli.main import main
terminal.LOG_AFTER_S = math.inf
main()
"""
"""The program `passerby`, without the lines that tell how far a run is after half a minute of wall time."""
ENDLESS = """
import time
from passerby.calibration import writing
def write_boxes(*given):
    while True:
        time.sleep(600)
writing.write_boxes = write_boxes
"""
"""Before that: a run that never comes to its end, so that none ends before it is stopped, however late."""


def kept_files(out):
    """How many files a run that still goes on has kept; a folder may vanish meanwhile, which `rglob` cannot bear."""
    return sum(name.endswith((".npz", ".txt")) for _, _, names in os.walk(out) for name in names)


def run_program(scene, out, files=None, sign=0, group=False, first=""):
    """Run the program with its processes to its end, or stop it when it has kept so many files; all of it has ended then."""
    program = first + (QUIET if files is None else ENDLESS + QUIET)
    arguments = [sys.executable, "-c", program, "calibrate", str(scene), "-o", str(out)]
    with subprocess.Popen(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        try:
            while files is not None and run.poll() is None and kept_files(out) < files:
                time.sleep(0.01)
            if files is not None and run.poll() is None:
                (os.killpg if group else os.kill)(run.pid, sign)
            # Until all who hold it have ended.
            errors = run.stderr.read()
            until = time.monotonic() + 600
            while processes_of(run.pid) and time.monotonic() < until:
                time.sleep(0.05)
            assert not processes_of(run.pid), "orphans"
        finally:
            if processes_of(run.pid):
                os.killpg(run.pid, signal.SIGKILL)
    return run.returncode, errors


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
@pytest.mark.parametrize(
    ("files", "sign", "group"),
    [
        (1, signal.SIGKILL, False),
        (5, signal.SIGINT, True),
        *(pytest.param(n, *how, marks=pytest.mark.slow)
          for n in (0, 3, 7) for how in ((signal.SIGKILL, False), (signal.SIGINT, True), (signal.SIGINT, False))),
    ],
)  # fmt: skip
def test_no_process_is_left_behind(scene, whole, tmp_path, files, sign, group):
    out = tmp_path / "out"
    status, errors = run_program(scene, out, files, sign, group)
    if sign == signal.SIGKILL:
        assert status == -signal.SIGKILL
    elif files:
        assert status == 130
        assert errors == "error: interrupted\n"
    assert not content(out)
    status, errors = run_program(scene, out)
    assert (status, errors) == (0, "")
    assert content(out) == whole[1]


STUCK = """
import multiprocessing, threading
lock = multiprocessing.get_context("spawn").Lock()
threading.Thread(target=threading.Event().wait).start()
"""
"""Before that: a thread that never ends and a semaphore, as of a pool that was left in the middle of its work."""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc")
def test_an_interrupted_program_waits_for_no_thread_and_leaks_nothing(scene, tmp_path):
    status, errors = run_program(scene, tmp_path / "out", 5, signal.SIGINT, True, STUCK)
    assert (status, errors) == (130, "error: interrupted\n")


EVENTS = ("picture", "detection", "embedding", "file", "name", "tracking in each camera", "appearance",
          "registering camera pairs", "solving", "tracks", "rig", "writing")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("event", "share"), [*((event, 0.45) for event in EVENTS), *((event, 1.0) for event in EVENTS[::2])])
def test_killed_at_any_moment_it_ends_in_the_same_bits(scene, whole, tmp_path, event, share):
    ended, files = whole
    count = ended.seen[event]
    assert count
    moment = event, 1 + round(share * (count - 1))
    assert calibrate(scene, tmp_path, moment).killed
    assert calibrate(scene, tmp_path).status == 0
    assert content(tmp_path) == files
