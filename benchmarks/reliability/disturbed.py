"""The program as its user starts it, disturbed from outside: killed at any time, no room, two at once, a clock that jumps."""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from passerby.common.errors import PasserbyError
from passerby.interchange.output_folder import read_report
from passerby.interchange.storage.transaction import FOLDER_LOCK
from reliability.machine import tree

JUMPING = """
import random, time
true, rng = time.time, random.Random(1)
time.time = lambda: true() + rng.uniform(-1e9, 1e9)
time.time_ns = lambda: int(1e9 * time.time())
"""
"""A `sitecustomize`: each look at the clock is off by up to thirty years."""


class SkippedError(Exception):
    """The machine does not let a fault be made."""


def program(arguments: list[str | Path], **options: object) -> subprocess.CompletedProcess[str]:
    """Run `passerby` to its end."""
    command = [sys.executable, "-m", "passerby", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, **options)  # type: ignore[call-overload,no-any-return]


def calibration(made: Path, out: Path) -> list[str | Path]:
    """The command that finds people in videos and calibrates: the longest."""
    return ["calibrate", made / "video" / "scene.toml", "-o", out, "--no-report"]


@contextmanager
def place(made: Path, before: str = "") -> Iterator[Path]:
    """An output folder, with what lies in a folder of `made`."""
    with tempfile.TemporaryDirectory(prefix="passerby-faults-") as scratch:
        os.chmod(scratch, 0o755)
        out = Path(scratch) / "out"
        if before:
            shutil.copytree(made / before, out)
        yield out


def repaired(made: Path, out: Path) -> list[str]:
    """What is wrong when the command is run once more on a sound machine."""
    ended = program(calibration(made, out))
    if ended.returncode not in (0, 3):
        return [f"run once more it ends with {ended.returncode}: {ended.stderr[-300:]}"]
    return [] if tree(out) == tree(made / "watched") else ["run once more it gives something else"]


def told(ended: subprocess.CompletedProcess[str], what: str) -> list[str]:
    """What is wrong with how a run ended that could not succeed: status 2 and one line that names the place or the matter."""
    # A run that takes long tells how far it is before.
    *before, last = ended.stderr.splitlines() or [""]
    sound = last.startswith("error: ") and what in last and not any(line.startswith(("error", "Trace")) for line in before)
    if ended.returncode == 2 and sound:
        return []
    return [f"ends with {ended.returncode} and says: {ended.stderr[-300:]}"]


def killed(made: Path, share: float) -> list[str]:
    """Killed with SIGKILL at a share of the time that it takes; its processes end with it."""
    with place(made, "other") as out:
        before = tree(out)
        run = subprocess.Popen(
            [sys.executable, "-m", "passerby", *map(str, calibration(made, out))],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        time.sleep(share * float((made / "seconds").read_text()))
        run.send_signal(signal.SIGKILL)
        run.wait()
        wrong = [] if _consistent(out) else ["leaves a folder that is half old, half new"]
        visible = {name: content for name, content in tree(out).items() if not name.startswith(".")}
        if run.returncode < 0 and visible not in (before, tree(made / "watched")):
            wrong.append("leaves neither the old nor the new")
        return wrong + repaired(made, out)


def small_disk(made: Path, kilobytes: float) -> list[str]:
    """On a disk of so many kilobytes."""
    with place(made) as out:
        out.mkdir()
        with _mounted(out, f"size={int(kilobytes * 1024)},mode=777"):
            ended = program([*calibration(made, out / "in")])
            found = tree(out)
            wrong = [] if ended.returncode in (0, 3) else told(ended, str(out))
            results = [name for name in found if name.endswith(("rig.toml", "calibration.json"))]
            if len(results) not in (0, 2) or any(name.endswith(".part") for name in found):
                wrong.append(f"leaves {sorted(found)}")
        return wrong


def small_files(made: Path, limit: int) -> list[str]:
    """Where no file may have more than so many bytes (RLIMIT_FSIZE): every longer one breaks off in the middle."""
    with place(made) as out:
        ended = program(
            calibration(made, out),
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY)),
        )
        wrong = [] if ended.returncode in (0, 3) else told(ended, str(out))
        return wrong + ([] if _consistent(out) else ["leaves a folder that is half written"]) + repaired(made, out)


def read_only(made: Path, command: str) -> list[str]:
    """Into a folder that may not be written: told at once, and nothing changes."""
    with place(made, "out") as out:
        before = tree(out)
        commands: Mapping[str, list[str | Path]] = {
            "calibrate": ["calibrate", made / "box" / "scene.toml", "-o", out],
            "report": ["report", out],
            "track": ["track", out],
            "align": ["align", out, "-o", out, "--camera", "C2"],
            "export": ["export", out, "-f", "colmap", "-o", out / "colmap"],
        }
        with _mounted(out, "bind,ro", out):
            ended = program(commands[command])
        return told(ended, str(out)) + ([] if tree(out) == before else ["changes the folder"])


def two(made: Path, second: str) -> list[str]:
    """Another command in a folder in which a calibration is at work."""
    with place(made, "other") as out:
        first = subprocess.Popen(
            [sys.executable, "-m", "passerby", *map(str, calibration(made, out))],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        until = time.monotonic() + 60
        while not (out / FOLDER_LOCK).exists() and first.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        commands: Mapping[str, list[str | Path]] = {
            "calibrate": calibration(made, out),
            "report": ["report", out],
            "align": ["align", out, "-o", out, "--camera", "C1"],
        }
        ended = program(commands[second])
        alone = first.poll() is not None  # the first was quicker than the start of the second
        _, errors = first.communicate()
        wrong = [] if first.returncode in (0, 3) else [f"the first ends with {first.returncode}: {errors[-300:]}"]
        if not (alone and ended.returncode in (0, 3)):
            wrong += told(ended, f"process {first.pid}")
        return wrong + repaired(made, out)


def clock(made: Path, how: str) -> list[str]:
    """With a clock that jumps, or times of files from the future or long ago."""
    with place(made, "watched") as out, tempfile.TemporaryDirectory() as site:
        (Path(site) / "sitecustomize.py").write_text(JUMPING if how == "jumps" else "")
        if how == "from nothing":
            shutil.rmtree(out)
        for path in out.rglob("*") if how in ("future", "past") else ():
            os.utime(path, (4e9, 4e9) if how == "future" else (1.0, 1.0))
        paths = os.pathsep.join([site, os.environ.get("PYTHONPATH", "")])
        ended = program(calibration(made, out), env={**os.environ, "PYTHONPATH": paths})
        wrong = [] if ended.returncode in (0, 3) else [f"ends with {ended.returncode}: {ended.stderr[-300:]}"]
        return wrong + ([] if tree(out) == tree(made / "watched") else ["gives something else"])


def bit_rot(made: Path, seed: int) -> list[str]:
    """A byte of every kept file is another one: all is made anew, and to the same bytes."""
    rng = random.Random(seed)
    with place(made, "watched") as out:
        for path in sorted(path for path in (out / "perception").rglob("*") if path.is_file()):
            flip(path, rng)
        return repaired(made, out)


def wrong_result(made: Path, seed: int) -> list[str]:
    """A byte of the rig or of a track is another one: whoever reads the folder as a whole says so."""
    rng = random.Random(seed)
    with place(made, "watched") as out:
        path = rng.choice([out / "rig.toml", *sorted((out / "tracks").glob("*.txt"))])
        flip(path, rng)
        return told(program(["report", out]), str(path)) + repaired(made, out)


def another_video(made: Path, seed: int) -> list[str]:
    """A video takes the place of another, with the same name, size and times: what was kept is not taken for its people."""
    rng = random.Random(seed)
    with place(made, "watched") as out:
        scene = out.parent / "video"
        shutil.copytree(made / "video", scene)
        video = scene / "videos" / "C1.mp4"
        kept = {path.name for path in (out / "perception" / "C1").iterdir()}
        times = video.stat()
        content = bytearray(video.read_bytes())
        for place_of in rng.sample(range(len(content) // 4, len(content) // 2), 20):
            content[place_of] ^= 0xFF
        video.write_bytes(content)
        os.utime(video, ns=(times.st_atime_ns, times.st_mtime_ns))
        ended = program(["calibrate", scene / "scene.toml", "-o", out, "--no-report"])
        wrong = [] if ended.returncode in (0, 2, 3) else [f"ends with {ended.returncode}: {ended.stderr[-300:]}"]
        now = {path.name for path in (out / "perception" / "C1").iterdir()}
        stale = ended.returncode != 2 and bool(now & kept)
        return wrong + ([f"{sorted(now & kept)} are kept from another video"] if stale else [])


def full_output(made: Path, command: str) -> list[str]:
    """Standard output that takes nothing more."""
    if not Path("/dev/full").exists():
        raise SkippedError("there is no /dev/full")
    commands = {"formats": ["formats"], "json": ["check", str(made / "box" / "scene.toml"), "--json"]}
    arguments = [sys.executable, "-m", "passerby", *commands[command]]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(arguments, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    return told(ended, "No space left")


DISTURBANCES: Mapping[str, Callable[..., list[str]]] = {
    function.__name__: function
    for function in (killed, small_disk, small_files, read_only, two, clock, bit_rot, wrong_result, another_video, full_output)
}


def flip(path: Path, rng: random.Random) -> None:
    """Let one bit of a file be another one."""
    content = bytearray(path.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def _consistent(out: Path) -> bool:
    """Whether rig, tracks and `calibration.json` are of one calibration, or there is none."""
    if not any((out / name).exists() for name in ("rig.toml", "calibration.json", ".written")):
        return True
    try:
        read_report(out)
    except PasserbyError:
        return False
    return True


@contextmanager
def _mounted(folder: Path, options: str, source: Path | None = None) -> Iterator[None]:
    """A file system on a folder. Raises `SkippedError` where this user may not."""
    kind = ["-t", "tmpfs", "passerby-faults"] if source is None else [str(source)]
    first = "bind" if source is not None else options
    done = subprocess.run(["mount", "-o", first, *kind, str(folder)], capture_output=True, text=True, check=False)
    if done.returncode == 0 and source is not None:
        done = subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SkippedError(f"this user may not mount: {done.stderr.strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)
