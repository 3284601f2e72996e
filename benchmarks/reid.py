"""Networks that tell people apart: trained on real crops, on rendered people, and adapted to a scene without labels."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from accuracy import NOT_HERE, WORKERS
from command import Calibrated
from datasets import models_folder
from pages.kept import code_digest
from pages.parts import time_part
from pages.records import Found, publish
from pages.tables import Table, errors, number, table, yes
from paper.goals import PRESETS
from perception import in_rig
from reid_runs import (
    HALVES,
    RETAIL,
    STRIPES,
    Half,
    Team,
    Trained,
    adapted,
    crowd,
    evaluate,
    real_crops,
    speed,
    train,
    untrained,
)

Scores = Mapping[str, Mapping[str, float]]  # plain and centred -> `rank_1` and so on

RANK_1_GOAL, MINUTES_GOAL, CROP_MS_GOAL = 0.80, 20.0, 5.0
BEFORE, AFTER = "start", "adapted"


def percent(share: float | None, digits: int = 1) -> str:
    """A share in per cent, or a dash."""
    return "-" if share is None else number(100 * share, digits)


TRAINED_HEAD = ("network", "people", "pictures", "epochs", "wall time", "pictures a second", "loss at the end")


def trained_row(label: str, run: Trained) -> list[str]:
    """What a training took."""
    return [
        label, str(run.people), str(run.pictures), str(run.epochs), f"{run.seconds:.0f} s", number(run.per_second, 0),
        number(run.loss, 3),
    ]  # fmt: skip


RETRIEVAL_HEAD = ("embedder", "rank-1, %", "rank-5, %", "mAP, %", "camera-centred: rank-1, %", "mAP, %")


def retrieval_row(label: str, scores: Scores) -> list[str]:
    """One embedder on one set."""
    plain, centred = scores["plain"], scores["centred"]
    shares = plain["rank_1"], plain["rank_5"], plain["map"], centred["rank_1"], centred["map"]
    return [label, *map(percent, shares)]


def crops_tables(trained: Trained, scores: Mapping[str, Scores], speed: Mapping[str, float]) -> dict[str, Table]:
    """Real crops: retrieval, the training, the export; the last of the scores is the trained network's."""
    rank_1 = scores[list(scores)[-1]]["plain"]["rank_1"]
    real = trained.exported["real"]
    goals = [
        ["rank-1 within 20 minutes on 2 cores", f"{percent(rank_1)} % in {trained.seconds / 60:.1f} min",
         f"{100 * RANK_1_GOAL:.0f} %", yes(rank_1 >= RANK_1_GOAL and trained.seconds <= 60 * MINUTES_GOAL)],
        ["ONNX file: a crop on one core", f"{speed['network_ms']:.2f} ms", f"{CROP_MS_GOAL:g} ms",
         yes(speed["network_ms"] <= CROP_MS_GOAL)],
        ["with cutting and normalising", f"{speed['embedder_ms']:.2f} ms", "", ""],
        [f"ONNX file: ranking of {real['pictures']} crops as PyTorch's",
         f"{'same' if real['same_ranking'] else 'differs'}; largest difference {real['largest_difference']:.1e}", "same",
         yes(real["same_ranking"])],
    ]  # fmt: skip
    return {
        "Retrieval": table(RETRIEVAL_HEAD, [retrieval_row(label, found) for label, found in scores.items()]),
        "Training": table(TRAINED_HEAD, [trained_row("small", trained)]),
        "Checks": table(("what", "measured", "goal", "reached"), goals),
    }


def crowd_tables(scores: Mapping[str, Mapping[str, Scores]]) -> dict[str, Table]:
    """Embedder -> test set -> scores: rank-1 and mAP, plain and camera-centred."""
    sets = list(next(iter(scores.values())))
    tables = {}
    for kind, told in (("plain", "As they are"), ("centred", "Camera-centred")):
        rows = [
            [label, *(f"{percent(found[one][kind]['rank_1'])} ({percent(found[one][kind]['map'])})" for one in sets)]
            for label, found in scores.items()
        ]
        tables[told] = table(("embedder", *sets), rows)
    return tables


LOOKS_HEAD = (
    "recording", "network", "rank-1, %", "camera-centred, %", "looks alone: precision, %", "camera pairs in which they tell",
    "mode appearance", "registered", "precision, %", "recall, %", "position, orientation",
)  # fmt: skip
COMBINED_HEAD = ("recording", "network", "mode combined", "registered", "precision, %", "recall, %", "position, orientation")


def team_tables(teams: Sequence[Team]) -> dict[str, Table]:
    """The means first, then seed by seed."""
    looks_rows, combined_rows, label_rows = [], [], []
    for team in teams:
        for part in HALVES:
            for network, halves in ((BEFORE, team.before), (AFTER, team.after)):
                label = [f"{part} half, seed {team.seed}", network]
                half = halves[part]
                looks_rows.append([*label, *_looks_cells(half), *_mode_cells(half, "appearance")])
                combined_rows.append([*label, *_mode_cells(half, "combined")])
        tuned = team.tuned
        label_rows.append([str(team.seed), *(_plain(tuned.labels.get(key)) for key in LABEL_KEYS), f"{tuned.seconds:.0f} s"])
    return {
        "Means": table(MEAN_HEAD, mean_rows(teams)), "Mode appearance": table(LOOKS_HEAD, looks_rows),
        "Mode combined": table(COMBINED_HEAD, combined_rows), "Labels": table(("seed", *LABEL_KEYS, "wall time"), label_rows),
    }  # fmt: skip


LABEL_KEYS = ("people", "crops")

MEAN_HEAD = ("means over the seeds", BEFORE, AFTER, "seeds in which it rises")


def mean_rows(teams: Sequence[Team]) -> list[list[str]]:
    """Before against after, half by half. What was refused has found no pair: it counts as no precision, and as recall 0."""
    rows = []
    for part in HALVES:
        for told, of in _MEASURES.items():
            pairs = [(of(team.before[part]), of(team.after[part])) for team in teams]
            rise = sum(after is not None and (before is None or after > before) for before, after in pairs)
            cells = [_mean([pair[k] for pair in pairs]) for k in (0, 1)]
            rows.append([f"{part} half: {told}", *cells, f"{rise} of {len(teams)}"])
    return rows


def _mean(shares: Sequence[float | None]) -> str:
    """Of those that are defined, with their number where some are not."""
    known = [share for share in shares if share is not None]
    if not known:
        return "none found"
    return f"{percent(float(np.mean(known)))} %" + (f" (in {len(known)})" if len(known) < len(shares) else "")


_MEASURES: dict[str, Callable[[Half], float | None]] = {
    "rank-1 on true crops": lambda half: half.retrieval["plain"]["rank_1"],
    "precision of the looks alone": lambda half: half.appearance.precision if half.appearance else None,
    "precision in mode appearance": lambda half: half.agreement["appearance"].precision,
    "recall in mode appearance": lambda half: half.agreement["appearance"].recall,
    "precision in mode combined": lambda half: half.agreement["combined"].precision,
    "recall in mode combined": lambda half: half.agreement["combined"].recall,
}


def _looks_cells(half: Half) -> list[str]:
    """Retrieval, and the Hungarian algorithm on tracklets' looks."""
    ranks = [percent(half.retrieval[kind]["rank_1"]) for kind in ("plain", "centred")]
    appearance = half.appearance
    return [
        *ranks,
        *(
            ("-", "-")
            if appearance is None
            else (percent(appearance.precision), f"{appearance.useful_pairs} of {appearance.pairs}")
        ),
    ]


def _mode_cells(half: Half, mode: str) -> list[str]:
    """Verdict, cameras, identities and errors."""
    run, found = half.calibrated[mode], half.agreement[mode]
    return [run.verdict, in_rig(run), percent(found.precision), percent(found.recall), _errors(run)]


def _errors(run: Calibrated) -> str:
    similarity = (run.errors or {}).get("similarity") or {}
    return errors(similarity.get("mean_position_mm"), similarity.get("mean_orientation_deg"))


def _plain(value: object) -> str:
    """A number, without digits that say nothing."""
    if isinstance(value, float):
        return number(value, 3) if math.isfinite(value) else "-"
    return "-" if value is None else str(value)


NO_TORCH = "not run: the extra `passerby[reid]` is not installed"
CLOTHES = ("individual", "alike")
TRAINING = [(preset, seed) for seed in (100, 101) for preset in ("terrace", "construction")]
TESTED = [(preset, 300) for preset in PRESETS]
CROWD_EPOCHS = 8  # what three minutes on a core allow; not chosen by any result on the people who are tested


@dataclass
class Place:
    """Where the parts work, and what one leaves for the next."""

    scratch: Path
    scenes: Path
    seeds: range
    quick: bool
    start: Trained | None = None  # the network trained on individual clothes


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
