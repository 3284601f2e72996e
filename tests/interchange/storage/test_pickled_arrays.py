"""Pickles of arrays: what numpy writes comes back, anything else is refused and runs nothing."""

import collections
import pickle

import numpy as np
import pytest

from passerby.interchange.storage.archives import parse_pickled_arrays
from passerby.interchange.storage.safe_parsing import NotParsed

VALUE = {
    "float": np.arange(6.0).reshape(2, 3), "fortran": np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3)),
    "byte": np.array([1, 2, 255], dtype=np.uint8), "flag": np.array([True, False]), "scalar": np.float64(2.5), "none": None,
    "mixed": [1, -7, 2**70, 2.5, "text", b"bytes", True, (1, (2, 3)), {"inner": 4}], "empty": np.zeros((0, 3)),
}  # fmt: skip


@pytest.mark.parametrize("protocol", range(6))
def test_what_numpy_writes_comes_back(protocol):
    found = parse_pickled_arrays(pickle.dumps(VALUE, protocol))
    assert found.keys() == VALUE.keys()
    for key, value in VALUE.items():
        np.testing.assert_array_equal(found[key], value) if isinstance(value, np.ndarray) else None
        assert isinstance(value, np.ndarray) or found[key] == value


@pytest.mark.parametrize("protocol", range(6))
def test_every_beginning_of_a_pickle_is_refused(protocol):
    whole = pickle.dumps({"a": np.arange(6.0).reshape(2, 3), "b": [1, "x"]}, protocol)
    for length in range(len(whole) - 1):
        with pytest.raises(NotParsed):
            parse_pickled_arrays(whole[:length])


@pytest.mark.parametrize(
    "value",
    [
        collections.OrderedDict(a=1), np.array([object()]), np.array(["text"]), np.zeros(2, dtype="f8,f4"), print, {1.5: 2},
        np.datetime64("2026-01-01"), {1, 2},
    ],
    ids=["subclass", "objects", "texts", "records", "function", "number as key", "date", "set"],
)  # fmt: skip
def test_other_objects_are_refused(value):
    with pytest.raises(NotParsed):
        parse_pickled_arrays(pickle.dumps(value))


def test_few_bytes_do_not_stand_for_endless_values():
    value = [0]
    for _ in range(40):
        value = [value, value]
    with pytest.raises(NotParsed, match="more than 10000 values"):
        parse_pickled_arrays(pickle.dumps(value))
    endless = []
    endless.append(endless)
    with pytest.raises(NotParsed):
        parse_pickled_arrays(pickle.dumps(endless))
