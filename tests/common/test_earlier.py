"""Results that are used again while their jobs are the same."""

from passerby.common.parallel import EarlierResults
from passerby.common.progress import silent


def test_only_jobs_that_are_new_or_changed_are_done():
    done: list[int] = []

    def double(job: int) -> int:
        done.append(job)
        return 2 * job

    earlier: EarlierResults[int, int] = EarlierResults(lambda a, b: a == b)
    assert earlier.side_by_side(double, [1, 2, 3], "abc", None, silent, "doubling") == [2, 4, 6]
    assert earlier.side_by_side(double, [3, 1, 5], "cab", None, silent, "doubling") == [6, 2, 10]
    assert done == [1, 2, 3, 5]
    assert earlier.side_by_side(double, [2], "b", None, silent, "doubling") == [4]
    assert done == [1, 2, 3, 5, 2]
