"""A calibrated scene, with its `calibration.json`, its files and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from passerby._version import __version__
from passerby.association.result import Association
from passerby.calibration.writing import write_calibration
from passerby.common.errors import EvidenceError, InputError
from passerby.common.progress import Progress
from passerby.core.association_figures import AssociationFigures
from passerby.core.cameras import Camera, Rig
from passerby.core.figures import SolverFigures, adjusted
from passerby.core.observations import UNKNOWN, Boxes, Observations
from passerby.core.solution import Verdict
from passerby.evaluation.reprojection import median_residuals
from passerby.findings.finding import Finding
from passerby.findings.ranking import find_cause
from passerby.findings.texts import diagnostic, texts_of
from passerby.interchange.calibration_json import (
    CalibrationDocument,
    CameraEntry,
    DiagnosticEntry,
    GroupEntry,
    PerceptionEntry,
    WorldEntry,
    entry_of,
    parse_document,
)
from passerby.interchange.declared_scene import DeclaredScene
from passerby.interchange.output_folder import (
    group_folder,
    scene_file,
)
from passerby.interchange.storage.text_formats import plain, to_json
from passerby.perception.video_probe import WallTime
from passerby.report.contents import Contents, declared_videos, turn_contents_upright
from passerby.scene.scene import Scene
from passerby.scene.wall_clock import WallClock

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated scene: the rig, the evidence on its quality, and its inputs."""

    scene: Scene
    rig: Rig
    """World z up, ground at z = 0, metres; a camera that could not be registered has no pose."""
    verdict: Verdict
    diagnostics: tuple[Finding, ...]
    """Evidence against the rig, then notices about the input."""
    observations: Observations
    """Observations of the people that it was computed from, with their identities."""
    seed: int
    options: dict[str, Any]
    """The options that the solver used."""
    figures: SolverFigures
    """Figures of the solver's stages."""
    association: Association | None = None
    """Identities, and the cameras' clocks."""
    clocked: bool = False
    """Whether the cameras' frame rates are known."""
    perception: dict[str, Any] = field(default_factory=dict)
    """JSON-ready figures of the detection of people in the videos; empty if no video was processed."""
    wall_clock: WallClock | None = None
    """Wall time of frame numbers; None if the files of the videos do not state it."""
    world: dict[str, Any] = field(default_factory=dict)
    """JSON-ready figures of the frame that `[world]` set; empty where the first camera set it."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time of each stage, seconds; never written to a file, so that the same input gives the same files."""
    group: int = 1
    """Number among the groups of cameras of the scene; 1 is the largest, the main rig."""
    groups: tuple[Calibration, ...] = ()
    """Groups of cameras that share no people with this one: separate calibrations, each in its own frame."""

    def __repr__(self) -> str:
        return f"Calibration({self.name!r}: {self.verdict}, {len(self.rig.posed())} of {len(self.rig)} cameras registered)"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the verdict with its reasons, the cameras, and the rig from above."""
        # Imported only if a notebook asks for it.
        from passerby.report.notebook import Outcome, result_html

        outcome = Outcome(self.verdict, self.reasons, self.findings, len(self.rig))
        return result_html(self.name, self.rig, outcome, calibration_document(self).cameras, clocked=self.clocks_searched)

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """The diagnostics that count against the rig: doubts and refusals."""
        return tuple(finding for finding in self.diagnostics if finding.severity != "notice")

    @property
    def notices(self) -> tuple[Finding, ...]:
        """The diagnostics that do not count against the rig."""
        return tuple(finding for finding in self.diagnostics if finding.severity == "notice")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Evidence against the rig, one sentence each."""
        return texts_of(self.doubts)

    @property
    def findings(self) -> tuple[str, ...]:
        """The notices, one sentence each."""
        return texts_of(self.notices)

    @property
    def accepted(self) -> bool:
        """Whether the verdict is "accepted"."""
        return self.verdict == "accepted"

    @property
    def tracks(self) -> Mapping[str, Boxes]:
        """The boxes of each camera, with identities that are the same in all cameras: the contents of `tracks/CAMERA.txt`.

        Frames are each camera's own. `passerby.trajectories(calibration)` gives the people's positions on the ground over time.
        """
        return {name: seen.boxes for name, seen in self.observations.cameras.items()}

    @property
    def clocks_searched(self) -> bool:
        """Whether the cameras' time offsets were searched for, instead of taken to be 0."""
        return self.scene.association.search_s > 0 and self.clocked

    @property
    def instants(self) -> Observations:
        """The observations at instants that all cameras share, as far as their clocks are known."""
        return self.observations if self.association is None else self.association.instants

    @property
    def name(self) -> str:
        """The scene's name, with the number of a further group."""
        return self.scene.name if self.group == 1 else f"{self.scene.name}, group {self.group}"

    @property
    def exit_status(self) -> int:
        """0 if all groups are accepted, 3 if one is doubtful or refused."""
        return 0 if self.accepted and all(one.accepted for one in self.groups) else EvidenceError.exit_status

    def to_dict(self) -> dict[str, Any]:
        """Return all but the observations and the times of the stages, as plain values for JSON."""
        table: dict[str, Any] = plain(calibration_document(self))
        del table["scene_file"]
        return table

    def document(self, files: Mapping[str, str] | None = None) -> CalibrationDocument:
        """Return its `calibration.json`; `files` are the checksums of the files beside it."""
        return calibration_document(self, files)

    def contents(self) -> Contents:
        """Return the contents of its report."""
        return contents_of(self)

    def write(self, folder: str | Path, *, report: bool = True, progress: Progress | None = None) -> None:
        """Write `rig.toml`, `calibration.json`, the tracks and the report into a folder, each file whole or not at all.

        `tracks/` gets CAMERA.txt (boxes) and CAMERA.json (joints), with identities over all cameras. Files of an earlier run
        are replaced. Raises `InputError` if the folder is not writable.

        Args:
            folder: the output folder; it is made if it does not exist.
            report: whether `report.html` is written too.
            progress: called with the report's parts.
        """
        write_calibration(self, Path(folder), report=report, progress=progress)

    def report(self, path: str | Path) -> None:
        """Write the report, an HTML page that needs no network. For more than fifty cameras, a folder of files is written
        beside it, with the name of the page and `_files`. Raises `InputError` if `path` is not writable.
        """
        from passerby.report.page import write_report

        write_report(contents_of(self), Path(path))

    def plot(self, view: Literal["space", "above"] = "space") -> Figure:
        """Draw the rig with people's trajectories as a plotly figure, in space or from above; a notebook shows it."""
        from plotly.graph_objects import Figure

        from passerby.report.fitted import fit_people
        from passerby.report.rig_plots import rig_from_above, rig_in_space

        views = {"space": rig_in_space, "above": rig_from_above}
        if view not in views:
            raise InputError(f"view {view!r}: choose one of {', '.join(views)}")
        contents = contents_of(self)
        return Figure(views[view](contents, fit_people(contents)))


def contents_of(calibration: Calibration) -> Contents:
    """Return the contents of the report of a new calibration, as they would be read from its folder."""
    scene = calibration.scene
    clocks = calibration.association.clocks if calibration.association else {}
    seen = Observations(calibration.observations.cameras, calibration.observations.fps, dict(clocks))
    document = parse_document(to_json(calibration_document(calibration)))
    videos = declared_videos(document, list(scene.cameras), scene.resolve(Path()))
    return turn_contents_upright(document, calibration.rig, seen, dict(clocks), videos)


COMPUTING_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "poselib", "av", "onnxruntime")
"""Libraries whose versions can change a figure."""


def calibration_document(calibration: Calibration, files: Mapping[str, str] | None = None) -> CalibrationDocument:
    """Return the `calibration.json` of a calibration; `files` are the checksums of the files beside it."""
    scene, association, residual_px = calibration.scene, calibration.association, _residuals(calibration)
    found = AssociationFigures() if association is None else association.figures
    clock = calibration.wall_clock
    return CalibrationDocument(
        scene_file=scene_file(scene.path),
        files=files,
        name=calibration.name,
        passerby=__version__,
        versions={name: _version(name) for name in COMPUTING_LIBRARIES},
        verdict=calibration.verdict,
        reasons=calibration.reasons,
        findings=calibration.findings,
        diagnostics=tuple(_diagnostic(finding, calibration.doubts) for finding in calibration.diagnostics),
        cameras=tuple(_entry(calibration, camera, residual_px.get(camera.name)) for camera in calibration.rig),
        perception=entry_of(PerceptionEntry, calibration.perception) if calibration.perception else None,
        association=replace(found, mode=scene.association.mode),
        method=scene.solver.method,
        seed=calibration.seed,
        options=calibration.options,
        scene=entry_of(DeclaredScene, scene.model_dump(mode="json", exclude_none=True)),
        figures=calibration.figures,
        wall_clock_origin=None if clock is None else clock.origin.text,
        wall_clock_span=None if clock is None else _texts(clock.first, clock.last),
        world=entry_of(WorldEntry, calibration.world) if calibration.world else None,
        group=None if calibration.group == 1 else calibration.group,
        groups=tuple(map(_group, calibration.groups)) or None,
    )


def _diagnostic(finding: Finding, doubts: Sequence[Finding]) -> DiagnosticEntry:
    """Return the entry of a finding, with the code of the doubt that explains it."""
    cause = None if finding.severity == "notice" else find_cause(finding, doubts)
    return DiagnosticEntry(**diagnostic(finding), explained_by=None if cause is None else cause.code)


def _group(one: Calibration) -> GroupEntry:
    """Return the entry of a further group in the main rig's file."""
    return GroupEntry(
        group=one.group, folder=group_folder(one.group), verdict=one.verdict, registered=len(one.rig.posed()),
        cameras=tuple(one.rig.names),
    )  # fmt: skip


def _entry(calibration: Calibration, camera: Camera, residual_px: float | None) -> CameraEntry:
    """Return the entry of a camera. Frame f shows the world at (f - 1) / fps + time_offset_s, by the clock of the first
    registered camera.
    """
    seen, association = calibration.observations[camera.name], calibration.association
    people = np.unique(np.concatenate([seen.boxes.identity, seen.keypoints.identity]))
    clock = association.clocks.get(camera.name) if association else None
    return CameraEntry(
        name=camera.name,
        people=len(people[people > UNKNOWN]),
        boxes=len(seen.boxes),
        keypoints=len(seen.keypoints),
        median_residual_px=residual_px,
        fps=None if clock is None else clock.fps,
        time_offset_s=None if clock is None else clock.offset_s,
        time_offset_sigma_s=association.sigma_s.get(camera.name) if association else None,
    ).with_pose(camera)


def _texts(first: WallTime | None, last: WallTime | None) -> tuple[str | None, str | None] | None:
    """Return the ends of a span of wall time as texts; None if neither end is chosen."""
    if first is None and last is None:
        return None
    return None if first is None else first.text, None if last is None else last.text


def _residuals(calibration: Calibration) -> dict[str, float]:
    """Return each camera's median residual, pixels: the solver's, or else the reprojection error of box centres or joints."""
    solved = {one.name: one.median_residual_px for one in adjusted(calibration.figures).cameras}
    missing = [camera.name for camera in calibration.rig.posed() if solved.get(camera.name) is None]
    found = median_residuals(calibration.rig, calibration.instants) if missing else {}
    return found | {name: value for name, value in solved.items() if value is not None}


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
