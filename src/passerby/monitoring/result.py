"""Result of monitoring, in words and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import EvidenceError
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.interchange.monitor_json import MONITOR_FILE, SCHEMA_VERSION, MonitoredCamera, MoveEntry, State
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.text_formats import plain, to_json
from passerby.monitoring.budget import Thinning
from passerby.monitoring.evidence import MotionTest
from passerby.monitoring.given_rig import Carried, News
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from passerby.people.held_cameras import GroundPlane


@dataclass(frozen=True, eq=False, kw_only=True)
class Sources:
    """Sources of the rig and the footage, so that both can be shown again. Paths are absolute; None if there was no file."""

    scene_file: str | None = None
    """Scene file of the footage."""
    rig_file: str | None = None
    calibration_scene_file: str | None = None
    """Scene file from which the rig was calibrated."""
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    """Clock of each camera's footage."""
    news: Mapping[str, News] = field(default_factory=dict)
    """State of the files that were read, by camera."""
    judged_by: str | None = None
    """Digest of the rig and the test: see `given_rig.describe_test`."""


@dataclass(frozen=True, eq=False)
class MonitoringResult:
    """Result of the test whether cameras have moved since they were calibrated."""

    given: Rig
    """The rig as it was calibrated."""
    watched: Watched
    options: WatchOptions
    ground: GroundPlane | None
    """Plane of the ground; None if each camera was tested with its own ground."""
    notes: tuple[str, ...] = ()
    """Notes about the input, one sentence each."""
    sources: Sources = field(default_factory=Sources)
    carried: Mapping[str, Carried] = field(default_factory=dict)
    """Results of an earlier run for cameras without new files, or whose new files give no evidence."""

    thinning: Thinning | None = None
    """The part of the footage that was used to stay in the budget; None without a budget."""

    def __repr__(self) -> str:
        return f"MonitoringResult({', '.join(f'{name}: {self.state(name)}' for name in self.cameras)})"

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras that were tested."""
        return self.watched.names

    @cached_property
    def cameras(self) -> tuple[str, ...]:
        """The cameras with a result: those that were tested, and those of an earlier run."""
        return tuple(name for name in self.given.names if name in self.watched.names or name in self.carried)

    @property
    def moves(self) -> tuple[Move, ...]:
        """All moves, in the order in which they were noticed."""
        return self.watched.moves

    @cached_property
    def rig(self) -> Rig:
        """The rig with new poses and sigmas of the cameras that moved; the others are the given objects.

        A camera keeps its old pose if the people do not determine which of several moved, or are too few to place it.
        """
        latest = {move.camera: move for move in self.moves}
        cameras = []
        for camera in self.given:
            move = latest.get(camera.name)
            known = self.carried.get(camera.name)
            if known is not None:
                cameras.append(known.pose or camera)
                continue
            sound = move is not None and move.pose is not None and not move.others
            cameras.append(replace(camera, pose=move.pose, sigma=move.sigma) if move is not None and sound else camera)
        return replace(self.given, cameras=tuple(cameras))

    @cached_property
    def changed(self) -> tuple[str, ...]:
        """The cameras that have a new pose in `rig`."""
        return tuple(old.name for old, new in zip(self.given, self.rig, strict=True) if new is not old)

    def state(self, camera: str) -> State:
        """Return the state of a camera, from an earlier run if that is used."""
        if camera in self.carried:
            return self.carried[camera].entry.state
        return self.state_by_footage(camera)

    def state_by_footage(self, camera: str) -> State:
        """Return the state of a tested camera by the footage alone, without an earlier run."""
        own = [move for move in self.moves if move.camera == camera]
        if any(not move.others for move in own):
            return "moved"
        if own or any(camera in move.others for move in self.moves):
            return "one of several moved"
        return "steady" if self.told(camera) else "cannot tell"

    @cached_property
    def _tests(self) -> dict[str, list[MotionTest]]:
        """The tests of each camera, one for each window that contains it."""
        found: dict[str, list[MotionTest]] = {name: [] for name in self.names}
        for window in self.watched.windows:
            for test in window.tests:
                found[self.names[test.camera]].append(test)
        return found

    def windows(self, camera: str) -> int:
        """Return the number of windows that contain a camera."""
        return len(self._tests[camera])

    def told(self, camera: str) -> int:
        """Return the number of windows with a clear test of a camera (`MotionTest.is_clear`)."""
        return sum(test.is_clear for test in self._tests[camera])

    def smallest(self, camera: str, *, worst: bool = False) -> tuple[float | None, float | None]:
        """Return the shift (metres) and the turn (degrees) of a camera that a window would show in 95 % of the cases.

        Both are medians over the windows with a clear test, or over all windows if there are none; None if no window has a
        finite limit.

        Args:
            camera: name of the camera.
            worst: whether the worst of three directions at right angles is used, instead of the middle one.
        """
        every = self._tests[camera]
        own = [test for test in every if test.is_clear] or every
        sizes = [(test.smallest_m[worst], test.smallest_deg[worst]) for test in own if np.isfinite(test.smallest_m[1])]
        if not sizes:
            return None, None
        metres, degrees = np.median(np.array(sizes), axis=0).tolist()
        return metres, degrees

    def whole_limit(self, camera: str) -> tuple[float | None, float | None]:
        """Return the shift (metres) and turn (degrees) that all footage since the last move shows in 95 % of the cases.

        Both are along the worst of three directions at right angles; None if that footage gives no evidence on the camera.
        """
        for test in (test for one in self.watched.whole for test in one.tests):
            if self.names[test.camera] == camera and np.isfinite(test.smallest_m[1] + test.smallest_deg[1]):
                return test.smallest_m[1], test.smallest_deg[1]
        return None, None

    @property
    def most_moved(self) -> tuple[str, ...]:
        """The cameras whose moves were noticed together, if they are more than half of the rig's; else none.

        The evidence then does not determine which of the cameras were at rest.
        """
        for noticed in sorted({move.noticed_s for move in self.moves}):
            together = {move.camera for move in self.moves if move.noticed_s == noticed}
            if 2 * len(together) > len(self.names):
                return tuple(name for name in self.names if name in together)
        return ()

    @property
    def exit_status(self) -> int:
        """0: every camera is steady; 3: a camera has moved, or its state is unknown."""
        return 0 if all(self.state(name) == "steady" for name in self.cameras) else EvidenceError.exit_status

    def sentences(self) -> list[str]:
        """Return one sentence for each move, and for each camera of unknown state."""
        told = [move_in_words(move) for move in self._moves]
        if self.most_moved:
            told.append(f"most cameras moved relative to each other ({', '.join(self.most_moved)}): calibrate anew")
        silent = [name for name in self.names if name not in self.carried and self.state(name) == "cannot tell"]
        return told + [self._silence(name) for name in silent]

    @property
    def _moves(self) -> list[MoveEntry]:
        """All moves as entries of the file; those that an earlier run noticed are last."""
        return [*map(entry_of, self.moves), *(move for one in self.carried.values() for move in one.moves)]

    def _silence(self, name: str) -> str:
        """Return the reason why the state of a camera is unknown."""
        metres, degrees = self.smallest(name)
        few = "not enough people that another camera also sees"
        if metres is None or degrees is None:
            return f"{name}: cannot tell: {few}"
        return (
            f"{name}: cannot tell: a move below {metres:.2f} m or {degrees:.1f} degrees would not be detected: {few}, or the "
            f"sigmas of the rig are large and the footage is too short to reduce them"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the whole result as plain values for JSON."""
        out: dict[str, Any] = plain({
            "schema_version": SCHEMA_VERSION,
            "from_s": self.watched.from_s, "until_s": self.watched.until_s, "window_s": self.options.every_s,
            "threshold": self.options.threshold, "exit_status": self.exit_status,
            "ground": None if self.ground is None else {"height_m": self.ground.height, "slope": self.ground.slope},
            "cameras": [self.camera(name) for name in self.cameras],
            "moves": self._moves, "most_moved": self.most_moved,
            "by_joints": self.watched.by_joints, "thinning": self.thinning,
            "windows": [_window(window, self.names) for window in self.watched.windows],
            "whole": [_window(window, self.names) for window in self.watched.whole],
            "notes": self.notes,
            "scene_file": self.sources.scene_file, "rig_file": self.sources.rig_file,
            "calibration_scene_file": self.sources.calibration_scene_file, "judged_by": self.sources.judged_by,
        })  # fmt: skip
        return out

    def camera(self, name: str) -> MonitoredCamera:
        """Return the entry of a camera in the summary, from this run or an earlier one."""
        if name in self.carried:
            return self.carried[name].entry
        metres, degrees = self.smallest(name)
        worst_m, worst_deg = self.smallest(name, worst=True)
        clock, news = self.sources.clocks.get(name), self.sources.news.get(name)
        return MonitoredCamera(
            name=name, state=self.state(name), windows=self.windows(name), windows_told=self.told(name),
            smallest_shift_m=metres, smallest_turn_deg=degrees, worst_shift_m=worst_m, worst_turn_deg=worst_deg,
            new_pose=name in self.changed, fps=None if clock is None else clock.fps,
            time_offset_s=None if clock is None else clock.offset_s, news=None if news is None else news.digest,
            as_of=None if news is None else news.as_of,
        )  # fmt: skip

    def write(self, folder: str | Path, rig_text: str) -> None:
        """Write `rig.toml` and `monitor.json` into a folder, both or neither.

        Raises `InputError` if the folder is not writable, or if another process works in it.
        """
        from passerby.interchange.output_folder import RIG_FILE
        from passerby.interchange.storage.transaction import folder_lock, transaction

        with folder_lock(Path(folder), "passerby monitor"), transaction(Path(folder)) as new:
            write_text(new / RIG_FILE, rig_text)
            write_text(new / MONITOR_FILE, to_json(self.to_dict()))


def measure_shift(shift: Floats, covariance: Floats) -> tuple[float | None, float | None]:
    """Return the length of a shift (3,) and its one sigma; None if unknown."""
    length = float(np.linalg.norm(shift))
    if not np.isfinite(length):
        return None, None
    way = shift / max(length, 1e-12)
    return length, float(np.sqrt(way @ covariance @ way))


def clock_time(seconds: float) -> str:
    """Format seconds from the footage's first frame as 00:05:12."""
    whole = max(0, round(seconds))
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def move_in_words(move: MoveEntry) -> str:
    """Return a sentence with the camera that moved, the time and the size of the move."""
    who = " or ".join((move.camera, *move.or_))
    when = "before the footage began" if move.seconds is None or move.from_s is None or move.until_s is None else (
        f"at {clock_time(move.seconds)} (between {clock_time(move.from_s)} and {clock_time(move.until_s)})"
    )  # fmt: skip
    noticed = f"noticed {'in an earlier run ' if move.carried else ''}at {clock_time(move.noticed_s)}"
    if move.metres is None or move.metres_sigma is None or move.degrees is None or move.degrees_sigma is None:
        return f"{who} moved {when}; not enough people to estimate by how much; {noticed}"
    turn = f"{move.degrees:.2f} +- {move.degrees_sigma:.2f} degrees"
    which = "" if not move.or_ else f" (if it was {move.camera}: the people do not show which)"
    return f"{who} moved {when}, by {move.metres:.3f} +- {move.metres_sigma:.3f} m and {turn}{which}; {noticed}"


def entry_of(move: Move) -> MoveEntry:
    """Return the entry of a move for files."""
    metres, metres_sd = measure_shift(move.shift[:3], move.covariance[:3, :3])
    radians, radians_sd = measure_shift(move.shift[3:], move.covariance[3:, 3:])
    moment, pose = move.moment, move.pose
    return MoveEntry(
        camera=move.camera, or_=move.others, before_footage=moment is None,
        seconds=None if moment is None else moment.seconds, from_s=None if moment is None else moment.from_s,
        until_s=None if moment is None else moment.until_s, noticed_s=move.noticed_s, score=move.score,
        metres=metres, metres_sigma=metres_sd, degrees=None if radians is None else float(np.degrees(radians)),
        degrees_sigma=None if radians_sd is None else float(np.degrees(radians_sd)),
        shift_m=tuple(plain(move.shift[:3])), turn_deg=tuple(plain(np.degrees(move.shift[3:]))),
        rotation_matrix=None if pose is None else tuple(map(tuple, pose.R_cw.tolist())),
        centre_m=None if pose is None else tuple(pose.centre.tolist()),
    )  # fmt: skip


def _window(window: Window, names: Sequence[str]) -> dict[str, Any]:
    """Return each camera's score and detection limits in a window, JSON-ready."""
    return {
        "from_s": window.from_s, "until_s": window.until_s,
        "cameras": {
            names[test.camera]: {
                "score": test.score, "stretches": test.clusters, "told": test.is_clear,
                "smallest_shift_m": test.smallest_m[0], "smallest_turn_deg": test.smallest_deg[0],
                "worst_shift_m": test.smallest_m[1], "worst_turn_deg": test.smallest_deg[1],
            }
            for test in window.tests
        },
    }  # fmt: skip


Monitored = MonitoringResult
"""Earlier name of `MonitoringResult`."""
