"""`passerby simulate`: a scene whose truth is known, as boxes or as videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from passerby.common.errors import InputError
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M

Number = TypeVar("Number", int, float)


def simulate(
    context: typer.Context,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write; an earlier simulation in it is replaced.")],
    preset: Annotated[
        str, typer.Option(help="terrace, basketball or construction; airport: a site of 8 to 1,000 cameras.")
    ] = "terrace",
    seed: Annotated[int, typer.Option(help="The same options and seed give the same scene.")] = 0,
    cameras: Annotated[int | None, typer.Option(help="Number of cameras; default: the preset's.")] = None,
    people: Annotated[int | None, typer.Option(help="Number of people; default: the preset's.")] = None,
    seconds: Annotated[float, typer.Option(help="Length of the recording; of an airport 600 by default.")] = 40.0,
    fps: Annotated[float, typer.Option(help="Time steps per second.")] = 5.0,
    camera_height_m: Annotated[float | None, typer.Option(help="Height of the cameras; default: the preset's.")] = None,
    person_height_mean_m: Annotated[float, typer.Option(help="Mean standing height, shoes on.")] = PERSON_HEIGHT_M,
    person_height_sd_m: Annotated[float, typer.Option(help="Its standard deviation.")] = PERSON_HEIGHT_SD_M,
    occlusion: Annotated[bool, typer.Option(help="People occlude each other.")] = True,
    box_noise: Annotated[float, typer.Option(help="Standard deviation of each edge, as a fraction of the box height.")] = 0.0,
    corner_noise_px: Annotated[float, typer.Option(help="Uniform noise of the corners, plus or minus pixels.")] = 0.0,
    box_slack: Annotated[float, typer.Option(help="Fraction of its height by which a box is larger on each side.")] = 0.0,
    missing: Annotated[float, typer.Option(help="Fraction of the boxes that are dropped.")] = 0.0,
    false_boxes: Annotated[float, typer.Option(help="Boxes without a person, as a fraction of the true ones.")] = 0.0,
    identity_swaps: Annotated[
        float, typer.Option(help="Fraction of the people in each time step who exchange identities.")
    ] = 0.0,
    clock_offsets: Annotated[
        str,
        typer.Option(
            help="Seconds: the largest offset, drawn for each camera, or one offset per camera, separated by commas. Of an "
            "airport the largest offset, 5 by default."
        ),
    ] = "0",
    joint_noise_px: Annotated[float, typer.Option(help="Standard deviation of the keypoints, in pixels.")] = 0.0,
    unrelated_ids: Annotated[
        bool, typer.Option(help="Ids are tracklets of each camera, not identities across cameras.")
    ] = False,
    tracklet_seconds: Annotated[
        float, typer.Option(help="Mean length at which tracklets are cut at random; 0: never. Needs --unrelated-ids.")
    ] = 0.0,
    embeddings: Annotated[
        str, typer.Option(help="Appearance of the boxes: none, distinct (distinguishes people) or alike (does not).")
    ] = "none",
    camera_fps: Annotated[
        str, typer.Option(help="Frames per second of each camera, separated by commas; default: --fps for all.")
    ] = "",
    groups: Annotated[
        str, typer.Option(help="Cameras in groups without common ground: the size of each group, separated by commas, as 6,2.")
    ] = "",
    lenses: Annotated[
        str,
        typer.Option(help="typical; varied (28 to 90 degrees across, up to strong distortion); shared (one such lens)."),
    ] = "typical",
    keypoints: Annotated[bool, typer.Option(help="Also write keypoints (COCO).")] = False,
    video: Annotated[bool, typer.Option(help="Render videos; the scene file names these instead of boxes.")] = False,
    clothes: Annotated[
        str, typer.Option(help="With --video: individual, or alike (vests and trousers of one kind).")
    ] = "individual",
    shadows: Annotated[bool, typer.Option(help="With --video: the sun casts shadows; otherwise the sky is overcast.")] = True,
    pixel_noise: Annotated[
        float, typer.Option(help="With --video: standard deviation of the sensor noise, in grey levels.")
    ] = 2.5,
) -> None:
    """Simulate people in a scene: boxes or videos, true cameras, and a scene file ready to calibrate."""
    from passerby.simulation.sites import SITES

    faults: dict[str, Any] = {
        "seed": seed, "fps": fps, "camera_height_m": camera_height_m, "person_height_mean_m": person_height_mean_m,
        "person_height_sd_m": person_height_sd_m, "occlusion": occlusion, "box_noise": box_noise,
        "corner_noise_px": corner_noise_px, "box_slack": box_slack, "missing": missing, "false_boxes": false_boxes,
        "identity_swaps": identity_swaps, "tracklet_seconds": tracklet_seconds, "embeddings": embeddings, "lenses": lenses,
        "cameras": cameras, "people": people, "seconds": seconds,
    }  # fmt: skip
    if preset in SITES:
        unfit = {
            "--joint-noise-px": joint_noise_px != 0, "--camera-fps": bool(camera_fps), "--groups": bool(groups),
            "--keypoints": keypoints, "--video": video, "--clock-offsets": "," in clock_offsets,
        }  # fmt: skip
        # A site has defaults of its own.
        own = {"seconds": seconds, "clock_offsets": clock_offsets}
        chosen_here = {name: value for name, value in own.items() if _given(context, name)}
        options = {name: value for name, value in faults.items() if name not in own} | chosen_here
        _write_site(preset, options, [name for name, present in unfit.items() if present], out)
        return
    from passerby.cli.terminal import stages
    from passerby.common.parallel import local_processes
    from passerby.simulation import SimulationOptions, write_scene
    from passerby.simulation import simulate as run_simulation
    from passerby.simulation.rendering import RenderOptions

    chosen = SimulationOptions(
        preset=preset,
        joint_noise_px=joint_noise_px,
        # A video has no identities, so neither do the boxes that it is compared with.
        unrelated_ids=unrelated_ids or video,
        clock_offsets=_clock_offsets(clock_offsets),
        camera_fps=_numbers(camera_fps, float, "--camera-fps", "frames per second of each camera"),
        groups=_numbers(groups, int, "--groups", "the number of cameras of each group"),
        **{name: value for name, value in faults.items() if value is not None},
    )
    rendering = RenderOptions(clothes=clothes, shadows=shadows, noise=pixel_noise) if video else None
    processes = local_processes(0, chosen.n_cameras, chosen.n_cameras if video else 0)
    with stages() as tell, processes as executor:
        tell("simulating")
        path = write_scene(run_simulation(chosen), out, keypoints=keypoints, video=rendering, executor=executor, tell=tell)
    print(f"written to {out}: passerby calibrate {path} -o {out}-rig")


def _given(context: typer.Context, name: str) -> bool:
    """Whether an option stands on the command line."""
    # By its name: some releases of typer have a click of their own.
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def _write_site(preset: str, options: Mapping[str, Any], unfit: Sequence[str], out: Path) -> None:
    """A site instead of a scene; `unfit` are options that it has none of."""
    from passerby.cli.terminal import stages
    from passerby.simulation.sites import SiteOptions, simulate_site, write_site

    if unfit:
        raise InputError(
            f"preset {preset!r} is a site of many cameras: boxes only, one frame rate, one largest clock offset. "
            f"Leave out {', '.join(unfit)}" + (", or give --clock-offsets one number" if "--clock-offsets" in unfit else "")
        )
    given = {name: value for name, value in options.items() if value is not None}
    if "clock_offsets" in given:
        given["clock_offsets"] = _clock_offsets(given["clock_offsets"])
    chosen = SiteOptions(preset=preset, **given)
    with stages() as tell:
        tell("simulating")
        path = write_site(simulate_site(chosen), out, tell)
    print(f"written to {out}: passerby calibrate {path} -o {out}-rig")


def _clock_offsets(text: str) -> float | tuple[float, ...]:
    try:
        offsets = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--clock-offsets {text!r}: give seconds, one number, or one for each camera separated by commas"
        ) from None
    return offsets[0] if len(offsets) == 1 else offsets


def _numbers(text: str, kind: type[Number], option: str, wanted: str) -> tuple[Number, ...]:
    """Numbers separated by commas; none where the text is empty."""
    try:
        return tuple(kind(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise InputError(f"{option} {text!r}: give {wanted}, separated by commas") from None
