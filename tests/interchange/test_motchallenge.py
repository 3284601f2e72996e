"""MOTChallenge text: round trips, and every fault told with its place and fix."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import read_boxes, write_boxes
from passerby.interchange.storage.safe_parsing import faults_of
from support.refusals import refused

GOOD = "1,4,10,20,30,60,0.9,-1,-1,-1\n2,4,11,20,30,60,0.9,-1,-1,-1\n"


def read(tmp_path, text):
    path = tmp_path / "boxes.txt"
    path.write_text(text)
    return read_boxes(path)


def test_columns_land_where_they_belong(tmp_path):
    boxes = read(tmp_path, GOOD)
    assert (boxes.frame.tolist(), boxes.identity.tolist()) == ([1, 2], [4, 4])
    assert (boxes.ltwh.tolist(), boxes.score.tolist()) == ([[10, 20, 30, 60], [11, 20, 30, 60]], [0.9, 0.9])


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("", 0),
        ("1, 4, 10, 20, 30, 60, 1, -1, -1, -1", 1),
        ("\ufeff1,4,10,20,30,60,1\r\n2,4,10,20,30,60,1\r\n\n", 2),
        ("1.0e+00,4.0,10,20,30,60,1,1,0.5\n", 1),
        ("1,-1,10,20,30,60,1\n1,-1,11,20,30,60,1\n", 2),
        ("0,0,-10,-20,30,60,1\n", 1),
    ],
)
def test_what_other_tools_write_is_read(tmp_path, text, count):
    assert len(read(tmp_path, text)) == count


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1,4,10,20,30,60\n", r"line 1: 6 columns instead of 7 to 10"),
        ("1 4 10 20 30 60 1\n", r"line 1: 1 columns .* separated by commas"),
        (GOOD + "3,4,10,20,30,60,1\n", r"line 3: 7 columns, but the first row has 10"),
        ("frame,id,left,top,width,height,score\n", r"line 1: frame is 'frame': a number is needed; delete headers"),
        ("1,4,1_0,20,30,60,1\n", r"line 1: left is '1_0'"),
        ("1,4,nan,20,30,60,1\n", r"line 1: left is nan: delete the row"),
        ("1,4,10,20,-30,60,1\n", r"line 1: width is -30: it must be above 0"),
        ("-1,4,10,20,30,60,1\n", r"line 1: frame is -1: a whole number from 0"),
        ("1,-2,10,20,30,60,1\n", r"line 1: identity is -2: a whole number from -1"),
        ("1e300,4,10,20,30,60,1\n", r"line 1: frame is 1e\+300"),
        ("2,4,10,20,30,60,1\n1,4,10,20,30,60,1\n", r"line 2: frame 1 comes after frame 2: sort"),
        (GOOD + "\n2,4,11,20,30,60,0.9,-1,-1,-1\n", r"line 4: repeats line 2 \(2,4,11,20,30,60,0.9,-1,-1,-1\): delete one"),
        ("1,-1,10,20,30,60,1\n1,-1,10,20,30,60,1\n", r"line 2: repeats line 1"),
        ("1,4,10,20,30,60,1\n1,4,90,20,30,60,1\n", r"line 2: identity 4 occurs a second time in frame 1 \(first on line 1\)"),
    ],
)
def test_a_fault_names_file_line_value_and_mend(tmp_path, text, told):
    with refused(told, tmp_path / "boxes.txt"):
        read(tmp_path, text)


def test_all_faults_are_gathered(tmp_path):
    with pytest.raises(InputError, match="and 2 more faults") as caught:
        read(tmp_path, "1,4,nan,20,30,60,1\n2,4,10,20,-30,60,1\n1,4,10,20,30,60,1\n1,4,10,21,30,60,1\n")
    assert [fault.split(": ")[1] for fault in faults_of(caught.value)] == ["line 1", "line 2", "line 4"]


def test_a_flood_of_faults_is_cut_short(tmp_path):
    with pytest.raises(InputError) as caught:
        read(tmp_path, "".join(f"{frame},1,nan,2,3,4,1\n" for frame in range(100)))
    assert faults_of(caught.value)[-1] == "... and 80 more faults"


def test_a_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_boxes(tmp_path / "none.txt")
    with pytest.raises(InputError, match="is a folder"):
        read_boxes(tmp_path)
    (tmp_path / "picture.txt").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(InputError, match="not UTF-8 text"):
        read_boxes(tmp_path / "picture.txt")


pixels = st.floats(-1e4, 1e4)
extents = st.floats(1e-3, 1e4)
rows = st.lists(
    st.tuples(st.integers(0, 10**6), st.integers(0, 10**6), pixels, pixels, extents, extents, st.floats(0, 1)),
    unique_by=lambda row: row[:2],
    max_size=30,
)


@given(rows)
def test_round_trip(tmp_path_factory, rows):
    table = np.array(rows, dtype=float).reshape(-1, 7)
    boxes = Boxes(table[:, 0], table[:, 1], table[:, 2:6], table[:, 6])
    path = tmp_path_factory.mktemp("boxes") / "boxes.txt"
    write_boxes(path, boxes)
    back = read_boxes(path)
    order = np.lexsort((boxes.identity, boxes.frame))
    assert np.array_equal(back.frame, boxes.frame[order])
    assert np.array_equal(back.identity, boxes.identity[order])
    np.testing.assert_allclose(back.ltwh, boxes.ltwh[order], rtol=1e-8)
    np.testing.assert_allclose(back.score, boxes.score[order], rtol=1e-8)


def test_writing_leaves_nothing_half_done(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"):
        write_boxes(tmp_path / "file" / "boxes.txt", Boxes.empty())
    write_boxes(tmp_path / "new" / "boxes.txt", Boxes.empty())
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["boxes.txt"]


@pytest.mark.real
def test_real_files_are_sound(data_root):
    files = sorted(data_root.glob("*/identities/*.txt"))
    assert len(files) >= 20
    assert all(len(read_boxes(path)) for path in files)
