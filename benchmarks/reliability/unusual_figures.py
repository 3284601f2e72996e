"""What `UNUSUAL_SIGMAS` is held against: groups of adults, and the same with children or with pictures of people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from pages.cases import Outcomes
from pages.records import Found
from pages.tables import table
from passerby.core.figures import adjusted
from passerby.evaluation.metrics import compare
from passerby.simulation import PRESETS
from passerby.solver import cues
from passerby.solver.cues import UNUSUAL_SIGMAS
from reliability.blind_people import together
from reliability.judging import calibrated
from reliability.staging import HandedIn, staged

FIRST_SEED, SECOND_SEED = 947_000, 5_000
"""Of the adults; how much is added for those who are not usual."""
ADULTS = 6
NEVER = 1e6
TRIED = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, NEVER)


@dataclass(frozen=True)
class Others:
    """Who is there besides adults."""

    people: int
    mean_m: float
    sd_m: float


KINDS: Mapping[str, Others | None] = {
    "adults alone": None,
    "one child of 1.2 m": Others(1, 1.2, 0.05),
    "two children of 1.2 m": Others(2, 1.2, 0.05),
    "two children of 0.95 m": Others(2, 0.95, 0.05),
    "a youth of 1.5 m": Others(1, 1.5, 0.05),
    "a life-size figure of 2.3 m": Others(1, 2.3, 0.05),
}


def cases(seeds: int) -> dict[str, tuple[str, str, int]]:
    """Scenes by key: kind, preset and seed, one of each preset for each seed."""
    wanted = [(kind, preset, FIRST_SEED + k) for kind in KINDS for preset in PRESETS for k in range(seeds)]
    return {" ".join(map(str, one)): one for one in wanted}


def measure(case: tuple[str, str, int]) -> dict[str, Any]:
    """By each limit that is tried, the logarithm of the scale and how many adults and others are left out of it."""
    scene = _scene(*case)
    logs, adults, others = [], [], []
    for limit in TRIED:
        with patch.object(cues, "UNUSUAL_SIGMAS", limit):
            found = calibrated(scene)
        people = adjusted(found.figures).people
        out = [] if people is None else [int(who) for who in people.unusual or ()]
        posed = len(found.rig.posed()) > 1
        ratio = compare(found.rig, scene.truth).scale_ratio if posed else None
        logs.append(None if ratio is None else float(np.log(ratio)))
        adults.append(sum(who <= ADULTS for who in out))
        others.append(sum(who > ADULTS for who in out))
    return {"log_scale": logs, "adults": adults, "others": others}


def _scene(kind: str, preset: str, seed: int) -> HandedIn:
    wanted: dict[str, Any] = {"preset": preset, "cameras": 3, "seconds": 25.0}
    adults, others = staged(seed, people=ADULTS, **wanted), KINDS[kind]
    if others is None:
        return adults
    more = staged(
        seed + SECOND_SEED, people=others.people, rig=lambda *_: adults.truth, person_height_mean_m=others.mean_m,
        person_height_sd_m=others.sd_m, **wanted,
    )  # fmt: skip
    return together(adults, more)


def tabulate(outcomes: Outcomes, wanted: Mapping[str, tuple[str, str, int]]) -> Found:
    """A table for each kind of group: what each limit makes of the scale, and whom it leaves out; `outcomes` of `measure`."""
    rows = []
    for kind, others in KINDS.items():
        some = [one for key, one in outcomes.items() if wanted[key][0] == kind]
        for index, limit in enumerate(TRIED):
            logs = np.array([one["log_scale"][index] for one in some if one["log_scale"][index] is not None])
            left = [sum(one[who][index] for one in some) for who in ("adults", "others")]
            of = [ADULTS * len(some), (0 if others is None else others.people) * len(some)]
            name = "none" if limit == NEVER else f"**{limit:g}**" if limit == UNUSUAL_SIGMAS else f"{limit:g}"
            mean, spread = (f"{100 * f(logs):+.1f}" if len(logs) else "-" for f in (np.mean, _rms))
            rows.append([kind, name, str(len(some)), mean, spread, f"{left[0]} of {of[0]}", f"{left[1]} of {of[1]}"])
    head = ("people", "limit", "scenes", "scale, mean %", "root mean square %", "adults left out", "others left out")
    return Found({"UNUSUAL_SIGMAS": table(head, rows)}, run=f"UNUSUAL_SIGMAS = {UNUSUAL_SIGMAS:g}")


def _rms(values: np.typing.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
