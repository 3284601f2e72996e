"""Results of jobs that were done before: several estimates of one scene share most of their work."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from passerby.common.parallel import side_by_side
from passerby.common.progress import Progress

Job = TypeVar("Job")
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class EarlierResults(Generic[Job, Result]):
    """The last result of each key, used again for as long as its job is the same."""

    same: Callable[[Job, Job], bool]
    """Whether two jobs of one key have the same result."""
    _done: dict[Hashable, tuple[Job, Result]] = field(default_factory=dict)

    def side_by_side(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], keys: Sequence[Hashable], executor: Executor | None,
        tell: Progress, stage: str, *, job_s: float | None = None,
    ) -> list[Result]:  # fmt: skip
        """The results of all jobs, in their order: those that were not done before as of `parallel.side_by_side`.

        Args:
            function: of one job, as of `parallel.side_by_side`.
            jobs: what is to be done.
            keys: of each job; all different.
            executor: as of `parallel.side_by_side`.
            tell: called with the stage, and each job that is done again.
            stage: its name.
            job_s: as of `parallel.side_by_side`.
        """
        new = [k for k, key in enumerate(keys) if key not in self._done or not self.same(self._done[key][0], jobs[k])]
        for k, result in zip(
            new, side_by_side(function, [jobs[k] for k in new], executor, tell, stage, job_s=job_s), strict=True
        ):
            self._done[keys[k]] = jobs[k], result
        return [self._done[key][1] for key in keys]
