"""Faults of the input that an estimate shows and that can be repaired: diagnose, correct the inputs, estimate again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from passerby.calibration.estimation import Estimate
from passerby.scene.inputs import SceneInputs


class Diagnose(Protocol):
    """Looks for one kind of fault."""

    def __call__(self, inputs: SceneInputs, estimate: Estimate) -> Correction | None:
        """The corrected inputs; None where this fault is not, or no longer, there."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Inputs without a fault that was found in them; kinds of faults add what they were."""

    inputs: SceneInputs


@dataclass(frozen=True)
class Repair:
    """One kind of fault."""

    diagnose: Diagnose
    most: int
    """Corrections at most, and so many estimates more."""
    is_worse: Callable[[Estimate, Estimate], bool] | None = None
    """Whether the estimate after a correction is worse than that before: then the correction is dropped, and no other one of
    this kind is made."""


@dataclass(frozen=True, eq=False)
class Repaired:
    """An estimate in whose inputs no fault is found any more, or none that may still be corrected."""

    inputs: SceneInputs
    estimate: Estimate
    corrections: tuple[Correction, ...] = ()
    """In the order in which they were made."""


def apply_repairs(inputs: SceneInputs, estimator: Callable[[SceneInputs], Estimate], repairs: Sequence[Repair]) -> Repaired:
    """Estimate; while a fault is found, correct the inputs and estimate again.

    The repairs are asked in their order, and from the first again after each correction. There are at most 1 + the sum of
    `most` estimates.
    """
    estimate = estimator(inputs)
    corrections: list[Correction] = []
    left = [repair.most for repair in repairs]
    while (found := _next_correction(inputs, estimate, repairs, left)) is not None:
        number, correction = found
        after, is_worse = estimator(correction.inputs), repairs[number].is_worse
        if is_worse is not None and is_worse(after, estimate):
            left[number] = 0
            continue
        corrections.append(correction)
        inputs, estimate = correction.inputs, after
    return Repaired(inputs, estimate, tuple(corrections))


def _next_correction(
    inputs: SceneInputs, estimate: Estimate, repairs: Sequence[Repair], left: list[int]
) -> tuple[int, Correction] | None:  # fmt: skip
    """The first repair that finds a fault, and what it corrects; it is counted in `left`."""
    for number, repair in enumerate(repairs):
        if left[number] > 0 and (found := repair.diagnose(inputs, estimate)) is not None:
            left[number] -= 1
            return number, found
    return None
