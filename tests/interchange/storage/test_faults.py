"""Faults of a file come whole out of another process."""

import pickle

import pytest

from passerby.interchange.storage.safe_parsing import LISTED_FAULTS, FileFaults


@pytest.mark.parametrize("count", [1, 2, LISTED_FAULTS + 5])
def test_faults_survive_pickling(count: int) -> None:
    error = FileFaults([f"/data/a.txt: line {k} is wrong" for k in range(count)])
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.faults) == (str(error), error.faults)
