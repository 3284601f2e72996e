"""What several scenes without intrinsics say together, and what is asked of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from lenses.recorded import DEMO
from pages.tables import reached

MOST_PERCENT = 8.0
"""No rig may be accepted with a focal length that is off by more."""
SHARE = 0.9
"""Of the scenes whose ratio is to be within the goal: 27 of 30."""


@dataclass(frozen=True)
class PartGoal:
    """What is asked of a simulated part: (acceptable, aim)."""

    median: tuple[float, float]
    """Focal error, per cent."""
    ratio: tuple[float, float]
    """Of nine in ten scenes."""
    most: tuple[float, float] | None = None
    """Focal error of 95 % of the cameras, per cent."""


PART_GOALS: Mapping[str, PartGoal] = MappingProxyType(
    {
        "varied": PartGoal((2.5, 1.5), (2.5, 1.5), (8.0, 5.0)),
        "shared": PartGoal((1.0, 0.3), (1.5, 1.1)),
        "keypoints": PartGoal((1.0, 0.5), (1.5, 1.5)),
    }
)
TIME_GOAL = (3.0, 1.5)
"""Processor time with estimated lenses over that with the true ones."""


@dataclass(frozen=True)
class RecordedGoal:
    """What is asked of a real set or the demonstration: (acceptable, aim)."""

    focal_percent: tuple[float, float] | None
    """Median over the cameras."""
    mm: tuple[float, float] | None = None
    deg: tuple[float, float] | None = None
    apart: tuple[str, ...] = ()
    """Cameras that the goal leaves out: their lenses are of no ordinary kind."""
    measures: bool = False
    """Whether `POINTS_MM` and `GROUND_RATIO` are asked, too."""

    def reached(self, focal_percent: float, mm: float | None, deg: float | None) -> str:
        """`aim`, `acceptable` or `missed`."""
        asked = [
            (value, limit)
            for value, limit in ((focal_percent, self.focal_percent), (mm, self.mm), (deg, self.deg))
            if limit is not None
        ]
        return reached([value for value, _ in asked], *([limit[rank] for _, limit in asked] for rank in (0, 1)))

    def in_words(self, rank: int) -> str:
        """Acceptable (0) or aim (1)."""
        focal = [] if self.focal_percent is None else [f"{self.focal_percent[rank]:g} %"]
        rig = [] if self.mm is None or self.deg is None else [f"{self.mm[rank]:g} mm {self.deg[rank]:g}°"]
        return ", ".join(focal + rig)


POINTS_MM, GROUND_RATIO = (25.0, 12.0), (1.25, 1.1)
"""Of a real set: error of points; and error on the ground, over that with the true lenses."""
RECORDED_GOALS: Mapping[str, RecordedGoal] = MappingProxyType(
    {
        "wildtrack": RecordedGoal((2.0, 1.0), (80.0, 30.0), (0.4, 0.15), measures=True),
        # V4's focal length is 6.2 image widths, and V7's stated distortion is none that a lens has.
        "pets2009": RecordedGoal((5.0, 3.0), apart=("V4", "V7")),
        "shelf": RecordedGoal((3.0, 2.0), (100.0, 50.0), (1.5, 0.8)),
        "pose2sim_single": RecordedGoal((3.0, 2.0), (100.0, 50.0), (1.5, 0.8)),
        "multiviewx": RecordedGoal((4.0, 2.0), (60.0, 25.0), (0.6, 0.2), measures=True),
        DEMO: RecordedGoal(None, (100.0, 40.0), (1.0, 0.4)),
    }
)
"""By the set's name."""


@dataclass(frozen=True)
class Summary:
    """Several cases: `known` is each calibrated with the true lenses, `estimated` with some or all withheld."""

    cases: Sequence[Mapping[str, Any]]
    """Of each: `cameras`, `withheld` (names), `known`, `estimated`."""

    @property
    def focal_errors(self) -> list[float]:
        """Per cent, of each camera whose lens was withheld; infinite where it was not registered."""
        return [
            abs(case["estimated"]["lenses"][name]["focal_percent"]) if name in case["estimated"]["lenses"] else math.inf
            for case in self.cases
            for name in case["withheld"]
        ]

    def ratios(self, *kinds: str) -> list[float]:
        """Of each scene, how many times larger the rig's error is: of `mm` or `deg`, or of both, whichever grew more.

        Infinite where fewer cameras were registered. A scene whose rig is not found with the true lenses has none.
        """
        return [
            max(_ratio(case["known"], case["estimated"], kind) for kind in kinds)
            for case in self.cases
            if "mm" in case["known"]
        ]

    @property
    def time_ratios(self) -> list[float]:
        """Of each scene, processor time with estimated lenses over that with the true ones."""
        return [case["estimated"]["cpu_s"] / case["known"]["cpu_s"] for case in self.cases]

    @property
    def in_sigmas(self) -> list[float]:
        """Errors of the focal lengths in the sigmas that the rig states."""
        lenses = [lens for case in self.cases for lens in case["estimated"]["lenses"].values()]
        return [abs(lens["focal_percent"]) / lens["sigma_percent"] for lens in lenses if lens["sigma_percent"]]

    @property
    def accepted_wrong(self) -> int:
        """Scenes that were accepted with a focal length off by more than `MOST_PERCENT`."""
        return sum(
            case["estimated"]["verdict"] == "accepted"
            and any(abs(lens["focal_percent"]) > MOST_PERCENT for lens in case["estimated"]["lenses"].values())
            for case in self.cases
        )

    @property
    def registered(self) -> tuple[int, int]:
        """Cameras registered with estimated lenses, and all."""
        return sum(case["estimated"]["registered"] for case in self.cases), sum(case["cameras"] for case in self.cases)

    @property
    def cpu_hours(self) -> float:
        """Processor time of all."""
        return float(sum(case[run]["cpu_s"] for case in self.cases for run in ("known", "estimated"))) / 3600

    def measured(self, kind: str) -> tuple[float, float]:
        """Median over the scenes of the errors of `points` or of the `ground`, mm: with the true lenses, and estimated."""
        known, estimated = (
            median(case[run].get(f"{kind}_mm", math.inf) for case in self.cases) for run in ("known", "estimated")
        )
        return known, estimated

    @property
    def measured_in_sigmas(self) -> list[float]:
        """Of each scene with estimated lenses, the larger of both errors in the sigmas that the rig states."""
        return [
            max(case["estimated"].get(f"{kind}_mm", math.inf) / case["estimated"].get(f"{kind}_sigma_mm", 1e-9)
                for kind in ("points", "ground"))
            for case in self.cases
        ]  # fmt: skip

    @property
    def accepted(self) -> float:
        """Share of the scenes with estimated lenses that were accepted, per cent."""
        return 100 * sum(case["estimated"]["verdict"] == "accepted" for case in self.cases) / max(len(self.cases), 1)

    def errors(self, run: str) -> tuple[float, float]:
        """Median over the scenes of the rig's error (mm, degrees), of `known` or `estimated`; infinite ones count."""
        return median(case[run].get("mm", math.inf) for case in self.cases), median(
            case[run].get("deg", math.inf) for case in self.cases
        )

    def verdicts(self, run: str = "estimated") -> str:
        """How many scenes have each verdict."""
        of = [case[run]["verdict"] for case in self.cases]
        return ", ".join(f"{of.count(verdict)} {verdict}" for verdict in ("accepted", "doubtful", "refused") if verdict in of)


def _ratio(known: Mapping[str, Any], estimated: Mapping[str, Any], kind: str) -> float:
    if "mm" not in estimated or estimated["registered"] < known["registered"]:
        return math.inf
    return float(estimated[kind] / known[kind])


def median(values: Iterable[float]) -> float:
    """The median; not a number of none."""
    return within(values, 0.5)


def within(values: Iterable[float], share: float) -> float:
    """The smallest of the values that so large a share of them does not exceed; not a number of none."""
    ordered = np.sort(np.array(list(values), dtype=np.float64))
    return float(ordered[math.ceil(share * len(ordered)) - 1]) if len(ordered) else math.nan
