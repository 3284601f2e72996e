"""Results as tables on standard output."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from passerby.calibration.calibration import Calibration
from passerby.cli.terminal import MISSING, is_interactive, number, show_table
from passerby.core.association_figures import TiedPair, route_in_words
from passerby.core.cameras import Camera, Rig
from passerby.core.figures import AdjustedFigures, CheckedLength, HeldOutFigures, adjusted
from passerby.core.lens_figures import field_of_view_deg, lens_parameters, names_in_words
from passerby.core.measuring import Distances, MeasuringErrors, MeasuringFigures
from passerby.evaluation.metrics import Comparison, Stated
from passerby.evaluation.on_people import PeopleComparison
from passerby.findings.ranking import describe_first_reasons
from passerby.findings.texts import text_of
from passerby.report.recommendations import good_for
from passerby.scene.check import CameraCheck, SceneCheck
from passerby.solver.cues import cue_in_words


def show_calibration(calibration: Calibration, verbose: bool) -> None:
    """Print the cameras' positions and uncertainties; with `verbose` also scale cues, pairs and reasons."""
    rows, timed = [], calibration.clocks_searched
    for camera in calibration.rig:
        seen, sigma = calibration.observations[camera.name], camera.sigma
        place = [MISSING] * 3 if camera.pose is None else [number(value, 3) for value in camera.pose.centre]
        position, orientation = (None, None) if sigma is None else (1000 * sigma.position_m, sigma.orientation_deg)
        measured = [None] * 2 if sigma is None else [_millimetres(sigma.points_m), _millimetres(sigma.ground_m)]
        sure = [
            *map(number, measured),
            number(position),
            number(orientation, 2),
            *(_clock(calibration, camera) if timed else ()),
        ]
        rows.append([camera.name, *place, *sure, str(len(seen.boxes)), str(len(seen.keypoints))])
    clock = ("time offset s", "offset std s") if timed else ()
    stds = ("points std mm", "ground std mm", "position std mm", "rotation std deg")
    columns = ("camera", "x m", "y m", "height m", *stds, *clock, "boxes", "keypoints")
    show_table(f"{calibration.name}: {calibration.verdict}", columns, rows)
    show_measuring(adjusted(calibration.figures).measuring)
    show_scale(adjusted(calibration.figures), calibration.rig)
    show_held_out(calibration.figures.held_out)
    show_checks(calibration.figures.checks)
    show_lenses(adjusted(calibration.figures), calibration.rig)
    for finding in calibration.findings if not is_interactive() else ():
        print(f"note: {finding}")
    if verbose:
        show_cues(adjusted(calibration.figures))
        if calibration.association is not None:
            show_pairs(calibration.association.figures.pairs or ())
            for name, why in calibration.association.lost.items():
                print(f"{name}: {' '.join(text_of(why).split())}")
        for reason in calibration.reasons:
            print(f"{calibration.verdict}: {' '.join(reason.split())}")
    for one in calibration.groups:
        show_calibration(one, verbose)


def show_measuring(measuring: MeasuringFigures | None) -> None:
    """Print the rig's measuring accuracy where people walked."""
    if measuring is not None:
        print(f"where people walked, 1 sigma, scale apart: {_describe_sigmas(measuring)}")


def _describe_sigmas(measuring: MeasuringFigures) -> str:
    points, ground = measuring.points, measuring.ground
    figures = [f"points by several cameras to {points.median_mm:.0f} mm (90 %: {points.p90_mm:.0f})"]
    if ground is not None:
        figures.append(f"positions on the ground by one camera to {ground.median_mm:.0f} mm (90 %: {ground.p90_mm:.0f})")
    return ", ".join(figures)


def describe_rig_so_far(calibration: Calibration) -> str:
    """Describe in one line the rig from a part of the videos."""
    measuring = adjusted(calibration.figures).measuring
    known = "" if measuring is None else f", {_describe_sigmas(measuring)}"
    used = [one.values["used_s"] for one in calibration.notices if one.code == "videos_used_in_part"]
    part = f" from {used[0]:.0f} s of the videos" if used else ""
    return f"a rig{part}: {calibration.verdict}{known}; more of the videos follows"


def _millimetres(metres: float | None) -> float | None:
    return None if metres is None else 1000 * metres


def _clock(calibration: Calibration, camera: Camera) -> list[str]:
    """Return the texts of the offset of a registered camera's clock and of its sigma."""
    association = calibration.association
    if association is None or camera.pose is None:
        return [MISSING, MISSING]
    return [number(association.clocks[camera.name].offset_s, 3), number(association.sigma_s.get(camera.name), 3)]


def tell_reasons(calibration: Calibration) -> None:
    """Print to standard error why a calibration is not accepted; nothing for an accepted one."""
    if not calibration.accepted:
        reasons = (
            describe_first_reasons(calibration.doubts, "the report, or diagnostics in calibration.json") or "no reason given"
        )
        which = "" if calibration.group == 1 else f"group {calibration.group}: "
        print(f"{which}{calibration.verdict}: {reasons}", file=sys.stderr)
        if calibration.verdict == "doubtful":
            measuring = adjusted(calibration.figures).measuring
            print(good_for(calibration.doubts, calibration.rig.posed().names, measuring), file=sys.stderr)
    for one in calibration.groups:
        tell_reasons(one)


def show_pairs(pairs: Sequence[TiedPair]) -> None:
    """Print how each pair of cameras was registered; nothing without pairs."""
    if not pairs:
        return
    rows = [
        [
            " + ".join(pair.cameras),
            route_in_words(pair.route),
            number(pair.score),
            number(pair.share, 2),
            number(pair.runner_up, 2),
            MISSING if pair.matches is None else str(pair.matches),
            number(pair.registered_offset_s, 2),
            "yes" if pair.used else "no",
        ]
        for pair in pairs
    ]
    columns = ("pair", "route", "score", "share", "second-best", "matches", "offset s", "used")
    show_table("pairs of cameras", columns, rows)


LENGTH_PAYS = 0.01
"""Relative sigma of the scale below which a measured length barely reduces this sigma."""
MOSTLY_SCALE = 0.5
"""A measured length is recommended if the largest position sigma within the rig is below this share of the largest in total."""


def show_scale(figures: AdjustedFigures, rig: Rig) -> None:
    """Print the scale's uncertainty, the weight of each cue, and the effect of a measured length; nothing without a rig."""
    scale = figures.scale
    if not figures.cameras:
        return
    if scale.relative_sigma is None:
        print("scale unknown: no observation and no stated length determines it")
        return
    pulls = ", ".join(f"{cue_in_words(cue)} ({100 * cue.share:.0f} %)" for cue in scale.cues if cue.share > 0)
    print(f"scale known to {100 * scale.relative_sigma:.1f} %, from {pulls}")
    whole = [1000 * camera.sigma.position_m for camera in rig if camera.sigma is not None]
    within = [sigma for camera in figures.cameras if (sigma := camera.shape_position_sigma_mm) is not None]
    sure = scale.relative_sigma < LENGTH_PAYS
    if not sure and whole and within and np.isfinite(whole).all() and max(within) < MOSTLY_SCALE * max(whole):
        print(
            f"most of the uncertainty is global scale: relative positions are known to {number(max(within), 0)} mm; one "
            f"measured length under [scale] fixes that"
        )


def show_held_out(figures: HeldOutFigures | None) -> None:
    """Print the errors on people who were held out of the adjustment; nothing if there were none."""
    if figures is None:
        return
    held, fit = figures.held_out, figures.fit
    stretches = "one stretch" if figures.stretches == 1 else f"{figures.stretches} stretches"
    print(
        f"people of {stretches} of {figures.stretch_s:.0f} s, held out: {number(held.median_px, 1)} px off in the median, "
        f"{number(fit.median_px, 1)} px those fitted; on the ground half within {_centimetres(held.ground_50_m)}, 90 % within "
        f"{_centimetres(held.ground_90_m)}"
    )


def show_checks(checks: Sequence[CheckedLength] | None) -> None:
    """Print the known lengths that the calibration did not use, as measured by the rig and as stated."""
    for one in checks or ():
        if one.measured_m is not None:
            off = 100 * (one.measured_m / one.stated_m - 1)
            sigma = "" if one.sigma_m is None else f" (one sigma {100 * one.sigma_m / one.stated_m:.1f} %)"
            print(f"check length {one.number}: {one.measured_m:.3f} m, stated {one.stated_m:.3f} m: {off:+.1f} %{sigma}")


def _centimetres(metres: float | None) -> str:
    return MISSING if metres is None else f"{100 * metres:.0f} cm"


def show_cues(figures: AdjustedFigures) -> None:
    """Print the scale by each cue alone, and the cues that contradict each other; nothing for fewer than two cues."""
    cues = figures.scale.cues
    if len(cues) < 2:
        return
    rows = [
        [
            cue_in_words(cue),
            number(cue.stated_m, 3),
            number(cue.measured_m, 3),
            MISSING if cue.own_scale is None else f"{100 * (cue.own_scale - 1):+.1f}",
            MISSING if cue.own_sigma is None else number(100 * cue.own_sigma, 1),
            number(100 * cue.share, 0),
            ", ".join(cue.disagrees_with or ()) or MISSING,
        ]
        for cue in cues
    ]
    columns = ("constraint", "stated m", "measured m", "alone %", "1 sigma %", "weight %", "contradicts")
    show_table("scale constraints: by how much lengths would change by each alone", columns, rows)


def show_lenses(figures: AdjustedFigures, rig: Rig) -> None:
    """Print the estimated lenses and the parameters that depend on their priors; nothing if no lens was estimated."""
    rows = []
    for name, parts in figures.lenses.items():
        lens, found = rig[name].lens, {one.name: one for one in lens_parameters(parts)}
        focal, bent = found.get("focal length"), found.get("distortion k1")
        points = [found.get(f"principal point {axis}") for axis in "xy"]
        sure = max((one.sigma for one in points if one is not None), default=None)
        rows.append(
            [
                name,
                number(lens.focal),
                MISSING if focal is None else number(100 * focal.sigma / focal.estimate),
                " x ".join(number(angle, 0) for angle in field_of_view_deg(lens)),
                " ".join(number(value, 0) for value in lens.matrix[:2, 2]),
                number(sure),
                *([MISSING] * 2 if bent is None else [number(bent.estimate, 3), number(bent.sigma, 3)]),
                names_in_words(one for one in found.values() if one.by_prior) or MISSING,
            ]
        )
    if rows:
        point = ("principal point px", "std px")
        columns = ("camera", "focal px", "std %", "field of view deg", *point, "k1", "std", "weakly known from people")
        show_table("intrinsics estimated from people", columns, rows)


def show_comparison(comparison: Comparison) -> None:
    """Print the errors of every camera, their means and medians, and the errors of the world frame."""
    metric, similarity = comparison.metric, comparison.similarity
    rows = [
        [
            name,
            number(metric.position_mm.get(name)),
            number(metric.orientation_deg.get(name), 2),
            number(similarity.position_mm.get(name)),
            number(similarity.orientation_deg.get(name), 2),
        ]
        for name in (*comparison.names, *comparison.missing)
    ]
    for label, values in (
        (
            "mean",
            [
                metric.mean_position_mm,
                metric.mean_orientation_deg,
                similarity.mean_position_mm,
                similarity.mean_orientation_deg,
            ],
        ),
        (
            "median",
            [
                metric.median_position_mm,
                metric.median_orientation_deg,
                similarity.median_position_mm,
                similarity.median_orientation_deg,
            ],
        ),
    ):
        rows.append([label, *(number(value, 1 + index % 2) for index, value in enumerate(values))])
    columns = ("camera", "metric mm", "metric deg", "similarity mm", "similarity deg")
    show_table(
        f"errors; metric: aligned at {comparison.reference}, scale kept; similarity: after similarity (Umeyama) alignment",
        columns,
        rows,
    )
    if any(error.differs for error in comparison.lenses.values()):
        rows = [
            [name, f"{error.focal_percent:+.2f}", number(error.principal_point_px), number(error.ray_px)]
            for name, error in comparison.lenses.items()
        ]
        show_table("errors of the intrinsics", ("camera", "focal %", "principal point px", "rays px (mean)"), rows)
    print(
        f"scale ratio {number(comparison.scale_ratio, 4)}, up direction error {number(comparison.gravity_error_deg, 2)} deg, "
        f"ground height error {number(comparison.ground_error_mm)} mm; {len(comparison.names)} of "
        f"{len(comparison.names) + len(comparison.missing)} cameras registered"
    )
    if comparison.measured is not None:
        print(_describe_measuring(comparison.measured))
    if comparison.stated is not None and comparison.stated.position_sigmas:
        print(_sigmas_in_words(comparison.stated))


def _describe_measuring(found: MeasuringErrors) -> str:
    """Describe the measuring errors of a rig in one line."""

    def said(one: Distances) -> str:
        return f"median {number(one.median_mm)} mm, 90 % within {number(one.p90_mm)} mm"

    where = "places where people walked" if found.of_people else "places on a grid"
    ground = "" if found.ground is None else f"; positions on the ground by one camera: {said(found.ground)}"
    return (
        f"measured after similarity alignment, at {found.places} {where}: points by all cameras: {said(found.points)}{ground}"
    )


def show_people_comparison(found: PeopleComparison) -> None:
    """Print, for both rigs, the distances of each camera's people from their positions by the other cameras."""
    rows = [
        [name, str(one.sightings), number(one.first_px, 2), number(one.second_px, 2)] for name, one in found.cameras.items()
    ]
    show_table("median distance of people from where the other cameras put them", ("camera", "people", "A px", "B px"), rows)
    for name, rig in (("A", found.first), ("B", found.second)):
        print(
            f"{name}: median {number(rig.median_px, 2)} px, 90 % within {number(rig.p90_px, 2)} px; on the ground half within "
            f"{_centimetres(rig.ground_50_m)}, 90 % within {_centimetres(rig.ground_90_m)}"
        )
    sigma = "sigma unknown: the recording is too short" if found.sigma_px is None else f"sigma {number(found.sigma_px, 2)} px"
    print(f"B less A: {number(found.difference_px, 2)} px ({sigma}; {found.stretches} stretches of 10 s)")
    words = {"first": "A places these people better", "second": "B places these people better"}
    print(words.get(found.better, "no difference beyond 2 sigma"))


def _sigmas_in_words(stated: Stated) -> str:
    """Describe how many errors are within the sigmas that the rig states."""

    def within(errors: Mapping[str, float]) -> str:
        return " and ".join(f"{sum(e <= n for e in errors.values())} of {len(errors)} within {n}" for n in (1, 2))

    return (
        f"errors in stated sigmas, rig aligned on the ground plane: positions {within(stated.position_sigmas)}, orientations "
        f"{within(stated.orientation_sigmas)}"
    )


def show_check(report: SceneCheck) -> None:
    """Print the content of a scene by camera, the notes, and the expected duration; the caller prints the faults."""
    if report.cameras:
        given, filmed = report.mode == "given", any(camera.video for camera in report.cameras)
        last = ("people", "people shared with") if given else ("tracklets", "embeddings", "fps")
        video = ("video", "length") if filmed else ()
        columns = ("camera", "size", *video, "span", "frames", "boxes", "keypoints", *last, "faults")
        show_table(report.name, columns, [_check_row(camera, given, filmed) for camera in report.cameras])
    if report.perception:
        told = (_describe_plan(FOUND_IN_VIDEOS[role], choice) for role, choice in report.perception.items())
        print("from the videos: " + ", ".join(told))
    _show_intrinsics(report.cameras)
    for finding in report.findings:
        print(f"note: {finding}")
    if report.time_s is not None:
        print(f"a calibration takes about {_describe_range(*report.time_s)} on this computer")
    if report.exit_status == 0:
        print("no problems found")


def _describe_range(least_s: float, most_s: float) -> str:
    """Write a range of time, as `20 to 50 s`; in minutes if it ends at two minutes or more."""
    unit, size = ("min", 60.0) if most_s >= 120.0 else ("s", 1.0)
    ends = [f"{end / size:.1g}" if end < size else f"{end / size:.0f}" for end in (least_s, most_s)]
    return f"{ends[0]} to {ends[1]} {unit}"


LENS_SOURCES = {
    "file": "intrinsics file",
    "hfov_deg": "hfov_deg",
    "focal_mm": "focal_mm",
    "focal_35mm": "focal_35mm",
    "metadata": "video metadata",
    "lens_network": "lens_network",
    "people": "nothing: estimated from people",
}
"""Sources of a lens, in words."""
MOST_FILES = 3
"""Most files of intrinsics that are named on one line."""


def _show_intrinsics(cameras: Sequence[CameraCheck]) -> None:
    """Print the known values of each lens and their source; only the files if all lenses are from files and used as stated."""
    known = [(camera, camera.lens, camera.lens_source) for camera in cameras]
    if all(lens is None or (not lens.uncalibrated and lens.focal_sd is None) for _, lens, _ in known):
        places = list(dict.fromkeys(source.place for _, _, source in known if source is not None))
        if places:
            print("intrinsics: " + ", ".join(places[:MOST_FILES]) + (", ..." if len(places) > MOST_FILES else ""))
        return
    rows = []
    for camera, lens, source in known:
        if lens is None or source is None:
            rows.append([camera.name, MISSING, MISSING, MISSING, MISSING, MISSING])
            continue
        unknown = source.source == "people"
        rows.append(
            [
                camera.name,
                LENS_SOURCES[source.source] + (f", as {source.same_as}" if source.same_as else ""),
                "fisheye" if lens.fisheye else "pinhole",
                MISSING if unknown else number(lens.focal, 0, " px"),
                MISSING if unknown or lens.focal_sd is None else number(100 * lens.focal_sd, 0, " %"),
                "estimated" if lens.uncalibrated else "as stated",
            ]
        )
    show_table("Intrinsics", ("camera", "known from", "model", "focal length", "sigma", "use"), rows)


FOUND_IN_VIDEOS = {"detector": "people", "embedder": "appearance", "keypoints": "keypoints"}


def _describe_plan(found: str, choice: Mapping[str, Any] | str) -> str:
    """Describe what is detected in videos, and the network or method."""
    if choice == "none":
        return f"no {found}"
    return f"{found} by {choice if isinstance(choice, str) else choice['network']}"


def _check_row(camera: CameraCheck, given: bool, filmed: bool) -> list[str]:
    """Return one row of `show_check`; shared people are shown only if identities hold across cameras."""
    tracklets = str(camera.identities) if camera.identities or not camera.frames else "detections"
    # The video has not been processed yet: that does not mean that no person is in it.
    span, *counts = [MISSING] * 4 if camera.awaiting else _count_observations(camera)
    if given:
        last = [str(camera.identities), " ".join(f"{name}:{shared.people}" for name, shared in camera.shared.items())]
    else:
        tracklets = "video" if camera.awaiting else tracklets
        last = [tracklets, str(camera.embedding_dimensions or MISSING), MISSING if camera.fps is None else f"{camera.fps:g}"]
    return [
        camera.name,
        MISSING if camera.size is None else f"{camera.size[0]}x{camera.size[1]}",
        *(_describe_video(camera) if filmed else ()),
        span,
        *counts,
        *last,
        str(len(camera.faults)) if camera.faults else "ok",
    ]


def _count_observations(camera: CameraCheck) -> tuple[str, ...]:
    """Return the texts of the span of frames, and of the numbers of frames, boxes and joints."""
    span = MISSING if camera.first_frame is None else f"{camera.first_frame}..{camera.last_frame}"
    return span, str(camera.frames), str(camera.boxes), str(camera.keypoints)


def _describe_video(camera: CameraCheck) -> tuple[str, str]:
    """Return the texts of a video's format and of its length."""
    video = camera.video
    if video is None:
        return MISSING, MISSING
    rate = f"about {video.average_fps:.3g}" if video.variable else f"{video.average_fps:.4g}"
    files = f", {len(video.pieces)} files" if video.pieces else ""
    return f"{video.codec} {video.size[0]}x{video.size[1]} {rate} fps{files}", number(video.seconds, 1, " s")
