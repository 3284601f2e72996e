"""Monitoring of a rig with new footage: it finds the cameras that have moved since the calibration.

If a calibration has groups that share no people, each group is a separate rig and is monitored separately.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import Clock, Observations
from passerby.core.quarter_turns import turn_rig
from passerby.core.synchronisation import resample_to_common_steps
from passerby.findings.finding import notice
from passerby.findings.texts import text_of, texts_of
from passerby.interchange.monitor_json import MONITOR_FILE
from passerby.interchange.output_folder import GROUPS_FOLDER, RIG_FILE, group_folder, scene_file
from passerby.monitoring.budget import SITE_BUDGET_S, Thinning, plan_thinning, thin
from passerby.monitoring.given_rig import GivenRig, describe_test, news_of, read_earlier, read_given, rig_text
from passerby.monitoring.result import MonitoringResult, Sources
from passerby.monitoring.site import MANY, SEED, CamerasOfSite, identify_by_rig, watch_site
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.monitoring.watching import joints_are_shared, watch, watch_adjusted
from passerby.people.ground import fit_ground, rough_height
from passerby.people.held_cameras import GroundPlane
from passerby.people.sightings import gather_sightings
from passerby.scene.inputs import SceneInputs, read_inputs
from passerby.scene.same_content import doubts_of_same_content
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor

MAIN = 1


def monitor(
    given: GivenRig, scene: Scene | str | Path, options: WatchOptions | None = None, *, in_step: bool = False,
    keep: str | Path | None = None, progress: Progress | None = None, executor: Executor | None = None,
) -> MonitoringResult:  # fmt: skip
    """Test whether cameras have moved.

    Args:
        given: the rig, with its clock offsets and the sigmas of its shape.
        scene: new footage of its cameras, under the same names.
        options: see `WatchOptions`.
        in_step: whether the clocks of the footage agree; else they differ as in the calibration.
        keep: folder in which detections in videos are kept. If an earlier run was written into it, its results are used for
            the cameras without new files.
        progress: called with each stage.
        executor: processes cameras in parallel.

    Raises:
        InputError: the scene cannot be read, or its cameras are not those of the rig.
    """
    tell, options = progress or silent, options or WatchOptions()
    tell("reading")
    scene = scene if isinstance(scene, Scene) else Scene.load(scene)
    kept = None if keep is None else Path(keep)
    judged = describe_test(given, options, in_step=in_step)
    earlier = read_earlier(kept, judged)
    news = {name: news_of(scene, name) for name in scene.cameras}
    fresh = tuple(name for name in scene.cameras if not earlier.has_read(name, news[name].digest))
    carried = earlier.of([name for name in given.rig.names if name not in fresh])
    if carried:
        unposed = [camera.name for camera in given.rig if camera.pose is None]
        fresh = tuple(name for name in fresh if name not in unposed)
    if not carried:
        _check_names(given.rig, tuple(scene.cameras), scene.place)
    found = _update_result(given, scene, fresh, options, in_step, kept, tell, executor, alone=bool(carried))
    # A move from an earlier run is kept if the new footage gives no evidence on its camera.
    kept_moves = {
        # The times of the move are of earlier footage, which is no longer there: no frames correspond to them.
        name: replace(one, entry=replace(one.entry, news=news[name].digest, fps=None, time_offset_s=None))
        for name, one in earlier.of(found.names).items()
        if found.windows(name)
        and one.entry.state in ("moved", "one of several moved")
        and found.state_by_footage(name) == "cannot tell"
    }
    findings = list(earlier.findings)
    if carried:
        since = sorted(one.entry.as_of for one in carried.values() if one.entry.as_of)
        findings.append(notice("no_news", count=len(carried), first=min(since, default=None), last=max(since, default=None)))
    if kept_moves:
        findings.append(notice("news_without_people", *kept_moves))
    # Their files count as not read, so that they are tested again when a neighbour has new files.
    alone = earlier.of([name for name in found.names if not found.windows(name)])
    if alone:
        findings.append(notice("news_alone", *alone))
    tested = {name: one for name, one in news.items() if name in found.names and found.windows(name)}
    sources = replace(
        found.sources, scene_file=scene_file(scene.path), rig_file=scene_file(given.path),
        calibration_scene_file=given.calibration_scene_file, news=tested, judged_by=judged,
    )  # fmt: skip
    absent = [name for name in given.rig.posed().names if name not in scene.cameras and name not in carried]
    notes = (*texts_of(findings), *_list_absent(absent), *found.notes)
    return replace(found, carried=carried | kept_moves | alone, sources=sources, notes=notes)


def _update_result(
    given: GivenRig, scene: Scene, fresh: tuple[str, ...], options: WatchOptions, in_step: bool, keep: Path | None,
    tell: Progress, executor: Executor | None, *, alone: bool,
) -> MonitoringResult:  # fmt: skip
    """Test some of the cameras with their footage; with `alone`, fewer than two cameras give an empty result, not an error."""
    posed = [name for name in fresh if name in given.rig.names and given.rig[name].pose is not None]
    if alone and len(posed) < 2 and set(fresh) <= set(given.rig.names):
        return MonitoringResult(given.rig, Watched(tuple(posed), (), (), 0.0, 0.0), options, None)
    part = scene.part(fresh, given.path) if len(fresh) < len(scene.cameras) else scene
    _check_names(given.rig, fresh, scene.place)
    watcher = SceneVideoProcessor(keep, executor, tell)
    inputs = read_inputs(part, watcher, compare_contents=len(given.rig) <= MANY)
    notes = texts_of([*watcher.notes, *inputs.doubts, *inputs.findings])
    found = monitor_inputs(given, part, inputs, options, in_step=in_step, tell=tell, executor=executor)
    return replace(found, notes=(*notes, *found.notes))


def monitor_inputs(
    given: GivenRig, scene: Scene, inputs: SceneInputs, options: WatchOptions | None = None, *, in_step: bool = False,
    tell: Progress = silent, executor: Executor | None = None,
) -> MonitoringResult:  # fmt: skip
    """Test whether cameras have moved, as `monitor`, from inputs that were read before."""
    options = options or WatchOptions()
    names = [name for name in given.rig.names if name in inputs.rig.names and given.rig[name].pose is not None]
    _check_names(given.rig, inputs.rig.names, scene.place)
    turned = replace(given, rig=turn_rig(given.rig, scene.turns))
    _check_pictures(turned.rig, inputs.rig, scene.place)
    rig, observations = _footage(turned, scene, inputs, names, in_step)
    known = scene.association.given
    doubts: tuple[str, ...] = ()
    budget_s = options.budget_s or (SITE_BUDGET_S if len(given.rig) > MANY else None)
    thinning = Thinning() if budget_s is None else plan_thinning(observations, options, budget_s)
    if budget_s is not None and thinning.is_thinned:
        observations = thin(observations, thinning, options.every_s)
        doubts = (text_of(thinning.finding(budget_s)),)
    if len(given.rig) > MANY:
        site = CamerasOfSite.of(rig, observations)
        doubts += texts_of(doubts_of_same_content(rig, observations, site.pairs_by_name))
        watched, ground = watch_site(site, options, known=known, tell=tell, executor=executor), None
    else:
        watched, ground = watch_footage(rig, observations, options, known=known, tell=tell, executor=executor)
    sources = Sources(clocks=observations.clocks)
    moves = tuple(move.turned(-scene.turns.get(move.camera, 0)) for move in watched.moves)
    notes = (*doubts, *_notes(given, inputs.rig, in_step))
    return MonitoringResult(
        given.rig, replace(watched, moves=moves), options, ground, notes, sources,
        thinning=None if budget_s is None else thinning,
    )  # fmt: skip


def watch_footage(
    rig: Rig, observations: Observations, options: WatchOptions, *, known: bool, tell: Progress = silent,
    executor: Executor | None = None,
) -> tuple[Watched, GroundPlane]:  # fmt: skip
    """Test all cameras of a rig together with footage, and fit the plane of the ground.

    Args:
        rig: the cameras to test, with poses.
        observations: observations of these cameras, with a clock for each.
        options: see `WatchOptions`.
        known: whether identities hold over all cameras; else they are each camera's own tracklets, or -1 for detections.
        tell: called with each stage.
        executor: processes cameras in parallel.
    """
    clocks, sizes = observations.clocks, {camera.name: camera.lens.size for camera in rig}
    # The systems are small, and the number of BLAS threads would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        height = rough_height(rig, observations)
        named = observations
        if not known:
            tell("associating identities")
            rng = np.random.default_rng(SEED)
            named = identify_by_rig(rig, observations, clocks, rng, ground_m=height, executor=executor, tell=tell)
        at_steps = resample_to_common_steps(named, clocks, sizes=sizes)
        seen = gather_sightings(rig, at_steps)
        ground = fit_ground(rig, seen, height)
        if joints_are_shared(at_steps):
            return watch_adjusted(rig, at_steps, seen, options, ground=ground, tell=tell), ground
        return watch(rig, seen, options, ground=ground, tell=tell), ground


def _check_names(rig: Rig, seen: tuple[str, ...], place: str) -> None:
    """Raise `InputError` if the scene's cameras are not those of the rig, or fewer than two of them have a pose."""
    posed = rig.posed().names
    unknown = [name for name in seen if name not in rig.names]
    if unknown:
        raise InputError(
            f"{place}: camera {unknown[0]} is not in the rig, which has {', '.join(rig.names)}: use the camera names of the rig"
        )
    both = [name for name in seen if name in posed]
    if len(both) < 2:
        have = f"only {both[0]}" if both else "none"
        raise InputError(
            f"{place}: of its cameras {have} has a pose in the rig: two or more that see the same people are needed, and "
            f"three to determine which of them has moved"
        )


def _check_pictures(rig: Rig, seen: Rig, place: str) -> None:
    """Raise `InputError` if pictures have another size than those of the rig's lens."""
    for camera in seen:
        size = rig[camera.name].lens.size
        if camera.lens.size != size:
            raise InputError(
                f"{place}: camera {camera.name} has images of {camera.lens.size[0]} x {camera.lens.size[1]}, the rig's of "
                f"{size[0]} x {size[1]}: give footage of the calibrated size, or calibrate again"
            )


def _footage(
    given: GivenRig, scene: Scene, inputs: SceneInputs, names: list[str], in_step: bool
) -> tuple[Rig, Observations]:  # fmt: skip
    """Return the cameras to test, and their observations with their clocks. Raises `InputError` without a frame rate."""
    rig = Rig(tuple(_loosen_camera(given, name) for name in names))
    fps = inputs.observations.fps
    if fps is None:
        raise InputError(f"{scene.place}: no frame rate is given, so frame numbers have no times: under [scene] set fps to it")
    rates = {name: inputs.observations.clocks.get(name, Clock(fps)).fps for name in names}
    offsets = {} if in_step else given.offsets_s
    clocks = {name: Clock(rates[name], offsets.get(name, 0.0)) for name in names}
    return rig, Observations({name: inputs.observations[name] for name in names}, fps, clocks)


def _loosen_camera(given: GivenRig, name: str) -> Camera:
    """Return a camera with the sigma of its place within the rig, without that of the scale, if this is known."""
    camera = given.rig[name]
    shape = given.shape_sigma_m.get(name)
    if shape is None or camera.sigma is None:
        return camera
    return replace(camera, sigma=replace(camera.sigma, position_m=min(shape, camera.sigma.position_m), covariance=None))


def _notes(given: GivenRig, seen: Rig, in_step: bool) -> tuple[str, ...]:
    """Return notes about the input for the user."""
    lost = [name for name in seen.names if given.rig[name].pose is None]
    notes = []
    if lost:
        notes.append(f"{_cameras(lost)} {_choose_have(lost)} no pose in the rig and cannot be monitored")
    if any(given.offsets_s.values()) and not in_step:
        notes.append(
            "clocks are assumed to differ as in the calibration (calibration.json beside the rig); use --in-step if they are "
            "synchronised"
        )
    if all(camera.sigma is None for camera in given.rig.posed()):
        notes.append(
            "the rig states no sigmas: its poses are assumed to have a standard deviation of 5 cm and 0.3 degrees in "
            "each direction"
        )
    return tuple(notes)


def _list_absent(absent: list[str]) -> list[str]:
    """Return a note on cameras that are not in the scene, if there are any."""
    if not absent:
        return []
    return [f"{_cameras(absent)} of the rig {_choose_have(absent)} no footage here and {_choose_are(absent)} not monitored"]


def _cameras(names: list[str]) -> str:
    return f"camera{'s' if len(names) > 1 else ''} {', '.join(names)}"


def _choose_have(names: list[str]) -> str:
    return "have" if len(names) > 1 else "has"


def _choose_are(names: list[str]) -> str:
    return "are" if len(names) > 1 else "is"


@dataclass(frozen=True, eq=False)
class MonitoredGroup:
    """The result of one group."""

    number: int
    """1 for the main rig, then the number of the group's folder."""
    given: GivenRig
    found: MonitoringResult

    @property
    def folder(self) -> str:
        """Folder of the group within the output folder; empty for the main rig."""
        return "" if self.number == MAIN else group_folder(self.number)

    def write(self, out: Path) -> None:
        """Write `rig.toml` and `monitor.json` of this group. Raises `InputError` if the folder is not writable."""
        self.found.write(out / self.folder, rig_text(self.given, self.found.rig, self.found.changed))


def read_groups(path: Path) -> dict[int, GivenRig]:
    """Read the rig of a rig file, or those of an output folder with its further groups, by number of the group.

    Raises `InputError` if one cannot be read.
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
    """Test whether cameras of any group have moved; groups with footage of fewer than two cameras are left out.

    Args:
        groups: result of `read_groups`.
        scene: new footage, of one or more groups.
        options: see `WatchOptions`.
        in_step: as in `monitor`.
        keep: as in `monitor`; each further group has its own folder in it.
        tell: called with each stage.
        executor: processes cameras in parallel.

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
    """Return the group in which a camera has a pose, or else one that contains it. Raises `InputError` if there is none."""
    inside = [number for number, given in groups.items() if name in given.rig.names]
    if not inside:
        every = dict.fromkeys(one for given in groups.values() for one in given.rig.names)
        raise InputError(
            f"{place}: camera {name} is not in the rig, which has {', '.join(every)}: use the camera names of the rig"
        )
    posed = [number for number in inside if groups[number].rig[name].pose is not None]
    return (posed or inside)[0]
