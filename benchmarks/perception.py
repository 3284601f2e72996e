"""From pixels to a rig: the demonstration, rendered and real videos, with networks and without, and what it takes.

Every part tells its table as far as it is, so that a benchmark that is stopped keeps what is finished.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

from accuracy import NOT_HERE
from command import Calibrated
from datasets import data_set, folder_of, models_folder
from pages.kept import code_digest
from pages.page import Page, load, table
from pages.sections import NOT_RUN, Heading, Section, SectionedPage
from passerby.scene.tables import WATCHED_FPS
from perception_runs import (
    BOXES,
    METHODS,
    NETWORKS,
    PETS_CAMERA,
    Watched,
    run_demo,
    run_pets,
    run_rendered,
    run_room,
    run_single,
    run_with_and_without_joints,
    score_pets_tracklets,
    watch_alone,
)
from perception_scenes import (
    FPS,
    LARGE,
    LARGE_FPS,
    ROOM_FPS,
    ROOM_SECONDS,
    SECONDS,
    large_video,
    rendered,
    rendered_room,
    repeated,
)
from perception_tables import (
    BOX_HEAD,
    GOAL_HEAD,
    IDF1_GOAL,
    JOINT_HEAD,
    LONG_HEAD,
    RATIO_GOAL,
    RATIO_HEAD,
    ROOM_SHARE,
    SEED_HEAD,
    SINGLE_GOAL,
    SIZE_GOAL,
    SIZE_HEAD,
    TRACKLET_HEAD,
    box_rows,
    demo_tables,
    goal_row,
    joint_row,
    long_row,
    pets_rows,
    ratio_row,
    room_rows,
    seed_row,
    size_rows,
    told,
    tracklet_rows,
)
from reliability.room import HEIGHT_M, ROOM_M
from simulations import PRESETS, WORKERS

Result = TypeVar("Result")
Runs = Mapping[str, Watched]
"""Method -> one scene's run."""

NO_MODELS = f"{NOT_RUN}: no model files"
MINUTE_S = 60.0
ROOM_SEEDS = 5
LONG_S = 10 * MINUTE_S


@dataclass(frozen=True)
class Wanted:
    """What is to be run."""

    scenes: Path | None = None
    """Folder in which rendered videos are kept for the next time."""
    seeds: int = 3
    parts: Sequence[str] = ()
    """Names of `PARTS`; all unless given."""
    earlier: Mapping[str, Section] = field(default_factory=dict)
    """Sections of an earlier run, for the parts that are not run."""


@dataclass(frozen=True)
class Place:
    """Where a part works."""

    scratch: Path
    scenes: Path
    seeds: range


def run(scratch: Path, quick: bool, wanted: Wanted | None = None) -> Iterator[Page]:
    """Three seeds of each rendered scene, or one in a quick run; the page again and again as it grows."""
    wanted = wanted or Wanted()
    place = Place(scratch, wanted.scenes or scratch / "scenes", range(1 if quick else wanted.seeds))
    page = SectionedPage("perception", _HEAD, _headings(), code_digest())
    yield from page.grow({name: partial(PARTS[name], place) for name in wanted.parts or PARTS}, wanted.earlier)


def _headings() -> dict[str, Heading]:
    """Of the parts, and what their tables are."""
    return {name: Heading(heading.title, heading.says.format(**_FIGURES)) for name, heading in _HEADINGS.items()}


def _demo(place: Place) -> Iterator[str]:
    before = load()
    demo = run_demo(place.scratch / "demo")
    _tell("demo", told(demo.calibrated))
    yield demo_tables(demo) + f"\n\nLoad of the machine (mean of a minute): {before:.1f} before, {load():.1f} after."


def _rendered(place: Place) -> Iterator[str]:
    """Scene after scene; of each, the methods side by side."""
    done: dict[str, dict[int, Runs]] = {preset: {} for preset in PRESETS}
    for seed in place.seeds:
        for preset in PRESETS:
            folder = rendered(place.scenes, preset, seed)
            into = place.scratch / f"{preset}-{seed}"
            methods = [*_methods(), BOXES]
            jobs = [_rendered_job(folder, method, into / method) for method in methods]
            done[preset][seed] = dict(zip(methods, _side_by_side(jobs), strict=True))
            for method, run in done[preset][seed].items():
                _tell(f"{preset} {seed} {method}", told(run.calibrated))
            yield _rendered_tables(done)


def _rendered_job(folder: Path, method: str, into: Path) -> Callable[[], Watched]:
    return lambda: run_rendered(folder, method, into)


def _rendered_tables(done: Mapping[str, Mapping[int, Runs]]) -> str:
    """Of the scenes so far: against true boxes, seed by seed, and the boxes."""
    ratios, seeds, boxes = [], [], []
    sizes: dict[str, list[Calibrated]] = {}
    for method in METHODS:
        if method not in _methods():
            ratios.append([f"all, {method}", NO_MODELS, *["-"] * (len(RATIO_HEAD) - 2)])
            continue
        for preset, runs in done.items():
            label = f"{preset}, {method}"
            if not runs:
                ratios.append([label, NOT_RUN, *["-"] * (len(RATIO_HEAD) - 2)])
                continue
            found, true = ([run[which].calibrated for run in runs.values()] for which in (method, BOXES))
            ratios.append(ratio_row(label, true, found))
            for whose in (f"all, {method}", "all"):
                sizes.setdefault(whose, []).extend(found)
            for seed, before, after in zip(runs, true, found, strict=True):
                seeds.append(seed_row(f"{preset} {seed}, {method}", before, after))
            boxes += box_rows(label, [run[method] for run in runs.values()])
    told = [table(RATIO_HEAD, ratios), _SIZES.format(*SIZE_GOAL), table(SIZE_HEAD, size_rows(sizes))]
    return "\n\n".join([*told, _SEEDS, table(SEED_HEAD, seeds), _BOXES, table(BOX_HEAD, boxes)])


def _pets(place: Place) -> Iterator[str]:
    """The calibrations, then the tracklets from what they kept."""
    folder = folder_of(data_set("pets2009"))
    if folder is None or models_folder() is None or not (folder / f"{PETS_CAMERA}.avi").is_file():
        yield NOT_HERE if folder is None else NO_MODELS
        return
    into = {method: place.scratch / f"pets-{method}" for method in ("networks", BOXES, "weight-free")}
    networks, boxes, weight_free = _side_by_side([_pets_job(folder, method, path) for method, path in into.items()])
    for method, run in zip(into, (networks, boxes, weight_free), strict=True):
        _tell(f"pets2009 {method}", told(run))
    first = table(GOAL_HEAD, pets_rows(networks, boxes, weight_free))
    yield first
    rows = tracklet_rows(score_pets_tracklets(folder, into["networks"]))
    yield "\n\n".join([first, _TRACKLETS.format(*IDF1_GOAL, camera=PETS_CAMERA), table(TRACKLET_HEAD, rows)])


def _pets_job(folder: Path, method: str, into: Path) -> Callable[[], Calibrated]:
    return lambda: run_pets(folder, method, into)


def _single(place: Place) -> Iterator[str]:
    folder = folder_of(data_set("pose2sim_single"))
    if folder is None or models_folder() is None or not (folder / "videos").is_dir():
        yield NOT_HERE if folder is None else NO_MODELS
        return
    run = run_single(folder, place.scratch / "single")
    _tell("pose2sim_single", told(run))
    yield table(GOAL_HEAD, [goal_row("pose2sim_single", run, *SINGLE_GOAL)])


def _joints(place: Place) -> Iterator[str]:
    """One scene of each preset, with keypoints and without."""
    if models_folder() is None:
        yield NO_MODELS
        return
    rows = []
    for preset in PRESETS:
        folder = rendered(place.scenes, preset, place.seeds[0])
        runs = run_with_and_without_joints(folder, place.scratch / f"joints-{preset}")
        rows.append(joint_row(f"{preset} {place.seeds[0]}", runs["without"], runs["with"]))
        for name, (run, seconds) in runs.items():
            _tell(f"{preset} {name} joints", f"{told(run)}, {seconds:.0f} s of watching")
        yield table(JOINT_HEAD, rows)


def _room(place: Place) -> Iterator[str]:
    """Seed after seed, two at a time."""
    seeds = range(len(place.seeds) if len(place.seeds) == 1 else ROOM_SEEDS)
    jobs = [_room_job(rendered_room(place.scenes, seed), place.scratch / f"room-{seed}") for seed in seeds]
    runs = {f"room {seed}": run for seed, run in zip(seeds, _side_by_side(jobs), strict=True)}
    for name, run in runs.items():
        _tell(name, told(run))
    yield table(GOAL_HEAD, room_rows(runs))


def _room_job(folder: Path, into: Path) -> Callable[[], Calibrated]:
    return lambda: run_room(folder, into)


def _long(place: Place) -> Iterator[str]:
    """Both detectors side by side, a core each: nothing else runs."""
    source = large_video(place.scenes)
    videos = [repeated(source, seconds, place.scratch / f"{seconds:g}.mp4") for seconds in (MINUTE_S, LONG_S)]
    jobs = [_long_job(videos, method, place.scratch / method) for method in _methods()]
    done = dict(zip(_methods(), _side_by_side(jobs), strict=True))
    rows = []
    for method, table_of in METHODS.items():
        if method not in done:
            rows.append([table_of["detector"], NO_MODELS, *["-"] * (len(LONG_HEAD) - 2)])
            continue
        short, long = done[method]
        _tell(f"long video, {method}", f"{short} {long}")
        rows.append(long_row(table_of["detector"], short, long))
    yield f"{table(LONG_HEAD, rows)}\n\nLoad of the machine at the end (mean of a minute): {load():.1f}."


def _long_job(videos: Sequence[Path], method: str, into: Path) -> Callable[[], list[dict[str, float]]]:
    return lambda: [watch_alone(video, method, into / video.stem) for video in videos]


PARTS: dict[str, Callable[[Place], Iterator[str]]] = {
    "demo": _demo, "pets2009": _pets, "single": _single, "room": _room, "joints": _joints, "rendered": _rendered,
    "long": _long,
}  # fmt: skip
"""In this order: what is timed by itself, then from the quick to the long."""


def _methods() -> list[str]:
    """What can be run here."""
    return [method for method, table in METHODS.items() if table != NETWORKS or models_folder() is not None]


def _side_by_side(jobs: Sequence[Callable[[], Result]]) -> list[Result]:
    """Two at a time; each runs its programs in processes of their own."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(lambda job: job(), jobs))


def _tell(what: str, found: str) -> None:
    print(f"{what}: {found}", file=sys.stderr, flush=True)


_HEAD = """# From pixels

Videos in, rig out: `passerby calibrate` on videos, identities to be found (mode combined). *networks*: `{detector}`,
`{embedder}` and, for keypoints, the best network at hand; *weight-free*: background subtraction and stripes of colour.
Similarity errors, mean over the registered cameras; a run that lacks a camera has missed its goal.""".format(**NETWORKS)

_FIGURES = {
    "seconds": SECONDS,
    "fps": FPS,
    "acceptable": RATIO_GOAL[0],
    "aim": RATIO_GOAL[1],
    "size": f"{LARGE[0]} × {LARGE[1]}",
    "rate": LARGE_FPS,
    "watched": WATCHED_FPS,
    "room": " × ".join(f"{length:g}" for length in ROOM_M),
    "height": HEIGHT_M,
    "room_seconds": ROOM_SECONDS,
    "room_fps": ROOM_FPS,
    "share": ROOM_SHARE,
}

_HEADINGS = {
    "demo": Heading(
        "The demonstration",
        """\
A terrace rendered and calibrated without weights by `passerby demo`. *calibrating*: its videos once more, by themselves, start
of the program included; *simulating and rendering*: the rest. Processor time is that of all processes.""",
    ),
    "pets2009": Heading(
        "A real video among boxes of others",
        """\
`pets2009`: one camera's people found in its video at 7 frames per second, the boxes of the other six from a detector of other
make. The aim is what the camera's own given boxes reach, within 5 %.""",
    ),
    "single": Heading(
        "One person on the spot",
        """\
`pose2sim_single`: four videos of 1088 × 1920 pixels, 60 frames per second, 100 frames; one person balances on the spot,
bystanders behind. Networks, for keypoints too.""",
    ),
    "room": Heading(
        "A room without weights",
        """\
A floor of {room} m, cameras {height:g} m up in its corners, {room_seconds:g} s at {room_fps:g} frames per second; two people
walk about and one sits. Walls and furniture are not drawn. Weight-free; identities and clocks are to be found. *reached* for
all: as the goal says in {share:.0%} of the seeds or more, the aim in all of them. Seeds 0 to 2 are not held out: a limit of the
search for cameras that no pair registers was chosen on them.""",
    ),
    "joints": Heading(
        "What joints bring and take",
        """\
One rendered scene of each preset, by networks: boxes alone (`keypoints = "none"`), and with the joints of those crops that are
measured by default. *watching*: processor time that a second run saves, which finds the people where the first one kept them.
*scale*: how much too long the rig's lengths are, and the stated sigma.""",
    ),
    "rendered": Heading(
        "Rendered scenes",
        """\
{seconds:g} s at {fps:g} frames per second, all of them looked at. The ratio is to what the true boxes of the same scenes give,
noise-free and without identities, as detections; people who are hidden by more than 60 % have no true box. *acceptable*: all
cameras and at most {acceptable:g} times the error, in every seed; *aim*: besides, the ratios of the means are at most {aim:g}.
A dash: a camera is missing.""",
    ),
    "long": Heading(
        "Ten minutes",
        """\
A construction site of {size} pixels at {rate:g} frames per second, 20 s repeated to a minute and to ten; one camera watched at
{watched:g} pictures per second by the detector alone. Peak memory of the whole program; time by the clock, the
detectors side by side on a core each. *detector's share*: of all the time, the learning of the background included.""",
    ),
}

_SIZES = """Nobody's height is known. How far the rig's lengths are off, positive where they are too long. *acceptable*:
{0[0]:g} % in the median, {0[1]:g} % in the mean with its sign, all within {0[2]:g} stated sigmas; *aim*: {1[0]:g} %,
{1[1]:g} %, {1[2]:g}. The drawn people of a scene are a few: their own mean is off the population's by 1 to 2 %."""

_SEEDS = "Seed by seed."

_BOXES = """The boxes against the true ones (overlap of at least 0.5), all seeds together. *found*: all of the detector's, weak
ones too; *used*: those of people whom the calibration knows. *off*: pairs with an edge off by more than a tenth of the true
height. Edges: median ± scatter (of the median absolute deviation) of found less true, in hundredths of the height, right and
down positive."""

_TRACKLETS = """Tracklets of {camera} from its video, every frame, against its true identities (which are a detector's boxes
tied to annotated positions; some are wrong). IDF1: {0:g} acceptable, {1:g} aim."""
