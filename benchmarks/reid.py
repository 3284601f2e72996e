"""Networks that tell people apart: trained on real crops, on rendered people, and adapted to a scene without labels."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

from accuracy import NOT_HERE
from datasets import models_folder
from pages.kept import code_digest
from pages.page import Page, table
from pages.sections import NOT_RUN, Heading, Section, SectionedPage
from reid_runs import RETAIL, STRIPES, Team, Trained, adapted, evaluate, real_crops, speed, train, untrained
from reid_scenes import CROWD, CROWD_FPS, CROWD_SECONDS, HALF_SECONDS, TEAM, TEAM_FPS, crowd
from reid_tables import TRAINED_HEAD, crops_tables, crowd_tables, team_tables, trained_row
from simulations import PRESETS, WORKERS

NO_TORCH = f"{NOT_RUN}: the extra `passerby[reid]` is not installed"
CLOTHES = ("individual", "alike")
TRAINING = [(preset, seed) for seed in (100, 101) for preset in ("terrace", "construction")]
TESTED = [(preset, 300) for preset in PRESETS]
CROWD_EPOCHS = 8
"""What three minutes on a core allow; not chosen by any result on the people who are tested."""


@dataclass
class Place:
    """Where the parts work, and what one leaves for the next."""

    scratch: Path
    scenes: Path
    seeds: range
    quick: bool
    start: Trained | None = None
    """The network trained on individual clothes."""


def run(
    scratch: Path,
    quick: bool,
    scenes: Path | None = None,
    seeds: int = 3,
    only: Sequence[str] = (),
    earlier: Mapping[str, Section] = MappingProxyType({}),
) -> Iterator[Page]:
    """The page again and again as it grows; a quick run trains for an epoch or two, to see that all of it works.

    Of `only` some parts the others stay as they were `earlier`.
    """
    place = Place(scratch, scenes or scratch / "scenes", range(1 if quick else seeds), quick)
    page = SectionedPage("reid", _HEAD, _HEADINGS, code_digest())
    parts = {name: partial(part, place) if find_spec("torch") else _no_torch for name, part in PARTS.items()}
    yield from page.grow({name: part for name, part in parts.items() if not only or name in only}, earlier)


def _no_torch() -> Iterator[str]:
    yield NO_TORCH


def _crops(place: Place) -> Iterator[str]:
    """Alone on the machine, as it is timed."""
    data = real_crops()
    if data is None:
        yield NOT_HERE
        return
    trained = train([data], place.scratch / "crops", {"epochs": 2} if place.quick else {})
    start = untrained(data, place.scratch / "untrained")
    embedders = _given() | {"small, untrained": start.network, "small, trained": trained.network}
    scores = {label: _only(evaluate(name, [data], place.scratch / "cache")) for label, name in embedders.items()}
    yield crops_tables(trained, scores, speed(trained.network, data))


def _crowds(place: Place) -> Iterator[str]:
    """The second network begins with the first: small differences are learnt faster where people are known already."""
    began = time.perf_counter()
    jobs = [(kind, *one) for kind in CLOTHES for one in (*TRAINING, *TESTED)]
    with ThreadPoolExecutor(WORKERS) as pool:
        folders = dict(zip(jobs, pool.map(lambda job: crowd(place.scenes, job[1], job[2], job[0]), jobs), strict=True))
    rendering = time.perf_counter() - began
    epochs = 1 if place.quick else CROWD_EPOCHS
    trained: dict[str, Trained] = {}
    for kind in CLOTHES:
        begin = {"weights": str(trained["individual"].folder)} if trained else {}
        data, options = [folders[kind, *one] for one in TRAINING], {"epochs": epochs, "warm_up_epochs": 0.1 * epochs}
        trained[kind] = train(data, place.scratch / f"crowd-{kind}", options | begin)
    place.start = trained["individual"]
    embedders = _given() | {
        "small, learnt on individual clothes": trained["individual"].network,
        "the same, then on alike clothes": trained["alike"].network,
    }
    tested = {f"{kind}, {one[0]}": folders[kind, *one] for kind in CLOTHES for one in TESTED}
    cache = place.scenes / "crops"
    scores = {}
    for label, name in embedders.items():
        scores[label] = dict(zip(tested, evaluate(name, list(tested.values()), cache).values(), strict=True))
    rows = [trained_row(f"small, {kind} clothes", run) for kind, run in trained.items()]
    note = f"Rendering, where nothing was kept from before: {rendering:.0f} s."
    yield "\n\n".join([crowd_tables(scores), table(TRAINED_HEAD, rows), note])


def _teams(place: Place) -> Iterator[str]:
    """Two seeds side by side; the table as far as it is."""
    start = place.start
    if start is None:
        raise SystemExit("reid: the part teams begins with the network that the part crowds trains: name both")
    done: list[Team] = []
    with ThreadPoolExecutor(WORKERS) as pool:
        epochs = 2 if place.quick else None
        for team in pool.map(
            lambda seed: adapted(place.scenes, seed, start, place.scratch / f"team-{seed}", epochs), place.seeds
        ):
            done.append(team)
            print(f"team {team.seed}: labels {dict(team.tuned.labels)}", file=sys.stderr, flush=True)
            yield team_tables(done)


PARTS: dict[str, Callable[[Place], Iterator[str]]] = {"crops": _crops, "crowds": _crowds, "teams": _teams}
"""In this order: what is timed by itself first; the last begins with what the second has trained."""


def _given() -> dict[str, str | Path]:
    """Embedders that nobody has to train."""
    networks: dict[str, str | Path] = {f"`{RETAIL}`": RETAIL} if models_folder() else {}
    return {"stripes, without weights": STRIPES, **networks}


def _only(sets: dict[str, dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """The one data set of an evaluation."""
    (found,) = sets.values()
    return found


_HEAD = """# Networks that tell people apart

All by the commands `passerby reid train`, `evaluate`, `export` and `finetune`, on the processor, recipe *small* from random
weights: 1.2 million weights, crops of 64 × 128 pixels. Rank-1: how often the most similar picture is the same person's, the
same person's by the same camera left out (Market-1501's protocol); *camera-centred*: each camera's mean taken off first, as
association does. Wall times are of this machine and this run. ResNet-50 was not trained here: there was no graphics card."""

_HEADINGS = {
    "crops": Heading(
        "Real crops",
        """\
`reid_crops`, 62 people by two cameras; learnt from its `train`, searched in its `val` (12 other people). Nothing was chosen by
the result: the recipe is as it stands. *untrained*: random weights, its normalisation fitted to the pictures.""",
    ),
    "crowds": Heading(
        "Rendered people",
        f"""\
Crowds of {CROWD} people before four cameras, {CROWD_SECONDS:g} s at {CROWD_FPS:g} picture a second, crops by the true boxes.
Learnt from: seeds {", ".join(map(str, sorted({seed for _, seed in TRAINING})))} of terrace and construction. Searched: other
people, seed {TESTED[0][1]}; the basketball court, where people are half as tall in the pictures, was never learnt from. Every
picture searches the other cameras' of its scene. *individual*: everybody in clothes of their own; *alike*: all in the same vest
and trousers, so that height, hair, skin and shoes are left. Rank-1 by chance: {100 / CROWD:.0f} %.""",
    ),
    "teams": Heading(
        "All in the same vest",
        f"""\
{TEAM} people in one vest on the terrace, four cameras, two halves of {HALF_SECONDS:g} s at {TEAM_FPS:g} pictures a second. They
are found by background subtraction. *start*: the network trained on individual clothes, above; *adapted*: the same after
`passerby reid finetune` on the calibration of the **first** half (mode combined), without any label. The **second** half was
never learnt from; it is calibrated by itself with either network. Precision and recall: pairs of boxes of one instant in two
cameras that got one identity, against the true ones (boxes that overlap by half). *looks alone*: the paper's Hungarian
matching of the tracklets at every instant, before anything is verified, and in how many pairs of cameras the association finds
that looks tell more than chance. What is refused has found nobody.""",
    ),
}
