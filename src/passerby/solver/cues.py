"""Scale cues in the adjustment: their rows, a first scale from them, and the weight of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.text import list_names
from passerby.core.cameras import Rig
from passerby.core.figures import CueFigures
from passerby.core.scale_cues import KnownLength, ScaleCues, WrongUnit, find_wrong_unit
from passerby.geometry.groups import NORMAL_BY_MAD
from passerby.geometry.plan_fit import UNKNOWN_SD, ScalePrior
from passerby.geometry.ray_consensus import vote_points
from passerby.geometry.triangulation import PointObservations, triangulate
from passerby.people.box_heights import BOX_SD
from passerby.solver.cue_terms import CueRows
from passerby.solver.plan_rows import plan_rows

MARK_SIGMA_PX = 1.5
"""Standard deviation of a point that a person marks in an image."""
MARK_TOLERANCE = 6.0
"""Sigmas within which the marks of one end agree, as for people and joints (`refinement.AGREE_SIGMAS`)."""

ROUGH_SCALE_SD = 0.1
"""Relative standard deviation of the scale of a rough rig from pairs of cameras and people's expected heights."""

MEDIAN_EFFICIENCY = 1.2533
"""Ratio of the standard deviation of a median to that of a mean, for many normal values."""
MOST_LONGER = 0.1
"""Largest share of a length by which noise is assumed to lengthen it: up to it, half the variance over the length is valid."""

POPULATION_BIAS = 0.045
"""Relative standard deviation, common to all people, of height cues if it is not stated: a crowd is not the population, and
boxes are not bodies. From published statures and rendered films (`docs/results/limits.md`)."""

UNUSUAL_SIGMAS, MEASURED_SD = 3.0, 0.04
"""People farther from the median height than this many sigmas are not used for the scale. The sigma combines the spread of the
population (5 % for adults) and the relative error of one measured height. Results for other limits: docs/results/limits.md."""
FEWEST_COMPARED, MOST_UNUSUAL = 5, 1 / 3
"""Smallest number of people for a test of unusual ones, and the largest share of these; above it, none counts as unusual."""
CHANCE = 0.975
"""Quantile of a sample variance up to which people differ by chance."""

LEAST_PEOPLE_SD = 0.02
"""Smallest relative sigma of the scale from people, when wrong placements of a plan are found: the best that boxes allow."""


def expected_heights(cues: ScaleCues, identities: Ints) -> tuple[Floats, Floats]:
    """Return the prior mean (P,) and standard deviation (P,) of each person's standing height, metres.

    An error common to all people does not average out. Each one's standard deviation is therefore enlarged, so that the mean of
    all is not more certain than `ScaleCues.population`.
    """
    common = POPULATION_BIAS * cues.population.mean_m if cues.population.mean_sd_m is None else cues.population.mean_sd_m
    mean = np.full(len(identities), cues.population.mean_m)
    unnamed = len(identities) - int(np.isin(identities, [cue.identity for cue in cues.people]).sum())
    sd = np.full(len(identities), np.hypot(cues.population.sd_m, np.sqrt(unnamed) * common))
    for cue in cues.people:
        known = identities == cue.identity
        mean[known], sd[known] = cue.metres, cue.sd_m
    return mean, sd


def population_spread(cues: ScaleCues, identities: Ints) -> Floats:
    """Return the spread (P,) of heights in the population, as a share of the height; NaN for people of stated height."""
    spread = np.full(len(identities), cues.population.sd_m / cues.population.mean_m)
    spread[np.isin(identities, [cue.identity for cue in cues.people])] = np.nan
    return spread


def unusual_people(heights: Floats, known: NDArray[np.bool_], spread: Floats) -> NDArray[np.bool_]:
    """Return who is far taller or shorter than most of a population (P,): posters and prams, or a child among adults.

    Args:
        heights: (P,) heights by the rig, metres.
        known: (P,) people of the population that were seen.
        spread: (P,) standard deviation of heights in the population, as a share.
    """
    far = np.zeros(len(heights), dtype=bool)
    if np.count_nonzero(known) < FEWEST_COMPARED:
        return far
    away = np.abs(np.log(heights[known] / np.median(heights[known])))
    far[known] = away > UNUSUAL_SIGMAS * np.hypot(spread[known], MEASURED_SD)
    return far if np.count_nonzero(far) <= MOST_UNUSUAL * np.count_nonzero(known) else np.zeros(len(heights), dtype=bool)


def unexplained_spread(heights: Floats, spread: Floats) -> float:
    """Return the standard deviation of heights in excess of population and chance, as a share; 0 without an excess.

    Stilts, loads on heads, or children among adults make some people far taller or shorter. If they are too many for
    `unusual_people`, it is not known who is as expected: the error of the scale may be as large as the excess.

    Args:
        heights: (P,) heights by the rig, metres, without unusual people.
        spread: (P,) standard deviation of heights in the population, as a share.
    """
    if len(heights) < 2:
        return 0.0
    expected = float(np.mean(spread**2)) + MEASURED_SD**2
    by_chance = expected * float(chdtri(len(heights) - 1, 1 - CHANCE)) / (len(heights) - 1)
    return float(np.sqrt(max(float(np.var(np.log(heights), ddof=1)) - by_chance, 0.0)))


def cue_rows(cues: ScaleCues, rig: Rig) -> CueRows | None:
    """Return lengths, distances, camera heights and the plan as rows over the rig's cameras; None without any.

    Cues on cameras outside the rig are left out. Raises `InputError` for a marked point outside the range of the lens.
    """
    index = {name: number for number, name in enumerate(rig.names)}
    inside = [cue for cue in cues.lengths if sum(name in index for name in cue.points) > 1]
    lengths = _without_marks_outside_lenses(inside, rig)
    marks = _ends_seen(lengths, rig)
    # One object that is measured several times is one cue.
    names = [cue.name or f"length {number}" for number, cue in enumerate(lengths, start=1)]
    order = {name: place for place, name in enumerate(dict.fromkeys(names))}
    cue_of = np.array([order[name] for name in names], dtype=np.int64)
    distances = [cue for cue in cues.distances if set(cue.between) <= set(index)]
    heights = [cue for cue in cues.camera_heights if cue.camera in index]
    plan = plan_rows(cues.plan, rig)
    if not (lengths or distances or heights or plan is not None):
        return None
    stated = np.array([[cue.metres, cue.sd_m] for cue in lengths]).reshape(-1, 2)
    stated[:, 1] *= np.sqrt(np.bincount(cue_of)[cue_of]) if len(lengths) else 1.0
    return CueRows(
        marks, stated, cue_of,
        np.array([[index[name] for name in cue.between] for cue in distances], dtype=np.int64).reshape(-1, 2),
        np.array([[cue.metres, cue.sd_m] for cue in distances]).reshape(-1, 2),
        np.array([index[cue.camera] for cue in heights], dtype=np.int64),
        np.array([[cue.metres, cue.sd_m] for cue in heights]).reshape(-1, 2),
        (
            *order,
            *(f"distance {cue.between[0]} to {cue.between[1]}" for cue in distances),
            *(f"height of camera {cue.camera}" for cue in heights),
        ),
        plan,
    )  # fmt: skip


def _without_marks_outside_lenses(lengths: Sequence[KnownLength], rig: Rig) -> list[KnownLength]:
    """Remove marks outside the range of a lens from objects that are marked at several times, as long as others remain.

    Such a mark is a false detection, or the lens is an estimate that is still wrong.
    """
    outside: set[tuple[int, str]] = set()
    for camera in rig:
        seen = [k for k, cue in enumerate(lengths) if cue.name and camera.name in cue.points]
        if seen:
            rays = camera.lens.bearings(np.concatenate([lengths[k].points[camera.name] for k in seen]))
            lost = np.asarray(~np.isfinite(rays.reshape(len(seen), 6)).all(axis=1))
            outside |= {(k, camera.name) for k, one in zip(seen, lost.tolist(), strict=True) if one}
    if not outside:
        return list(lengths)
    parts = [
        replace(cue, points={name: ends for name, ends in cue.points.items() if (k, name) not in outside})
        for k, cue in enumerate(lengths)
    ]
    whole = [sum(name in rig.names for name in cue.points) > 1 for cue in parts]
    measured = {cue.name for cue, enough in zip(parts, whole, strict=True) if enough}
    return [
        part if enough else cue
        for cue, part, enough in zip(lengths, parts, whole, strict=True)
        if enough or cue.name not in measured
    ]


def _ends_seen(lengths: Sequence[KnownLength], rig: Rig) -> PointObservations | None:
    """Return the marked ends of lengths, sorted by camera; None without any. Raises `InputError` as `cue_rows`."""
    parts = []
    for c, camera in enumerate(rig):
        seen = [k for k, cue in enumerate(lengths) if camera.name in cue.points]
        if not seen:
            continue
        pixels = np.concatenate([lengths[k].points[camera.name] for k in seen])
        bearing = camera.lens.bearings(pixels)
        outside = np.flatnonzero(~np.isfinite(bearing).all(axis=1))
        if len(outside):
            own = lengths[seen[outside[0] // 2]]
            what = f"an end of the {own.name}" if own.name else "a point"
            raise InputError(
                f"scale.lengths: {what} marked in camera {camera.name} lies outside what its lens can see: "
                f"{own.points[camera.name].tolist()}"
            )
        point = (2 * np.array(seen)[:, None] + np.arange(2)).ravel()
        many = np.full(len(point), MARK_SIGMA_PX)
        parts.append(PointObservations(np.full(len(point), c), point, bearing, camera.lens.tangents(bearing), many))
    return PointObservations.joined(parts) if parts else None


def settle_cues(rows: CueRows | None, R: Floats, centre: Floats, heights: Floats, mean: Floats, sd: Floats) -> CueRows | None:
    """Return the cues with the plan's placements that agree under a rig, and with the bias of lengths due to noise there.

    Args:
        rows: the cues.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        heights: (P,) heights of the people by the rig, metres.
        mean: (P,) expected heights, metres.
        sd: (P,) one sigma of the expected heights, metres.
    """
    if rows is None:
        return rows
    if rows.marks is not None:
        rows = replace(rows, longer_m=measure_cues(rows, R, centre, triangulate_marks(rows, R, centre)).longer_m)
    if rows.plan is None:
        return rows
    weight = (mean / sd) ** 2
    people = len(heights) and weight.sum() > 0
    growth = float(np.average(np.log(mean / heights), weights=weight)) if people else 0.0
    prior = ScalePrior(growth, float(np.hypot(1 / np.sqrt(weight.sum()), LEAST_PEOPLE_SD)) if people else UNKNOWN_SD)
    return replace(rows, plan=rows.plan.settle(R, centre, prior))


def triangulate_marks(rows: CueRows | None, R: Floats, centre: Floats) -> Floats:
    """Triangulate the ends (2 K, 3) of the known lengths under a rig, metres.

    NaN where the marks of an end disagree at one of several times. Raises `InputError` where the rays of a length never meet.
    """
    if rows is None or rows.marks is None:
        return np.zeros((0, 3))
    m, n = rows.marks, 2 * len(rows.lengths)
    points = triangulate(m.camera, m.point, m.bearing, R, -np.einsum("cij,cj->ci", R, centre), n)
    tolerance = np.full(len(m.point), MARK_TOLERANCE * MARK_SIGMA_PX)
    agreeing = vote_points(m.camera, m.point, m.bearing, m.tangent, tolerance, n, R, centre).points
    for cue, count in enumerate(rows.count_of_cue()):
        own = np.repeat(rows.length_cue == cue, 2)
        found = np.isfinite(agreeing[own].reshape(-1, 6)).all(axis=1).any()
        points[own] = agreeing[own] if count > 1 and found else points[own]
        if not np.isfinite(points[own].reshape(-1, 6)).all(axis=1).any():
            raise InputError(
                f"{rows.names[cue]}, under scale: the marks of one end do not meet: mark it in cameras farther apart"
            )
    return points


def without_gaps(rows: CueRows | None, points: Floats) -> Floats:
    """Return the points of `triangulate_marks`, with NaN replaced by the median of the same end at the other times."""
    if rows is None:
        return points
    points, group = points.copy(), 2 * np.repeat(rows.length_cue, 2) + np.arange(len(points)) % 2
    lost = ~np.isfinite(points).all(axis=1)
    for one in np.unique(group[lost]):
        points[lost & (group == one)] = np.median(points[~lost & (group == one)], axis=0)
    return points


def length_noise(rows: CueRows, R: Floats, centre: Floats, marks: Floats) -> tuple[Floats, Floats]:
    """Return one sigma (K,) of each marked length due to the noise of its marks, and its mean increase (K,), metres.

    Noise across a length makes it longer, on average by half its variance over the length.

    Args:
        rows: the cues, with the rays of the marks.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        marks: (2 K, 3) the marked points, metres.
    """
    o = rows.marks
    if o is None:
        return np.zeros(0), np.zeros(0)
    away = np.linalg.norm(marks[o.point] - centre[o.camera], axis=1)
    J = o.tangent @ R[o.camera] / (np.maximum(away, 1e-3) * o.sigma_px)[:, None, None]
    information = np.tile(1e-6 * np.eye(3), (len(marks), 1, 1))
    np.add.at(information, o.point, J.transpose(0, 2, 1) @ J)
    of_ends = np.linalg.inv(information)
    between = of_ends[0::2] + of_ends[1::2]
    line = marks[0::2] - marks[1::2]
    length = np.maximum(np.linalg.norm(line, axis=1, keepdims=True), 1e-9)
    along = np.einsum("li,lij,lj->l", line / length, between, line / length)
    return np.sqrt(along), (np.trace(between, axis1=1, axis2=2) - along) / (2 * length[:, 0])


@dataclass(frozen=True, eq=False)
class MeasuredLengths:
    """The L cues about lengths as measured by a rig, and the bias of their K measurements."""

    metres: Floats
    """(L,) measured lengths."""
    sigma_m: Floats
    """(L,) one sigma due to the marks."""
    longer_m: Floats
    """(K,) mean increase of each measurement due to noise; 0 for an object that is measured once."""


def measure_cues(rows: CueRows, R: Floats, centre: Floats, marks: Floats) -> MeasuredLengths:
    """Measure the cues about lengths by a rig; an object that is measured several times by the weighted median.

    The noise of its marks is estimated from the scatter of the measurements.

    Args:
        rows: the cues.
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        marks: (2 K, 3) points from `triangulate_marks`, metres.
    """
    noise, longer = length_noise(rows, R, centre, without_gaps(rows, marks))
    measured = np.linalg.norm(marks[0::2] - marks[1::2], axis=1)
    values, sigmas = [], []
    for cue, count in enumerate(rows.count_of_cue()):
        every = rows.length_cue == cue
        own = every & np.isfinite(measured)
        if count == 1:
            values.append(float(measured[own][0]))
            sigmas.append(float(noise[own][0]))
            longer[own] = 0.0
            continue
        order = np.argsort(measured[own], kind="stable")
        weight = np.cumsum(1 / noise[own][order] ** 2)
        middle = order[np.searchsorted(weight, 0.5 * weight[-1])]
        median = float(measured[own][middle])
        factor = NORMAL_BY_MAD * float(np.median(np.abs(measured[own] - median) / noise[own]))
        longer[every] = np.minimum(factor**2 * longer[every], MOST_LONGER * median)
        bias = float(np.average(longer[own], weights=1 / noise[own] ** 2))
        values.append(median - bias)
        # The formula of the bias is valid for small noise: half of the bias is added to the sigma.
        sigmas.append(float(np.hypot(MEDIAN_EFFICIENCY * factor / np.sqrt(weight[-1]), 0.5 * bias)))
    return MeasuredLengths(np.array(values), np.array(sigmas), longer)


def scale_cue_lengths(rows: CueRows | None, R: Floats, centre: Floats, marks: Floats) -> list[tuple[str, float, float, float]]:
    """Return (name, measured, stated, standard deviation) of every length, distance and camera height, metres.

    The standard deviations of lengths include the noise of the marks. The span of a settled plan comes last.
    """
    if rows is None:
        return []
    lengths, count = measure_cues(rows, R, centre, marks), rows.count_of_cue()
    first = np.searchsorted(rows.length_cue, np.arange(len(count)))
    stated = np.concatenate([rows.lengths[first], rows.distances, rows.heights])
    stated[: len(count), 1] = np.hypot(stated[: len(count), 1] / np.sqrt(count), lengths.sigma_m)
    values = lengths.metres.tolist()
    values += [float(np.linalg.norm(centre[i] - centre[j])) for i, j in rows.distance_between]
    values += [float(centre[i, 2]) for i in rows.height_of]
    found = [
        (name, value, float(metres), float(sd)) for name, value, (metres, sd) in zip(rows.names, values, stated, strict=True)
    ]
    if rows.plan is not None and (span := rows.plan.span(R, centre)) is not None:
        found.append((f"plan {rows.plan.name}", *span, rows.plan.sigma * span[1]))
    return found


def refuse_wrong_units(rows: CueRows | None, rigs: Sequence[tuple[Floats, Floats]]) -> None:
    """Raise `InputError` for a length that is in another unit than metres by every rough rig with the scale of people.

    Args:
        rows: the cues.
        rigs: rotations (C, 3, 3) world to camera and centres (C, 3), metres.
    """
    found: dict[str, list[WrongUnit | None]] = {}
    for R, centre in rigs:
        for name, measured, stated, _ in scale_cue_lengths(rows, R, centre, triangulate_marks(rows, R, centre)):
            if measured > 0 and not name.startswith("plan "):
                found.setdefault(name, []).append(find_wrong_unit(float(np.log(stated / measured)), ROUGH_SCALE_SD))
    for name, wrong in found.items():
        first = wrong[0]
        if first is not None and first.unit is not None and all(one is not None and one.unit == first.unit for one in wrong):
            raise InputError(f"[scale], {name}: the stated metres are {first.in_words}")


def initial_scale(rows: CueRows | None, R: Floats, centre: Floats, marks: Floats, n_people: int, population_sd: float) -> float:
    """Return the factor on a rig with the scale of people's heights that best fits these and the cues, by their sigmas."""
    logs, weights = [0.0], [max(n_people, 1) / population_sd**2]
    for _, value, stated, sd in scale_cue_lengths(rows, R, centre, marks):
        if value > 1e-3:
            logs.append(np.log(stated / value))
            weights.append((stated / sd) ** 2)
    return float(np.exp(np.average(logs, weights=weights)))


def scale_cue_weights(
    cues: ScaleCues, rows: CueRows | None, R: Floats, centre: Floats, marks: Floats, heights: Floats, mean: Floats, sd: Floats,
    seen: Ints, segments: float = 1.0, by_boxes: Mapping[int, float] | None = None, freed: Floats | None = None,
    unusual: NDArray[np.bool_] | None = None, population: Floats | None = None,
) -> tuple[list[CueFigures], float]:  # fmt: skip
    """Return the figures of each cue (stated, measured, residual in sigmas, share of the weight), and the scale's sigma.

    In the adjustment a person of stated height is as tall as stated, and boxes that contradict it are outliers. `by_boxes` has
    the people's heights as measured by their boxes (identity -> metres). The own scale of a distance or a camera height is that
    of `freed_measurements`, if `freed` is given.

    The weight of a cue is its information on the logarithm of the scale, (length / standard deviation)^2. The scale's sigma
    also includes the error of the rig's own measurement. The people of the population are one cue, without those who are
    `unusual` (P,); its sigma includes the spread in excess of their `population` (P,) (`population_spread`). Segments of bodies
    are one cue too: their lengths are `segments` times the expected ones. The sigma is infinite where there is no cue.
    """
    places = {cue.identity: f", {cue.place}" if cue.place else "" for cue in cues.people}
    named = np.array([identity in places for identity in seen], dtype=bool)
    found: list[tuple[str, float, float, float]] = []
    kinds: list[dict[str, Any]] = []
    counted = ~named if unusual is None else ~named & ~unusual
    if counted.any():
        count = int(np.count_nonzero(counted))
        spread = float(np.mean(sd[counted]) / np.sqrt(count))
        if population is not None:
            spread = float(np.hypot(spread, np.mean(mean[counted]) * unexplained_spread(heights[counted], population[counted])))
        kinds.append({"kind": "population", "count": count})
        found.append((f"population of {count}", float(np.mean(heights[counted])), float(np.mean(mean[counted])), spread))
    for i in np.flatnonzero(named):
        kinds.append({"kind": "person", "identity": int(seen[i])})
        boxed = None if by_boxes is None else by_boxes.get(int(seen[i]))
        tall, spread = (heights[i], sd[i]) if boxed is None else (boxed, np.hypot(sd[i], BOX_SD * mean[i]))
        found.append((f"height of person {seen[i]}{places[int(seen[i])]}", float(tall), float(mean[i]), float(spread)))
    first = len(found) + (0 if rows is None else len(rows.count_of_cue()))
    found += scale_cue_lengths(rows, R, centre, marks)
    own = [(value, spread) for _, value, _, spread in found]
    for number, (value, by_rig) in enumerate([] if freed is None else freed.tolist(), start=first):
        own[number] = value, float(np.hypot(own[number][1], by_rig))
    if rows is not None:
        kinds += [{"kind": kind} for kind in rows.kinds]
        for number, count in enumerate(rows.count_of_cue().tolist(), start=first - len(rows.count_of_cue())):
            kinds[number] |= {"count": count} if count > 1 else {}
        kinds += [{"kind": "plan"} for _ in range(len(found) - len(kinds))]
    if rows is not None and rows.world is not None and rows.world.trunk_m is not None:
        usual, spread = rows.world.trunk_m
        kinds.append({"kind": "segments", "count": rows.world.people})
        name = f"body segments of {rows.world.people} people ({list_names(rows.world.segments)})"
        found.append((name, usual * segments, usual, spread))
        own.append((usual * segments, spread))
    stated_m = np.array([stated for _, _, stated, _ in found])
    sds = [spread for _, _, _, spread in found], [spread for _, spread in own]
    pull, known = ((stated_m / np.array(sd_m)) ** 2 for sd_m in sds)
    if not len(seen):  # without people who stand on it, the height of the ground below a camera is unknown
        pull[[kind["kind"] == "camera_height" for kind in kinds]] = 0.0
    known = np.where(pull > 0, known, 0.0)
    return [
        CueFigures(
            cue=name, **kind, stated_m=stated, measured_m=value, sd_m=spread, residual_sigmas=(value - stated) / spread,
            share=float(pull[i] / max(float(pull.sum()), 1e-300)),
            own_scale=stated / own[i][0] if known[i] > 0 and own[i][0] > 0 else None,
            own_sigma=float(known[i] ** -0.5) if known[i] > 0 and own[i][0] > 0 else None,
        )
        for i, ((name, value, stated, spread), kind) in enumerate(zip(found, kinds, strict=True))
    ], float(1 / np.sqrt(known.sum())) if known.sum() > 0 else float("inf")  # fmt: skip


def cue_in_words(cue: CueFigures) -> str:
    """Return the name of a cue from `scale_cue_weights`; files of older versions lack its kind."""
    return f"heights of {cue.count} people" if cue.kind == "population" else cue.cue
