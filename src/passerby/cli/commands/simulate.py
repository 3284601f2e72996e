"""Scenes with known truth: `passerby simulate`, `passerby demo`, and `passerby dataset` for published data sets."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from passerby.common.errors import InputError
from passerby.common.progress import ProgressForm
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M

if TYPE_CHECKING:
    from passerby.datasets.published import Published
    from passerby.datasets.scene_folder import SceneFolder

Number = TypeVar("Number", int, float)
SECONDS, FPS = 60.0, 10.0
"""Length and frame rate of the demo: a minute, as the documentation recommends to users; half the time doubles the error."""


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
        # A site has its own defaults for these options.
        own = {"seconds": seconds, "clock_offsets": clock_offsets}
        chosen_here = {name: value for name, value in own.items() if _is_on_command_line(context, name)}
        options = {name: value for name, value in faults.items() if name not in own} | chosen_here
        _write_site(preset, options, [name for name, present in unfit.items() if present], out)
        return
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.simulation import SimulationOptions, write_scene
    from passerby.simulation import simulate as run_simulation
    from passerby.simulation.rendering import RenderOptions

    chosen = SimulationOptions(
        preset=preset,
        joint_noise_px=joint_noise_px,
        # A video has no identities, so the boxes for comparison have none either.
        unrelated_ids=unrelated_ids or video,
        clock_offsets=_clock_offsets(clock_offsets),
        camera_fps=_numbers(camera_fps, float, "--camera-fps", "frames per second of each camera"),
        groups=_numbers(groups, int, "--groups", "the number of cameras of each group"),
        **{name: value for name, value in faults.items() if value is not None},
    )
    rendering = RenderOptions(clothes=clothes, shadows=shadows, noise=pixel_noise) if video else None
    processes = open_local_processes(0, chosen.n_cameras, chosen.n_cameras if video else 0)
    with stages() as tell, processes as executor:
        tell("simulating")
        path = write_scene(run_simulation(chosen), out, keypoints=keypoints, video=rendering, executor=executor, tell=tell)
    print(f"written to {out}: passerby calibrate {path} -o {out}-rig")


def _is_on_command_line(context: typer.Context, name: str) -> bool:
    """Check whether the user gave an option on the command line."""
    # The source is compared by name, because some releases of typer contain their own copy of click.
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def _write_site(preset: str, options: Mapping[str, Any], unfit: Sequence[str], out: Path) -> None:
    """Write a site instead of a scene; `unfit` are given options that a site does not have."""
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
    """Read numbers separated by commas; none from an empty text."""
    try:
        return tuple(kind(part) for part in text.split(",")) if text else ()
    except ValueError:
        raise InputError(f"{option} {text!r}: give {wanted}, separated by commas") from None


def demo(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Keep the scene and its calibration in this folder.")] = None,
    detector: Annotated[
        str, typer.Option(help="Detector of people: background, auto, a model's name or a path.")
    ] = "background",
    embedder: Annotated[str, typer.Option(help="Appearance embedding: stripes, none, auto, a name or a path.")] = "stripes",
    keypoints: Annotated[str, typer.Option(help="Keypoints of people: none, auto, a model's name or a path.")] = "none",
    intrinsics: Annotated[bool, typer.Option(help="Use the intrinsics; without them they are estimated too.")] = True,
    progress: Annotated[
        ProgressForm,
        typer.Option("--progress", help="How progress is written on standard error; json: a JSON object a line."),
    ] = ProgressForm.auto,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more: wall times and figures of the stages.")] = False,
) -> None:
    """Film a simulated terrace with four cameras, calibrate them from the videos, and print the errors.

    Needs no internet connection and no model files unless you ask for them.
    """
    import tempfile

    from passerby.calibration.calibrate import calibrate
    from passerby.calibration.writing import write_results
    from passerby.cli.tables import show_calibration, show_comparison, tell_reasons
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.evaluation.metrics import compare
    from passerby.interchange.rig_toml import read_rig
    from passerby.interchange.storage.transaction import folder_lock
    from passerby.scene.scene import Scene
    from passerby.scene.tables import PerceptionTable
    from passerby.simulation import SimulationOptions, simulate, write_scene
    from passerby.simulation.rendering import RenderOptions

    options = SimulationOptions(preset="terrace", seconds=SECONDS, fps=FPS, unrelated_ids=True)
    with tempfile.TemporaryDirectory(prefix="passerby-demo-") as temporary, stages(form=progress) as tell:
        folder = out or Path(temporary)
        processes = open_local_processes(0, options.n_cameras, options.n_cameras)
        with folder_lock(folder / "out", "passerby demo"), processes as executor:
            tell("simulating")
            path = write_scene(simulate(options), folder / "scene", video=RenderOptions(), executor=executor, tell=tell)
            scene = Scene.load(path).with_perception(PerceptionTable(detector=detector, embedder=embedder, keypoints=keypoints))
            scene = scene if intrinsics else scene.without_intrinsics()
            calibration = calibrate(scene, progress=tell, executor=executor, keep=folder / "out")
            write_results(calibration, folder / "out", report=out is not None, progress=tell)
        comparison = compare(read_rig(folder / "out" / "rig.toml"), read_rig(path.parent / "truth.toml"))
    print(
        f"A simulated terrace of 7 x 11 m, filmed by {options.n_cameras} cameras for {options.seconds:g} s: people walk "
        f"about and are detected by {calibration.perception['detector']}.\n"
    )
    show_calibration(calibration, verbose or bool(context.obj))
    print()
    show_comparison(comparison)
    if out is not None:
        print(f"\nwritten to {out}: the videos and scene.toml in scene/, the rig and the tracks in out/")
        print(f"report: {out / 'out' / 'report.html'}")
    tell_reasons(calibration)
    raise typer.Exit(calibration.exit_status)


def dataset(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="The data set; without it, list those that can be read.")
    ] = None,
    folder: Annotated[Path | None, typer.Argument(metavar="[FOLDER]", help="Folder of its files, as published.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Scene folder to write; an earlier one of this kind is replaced.")
    ] = None,
    videos: Annotated[
        bool, typer.Option("--videos", help="Make videos from the images of the set, to detect people in them.")
    ] = False,
    listing: Annotated[bool, typer.Option("--list", help="List the data sets that can be read, and exit.")] = False,
) -> None:
    """Turn a published data set into a scene folder with its truth.

    The scene has mode "given" (known identities) if the set identifies people across at least two cameras; otherwise people
    are detected in its videos or images.
    """
    from passerby.cli.terminal import stages
    from passerby.common.parallel import open_local_processes
    from passerby.datasets import read_published
    from passerby.datasets.scene_folder import write_scene_folder

    if listing or name is None:
        _list()
        return
    if folder is None or out is None:
        missing = "the folder of its files" if folder is None else "the scene folder to write, -o scene"
        raise InputError(f"passerby dataset {name}: give {missing}: passerby dataset {name} FOLDER -o scene")
    with stages() as tell:
        tell("reading")
        published = read_published(name, folder)
        with open_local_processes(0, len(published.rig), len(published.pictures)) as executor:
            written = write_scene_folder(published, out, folder, film=videos, executor=executor, tell=tell)
    _show(published, written, out)


def _list() -> None:
    """Print the names of the data sets, what they contain and where they are published."""
    from passerby.datasets import READERS

    width = max(map(len, READERS))
    for name, reader in READERS.items():
        print(f"{name.ljust(width)}  {reader.what}")
        print(f"{' ' * width}  {reader.where}")
    print("\nDownload the files from there, under the terms of each set: passerby dataset NAME FOLDER -o scene")


def _show(published: Published, written: SceneFolder, out: Path) -> None:
    """Print the content of a data set, notes on missing parts, and the next commands."""
    from passerby.cli.terminal import MISSING, show_table

    def count(value: int) -> str:
        return str(value) if value else MISSING

    rows = []
    for camera in published.rig:
        boxes, joints = published.boxes.get(camera.name), published.keypoints.get(camera.name)
        width, height = camera.lens.size
        rows.append(
            [
                camera.name,
                f"{width} x {height}",
                count(0 if boxes is None else len(boxes)),
                count(0 if joints is None else len(joints)),
                count(len(published.pictures.get(camera.name, ()))),
                published.videos[camera.name].name if camera.name in published.videos else MISSING,
                MISSING if camera.pose is None else "known",
            ]
        )
    title = f"{published.name}: {len(rows)} cameras" + (f", {published.people} people" if published.people else "")
    show_table(title, ("camera", "size", "boxes", "keypoints", "images", "video", "pose"), rows)
    frames = [boxes.frame for boxes in published.boxes.values() if len(boxes)]
    frames += [joints.frame for joints in published.keypoints.values() if len(joints)]
    if frames:
        rate = "" if published.fps is None else f", {published.fps:g} per second"
        print(f"annotated frames {min(f.min() for f in frames)} to {max(f.max() for f in frames)}{rate}")
    if published.ground is not None:
        print(f"{len(published.ground)} positions on the ground")
    for note in written.notes:
        print(f"note: {note}")
    scene, rig = shlex.quote(str(written.scene)), shlex.quote(f"{out}-rig")
    print(f"written to {out}, identities: {written.mode}")
    print("\nNext:")
    print(f"  passerby check {scene}")
    print(f"  passerby calibrate {scene} -o {rig}")
    if written.truth is not None:
        print(f"  passerby evaluate {rig}/rig.toml {shlex.quote(str(written.truth))}")
    if written.videos is not None:
        print(f"from the videos alone: passerby calibrate {shlex.quote(str(written.videos))} -o {rig}")
