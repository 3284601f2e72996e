"""What each stage did, with which settings, by which versions, and which files were written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from passerby.report.contents import Contents
from passerby.report.html import Html, Section, element, join, nothing
from passerby.report.seen import Seen
from passerby.report.tables import Column, data_table, text
from passerby.report.values import count, figure, listed, number_of, rows_of, table_of, texts_of

MODES = {
    "given": "who is who was given",
    "combined": "people were told apart by their tracks on the ground and by their looks",
    "trajectory": "people were told apart by their tracks on the ground",
    "appearance": "people were told apart by their looks",
}
METHODS = {
    "people": "a model of upright people is fitted to all cameras at once",
    "geopose": "the paper's method: each camera is registered with a reference, then all are adjusted",
}
FILES = (
    ("report.html", "this page"),
    ("rig.toml", "the cameras, as Anipose, Caliscope and Pose2Sim read them too"),
    ("calibration.json", "everything that this page tells, for machines"),
)


def stages_section(contents: Contents, seen: Seen) -> Section:
    """What was done, in the order in which it was done."""
    steps = [
        _observed(contents, seen),
        _watched(contents),
        _associated(contents),
        _solved(contents),
        _scaled(contents),
        _placed(contents),
    ]
    body = element(
        "ol",
        [
            element("li", element("h3", title), element("ul", [element("li", fact) for fact in facts]))
            for title, facts in filter(None, steps)
        ],
        class_="stages",
    )
    return Section("stages", "What each stage did", "", body, "Stages")


Step = tuple[str, list[str]] | None


def _watched(contents: Contents) -> Step:
    """How people were found in the videos."""
    told = table_of(contents.told, "perception")
    if not told:
        return None
    roles = {"detector": "People were found by", "embedder": "Looks were taken by", "keypoints": "Joints were found by"}
    facts = [f"{words} {_choice(told[role])}." for role, words in roles.items() if told.get(role) not in (None, "none")]
    for name, one in table_of(told, "cameras").items():
        facts.append(_camera_video(str(name), table_of(one)))
    return "Watching the videos", facts


def _choice(choice: Any) -> str:
    """What did the work of a role, in words."""
    if isinstance(choice, Mapping):
        return f"the network {choice.get('network')} (licence: {choice.get('licence', 'unknown')})"
    return {"background": "what differs from the empty scene", "stripes": "colours of horizontal stripes"}.get(
        str(choice), str(choice)
    )


def _camera_video(name: str, one: Mapping[str, Any]) -> str:
    """What was found in one camera's video, and what is wrong with it."""
    told = f"{name}: {figure(number_of(one.get('boxes')), 0)} boxes in {figure(number_of(one.get('pictures')), 0)} pictures"
    shake, broken = number_of(one.get("shake_px")), number_of(one.get("broken"))
    told += f"; it shakes by {shake:.2f} px" if shake is not None else ""
    told += f"; {broken:.0f} pictures are broken" if broken else ""
    moves = one.get("moves")
    told += f"; it was moved {count(len(moves), 'time')}" if isinstance(moves, list) and moves else ""
    ended = number_of(one.get("ended_early"))
    told += "; it ends early" if one.get("ended_early") is not None else ""
    return told + (f" (at {ended:.1f} s)." if ended is not None else ".")


def _observed(contents: Contents, seen: Seen) -> Step:
    """What the rig was computed from."""
    facts = []
    for name, told in contents.cameras.items():
        boxes, joints = number_of(told.get("boxes")), number_of(told.get("keypoints"))
        parts = [f"{boxes:.0f} boxes" if boxes else None, f"{joints:.0f} sightings with joints" if joints else None]
        width, height = contents.rig[name].lens.size
        kind = ", fisheye" if contents.rig[name].lens.fisheye else ""
        what = listed([part for part in parts if part]) or "nobody"
        facts.append(f"{name} ({width} × {height} px{kind}): {what}, {count(seen.people[name], 'person', 'people')}.")
    return "What the cameras saw", facts


def _associated(contents: Contents) -> Step:
    """How people were told apart."""
    told = table_of(contents.told, "association")
    mode = str(told.get("mode") or table_of(contents.told, "scene", "association").get("mode") or "given")
    facts = [f"Mode “{mode}”: {MODES.get(mode, 'see the documentation')}."]
    for one in rows_of(told.get("cameras")):
        tracklets, walked = number_of(one.get("tracklets")), number_of(one.get("walking_samples"))
        if tracklets is not None:
            appearance = number_of(one.get("looks"))
            facts.append(
                f"{one.get('name')}: {count(int(tracklets), 'tracklet')}, {figure(walked, 0)} samples of people who walk"
                + (f"; looks tell people apart in {100 * appearance:.0f} % of trials." if appearance is not None else ".")
            )
    pairs = rows_of(told.get("pairs"))
    if pairs:
        used = sum(bool(pair.get("used")) for pair in pairs)
        facts.append(f"{used} of {count(len(pairs), 'pair')} of cameras could be registered.")
    people, rounds = number_of(told.get("people")), rows_of(told.get("rounds"))
    if people is not None:
        facts.append(
            f"{count(int(people), 'person', 'people')} in all, after {count(len(rounds), 'round')} of matching and solving."
        )
    return "Who is who", facts


def _solved(contents: Contents) -> Step:
    """How the rig was computed."""
    told = table_of(contents.told, "figures")
    method = str(contents.told.get("method", "people"))
    facts = [f"Method “{method}”: {METHODS.get(method, 'see the documentation')}."]
    if not told:
        return "Solving", [*facts, "It did not come to a rig."]
    for number, one in enumerate(rows_of(told.get("rounds")), start=1):
        sightings, joints, steps = (number_of(one.get(key)) for key in ("sightings", "joints", "iterations"))
        with_joints = f" and {joints:.0f} joints" if joints else ""
        done = "converged" if one.get("converged") else "did not converge"
        facts.append(f"Round {number}: {figure(sightings, 0)} sightings{with_joints}, {done} after {figure(steps, 0)} steps.")
    if not rows_of(told.get("rounds")) and number_of(told.get("iterations")) is not None:
        done = "converged" if told.get("converged") else "did not converge"
        facts.append(f"Adjustment: {done} after {figure(number_of(told.get('iterations')), 0)} steps.")
    if number_of(told.get("rms_px")) is not None:
        facts.append(f"Points are off by {figure(number_of(told.get('rms_px')), 2, ' px')} (root mean square).")
    facts += _noise(told)
    return "Solving", facts


def _noise(told: Mapping[str, Any]) -> list[str]:
    """What the residuals told of the boxes, and what that means for the sigmas."""
    noise, people = table_of(told, "noise"), table_of(told, "people")
    facts = []
    centre, height, broken = (number_of(noise.get(key)) for key in ("centre", "height", "broken_edges"))
    if centre is not None and height is not None:
        facts.append(
            f"Boxes are off by {100 * centre:.1f} % of their height in their middle, by {100 * height:.1f} % in their height."
        )
    if broken is not None:
        facts.append(f"{100 * broken:.0f} % of the boxes' edges do not end where the people do: hidden, or cut off.")
    standing = number_of(people.get("standing"))
    if standing is not None:
        facts.append(f"{100 * standing:.0f} % of the sightings are of standing or walking people.")
    inflation = number_of(told.get("covariance_inflation"))
    if inflation is not None:
        facts.append(
            f"Sightings in a row err alike: they count {inflation:.1f} times less in the sigmas than as many independent ones."
        )
    return facts


def _scaled(contents: Contents) -> Step:
    """What is known of length, up and clocks."""
    told = table_of(contents.told, "figures")
    facts = []
    scale, vertical = number_of(table_of(told, "scale").get("relative_sigma")), number_of(told.get("vertical_sigma_deg"))
    if scale is not None:
        facts.append(f"Lengths are known to {100 * scale:.1f} % (one sigma).")
    if vertical is not None:
        facts.append(f"The vertical is known to {vertical:.2f}° (one sigma).")
    free = texts_of(told.get("undetermined"))
    if free:
        facts.append(f"No evidence fixes these: {listed(free)}.")
    clocks = table_of(told, "clocks")
    if clocks:
        corrections = [
            abs(value) for one in clocks.values() if (value := number_of(table_of(one).get("correction_s"))) is not None
        ]
        facts.append(f"The clocks were refined with the cameras, by {1000 * max(corrections, default=0.0):.0f} ms at most.")
    return ("Length, up and time", facts) if facts else None


def _placed(contents: Contents) -> Step:
    """How the world's frame was set, where its user wanted another one."""
    told = table_of(contents.told, "world")
    if not told:
        return None
    facts = [f"Origin and heading are set by {told.get('by')}."]
    turn, place = number_of(told.get("turn_sigma_deg")), number_of(told.get("place_sigma_mm"))
    if turn is not None and place is not None:
        facts.append(f"The heading is known to {turn:.2f}°, the place to {place / 1000:.2f} m (one sigma).")
    if told.get("scale_fitted"):
        facts.append(f"Lengths were multiplied by {figure(number_of(told.get('scale')), 4)}.")
    for row in rows_of(told.get("residuals")):
        what = f"Point {row.get('point')} in {row.get('camera')}" if "point" in row else str(row.get("camera"))
        out = "" if row.get("used", True) else ", left out"
        facts.append(f"{what} is off by {figure(number_of(row.get('off_m')), 2, ' m')}{out}.")
    facts += [f"{note[:1].upper()}{note[1:]}." for note in texts_of(told.get("notes"))]
    return "Placing the world", facts


def settings_section(contents: Contents) -> Section:
    """All settings as used, and the versions that can change a figure."""
    scene = contents.told.get("scene_file")
    lead = f"Scene file: {scene}. " if scene else ""
    lead += f"Seed of the random numbers: {contents.told.get('seed', 'unknown')}. "
    lead += "The same input, seed and versions give the same figures."
    settings = _flat(table_of(contents.told, "scene"), "")
    settings += _flat(table_of(contents.told, "options"), "solver.options as used.")
    versions = [("passerby", str(contents.told.get("passerby", "unknown")))]
    versions += [(str(name), str(value or "not installed")) for name, value in table_of(contents.told, "versions").items()]
    parts = []
    if settings:
        table = _pairs("settings-table", "Settings", ("Setting", "Value"), settings)
        parts.append(element("details", element("summary", count(len(settings), "setting")), table))
    else:
        parts.append(nothing("The settings were not kept."))
    parts.append(_pairs("versions-table", "Versions", ("Package", "Version"), versions))
    return Section("settings", "Settings and versions", lead, join(parts), "Settings")


def _flat(value: Mapping[str, Any], before: str) -> list[tuple[str, str]]:
    """Nested tables as (dotted name, value)."""
    out = []
    for key, entry in value.items():
        if isinstance(entry, Mapping):
            out += _flat(entry, f"{before}{key}.")
        elif entry not in ([], None):
            out.append((f"{before}{key}", _shown(entry)))
    return out


def _shown(value: Any) -> str:
    """A setting's value as a scene file would have it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return "[" + ", ".join(_shown(one) for one in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_shown(one)}" for key, one in value.items()) + "}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def files_section(contents: Contents) -> Section:
    """What the output folder holds."""
    rows = list(FILES)
    for name, told in contents.cameras.items():
        if number_of(told.get("boxes")):
            rows.append((f"tracks/{name}.txt", f"the people in {name}, by their identities (MOTChallenge)"))
        if len(contents.observations[name].keypoints):
            rows.append((f"tracks/{name}.json", f"the joints in {name}, by their identities (COCO)"))
    lead = "In the output folder. For other tools see passerby export and passerby formats; for people's ways passerby track."
    return Section("files", "Files", lead, _pairs("files-table", "Files", ("File", "Holds"), rows))


def _pairs(identifier: str, caption: str, titles: tuple[str, str], rows: list[tuple[str, str]]) -> Html:
    """A table of two columns of text."""
    columns = [Column(title, numeric=False) for title in titles]
    cells = [[text(element("code", name), name), text(value)] for name, value in rows]
    return data_table(identifier, caption, columns, cells, sortable=False, copy=False)
