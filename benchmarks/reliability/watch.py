"""`passerby monitor`: does it keep silent over quiet hours, and does it see a camera that was knocked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pages.page import table
from pages.sections import Found
from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.geometry.rotations import log_rotation
from passerby.monitoring.site import identify_by_rig
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.monitoring.watching import watch
from passerby.people.rig_observations import gather_rig_observations
from reliability.footage import Move, calibrated, footage, true_rig, unit
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept, percent, seeds
from reliability.staging import staged

PRESETS = "terrace", "basketball", "construction"
CAMERAS = 3, 4, 5, 6
QUIET_PEOPLE = 2.0, 5.0
"""On average at once, in quiet hours."""
PEOPLE: Mapping[str, tuple[float, float]] = {"terrace": (3.0, 7.0), "basketball": (4.0, 9.0), "construction": (4.0, 9.0)}
"""The same where a camera is knocked; the presets themselves have 7, 14 and 20."""
TURN_DEG, SHIFT_M = 1.0, 0.1
HOUR_S = 3600.0
QUIET_BEFORE_S = 120.0, 420.0
MINUTE_S = 60.0
FPS = 1.0

Case = tuple[str, int, int]
"""Kind, number, seed."""


def run(wanted: Wanted) -> Found:
    """Quiet hours, knocks in cheap footage, and knocks in the full simulator's."""
    count = (4, 8, 4) if wanted.quick else (200, 240, 60)
    cases = {
        f"{kind} {seed}": (kind, number, seed)
        for kind, n, first in zip(("quiet", "knock", "simulated"), count, (100_000, 200_000, 300_000), strict=True)
        for number, seed in enumerate(seeds(first, n))
    }
    results = list(kept(wanted, "monitor", cases, work).values())
    quiet, cheap, full = ([one for one in results if one["kind"] == kind] for kind in ("quiet", "knock", "simulated"))
    return part_found(_lines(quiet, cheap), _text(quiet, cheap, full), quick=wanted.quick)


def work(case: Case) -> dict[str, Any]:
    """One case."""
    kind, number, seed = case
    found = {"quiet": _quiet, "knock": _knock, "simulated": _simulated}[kind](number, seed)
    return {"kind": kind, **found}


def _setting(number: int, rng: np.random.Generator) -> tuple[str, Rig, Rig]:
    """Preset, true rig and the rig as it was calibrated."""
    preset = PRESETS[number % len(PRESETS)]
    rig = true_rig(preset, CAMERAS[number // len(PRESETS) % len(CAMERAS)], rng)
    return preset, rig, calibrated(rig, rng)


def _quiet(number: int, seed: int) -> dict[str, Any]:
    """An hour in which nothing moves."""
    rng = np.random.default_rng(seed)
    preset, rig, given = _setting(number, rng)
    found = watch(given, gather_rig_observations(given, footage(preset, rig, HOUR_S, rng.uniform(*QUIET_PEOPLE), rng, fps=FPS)))
    told = [sum(window.clear(c) for c in range(len(rig))) for window in found.windows]
    return {
        "preset": preset, "cameras": len(rig), "alarms": len(found.moves), "minutes": len(found.windows),
        "told": sum(told), "camera_minutes": len(rig) * len(found.windows),
        "largest": max((test.score for window in found.windows for test in window.tests), default=0.0),
    }  # fmt: skip


def _knocked(number: int, rig: Rig, rng: np.random.Generator) -> Move:
    """By turns a degree about a random axis and 10 cm in a random direction, of a random camera."""
    camera, way = rig.names[int(rng.integers(len(rig)))], np.array(unit(rng))
    seconds = float(rng.uniform(*QUIET_BEFORE_S))
    x, y, z = ((TURN_DEG if number % 2 else SHIFT_M) * way).tolist()
    return Move(camera, seconds, turn_deg=(x, y, z)) if number % 2 else Move(camera, seconds, shift_m=(x, y, z))


def _knock(number: int, seed: int) -> dict[str, Any]:
    """A camera is knocked after some quiet minutes; the footage ends a minute later."""
    rng = np.random.default_rng(seed)
    # Knocks alternate, so that presets and numbers of cameras must not.
    preset, rig, given = _setting(number // 2, rng)
    move = _knocked(number, rig, rng)
    seen = footage(preset, rig, move.seconds + MINUTE_S + 1, rng.uniform(*PEOPLE[preset]), rng, fps=FPS, moves=(move,))
    last = [seen[name].boxes.frame >= (move.seconds * FPS) for name in rig.names]
    boxes = sum(int(np.count_nonzero(rows)) for rows in last)
    people = boxes / (len(rig) * MINUTE_S * FPS)
    found = watch(given, gather_rig_observations(given, seen))
    return {"preset": preset, "cameras": len(rig), "people": people, **_judged(found, move, rig)}


def _simulated(number: int, seed: int) -> dict[str, Any]:
    """The same by the full simulator: every limb, hidden people, false boxes; in half of the cases nobody says who is who."""
    rng = np.random.default_rng(seed)
    preset, given_ids = PRESETS[number // 2 % len(PRESETS)], number // 6 % 2 == 0
    cameras = CAMERAS[number // 12 % len(CAMERAS)]
    seconds, placed = 110.0, list[Move]()

    def knock(rig: Rig, _: np.random.Generator) -> Rig:
        """The rig after the knock."""
        placed.append(replace(_knocked(number, rig, rng), seconds=seconds))
        moved = [replace(c, pose=placed[0].after(c.pose)) if c.name == placed[0].camera and c.pose else c for c in rig]
        return Rig(tuple(moved))

    scene = staged(
        seed, given=given_ids, later=(seconds, knock), preset=preset, cameras=cameras, people=6, seconds=seconds + MINUTE_S + 1,
        fps=2.0, clock_offsets=0.0,
    )  # fmt: skip
    given = calibrated(scene.truth, rng)
    seen = Observations({name: CameraObservations(boxes) for name, boxes in scene.boxes.items()}, 2.0)
    if not given_ids:
        clocks = {name: Clock(2.0) for name in given.names}
        seen = identify_by_rig(given, replace(seen, clocks=clocks), clocks, np.random.default_rng(0))
    found = watch(given, gather_rig_observations(given, seen))
    return {"preset": preset, "cameras": cameras, "given": given_ids, **_judged(found, placed[0], scene.truth)}


def _judged(found: Watched, move: Move, rig: Rig) -> dict[str, Any]:
    """What was said of a knock, held against the truth."""
    turn = bool(np.any(np.array(move.turn_deg) != 0))
    early = [one for one in found.moves if one.noticed_s < move.seconds]
    late = [one for one in found.moves if one.noticed_s >= move.seconds]
    result: dict[str, Any] = {"turn": turn, "early": len(early), "seen": bool(late), "right": False, "among": False, "more": 0}
    if not late:
        return result
    first = late[0]
    result |= {
        "right": first.camera == move.camera and not first.others, "among": move.camera in (first.camera, *first.others),
        "more": len(late) - 1, "delay_s": first.noticed_s - move.seconds,
    }  # fmt: skip
    if first.camera != move.camera or first.moment is None or first.pose is None:
        return result
    before = rig[move.camera].pose
    assert before is not None
    error = first.shift - _shift(before, move.after(before))
    position = float(np.linalg.norm(error[:3]) / np.sqrt(np.trace(first.covariance[:3, :3])))
    angle = float(np.linalg.norm(error[3:]) / np.sqrt(np.trace(first.covariance[3:, 3:])))
    return result | {
        "late_s": first.moment.seconds - move.seconds, "position": position, "orientation": angle,
        "error_m": float(np.linalg.norm(error[:3])), "error_deg": float(np.degrees(np.linalg.norm(error[3:]))),
        "bracketed": first.moment.from_s <= move.seconds <= first.moment.until_s,
    }  # fmt: skip


def _shift(before: Pose, after: Pose) -> Floats:
    """(6,) as `watching.Move.shift`."""
    return np.concatenate([after.centre - before.centre, log_rotation(after.R_cw @ before.R_cw.T)])


def _lines(quiet: Sequence[dict[str, Any]], knocks: Sequence[dict[str, Any]]) -> list[Line]:
    """The lines of the table over all parts."""
    false = sum(one["alarms"] > 0 for one in quiet)
    minutes, alarms = sum(one["minutes"] for one in quiet), sum(one["alarms"] for one in quiet)
    seen = sum(one["seen"] for one in knocks)
    right, wrong = sum(one["right"] for one in knocks), sum(one["seen"] and not one["among"] for one in knocks)
    late = np.append(np.abs(_of(knocks, "late_s")), [] if seen else [np.inf])
    half, most = float(np.median(late)), float(np.quantile(late, 0.9))
    return [
        Line(
            "monitor: false alarms over quiet hours", f"{false} of {len(quiet)} hours ({percent(false, len(quiet))}), "
            f"{alarms} in {minutes} minutes", "under 1 % of the hours", false < 0.01 * len(quiet),
        ),
        Line(
            "monitor: moves of 1 degree or 10 cm seen within a minute",
            f"{seen} of {len(knocks)} ({percent(seen, len(knocks))})", "95 %", seen >= 0.95 * len(knocks),
        ),
        Line(
            "monitor: the camera that moved", f"named in {percent(right, seen)} of those seen, one of several named in "
            f"{percent(seen - right - wrong, seen)}, wrong in {percent(wrong, seen)}", "wrong under 2 %", wrong < 0.02 * seen,
        ),
        Line("monitor: the moment", f"off by {half:.1f} s (median), {most:.1f} s (90 %)", "within 5 s in 90 %", most <= 5),
        _coverage("position", knocks), _coverage("orientation", knocks),
    ]  # fmt: skip


def _coverage(what: str, knocks: Sequence[dict[str, Any]]) -> Line:
    """How many of the measured moves lie inside one and two of their sigmas."""
    ratio = _of(knocks, what)
    one, two = (float(np.mean(ratio < k)) if len(ratio) else 0.0 for k in (1, 2))
    return Line(
        f"monitor: {what} of the move inside one and two sigmas", f"{100 * one:.0f} %, {100 * two:.0f} %",
        "60 to 76 %, 90 % or more", 0.6 <= one <= 0.76 and two >= 0.9,
    )  # fmt: skip


def _of(cases: Sequence[dict[str, Any]], key: str) -> Floats:
    """(K,) of the cases that tell it."""
    return np.array([one[key] for one in cases if one.get(key) is not None])


def _text(quiet: Sequence[dict[str, Any]], knocks: Sequence[dict[str, Any]], full: Sequence[dict[str, Any]]) -> str:
    """The section."""
    told, all_of = sum(one["told"] for one in quiet), sum(one["camera_minutes"] for one in quiet)
    largest = np.sort(_of(quiet, "largest"))[::-1][:3]
    rows = [
        _row(f"{what}, {name}", [one for one in group if one["turn"] == turn])
        for what, group in (("cheap", knocks), ("simulated", full))
        for turn, name in ((True, f"{TURN_DEG:g} degree"), (False, f"{100 * SHIFT_M:g} cm"))
    ]
    rows += [_row(f"cheap, {n} cameras", [one for one in knocks if one["cameras"] == n]) for n in CAMERAS]
    for low, high in ((0, 2), (2, 4), (4, 6), (6, 99)):
        some = [one for one in knocks if low <= one["people"] < high]
        rows.append(_row(f"cheap, {low} to {high} people in a frame" if high < 99 else f"cheap, over {low} people", some))
    for known, name in ((True, "known"), (False, "unknown")):
        rows.append(_row(f"simulated, identities {name}", [one for one in full if one["given"] == known]))
    crowd = ", ".join(f"{low:g} to {high:g} ({preset})" for preset, (low, high) in PEOPLE.items())
    columns = (
        "bumps", "number", "seen", "camera named", "one of several", "wrong", "false before", "s late (median)", "m off",
        "degrees off",
    )  # fmt: skip
    return f"""
The footage is of rigs of 3 to 6 cameras around the areas of the three presets. The input rig has the errors of a typical
calibration (1 to 3 cm, 0.1 degrees, all lengths by 1 %), and its sigmas state them. Most footage is *cheap*: people come
and go as boxes only, {FPS:g} frame a second, with realistic errors. Most errors last for seconds (2 % of the height), some for
as long as a person stays (a bag on one side, 4 cm). People bend, and 4 % of the time something hides their legs. *Simulated*
footage comes from the full simulator. The monitor knows only the rig; in the cheap footage it also knows the identities.

Quiet hours: {len(quiet)}, with {QUIET_PEOPLE[0]:g} to {QUIET_PEOPLE[1]:g} people at once on average, tested every
{WatchOptions().step_s:g} s against all earlier footage. The cameras could be tested in {percent(told, all_of)} of their
minutes. The largest scores: {", ".join(f"{value:.1f}" for value in largest)}; a camera counts as moved from
{WatchOptions().threshold:g} on.

Bumps: a randomly chosen camera is rotated about a random axis or moved in a random direction after {QUIET_BEFORE_S[0]:g} to
{QUIET_BEFORE_S[1]:g} quiet seconds; the footage ends a minute later. *Seen* counts the cases in which the monitor reported
within this minute that a camera, or one of several that it named, had moved. There are {crowd} people at once on average.

{table(columns, rows)}
"""


def _row(what: str, some: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """One line of the table of knocks."""
    seen = [one for one in some if one["seen"]]
    right, among = sum(one["right"] for one in seen), sum(one["among"] for one in seen)
    medians = [f"{np.median(_of(seen, key)):.{digits}f}" if len(_of(seen, key)) else "-"
               for key, digits in (("late_s", 1), ("error_m", 3), ("error_deg", 2))]  # fmt: skip
    return (
        what, str(len(some)), percent(len(seen), len(some)), percent(right, len(seen)), percent(among - right, len(seen)),
        percent(len(seen) - among, len(seen)), str(sum(one["early"] for one in some)), *medians,
    )  # fmt: skip
