"""People at whom the scene file points by a camera, a time and a pixel, and their search in the observations of that camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from passerby.core.pointing import PeopleInFrame, PointedPerson, Sighting, StatedIdentities, find_nearest_frame, people_in_frame
from passerby.findings.finding import Finding, notice
from passerby.scene.camera_input import CameraInput
from passerby.scene.scale_tables import PersonTable
from passerby.scene.scene import Scene
from passerby.scene.table import PersonAtTable, TogetherTable

PersonAt = PersonTable | PersonAtTable


def pointed_people(scene: Scene, readings: Sequence[CameraInput]) -> tuple[PointedPerson, ...]:
    """Return the people of known height at whom the scene points, each with the frame of the search; without faulty ones."""
    by_name = {reading.name: reading for reading in readings}
    found = []
    for number, cue in enumerate(scene.scale.people, start=1):
        frame = None if cue.camera is None else _find_nearest_frame(cue, by_name.get(cue.camera))
        if cue.camera is not None and cue.at is not None and frame is not None:
            found.append(
                PointedPerson(number, cue.camera, frame, _turn_pixel(cue.at, by_name[cue.camera]), cue.height_m, cue.sd_m)
            )
    return tuple(found)


def find_stated_identities(scene: Scene, readings: Sequence[CameraInput]) -> StatedIdentities:
    """Return the identities that the scene corrects, each person with the frame of the search; without faulty ones."""
    by_name = {reading.name: reading for reading in readings}
    association = scene.association

    def sightings(place: str, boxes: Sequence[PersonAtTable]) -> tuple[Sighting, ...]:
        frames = [_find_nearest_frame(one, by_name.get(one.camera)) for one in boxes]
        return tuple(
            Sighting(one.camera, frame, _turn_pixel(one.at, by_name[one.camera]), place)
            for one, frame in zip(boxes, frames, strict=True)
            if frame is not None
        )

    def groups(key: str, tables: Sequence[TogetherTable]) -> tuple[tuple[Sighting, ...], ...]:
        return tuple(sightings(f"[[association.{key}]] {number}", one.boxes) for number, one in enumerate(tables, start=1))

    return StatedIdentities(
        groups("same", association.same),
        groups("different", association.different),
        sightings("[[association.not_people]]", association.not_people),
    )


def pointing_faults(scene: Scene, readings: Sequence[CameraInput]) -> list[str]:
    """Return a fault for each pixel outside the image, time outside the recording, and pixel without a person."""
    faults = [
        (place, _place_fault(cue, reading) or (None if reading.awaiting else _person_fault(cue, reading)))
        for place, cue, reading in _pointings(scene, readings)
        if not reading.faults
    ]
    return [f"{scene.place}: {place} {fault}" for place, fault in faults if fault is not None]


def overlapped_people(scene: Scene, readings: Sequence[CameraInput]) -> list[Finding]:
    """Return a notice for each pixel that lies on several people."""
    findings = []
    for place, cue, reading in _pointings(scene, readings):
        frame = None if reading.awaiting or cue.at is None else _find_nearest_frame(cue, reading)
        if frame is None or cue.at is None:
            continue
        people = people_in_frame(reading.seen, frame)
        holding = people.holding(_turn_pixel(cue.at, reading))
        if len(holding) > 1:
            values = {"frame": frame, "at": list(cue.at), "count": len(holding), "box": _box(people, holding[0], reading)}
            findings.append(notice("pointed_people_overlap", reading.name, place=f"{scene.place}: {place}", **values))
    return findings


def pointings_of(scene: Scene) -> Iterator[tuple[str, PersonAt]]:
    """Yield each table that points at a person in a camera's image, with its place in the scene file."""
    association = scene.association
    tables: list[tuple[str, PersonAt]] = [
        (f"[[scale.people]] {number}", cue) for number, cue in enumerate(scene.scale.people, start=1)
    ]
    for key, groups in (("same", association.same), ("different", association.different)):
        tables += [
            (f"[[association.{key}]] {number} boxes {row}", one)
            for number, group in enumerate(groups, start=1)
            for row, one in enumerate(group.boxes, start=1)
        ]
    tables += [(f"[[association.not_people]] {number}", one) for number, one in enumerate(association.not_people, start=1)]
    yield from ((place, cue) for place, cue in tables if cue.camera is not None)


def is_pointed_at(scene: Scene, readings: Sequence[CameraInput]) -> bool:
    """Return whether the scene points at people in any of these cameras, at any time."""
    return bool({cue.camera for _, cue in pointings_of(scene)} & {reading.name for reading in readings})


def _pointings(scene: Scene, readings: Sequence[CameraInput]) -> Iterator[tuple[str, PersonAt, CameraInput]]:
    """Yield the place of each table that points at a person, the table, and its camera."""
    by_name = {reading.name: reading for reading in readings}
    for place, cue in pointings_of(scene):
        if cue.camera in by_name:
            yield place, cue, by_name[cue.camera]


def _find_nearest_frame(cue: PersonAt, reading: CameraInput | None) -> int | None:
    """Find the frame in which a person is searched; None if the camera saw no person near the time."""
    return None if reading is None else find_nearest_frame(reading.seen, _frame(cue, reading), reading.fps)


def _frame(cue: PersonAt, reading: CameraInput) -> float:
    """Compute the frame number, fractional if a time is stated; NaN for a time without a frame rate."""
    if cue.frame is not None:
        return float(cue.frame)
    if reading.fps is None or cue.time_s is None:
        return float("nan")
    return 1.0 + cue.time_s * reading.fps


def _place_fault(cue: PersonAt, reading: CameraInput) -> str | None:
    """Return the fault of the pixel or the time that does not depend on people; None if there is none."""
    if cue.at is None:
        return None
    (u, v), size = cue.at, reading.filmed_size
    if size is not None and not (0 <= u <= size[0] and 0 <= v <= size[1]):
        return (
            f"at: [{u:g}, {v:g}] lies outside the {size[0]} x {size[1]} image of camera {reading.name}: give a pixel of that "
            "image"
        )
    if cue.time_s is not None and reading.fps is None:
        return f"time_s: no frame rate of camera {reading.name} is known: use frame, or under [scene] set fps"
    video = reading.video
    if video is not None and video.end_s is not None and reading.fps is not None:
        length = video.end_s * video.clock_fps / reading.fps
        at_s = (_frame(cue, reading) - 1) / reading.fps
        if at_s > length:
            return (
                f"{_key(cue)}: {_describe_time(cue)} is after the end of camera {reading.name}'s recording of {length:.1f} s: "
                "give a time within it"
            )
    return None


def _person_fault(cue: PersonAt, reading: CameraInput) -> str | None:
    """Return the fault that the camera sees no person at this time, or none at the pixel; None if it does."""
    frames = reading.frames
    if cue.at is None or not len(frames):
        return None
    frame = _frame(cue, reading)
    found = find_nearest_frame(reading.seen, frame, reading.fps)
    if found is None:
        span = f"frames {frames[0]} to {frames[-1]}"
        if reading.fps is not None:
            span += f" ({(frames[0] - 1) / reading.fps:.1f} to {(frames[-1] - 1) / reading.fps:.1f} s)"
        if frames[0] <= frame <= frames[-1]:
            near = int(frames[np.argmin(np.abs(frames - frame))])
            return (
                f"{_key(cue)}: camera {reading.name} sees no person at {_describe_time(cue)}; the nearest frame with people is "
                f"{near}: give a time at which it sees the person"
            )
        return f"{_key(cue)}: camera {reading.name} sees people in {span}, not at {_describe_time(cue)}: give a time within it"
    people = people_in_frame(reading.seen, found)
    distance = people.distance_px(_turn_pixel(cue.at, reading))
    if not len(distance) or distance.min() > 0:
        nearest = ""
        if len(distance):
            left, top, width, height = _box(people, int(np.argmin(distance)), reading)
            nearest = (
                f"; the nearest box, {distance.min():.0f} px away, is {width:.0f} x {height:.0f} px at left {left:.0f}, top "
                f"{top:.0f}"
            )
        u, v = cue.at
        return (
            f"at: no person at [{u:g}, {v:g}] in camera {reading.name} at {_describe_time(cue)} (frame {found}){nearest}: "
            "give a pixel inside the person's box"
        )
    return None


def _turn_pixel(pixel: tuple[float, float], reading: CameraInput) -> tuple[float, float]:
    """Convert a pixel of the images as filmed to the turned images, to which the people's pixels refer."""
    u, v = reading.upright(pixel)
    return float(u), float(v)


def _box(people: PeopleInFrame, row: int, reading: CameraInput) -> list[float]:
    """Return left, top, width and height of a person, in pixels of the images as filmed."""
    left, top, width, height = people.ltwh[row]
    corners = reading.filmed([[left, top], [left + width, top + height]])
    return [round(float(value), 1) for value in (*corners.min(axis=0), *np.ptp(corners, axis=0))]


def _key(cue: PersonAt) -> str:
    return "time_s" if cue.frame is None else "frame"


def _describe_time(cue: PersonAt) -> str:
    return f"{cue.time_s:g} s" if cue.frame is None else f"frame {cue.frame}"
