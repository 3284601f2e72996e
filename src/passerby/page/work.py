"""A calibration in a process of its own. Its output goes to files, so a later server can also find its outcome."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from passerby.common.errors import InputError
from passerby.interchange.calibration_json import CALIBRATION_FILE
from passerby.interchange.storage.atomic import cannot_write, make_folder, write_text
from passerby.interchange.storage.transaction import try_lock

FOLDER = ".page"
"""Folder of the page's files, in the output folder."""
RUN_LOCK, RUN_FILE, EVENTS, RESULT, BEFORE = "run.lock", "run.json", "events.jsonl", "result.json", "before.json"
LAST_NOTES = 20


@dataclass(eq=False)
class Work:
    """The calibrations of one output folder, one at a time."""

    out: Path
    prepares: bool = False
    """Whether a waiting process is prepared for the next calibration; true in a server."""
    _waiting: _Waiting | None = None
    _process: subprocess.Popen[bytes] | None = None
    _ended: int | None = None
    """Exit status of the last run; None if this server did not see a run end."""
    _lock: threading.RLock = field(default_factory=threading.RLock)

    @property
    def folder(self) -> Path:
        """Folder of the page's files."""
        return self.out / FOLDER

    def prepare(self) -> None:
        """Start a process that imports the modules of a calibration and waits, so that the next calibration starts at once."""
        with self._lock:
            if not self.prepares or (self._waiting is not None and self._waiting.process.poll() is None) or self.running():
                return
            with suppress(InputError, OSError):  # then `start` begins a new process
                make_folder(self.folder)
                lock = (self.folder / RUN_LOCK).open("a+b")
                self._waiting = _Waiting(_begin("passerby.cli.ready", [], lock, subprocess.PIPE, None, None), lock)

    def start(self, scene: Path, version: str) -> None:
        """Begin or resume a calibration. Raises `InputError` if one is running, or the folder cannot be written."""
        with self._lock:
            make_folder(self.folder)
            waiting, self._waiting = self._waiting, None
            # The process inherits the lock, which is released when the process ends.
            lock = (self.folder / RUN_LOCK).open("a+b") if waiting is None else waiting.lock
            try:
                if not try_lock(lock):
                    raise InputError("a calibration is running already: stop it first")
                self._keep_before()
                for name in (EVENTS, RESULT):
                    (self.folder / name).unlink(missing_ok=True)
                command = ["calibrate", str(scene.absolute()), "-o", str(self.out.absolute()), "--json", "--progress", "json"]
                self._process = None if waiting is None else waiting.run(command, self.folder / RESULT, self.folder / EVENTS)
                if self._process is None:
                    with (self.folder / EVENTS).open("wb") as events, (self.folder / RESULT).open("wb") as result:
                        self._process = _begin("passerby", command, lock, None, result, events)
                self._ended = None
                try:
                    write_text(self.folder / RUN_FILE, json.dumps({"pid": self._process.pid, "version": version}))
                except InputError:  # `stop` could not find the process later
                    self._process.terminate()
                    self._process.wait()
                    self._process = None
                    raise
            except OSError as error:
                raise cannot_write(self.folder, error) from error
            finally:
                lock.close()

    def stop(self) -> None:
        """Interrupt the running calibration, as Ctrl-C does; detections from videos are kept."""
        with self._lock:
            if not self.running():
                return
            with suppress(OSError, ValueError, KeyError, TypeError):
                pid = int(json.loads((self.folder / RUN_FILE).read_text(encoding="utf-8"))["pid"])
                if sys.platform == "win32":
                    os.kill(pid, signal.SIGTERM)
                else:
                    os.killpg(pid, signal.SIGINT)

    def running(self) -> bool:
        """Check whether a calibration is running that this server or an earlier one began."""
        with self._lock:  # `try_lock` holds the file's lock for a moment
            if self._process is not None:
                if self._process.poll() is None:
                    return True
                self._ended, self._process = self._process.returncode, None
            try:
                with (self.folder / RUN_LOCK).open("rb+") as lock:
                    return not try_lock(lock)
            except OSError:
                return False

    def status(self) -> dict[str, Any]:
        """Return the status of the current or last run as plain values: `state` is none, running, done, failed or stopped."""
        running = self.running()
        events = _events(self.folder / EVENTS)
        told: dict[str, Any] = {
            "state": "running" if running else "none",
            "stages": _stages(events),
            "version": self._version(),
        }
        told["notes"] = [one["text"] for one in events if one.get("event") in ("note", "warning")][-LAST_NOTES:]
        errors = [one["text"] for one in events if one.get("event") == "error"]
        if running or (not events and not self._ended):
            return told
        if self._has_finished():
            told["state"] = "done"
        elif not errors and self._ended is not None and self._ended > 0:
            unheard = "the calibration ended, but what it says could not be written: make room there and calibrate again"
            told |= {"state": "failed", "error": f"{self.folder}: {unheard}"}
        elif errors and errors[-1] != "interrupted":
            told |= {"state": "failed", "error": errors[-1]}
        else:
            told["state"] = "stopped"
        return told

    def before(self) -> dict[str, Any] | None:
        """Read the report of the calibration before the last one; None if there was none."""
        try:
            found: dict[str, Any] = json.loads((self.folder / BEFORE).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return found

    def _keep_before(self) -> None:
        """Keep the last calibration's report for the comparison with the new one."""
        with suppress(OSError):
            shutil.copyfile(self.out / CALIBRATION_FILE, self.folder / BEFORE)

    def _version(self) -> str:
        try:
            return str(json.loads((self.folder / RUN_FILE).read_text(encoding="utf-8"))["version"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _has_finished(self) -> bool:
        """Check whether the process has reported its verdict."""
        try:
            return "verdict" in json.loads((self.folder / RESULT).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False


@dataclass(frozen=True)
class _Waiting:
    """A process that waits for its command line, and the open file of the lock that the run will hold."""

    process: subprocess.Popen[bytes]
    lock: IO[bytes]

    def run(self, command: Sequence[str], output: Path, errors: Path) -> subprocess.Popen[bytes] | None:
        """Send the process its command line, and return the process; None if it has ended."""
        assert self.process.stdin is not None
        told = {"arguments": list(command), "output": str(output.absolute()), "errors": str(errors.absolute())}
        try:
            with self.process.stdin as words:
                words.write(json.dumps(told).encode() + b"\n")
        except OSError:
            return None
        return self.process if self.process.poll() is None else None


def _begin(
    module: str, arguments: Sequence[str], lock: IO[bytes], words: int | None, output: IO[bytes] | None,
    errors: IO[bytes] | None,
) -> subprocess.Popen[bytes]:  # fmt: skip
    """Start a process that shares the lock, in a session of its own: it survives the server, and stops with its children."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=words or subprocess.DEVNULL, stdout=output or subprocess.DEVNULL, stderr=errors or subprocess.DEVNULL,
        pass_fds=() if sys.platform == "win32" else (lock.fileno(),), start_new_session=True,
    )  # fmt: skip


def _events(path: Path) -> list[dict[str, Any]]:
    """Read the events of a run so far. A line that is not JSON and begins with "error: " is an error message of the command."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    found = []
    for line in lines:
        try:
            event = json.loads(line)
            found.append(event if isinstance(event, dict) else {})
        except ValueError:
            if line.startswith("error: "):
                found.append({"event": "error", "text": line.removeprefix("error: ")})
    return found


def _stages(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the stages in their order, each with the last count of its parts."""
    stages: dict[str, dict[str, Any]] = {}
    for event in events:
        name = event.get("stage")
        if not isinstance(name, str):
            continue
        stage = stages.setdefault(name, {"name": name, "state": "running", "parts": {}, "seconds": 0.0})
        stage["seconds"] = event.get("seconds", stage["seconds"])
        if event["event"] == "progress":
            stage["parts"][event.get("part", "")] = [event.get("done", 0), event.get("total", 0)]
        elif event["event"] in ("end", "failed"):
            stage["state"] = "done" if event["event"] == "end" else "failed"
        elif event["event"] == "begin":
            stage["state"] = "running"
    return list(stages.values())
