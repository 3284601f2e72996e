"""Networks that tell people apart: trained on real crops, on rendered people, and adapted to a scene without labels."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from accuracy import NOT_HERE
from datasets import models_folder
from pages.kept import code_digest
from pages.parts import time_part
from pages.records import Found, publish
from pages.tables import table
from reid_runs import RETAIL, STRIPES, Team, Trained, adapted, evaluate, real_crops, speed, train, untrained
from reid_scenes import crowd
from reid_tables import TRAINED_HEAD, crops_tables, crowd_tables, team_tables, trained_row
from simulations import PRESETS, WORKERS

NO_TORCH = "not run: the extra `passerby[reid]` is not installed"
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
    scratch: Path, scenes: Path | None, seeds: int, parts: Sequence[str], out: Path | None, command: str, *,
    quick: bool = False, written: bool = True,
) -> None:  # fmt: skip
    """Run the parts that are named, or all; a quick run trains for an epoch or two, to see that all of it works."""
    place = Place(scratch, scenes or scratch / "scenes", range(1 if quick else seeds), quick)
    for name in [name for name in PARTS if not parts or name in parts]:
        found = time_part(PARTS[name](place)) if find_spec("torch") else [Found(notes=[NO_TORCH])]
        publish("reid", name, found, out, command, code=code_digest(), quick=quick, written=written)


def _crops(place: Place) -> Iterator[Found]:
    """Alone on the machine, as it is timed."""
    data = real_crops()
    if data is None:
        yield Found(notes=[NOT_HERE])
        return
    trained = train([data], place.scratch / "crops", {"epochs": 2} if place.quick else {})
    start = untrained(data, place.scratch / "untrained")
    embedders = _given() | {"small, untrained": start.network, "small, trained": trained.network}
    scores = {label: _only(evaluate(name, [data], place.scratch / "cache")) for label, name in embedders.items()}
    yield Found(crops_tables(trained, scores, speed(trained.network, data)))


def _crowds(place: Place) -> Iterator[Found]:
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
    yield Found({**crowd_tables(scores), "Training": table(TRAINED_HEAD, rows)}, [note])


def _teams(place: Place) -> Iterator[Found]:
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
            yield Found(team_tables(done))


PARTS: dict[str, Callable[[Place], Iterator[Found]]] = {"crops": _crops, "crowds": _crowds, "teams": _teams}
"""In this order: what is timed by itself first; the last begins with what the second has trained."""


def _given() -> dict[str, str | Path]:
    """Embedders that nobody has to train."""
    networks: dict[str, str | Path] = {f"`{RETAIL}`": RETAIL} if models_folder() else {}
    return {"stripes, without weights": STRIPES, **networks}


def _only(sets: dict[str, dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """The one data set of an evaluation."""
    (found,) = sets.values()
    return found
