"""Processing stages of a calibration, its settings, the versions of the software, and the written files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from passerby.core.figures import AdjustedFigures, CheckedLength, HeldOutFigures, StarFigures
from passerby.findings.texts.solver import PART_NAMES
from passerby.interchange.calibration_json import NetworkEntry, VideoEntry
from passerby.interchange.storage.text_formats import plain
from passerby.report.contents import Contents
from passerby.report.rendering import Section, section
from passerby.report.seen import Seen
from passerby.report.tables import Column, Table, count, figure, list_names, text

MODES = {
    "given": "identities are known",
    "combined": "people were associated by their tracks on the ground and by their appearance",
    "trajectory": "people were associated by their tracks on the ground",
    "appearance": "people were associated by their appearance",
}
METHODS = {
    "people": "a model of upright people is fitted to all cameras at once",
    "geopose": "the method of the paper: each camera is registered with a reference camera, then all are adjusted",
}
MOST_FACTS, SHOWN_FACTS = 60, 8
"""Most facts of a step that are all shown, and the number that is shown first if there are more."""
FILES = (
    ("report.html", "this page"),
    ("rig.toml", "the cameras, also readable by Anipose, Caliscope and Pose2Sim"),
    ("calibration.json", "all contents of this page, machine-readable"),
)


def stages_section(contents: Contents, seen: Seen) -> Section:
    """Return the section with the processing stages, in the order in which they ran."""
    steps = [
        _describe_observations(contents, seen),
        _describe_perception(contents),
        _describe_association(contents),
        _describe_solution(contents),
        _describe_scale(contents),
        _describe_world(contents),
    ]
    return section("stages", "Stages", steps=[step for step in steps if step is not None], most=MOST_FACTS, shown=SHOWN_FACTS)


Step = tuple[str, list[str]] | None


def _describe_perception(contents: Contents) -> Step:
    """Describe the processing of the videos."""
    perception = contents.document.perception
    if perception is None:
        return None
    roles = (
        ("People were detected by", perception.detector),
        ("Appearance was described by", perception.embedder),
        ("Keypoints were detected by", perception.keypoints),
    )
    facts = [f"{words} {_choice(choice)}." for words, choice in roles if choice not in (None, "none")]
    return "Processing the videos", facts + [_camera_video(name, one) for name, one in perception.cameras.items()]


def _choice(choice: str | NetworkEntry | None) -> str:
    """Name the network or method that was chosen for a role."""
    if isinstance(choice, NetworkEntry):
        return f"the network {choice.network} (licence: {choice.licence or 'unknown'})"
    return {"background": "a background model", "stripes": "colour histograms of horizontal stripes"}.get(
        str(choice), str(choice)
    )


def _camera_video(name: str, one: VideoEntry) -> str:
    """Describe the detections and the defects of one camera's video."""
    told = f"{name}: {one.boxes} boxes in {one.pictures} frames"
    told += f"; it shakes by {one.shake_px:.2f} px" if one.shake_px is not None else ""
    told += f"; {one.broken} frames could not be decoded" if one.broken else ""
    told += f"; it was moved {count(len(one.moves), 'time')}" if one.moves else ""
    return told + ("; it ends early." if one.ended_early is not None else ".")


def _describe_observations(contents: Contents, seen: Seen) -> Step:
    """Describe the observations of each camera, from which the rig was computed."""
    facts = []
    for name, entry in contents.cameras.items():
        boxes, joints = entry.boxes, entry.keypoints
        parts = [f"{boxes} boxes" if boxes else None, f"{joints} observations with keypoints" if joints else None]
        width, height = contents.rig[name].lens.size
        kind = ", fisheye" if contents.rig[name].lens.fisheye else ""
        what = list_names([part for part in parts if part]) or "nobody"
        facts.append(f"{name} ({width} × {height} px{kind}): {what}, {count(seen.people[name], 'person', 'people')}.")
    return "Observations of the cameras", facts


def _describe_association(contents: Contents) -> Step:
    """Describe the association of identities across cameras."""
    found = contents.document.association
    mode = found.mode or contents.document.scene.association.mode or "given"
    facts = [f"Mode “{mode}”: {MODES.get(mode, 'see the documentation')}."]
    for one in found.cameras or ():
        facts.append(
            f"{one.name}: {count(one.tracklets, 'tracklet')}, {one.walking_samples} samples of walking people"
            + (f"; appearance distinguishes people in {100 * one.looks:.0f} % of trials." if one.looks is not None else ".")
        )
    if found.pairs:
        used = sum(pair.used for pair in found.pairs)
        facts.append(f"{used} of {count(len(found.pairs), 'pair')} of cameras could be registered.")
    if found.people is not None:
        rounds = count(len(found.rounds or ()), "round")
        facts.append(f"{count(found.people, 'person', 'people')} in all, after {rounds} of matching and solving.")
    return "Cross-camera identity association", facts


def _describe_solution(contents: Contents) -> Step:
    """Describe the computation of the rig."""
    document = contents.document
    method, figures = document.method, document.figures
    facts = [f"Method “{method}”: {METHODS.get(method, 'see the documentation')}."]
    if isinstance(figures, StarFigures):
        facts.append(f"Adjustment: {_describe_end(figures.converged)} after {figures.iterations} steps.")
        if figures.rms_px is not None:
            facts.append(f"The residual of the points is {figures.rms_px:.2f} px (root mean square).")
    elif not isinstance(figures, AdjustedFigures):
        facts.append("No rig was found.")
    for number, one in enumerate(contents.figures.rounds, start=1):
        with_joints = f" and {one.joints} keypoints" if one.joints else ""
        done = f"{_describe_end(one.converged)} after {one.iterations} steps"
        facts.append(f"Round {number}: {one.sightings} observations{with_joints}, {done}.")
    return "Solving", facts + _noise(contents.figures) + _describe_held_out(figures.held_out) + _describe_checks(figures.checks)


def _describe_held_out(figures: HeldOutFigures | None) -> list[str]:
    """Describe the errors on people who were held out."""
    if figures is None:
        return []
    held, fit = figures.held_out, figures.fit
    return [
        f"Checked on people of {count(figures.stretches, 'stretch', 'stretches')} of {figures.stretch_s:.0f} s, who were held "
        f"out of one more adjustment: each camera sees them {figure(held.median_px, 1)} px (90 %: {figure(held.p90_px, 1)} px) "
        f"from where the others put them; those who were fitted {figure(fit.median_px, 1)} px ({figure(fit.p90_px, 1)} px).",
        f"On the ground, one camera puts half of the people held out within {figure(held.ground_50_m, 2)} m of where the "
        f"others put them, and 90 % within {figure(held.ground_90_m, 2)} m; of those fitted {figure(fit.ground_50_m, 2)} m and "
        f"{figure(fit.ground_90_m, 2)} m.",
    ]


def _describe_checks(checks: Sequence[CheckedLength] | None) -> list[str]:
    """Describe known lengths that the calibration did not use."""
    facts = []
    for one in checks or ():
        if one.measured_m is None:
            facts.append(f"Check length {one.number} could not be measured.")
            continue
        sigma = "" if one.sigma_m is None else f" (one sigma {100 * one.sigma_m / one.stated_m:.1f} %)"
        facts.append(
            f"Check length {one.number}, between marks in {', '.join(one.cameras)}, had no part in the calibration: "
            f"{figure(one.measured_m, 3)} m by the rig, {figure(one.stated_m, 3)} m as stated, "
            f"{100 * (one.measured_m / one.stated_m - 1):+.1f} %{sigma}."
        )
    return facts


def _describe_end(converged: bool) -> str:
    """Write whether an adjustment converged."""
    return "converged" if converged else "did not converge"


def _noise(figures: AdjustedFigures) -> list[str]:
    """Describe the noise of the boxes, as estimated from the residuals, and its effect on the sigmas."""
    noise, people, inflation = figures.noise, figures.people, figures.covariance_inflation
    facts = []
    if noise is not None:
        facts += [
            f"The error of the boxes is {100 * noise.centre:.1f} % of their height in the centre and {100 * noise.height:.1f} "
            f"% in the height.",
            f"{100 * noise.broken_edges:.0f} % of the box edges do not end where the person does: the person is occluded or "
            f"cut off.",
        ]
    if people is not None and people.standing is not None:
        facts.append(f"{100 * people.standing:.0f} % of the observations show standing or walking people.")
    if inflation is not None:
        facts.append(
            f"Errors of consecutive observations are correlated: their weight in the sigmas is {inflation:.1f} times lower."
        )
    return facts


def _describe_scale(contents: Contents) -> Step:
    """Describe the uncertainty of the scale and the up direction, undetermined quantities, and the clocks."""
    figures = contents.figures
    facts = []
    scale, vertical = figures.scale.relative_sigma, figures.vertical_sigma_deg
    if scale is not None:
        facts.append(f"The scale is known to {100 * scale:.1f} % (1 sigma).")
    if vertical is not None:
        facts.append(f"The up direction is known to {vertical:.2f}° (1 sigma).")
    if figures.up is not None and figures.up.direction == "ground normal":
        facts.append(
            "It is the normal of the ground that people walk on. Gravity may differ from it by "
            f"{figures.up.gravity_sigma_deg:.1f}° (1 sigma): the ground may slope."
        )
    if figures.undetermined:
        facts.append(f"No evidence fixes these: {list_names([PART_NAMES.get(part, part) for part in figures.undetermined])}.")
    if figures.clocks:
        most = max(abs(clock.correction_s) for clock in figures.clocks.values())
        facts.append(f"The clocks were refined with the cameras, by {1000 * most:.0f} ms at most.")
    return ("Scale, up direction and time", facts) if facts else None


def _describe_world(contents: Contents) -> Step:
    """Describe how the world frame was set, if the user chose it."""
    world = contents.document.world
    if world is None:
        return None
    facts = [f"Origin and heading are set by {world.by}."]
    turn, place = world.turn_sigma_deg, world.place_sigma_mm
    if turn is not None and place is not None:
        facts.append(f"The heading is known to {turn:.2f}°, the position to {place / 1000:.2f} m (1 sigma).")
    if world.scale_fitted:
        facts.append(f"Lengths were multiplied by {figure(world.scale, 4)}.")
    for row in world.residuals or ():
        what = str(row.camera) if row.point is None else f"Point {row.point} in {row.camera}"
        facts.append(f"{what} has a residual of {figure(row.off_m, 2, ' m')}{'' if row.used else ', left out'}.")
    facts += [f"{note[:1].upper()}{note[1:]}." for note in world.notes or ()]
    return "Alignment of the world frame", facts


def settings_section(contents: Contents) -> Section:
    """Return the section with all settings as used, and the versions of software that can change a figure."""
    document = contents.document
    settings = _flatten_table(plain(document.scene), "") + _flatten_table(document.options, "solver.options as used.")
    versions = [("passerby", document.passerby or "unknown")]
    versions += [(name, version or "not installed") for name, version in document.versions.items()]
    return section(
        "settings", "Settings", scene_file=document.scene_file, seed=document.seed,
        settings=_pairs("settings-table", "Settings", ("Setting", "Value"), settings),
        versions=_pairs("versions-table", "Versions", ("Package", "Version"), versions),
    )  # fmt: skip


def _flatten_table(value: Mapping[str, Any], before: str) -> list[tuple[str, str]]:
    """Flatten nested tables to pairs (dotted name, value)."""
    out = []
    for key, entry in value.items():
        if isinstance(entry, Mapping):
            out += _flatten_table(entry, f"{before}{key}.")
        elif entry not in ([], None):
            out.append((f"{before}{key}", _write_setting(entry)))
    return out


def _write_setting(value: Any) -> str:
    """Write a setting's value as in a scene file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(_write_setting(one) for one in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_write_setting(one)}" for key, one in value.items()) + "}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def files_section(contents: Contents, *, several: bool = False) -> Section:
    """Return the section with the files of the output folder; `several`: the report has files beside it."""
    rows = list(FILES)
    if several:
        rows.insert(1, ("report_files/", "what this page loads when it is asked for: copy it along with the page"))
        rows.append(("tracks/NAME.txt", "the people in each camera, by their identities (MOTChallenge)"))
        rows.append(("tracks/NAME.json", "the keypoints in each camera that has any, by their identities (COCO)"))
    for name, entry in contents.cameras.items() if not several else ():
        if entry.boxes:
            rows.append((f"tracks/{name}.txt", f"the people in {name}, by their identities (MOTChallenge)"))
        if len(contents.observations[name].keypoints):
            rows.append((f"tracks/{name}.json", f"the keypoints in {name}, by their identities (COCO)"))
    return section("files", "Files", table=_pairs("files-table", "Files", ("File", "Holds"), rows))


def _pairs(identifier: str, caption: str, titles: tuple[str, str], rows: list[tuple[str, str]]) -> Table:
    """Return a table with two columns of text."""
    columns = [Column(title, numeric=False) for title in titles]
    cells = [[text(name, inner="code"), text(value)] for name, value in rows]
    return Table(identifier=identifier, caption=caption, columns=columns, rows=cells, sortable=False, copy=False)
