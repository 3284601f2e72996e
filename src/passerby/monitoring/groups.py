"""A calibration in groups that share no people: each is a rig of its own, and is monitored as one."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.interchange.monitor_json import MONITOR_FILE
from passerby.interchange.output_folder import GROUPS_FOLDER, RIG_FILE, group_folder
from passerby.monitoring.given_rig import GivenRig, read_given, rig_text
from passerby.monitoring.monitor import monitor
from passerby.monitoring.result import MonitoringResult
from passerby.monitoring.watched import WatchOptions
from passerby.scene.scene import Scene

MAIN = 1


@dataclass(frozen=True, eq=False)
class MonitoredGroup:
    """What was found of one group."""

    number: int
    """1 for the main rig, then as the folders are numbered."""
    given: GivenRig
    found: MonitoringResult

    @property
    def folder(self) -> str:
        """Within the folder that is written; empty for the main rig."""
        return "" if self.number == MAIN else group_folder(self.number)

    def write(self, out: Path) -> None:
        """Write `rig.toml` and `monitor.json` of this group. Raises `InputError` where the folder is not writable."""
        self.found.write(out / self.folder, rig_text(self.given, self.found.rig, self.found.changed))


def read_groups(path: Path) -> dict[int, GivenRig]:
    """The rigs of a rig file, or of a folder with those of its further groups, by number.

    Raises `InputError` where one cannot be read.
    """
    found = {MAIN: read_given(path)}
    if path.is_dir() and (path / GROUPS_FOLDER).is_dir():
        numbers = [int(one.name) for one in (path / GROUPS_FOLDER).iterdir() if one.name.isdecimal()]
        for number in sorted(numbers):
            folder = path / group_folder(number)
            if number > MAIN and (folder / RIG_FILE).is_file():
                found[number] = read_given(folder)
    return found


def monitor_groups(
    groups: Mapping[int, GivenRig], scene: Scene, options: WatchOptions, *, in_step: bool = False, keep: Path | None = None,
    tell: Progress = silent, executor: Executor | None = None,
) -> list[MonitoredGroup]:  # fmt: skip
    """Whether cameras of any group have moved; groups of which fewer than two cameras have footage are left out.

    Args:
        groups: of `read_groups`.
        scene: new footage, of one or more groups.
        options: see `WatchOptions`.
        in_step: as of `monitor`.
        keep: as of `monitor`; each further group has its own folder in it.
        tell: called with each stage.
        executor: works on cameras side by side.

    Raises:
        InputError: the scene cannot be read, a camera is in no group, or no group has two cameras with footage.
    """
    if len(groups) == 1:
        ((number, given),) = groups.items()
        found = monitor(given, scene, options, in_step=in_step, keep=keep, progress=tell, executor=executor)
        return [MonitoredGroup(number, given, found)]
    named = {name: _group_of(groups, name, scene.place) for name in scene.cameras}
    done = []
    for number, given in groups.items():
        folder = None if keep is None else keep if number == MAIN else keep / group_folder(number)
        own = [name for name in named if named[name] == number]
        enough = sum(given.rig[name].pose is not None for name in own) > 1
        known = folder is not None and (folder / MONITOR_FILE).is_file()
        if own and (enough or known):
            part = scene.part(own, given.path)
            found = monitor(given, part, options, in_step=in_step, keep=folder, progress=tell, executor=executor)
            done.append(MonitoredGroup(number, given, found))
    if not done:
        raise InputError(
            f"{scene.place}: of no group of the calibration two cameras with a pose have footage: two or more that see the "
            "same people are needed, and three to determine which of them has moved"
        )
    return done


def _group_of(groups: Mapping[int, GivenRig], name: str, place: str) -> int:
    """The group in which a camera has a pose, or else is named. Raises `InputError` where it is in none."""
    inside = [number for number, given in groups.items() if name in given.rig.names]
    if not inside:
        every = dict.fromkeys(one for given in groups.values() for one in given.rig.names)
        raise InputError(
            f"{place}: camera {name} is not in the rig, which has {', '.join(every)}: use the camera names of the rig"
        )
    posed = [number for number in inside if groups[number].rig[name].pose is not None]
    return (posed or inside)[0]
