"""The scene file: the user's statements about the cameras, the people and known lengths.

It is TOML and is checked completely: an unknown key, a wrong value or a camera that does not exist is an error that names its
place and its remedy. Paths are relative to the scene file, or absolute.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from passerby.common.errors import InputError
from passerby.common.text import shortened, suggest_name
from passerby.core.observations import BoxFormat
from passerby.core.scale_cues import (
    CameraDistance,
    CameraHeight,
    KnownLength,
    PersonHeight,
    PopulationHeight,
    ScaleCues,
    Wand,
)
from passerby.interchange.storage.safe_parsing import FileFaults, NotParsed, parse_toml, path_problem, read_text
from passerby.interchange.storage.text_formats import check_version
from passerby.perception.video_probe import VARIABLE_CLOCK_FPS
from passerby.scene.lens_keys import check_models, models_of, parse_named_camera
from passerby.scene.scale_tables import (
    CameraHeightTable,
    CheckTable,
    DistanceTable,
    LengthTable,
    PersonTable,
    ScaleTable,
    WandTable,
)
from passerby.scene.table import PersonAtTable, Table, TogetherTable, explain_fault, find_repeated_key
from passerby.scene.tables import (
    RECORDS,
    SCENE_FORMAT,
    AssociationTable,
    CameraTable,
    PerceptionTable,
    RecordingTable,
    SceneTable,
    SitesTable,
    SolverTable,
)
from passerby.scene.world_tables import LineTable, PlanDistanceTable, PlanPointTable, PlanTable, WorldTable, floor_plan

CAMERA_NAME = re.compile(r"[\w+@-][\w .+@-]*")
"""Valid names of cameras: they become names of TOML tables and of files."""
LONGEST_NAME = 100
RESERVED = frozenset(["con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10))])
"""Names that no file can have on Windows, with any ending."""


class Scene(Table):
    """A whole scene file. `Scene.load(path)` reads one; paths are taken from its folder."""

    scene: SceneTable = Field(default_factory=SceneTable)
    cameras: dict[str, CameraTable]
    perception: PerceptionTable = Field(default_factory=PerceptionTable)
    association: AssociationTable = Field(default_factory=AssociationTable)
    sites: SitesTable = Field(default_factory=SitesTable)
    solver: SolverTable = Field(default_factory=SolverTable)
    scale: ScaleTable = Field(default_factory=ScaleTable)
    world: WorldTable | None = None
    recording: RecordingTable | None = None
    _path: Path | None = PrivateAttr(default=None)
    _unrecorded: frozenset[str] = PrivateAttr(default=frozenset())

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file. Raises `FileFaults` (an `InputError`) that names file, key, value and remedy."""
        path = Path(path)
        text = read_text(path, "a scene file (TOML)")
        try:
            content = parse_toml(text)
        except NotParsed as error:
            raise InputError(f"{path}: {find_repeated_key(text) or f'is not TOML: {error}'}") from None
        return cls.of_content(content, path)

    @classmethod
    def of_content(cls, content: dict[str, Any], path: Path, unrecorded: Iterable[str] = ()) -> Scene:
        """Make a scene from the content of a file that exists or will be written. Raises `FileFaults` as `load` does.

        `unrecorded` are the cameras whose videos are not recorded yet.
        """
        table = content.get("scene")
        check_version(path, table if isinstance(table, dict) else {}, "format_version", SCENE_FORMAT, "[scene] ")
        try:
            table = content.get("recording")
            scene = cls.model_validate(content, context={RECORDS: isinstance(table, dict) and "seconds" in table})
        except ValidationError as error:
            # A misspelt key is reported before the key that is missing for it.
            faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
            raise FileFaults([f"{path}: {explain_fault(dict(fault), TABLES)}" for fault in faults]) from None
        scene._path, scene._unrecorded = path, frozenset(unrecorded)
        scene._check_paths()
        return scene

    def _check_paths(self) -> None:
        """Raise `FileFaults` for paths that no system can open, so that they need no check later."""
        faults = []
        for name, table in self.cameras.items():
            for key, value in table:
                for path in value if isinstance(value, tuple) else (value,):
                    if isinstance(path, Path) and (why := path_problem(self.resolve(path))):
                        faults.append(f"{self.place}: [cameras.{name}] {key} is {shortened(str(path))}: {why}")
        for where, value in (("[perception] models", self.perception.models), *self._world_paths()):
            if value is not None and (why := path_problem(self.resolve(value))):
                faults.append(f"{self.place}: {where} is {shortened(str(value))}: {why}")
        if faults:
            raise FileFaults(faults)

    def _world_paths(self) -> list[tuple[str, Path | None]]:
        """Return the files that `[world]` names, each with its key; None where a key is not stated."""
        if self.world is None:
            return []
        plan = [] if self.world.plan is None else [("[world.plan] image", self.world.plan.image)]
        return [*plan, *((f"[world] {key}", getattr(self.world, key)) for key in ("points", "positions"))]

    @property
    def path(self) -> Path | None:
        """The file from which the scene was read; None for a scene from memory."""
        return self._path

    @property
    def unrecorded(self) -> frozenset[str]:
        """Cameras whose videos do not exist yet: their streams are recorded first."""
        return self._unrecorded

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.scene.name or (self._path.stem if self._path else "scene")

    @property
    def place(self) -> str:
        """Name of the scene in error messages."""
        return str(self._path) if self._path else f"scene {self.name}"

    def resolve(self, path: Path) -> Path:
        """Convert a path of the scene file to one that can be opened."""
        return self._path.parent / path if self._path else path

    def with_perception(self, perception: PerceptionTable) -> Scene:
        """Return the same scene with another `[perception]`."""
        changed = self.model_copy(update={"perception": perception})
        changed._path = self._path
        return changed

    def without_intrinsics(self) -> Scene:
        """Return the same scene without the intrinsics of all cameras; image sizes are those of the videos."""
        nothing = {"intrinsics": None, "focal_sd_percent": None}
        cameras = {
            name: table if table.intrinsics is None else table.model_copy(update=nothing)
            for name, table in self.cameras.items()
        }
        changed = self.model_copy(update={"cameras": cameras})
        changed._path = self._path
        return changed

    def part(self, names: Collection[str], rig: Path | None) -> Scene:
        """Return the scene of some cameras, as if the others did not exist.

        Statements about lengths, places, people and sites are left out. A camera that shares the lens of a left-out camera gets
        its lens from the rig file.
        """
        cameras = {}
        for name, table in self.cameras.items():
            if name in names:
                lens = {"lens": None, "intrinsics": None if rig is None else rig.absolute()}
                cameras[name] = table if self.models[name][0] in names else table.model_copy(update=lens)
        association = AssociationTable(mode=self.association.mode, max_offset_s=self.association.max_offset_s)
        changed = self.model_copy(
            update={
                "cameras": cameras, "association": association, "scale": ScaleTable(), "sites": SitesTable(),
                "world": None, "recording": None,
            }
        )  # fmt: skip
        # Delete the cached value, which is that of all cameras.
        changed.__dict__.pop("models", None)
        changed._path = self._path
        return changed

    @property
    def size_bytes(self) -> int:
        """Total size of the files of boxes and joints, bytes; missing files count as 0."""
        named = (
            path for table in self.cameras.values() for path in (table.tracks or table.detections, table.keypoints) if path
        )
        return sum(path.stat().st_size for path in map(self.resolve, named) if path.is_file())

    @property
    def shared_paths(self) -> tuple[Path, ...]:
        """Paths that are read when videos are processed: the videos and the folder of models, without patterns and streams."""
        named = [path for table in self.cameras.values() for path in table.videos]
        named += [] if self.perception.models is None else [self.perception.models]
        return tuple(path for path in map(self.resolve, named) if path.exists())

    @property
    def n_videos(self) -> int:
        """Number of cameras with a video."""
        return sum(table.video is not None for table in self.cameras.values())

    @cached_property
    def models(self) -> dict[str, tuple[str, ...]]:
        """By camera, all cameras with the same lens, itself among them; the first is the one that the others name."""
        return models_of(self.cameras)

    def fps_of(self, camera: str) -> float | None:
        """Return the frames per second of a camera's frame numbers from the scene file; None if it does not state them."""
        if self.cameras[camera].times is not None:
            return VARIABLE_CLOCK_FPS
        return self.cameras[camera].fps or self.scene.fps

    def box_format(self, camera: str) -> BoxFormat:
        """Return the format of a camera's boxes."""
        return BoxFormat.of_text(self.cameras[camera].boxes or self.scene.boxes)

    @property
    def turns(self) -> dict[str, int]:
        """By camera with `rotate`, the degrees clockwise by which its images are turned before they are used."""
        return {name: table.rotate for name, table in self.cameras.items() if table.rotate}

    def scale_cues(self) -> ScaleCues:
        """Convert the scale table to the form that the solvers use."""
        scale = self.scale
        return ScaleCues(
            population=PopulationHeight(scale.person_height_m, scale.person_height_sd_m, scale.person_height_mean_sd_m),
            people=tuple(
                PersonHeight(cue.identity, cue.height_m, cue.sd_m) for cue in scale.people if cue.identity is not None
            ),
            lengths=tuple(
                KnownLength(
                    cue.metres,
                    cue.sd_m,
                    {name: np.array(ends) for name, ends in cue.points.items()},
                    f"length {cue.name}" if cue.name else "",
                )
                for cue in scale.lengths
            ),
            distances=tuple(CameraDistance(cue.between, cue.metres, cue.sd_m) for cue in scale.distances),
            camera_heights=tuple(CameraHeight(cue.camera, cue.metres, cue.sd_m) for cue in scale.camera_heights),
            wands=tuple(Wand(cue.points, cue.metres, cue.sd_m) for cue in scale.wands),
            plan=None if self.world is None or self.world.plan is None else floor_plan(self.world.plan),
        )

    @model_validator(mode="after")
    def _cameras_fit(self) -> Self:
        if len(self.cameras) < 2:
            raise ValueError(f"[cameras]: {len(self.cameras)} camera is declared: a calibration needs two or more")
        for name in self.cameras:
            if not CAMERA_NAME.fullmatch(name) or name == "metadata":
                raise ValueError(
                    f"[cameras.{name[:40]}]: '{name[:40]}' cannot be a camera's name: use letters, digits, spaces and "
                    "_ . + @ -, not 'metadata'"
                )
            if len(name) > LONGEST_NAME or name.split(".")[0].casefold() in RESERVED:
                raise ValueError(
                    f"[cameras.{name[:40]}]: '{name[:40]}' cannot be a file's name everywhere: give another one, of up to "
                    f"{LONGEST_NAME} characters"
                )
        first: dict[str, str] = {}
        for name in self.cameras:
            other = first.setdefault(name.casefold(), name)
            if other != name:
                raise ValueError(
                    f"[cameras.{name}]: differs from [cameras.{other}] only in capitals, but files are named after cameras: "
                    "rename one of the two"
                )
        for place, name in self._list_mentions():
            if name not in self.cameras:
                told = suggest_name(name[:LONGEST_NAME], list(self.cameras))
                raise ValueError(f"{place}: camera {shortened(name)} is not declared: {told}")
        check_models(self.cameras)
        for number, length in enumerate(self.scale.lengths, start=1):
            if len(length.points) < 2:
                raise ValueError(f"[[scale.lengths]] {number}: points are marked in one camera: mark both ends in two or more")
        for number, distance in enumerate(self.scale.distances, start=1):
            if distance.between[0] == distance.between[1]:
                raise ValueError(f"[[scale.distances]] {number}: between names one camera twice: name two")
        return self

    @model_validator(mode="after")
    def _tables_agree(self) -> Self:
        timed = [name for name, table in self.cameras.items() if self.fps_of(name) is not None or table.watched]
        for name, table in self.cameras.items():
            if timed and name not in timed and table.video is None:
                raise ValueError(
                    f"[cameras.{name}]: has no fps, but camera {timed[0]} has: set fps there, or under [scene] set fps to the "
                    "rate of all"
                )
            if table.watched and self.association.given:
                raise ValueError(
                    f'[cameras.{name}]: has only a video, which has no identities: mode "given" needs `tracks` or '
                    '`keypoints` with identities; to estimate them, under [association] set mode = "combined"'
                )
        if any(cue.identity is not None for cue in self.scale.people) and not self.association.given:
            raise ValueError(
                f"[[scale.people]]: names identities, but mode '{self.association.mode}' does not know them in advance: point "
                "at the person by camera, at = [u, v] and time_s or frame, or give global identities and under [association] "
                'set mode = "given"'
            )
        return self

    @model_validator(mode="after")
    def _groups_hold_all_cameras(self) -> Self:
        if not self.sites.groups:
            return self
        if self.association.given:
            raise ValueError(
                '[sites] groups: say which cameras are compared to find identities, but mode "given" knows them: delete groups'
            )
        grouped = {name for group in self.sites.groups for name in group}
        for name in self.cameras:
            if name not in grouped:
                raise ValueError(
                    f"[sites] groups: camera {name} is in no group and would be compared with none: add it to the groups of "
                    "the cameras that it may share ground with"
                )
        return self

    def _list_mentions(self) -> list[tuple[str, str]]:
        """List (place, camera) for each mention of a camera in another table."""
        found = [("[solver] reference", self.solver.reference)] if self.solver.reference is not None else []
        found += [
            (f"[sites] groups {number}", name) for number, group in enumerate(self.sites.groups, start=1) for name in group
        ]
        lenses = ((name, table.lens) for name, table in self.cameras.items())
        found += [(f"[cameras.{name}] lens", parse_named_camera(lens)) for name, lens in lenses if lens is not None]
        for number, person in enumerate(self.scale.people, start=1):
            found += [] if person.camera is None else [(f"[[scale.people]] {number} camera", person.camera)]
        for key, entries in (("same", self.association.same), ("different", self.association.different)):
            for number, together in enumerate(entries, start=1):
                found += [(f"[[association.{key}]] {number} boxes", one.camera) for one in together.boxes]
        for number, nobody in enumerate(self.association.not_people, start=1):
            found.append((f"[[association.not_people]] {number} camera", nobody.camera))
        for number, length in enumerate(self.scale.lengths, start=1):
            found += [(f"[[scale.lengths]] {number} points", name) for name in length.points]
        for number, check in enumerate(self.scale.checks, start=1):
            found += [(f"[[scale.checks]] {number} points", name) for name in check.points or ()]
            found += [(f"[[scale.checks]] {number} between", name) for name in check.between or ()]
        for number, distance in enumerate(self.scale.distances, start=1):
            found += [(f"[[scale.distances]] {number} between", name) for name in distance.between]
        for number, height in enumerate(self.scale.camera_heights, start=1):
            found.append((f"[[scale.camera_heights]] {number} camera", height.camera))
        if self.world is not None:
            named = ("camera", self.world.camera), ("towards", self.world.towards)
            found += [(f"[world] {key}", name) for key, name in named if name is not None]
        for number, line in enumerate(self.world.lines if self.world is not None else (), start=1):
            found += [(f"[[world.lines]] {number} points", name) for name in line.points]
        if self.world is not None and self.world.plan is not None:
            found += [("[world.plan] cameras", name) for name in self.world.plan.cameras]
            for number, point in enumerate(self.world.plan.points, start=1):
                found += [(f"[[world.plan.points]] {number} pixels", name) for name in point.pixels]
        return found


TABLES: dict[tuple[str, ...], type[Table]] = {
    (): Scene,
    ("scene",): SceneTable,
    ("recording",): RecordingTable,
    ("cameras", "*"): CameraTable,
    ("perception",): PerceptionTable,
    ("association",): AssociationTable,
    ("association", "same", "*"): TogetherTable,
    ("association", "same", "*", "boxes", "*"): PersonAtTable,
    ("association", "different", "*"): TogetherTable,
    ("association", "different", "*", "boxes", "*"): PersonAtTable,
    ("association", "not_people", "*"): PersonAtTable,
    ("sites",): SitesTable,
    ("solver",): SolverTable,
    ("scale",): ScaleTable,
    ("scale", "people", "*"): PersonTable,
    ("scale", "lengths", "*"): LengthTable,
    ("scale", "wands", "*"): WandTable,
    ("scale", "distances", "*"): DistanceTable,
    ("scale", "camera_heights", "*"): CameraHeightTable,
    ("scale", "checks", "*"): CheckTable,
    ("world",): WorldTable,
    ("world", "lines", "*"): LineTable,
    ("world", "plan"): PlanTable,
    ("world", "plan", "distance"): PlanDistanceTable,
    ("world", "plan", "points", "*"): PlanPointTable,
}
