"""One opened scene: its state for the browser, the acts that change its file, and the results of its calibration."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError, PasserbyError
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.lens_figures import LensFigures
from passerby.interchange.calibration_json import CALIBRATION_FILE, CalibrationDocument, parse_document, read_document
from passerby.interchange.output_folder import REPORT_FILE, read_folder_rig
from passerby.interchange.storage.atomic import make_folder, write_text
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.page.pictures import PictureStore
from passerby.page.requests import remove_folders
from passerby.page.scene_edits import save_scene, text_of, version_of
from passerby.page.work import Work
from passerby.report.recommendations import choose_first_reasons
from passerby.scene.scene import Scene
from passerby.scene.world_tables import PlanTable

UNDO_FILE = "undo.json"
MOST_UNDONE = 20


class StaleError(InputError):
    """An act on a scene file that was changed since its browser read it."""


@dataclass(eq=False)
class Session:
    """A scene file and the folder of its calibration, for any number of browsers."""

    scene_file: Path
    out: Path
    serves: bool = False
    """Whether a lasting server uses the session: then a process is prepared for the next calibration after each act."""
    pictures: PictureStore = field(default_factory=PictureStore)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _checking: threading.Lock = field(default_factory=threading.Lock)
    _checked: tuple[str, dict[str, Any]] | None = None
    _rig: tuple[tuple[int, int], Rig] | None = None

    def __post_init__(self) -> None:
        self.work = Work(self.out, self.serves)

    @property
    def version(self) -> str:
        """Version of the current scene file."""
        return version_of(self.scene_file)

    def scene(self) -> tuple[Scene, str]:
        """Read the scene and its version. Raises `InputError` if the file is broken."""
        version = self.version
        return Scene.load(self.scene_file), version

    def camera(self, name: str) -> tuple[Scene, str]:
        """Read the scene and its version. Raises `InputError` if the scene has no camera of this name."""
        scene, version = self.scene()
        if name not in scene.cameras:
            raise InputError("the scene has no such camera")
        return scene, version

    def rig(self) -> Rig:
        """Return the rig of the output folder. Raises `InputError` if there is none yet."""
        path = self.out / "rig.toml"
        try:
            stat = path.stat()
        except OSError:
            raise InputError("there is no rig yet: calibrate first") from None
        stamp = stat.st_mtime_ns, stat.st_size
        if self._rig is None or self._rig[0] != stamp:
            self._rig = stamp, read_folder_rig(self.out)
        return self._rig[1]

    def state(self) -> dict[str, Any]:
        """Return the changing state as plain values; this is fast, because browsers request it every second."""
        told: dict[str, Any] = {"file": self.scene_file.name, "version": self.version, "can_undo": self._undo() is not None}
        try:
            scene = Scene.load(self.scene_file)
        except InputError as error:
            told |= {"name": self.scene_file.stem, "cameras": [], "faults": [self.public(one) for one in faults_of(error)]}
        else:
            told |= {"name": scene.name, "faults": [], "cameras": list(scene.cameras), **_cues(scene)}
        try:
            told["posed"] = [[camera.name, *camera.lens.size] for camera in self.rig().posed()]
        except PasserbyError:
            told["posed"] = []
        told["run"] = self.work.status()
        if "error" in told["run"]:
            told["run"]["error"] = self.public(told["run"]["error"])
        told["run"]["notes"] = [self.public(one) for one in told["run"]["notes"]]
        told["result"] = outcome(self.out)
        told["before"] = outcome(self.work.folder, self.work.before()) if told["result"] else None
        told["report"] = self._stamp(self.out / REPORT_FILE)
        told["calibration"] = self._stamp(self.out / CALIBRATION_FILE)
        return told

    def check(self) -> dict[str, Any]:
        """Return the result of `passerby check` for the current scene; computed once for each version of the file."""
        # This import loads the modules of a calibration and takes a second, for which the first pictures need not wait.
        from passerby.scene.check import check_scene

        with self._checking:
            version = self.version
            if self._checked is None or self._checked[0] != version:
                self._checked = version, self._public_values(check_scene(self.scene_file).to_dict())
            return self._checked[1]

    def act(self, version: str, change: Callable[[str], str]) -> None:
        """Change the scene file atomically, if it still has the version that the browser saw.

        Raises:
            StaleError: the file has another version.
            InputError: the changed text is not a valid scene; nothing is written.
        """
        with self._lock:
            self._check_version(version)
            before = text_of(self.scene_file)
            after = change(before)
            save_scene(self.scene_file, after)
            self._remember(before)
        self.work.prepare()

    def undo(self, version: str) -> None:
        """Undo the last act. Raises as `act` does, and `InputError` if there is none."""
        with self._lock:
            self._check_version(version)
            step = self._undo()
            if step is None:
                raise InputError("there is no act to take back: the scene file was changed since, or never by this page")
            save_scene(self.scene_file, str(step["before"]))
            # Without this step, the next undo finds the act before it.
            self._write_undo([one for one in self._list_steps() if one is not step and one != step])

    def public(self, text: str) -> str:
        """Return a message without the folders of this machine."""
        return remove_folders(text, (self.scene_file.parent, self.out.parent))

    def _public_values(self, value: Any) -> Any:
        """Apply `public` to all texts in plain values."""
        if isinstance(value, str):
            return self.public(value)
        if isinstance(value, dict):
            return {key: self._public_values(one) for key, one in value.items()}
        return [self._public_values(one) for one in value] if isinstance(value, list | tuple) else value

    def _check_version(self, version: str) -> None:
        if version != self.version:
            raise StaleError("the scene file was changed meanwhile, by an editor or another browser: the page shows it now")

    def _stamp(self, path: Path) -> str:
        """Return a text that changes when a file changes; empty if there is no file."""
        try:
            stat = path.stat()
        except OSError:
            return ""
        return f"{stat.st_mtime_ns:x}-{stat.st_size:x}"

    def _remember(self, before: str) -> None:
        """Keep the text that the last act replaced."""
        self._write_undo([*self._list_steps(), {"after": self.version, "before": before}][-MOST_UNDONE:])

    def _undo(self) -> dict[str, str] | None:
        """Return the act that made the current text of the file; None if there is none."""
        return next((one for one in reversed(self._list_steps()) if one.get("after") == self.version), None)

    def _list_steps(self) -> list[dict[str, str]]:
        try:
            found = json.loads((self.work.folder / UNDO_FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return []
        return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []

    def _write_undo(self, steps: list[dict[str, str]]) -> None:
        make_folder(self.work.folder)
        write_text(self.work.folder / UNDO_FILE, json.dumps(steps))


def _cues(scene: Scene) -> dict[str, Any]:
    """Return the scene file's lengths, heights, identities, exclusions, limits in time, and world frame as plain values."""
    world = scene.world
    how = None
    if world is not None:
        how = world.placed_by
    return {
        "lengths": [
            {"metres": one.metres, "sd_m": one.sd_m, "points": {name: list(ends) for name, ends in one.points.items()}}
            for one in scene.scale.lengths
        ],
        "checks": [one.model_dump(mode="json", exclude_none=True) for one in scene.scale.checks],
        "people": [one.model_dump(mode="json", exclude_none=True) for one in scene.scale.people],
        **{
            key: [one.model_dump(mode="json", exclude_none=True) for one in getattr(scene.association, key)]
            for key in ("same", "different", "not_people")
        },
        "excluded": {
            name: {"exclude": camera.exclude, "exclude_s": camera.exclude_s}
            for name, camera in scene.cameras.items()
            if camera.exclude or camera.exclude_s
        },
        "limits": {
            name: {key: value for key in ("from_s", "until_s") if (value := getattr(camera, key)) is not None}
            for name, camera in scene.cameras.items()
        },
        "world": how,
        "lines": [] if world is None else [one.model_dump(mode="json") for one in world.lines],
        "plan": None if world is None or world.plan is None else _describe_plan(world.plan),
    }


def _describe_plan(plan: PlanTable) -> dict[str, Any]:
    """Return the scene file's plan as plain values, with only the file name of its picture."""
    told = plan.model_dump(mode="json", exclude_unset=True, include={"metres_per_pixel", "distance", "cameras", "points"})
    return {**told, "name": plan.image.name}


def outcome(folder: Path, kept: dict[str, Any] | None = None) -> dict[str, Any] | None:
    """Return the outcome of the calibration in a folder, or of a kept document; None if there is none that can be read."""
    try:
        if kept is not None:
            document = parse_document(json.dumps(kept))
        elif (folder / CALIBRATION_FILE).is_file():
            document = read_document(folder)
        else:
            return None
    except InputError:
        return None
    return _describe_entry(document)


def _describe_entry(document: CalibrationDocument) -> dict[str, Any]:
    lenses = adjusted(document.figures).lenses
    return {
        "verdict": document.verdict,
        "reasons": choose_first_reasons(document),
        "findings": list(document.findings),
        "cameras": [
            {
                "name": one.name,
                "centre_m": None if one.centre_m is None else list(one.centre_m),
                "heading_deg": one.heading_deg,
                "tilt_deg": one.tilt_deg,
                "points_sigma_mm": one.points_sigma_mm,
                "ground_sigma_mm": one.ground_sigma_mm,
                "position_sigma_mm": one.position_sigma_mm,
                "orientation_sigma_deg": one.orientation_sigma_deg,
                "time_offset_s": one.time_offset_s,
                "time_offset_sigma_s": one.time_offset_sigma_s,
                "fps": one.fps,
                "registered": one.registered is not False,
                **_focal(lenses.get(one.name)),
                **_list_findings(document, one.name),
            }
            for one in document.cameras
        ],
    }


def _focal(lens: LensFigures | None) -> dict[str, float | None]:
    """Return an estimated focal length and its sigma, pixels; None if the stated one was used."""
    focal = None if lens is None else lens.focal
    return {
        "focal_px": None if focal is None else focal.refined_px,
        "focal_sigma_px": None if focal is None else focal.sigma_px,
    }


def _list_findings(document: CalibrationDocument, name: str) -> dict[str, list[str]]:
    """List the diagnostics that name a camera: problems, and warnings that do not change the verdict.

    Diagnostics that name all cameras are left out: the page shows them only at the top, with `reasons` and `findings`.
    """
    everywhere = {one.name for one in document.cameras}
    own = [one for one in document.diagnostics or () if name in one.cameras and not everywhere <= set(one.cameras)]
    return {
        "problems": [one.text for one in own if one.severity != "notice"],
        "warnings": [one.text for one in own if one.severity == "notice"],
    }
