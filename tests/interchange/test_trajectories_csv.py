"""People's ways as CSV: what is written is read, whatever frames it has, and every fault is told with its line."""

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import Clock
from passerby.core.trajectories import Trajectories
from passerby.interchange.trajectories_csv import HEADER, read_ground_positions, read_trajectories, write_trajectories
from support.refusals import refused

HEAD = ",".join(HEADER) + "\n"
ROW = "0.2000,3,7,1.000,-2.000,0.900,0.050,2\n"


def ways(frame, identity, clock):
    frame, identity = np.array(frame), np.array(identity)
    n = len(frame)
    xyz = np.column_stack([0.5 * frame, -0.25 * identity, np.full(n, 0.9)])
    sigma = np.where(np.arange(n) % 2, np.nan, 0.05)
    return Trajectories(identity, frame, clock.seconds(frame), xyz, sigma, np.arange(n) % 3, np.ones(n, dtype=int), clock)


@pytest.mark.parametrize(
    ("frame", "identity", "parts", "clock"),
    [
        ([1, 2, 3, 9, 10, 2, 3], [4, 4, 4, 4, 4, 6, 6], [1, 1, 1, 2, 2, 1, 1], Clock(5.0, 0.25)),
        ([1, 3, 5], [1, 1, 1], [1, 1, 1], Clock(25.0, -2.0)),
        ([8, 8], [3, 4], [1, 1], Clock(5.0, 1.0)),
    ],
    ids=["two people", "every other frame", "one instant"],
)
def test_what_is_written_is_read(tmp_path, frame, identity, parts, clock):
    found = ways(frame, identity, clock)
    write_trajectories(tmp_path / "a.csv", found)
    back = read_trajectories(tmp_path / "a.csv")
    for name in ("identity", "frame", "cameras"):
        assert np.array_equal(getattr(back, name), getattr(found, name))
    np.testing.assert_allclose(back.xyz, found.xyz, atol=6e-4)
    np.testing.assert_allclose(back.sigma_m, found.sigma_m, atol=6e-4)
    # The clock by which these frames have these times; of one instant the rate is not known.
    np.testing.assert_allclose(back.clock.seconds(back.frame), found.time_s, atol=1e-4)
    assert back.part.tolist() == parts


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("time_s,frame\n", r"line 1: has no column id: give the trajectories\.csv that `passerby track` wrote"),
        (HEAD, "has no row: no person was followed"),
        (HEAD + ROW.replace("1.000", "far"), "line 2: x_m is 'far': a finite number is needed"),
        (HEAD + ROW.replace("0.2000,3", "0.2000,3.5"), "line 2: frame is 3.5: a whole number is needed"),
        (HEAD + ROW.replace("-2.000", "1e15"), r"line 2: y_m is 1e\+15: no trajectory has such a number"),
        (HEAD + ROW + ROW, "person 7 occurs twice in frame 3: delete one row"),
        (HEAD + ROW + ROW.replace("0.2000,3", "0.1000,4"), "time_s does not grow with frame: give the trajectories.csv"),
    ],
)
def test_a_fault_is_told_with_its_line(tmp_path, text, told):
    (tmp_path / "a.csv").write_text(text)
    with refused(told, tmp_path / "a.csv"):
        read_trajectories(tmp_path / "a.csv")


@pytest.mark.parametrize(("text", "column"), [("", "frame"), ("frame,x_m,y_m\n1,2,3\n", "id")])
def test_a_column_of_true_places_that_is_missing_is_told(tmp_path, text, column):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=f"line 1: has no column {column}"):
        read_ground_positions(tmp_path / "a.csv")


def test_true_places_have_a_persons_number_under_any_of_its_names(tmp_path):
    for name in ("id", "person", "identity"):
        (tmp_path / "a.csv").write_text(f"frame,{name},x_m,y_m,more\n3,7,1.5,-2,x\n\n4,7,1.6,-2,y\n")
        found = read_ground_positions(tmp_path / "a.csv")
        assert (found.frame.tolist(), found.identity.tolist()) == ([3, 4], [7, 7])
        assert found.xy.tolist() == [[1.5, -2.0], [1.6, -2.0]]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("", "has no row"),
        ("3,7,1.5", r"line 2: has 3 columns, the header has more: complete the row"),
        ("3.5,7,1.5,2", "line 2: frame is 3.5: a whole number is needed"),
        ("3,7,1.5,2\n3,7,1.6,2", r"line 3: id 7 occurs a second time in frame 3 \(first on line 2\): delete one"),
        ("3,7,1.5,1e13", r"line 2: y_m is 1e\+13: no position and no frame has such a number"),
    ],
)
def test_a_fault_of_true_places_is_told_with_its_line(tmp_path, row, told):
    (tmp_path / "a.csv").write_text(f"frame,id,x_m,y_m\n{row}\n")
    with pytest.raises(InputError, match=told):
        read_ground_positions(tmp_path / "a.csv")
