"""Boxes as MOTChallenge text and embeddings as npz: round trips, what other tools write, and every fault."""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import read_boxes, read_embeddings, write_boxes, write_embeddings
from passerby.interchange.storage import archives
from passerby.interchange.storage.safe_parsing import faults_of
from support.refusals import refused

GOOD = "1,4,10,20,30,60,0.9,-1,-1,-1\n2,4,11,20,30,60,0.9,-1,-1,-1\n"
VECTORS = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 7.0]])
UNIT = [[0.6, 0.8, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def read(tmp_path, text):
    path = tmp_path / "boxes.txt"
    path.write_text(text)
    return read_boxes(path)


@pytest.mark.parametrize(("text", "rows"), [
    (GOOD, [[1, 4, 10, 20, 30, 60, 0.9], [2, 4, 11, 20, 30, 60, 0.9]]),
    ("", []),
    ("1, 4, 10, 20, 30, 60, 1, -1, -1, -1", [[1, 4, 10, 20, 30, 60, 1]]),
    ("\ufeff1,4,10,20,30,60,1\r\n2,4,10,20,30,60,1\r\n\n", [[1, 4, 10, 20, 30, 60, 1], [2, 4, 10, 20, 30, 60, 1]]),
    ("1.0e+00,4.0,10,20,30,60,1,1,0.5\n", [[1, 4, 10, 20, 30, 60, 1]]),
    ("1,-1,10,20,30,60,1\n1,-1,11,20,30,60,1\n", [[1, -1, 10, 20, 30, 60, 1], [1, -1, 11, 20, 30, 60, 1]]),
    ("0,0,-10,-20,30,60,1\n", [[0, 0, -10, -20, 30, 60, 1]]),
])  # fmt: skip
def test_boxes_of_other_tools_are_read(tmp_path, text, rows):
    boxes = read(tmp_path, text)
    assert np.column_stack([boxes.frame, boxes.identity, boxes.ltwh, boxes.score]).tolist() == rows


@pytest.mark.parametrize(("text", "message"), [
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
    ("1,4,10,20,30,60,1\n1,4,90,20,30,60,1\n", r"line 2: identity 4 occurs a second time in frame 1 \(first on line 1\)"),
])  # fmt: skip
def test_a_fault_of_boxes_names_file_line_value_and_mend(tmp_path, text, message):
    with refused(message, tmp_path / "boxes.txt"):
        read(tmp_path, text)


def test_all_faults_are_gathered_and_a_flood_is_cut_short(tmp_path):
    with pytest.raises(InputError, match="and 2 more faults") as caught:
        read(tmp_path, "1,4,nan,20,30,60,1\n2,4,10,20,-30,60,1\n1,4,10,20,30,60,1\n1,4,10,21,30,60,1\n")
    assert [fault.split(": ")[1] for fault in faults_of(caught.value)] == ["line 1", "line 2", "line 4"]
    with pytest.raises(InputError) as caught:
        read(tmp_path, "".join(f"{frame},1,nan,2,3,4,1\n" for frame in range(100)))
    assert faults_of(caught.value)[-1] == "... and 80 more faults"


def test_a_file_of_boxes_that_is_not_there_or_not_text_is_refused(tmp_path):
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
def test_boxes_come_back(tmp_path_factory, rows):
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


def saved(tmp_path, **arrays):
    np.savez(tmp_path / "V1.npz", **arrays)
    return tmp_path / "V1.npz"


@pytest.mark.parametrize(("dtype", "save", "name", "others"), [
    (np.float16, np.savez, "embeddings", {"b": np.ones((5, 5)), "names": np.array(["a", None], dtype=object)}),
    (np.float32, np.savez_compressed, "feats", {"score": np.ones(3)}),
    (np.float64, np.savez, "arr_0", {}),
])  # fmt: skip
def test_rows_come_to_length_one_and_keep_their_order(tmp_path, dtype, save, name, others):
    save(tmp_path / "V1.npz", **{name: VECTORS.astype(dtype)}, **others)
    found = read_embeddings(tmp_path / "V1.npz")
    np.testing.assert_allclose(found.vectors, UNIT, atol=1e-6)
    assert found.vectors.dtype == np.float32
    assert found.frame is None


def test_embeddings_come_back(tmp_path):
    rng = np.random.default_rng(0)
    vectors, frame = rng.normal(size=(40, 16)), np.sort(rng.integers(1, 20, 40))
    for name in ("one", "two"):
        write_embeddings(tmp_path / name / "V1.npz", vectors, frame)
    found = read_embeddings(tmp_path / "one" / "V1.npz")
    np.testing.assert_allclose(found.vectors, vectors / np.linalg.norm(vectors, axis=1, keepdims=True), atol=1e-6)
    assert found.frame.tolist() == frame.tolist()
    assert (tmp_path / "one" / "V1.npz").read_bytes() == (tmp_path / "two" / "V1.npz").read_bytes()
    assert [path.name for path in (tmp_path / "one").iterdir()] == ["V1.npz"]
    write_embeddings(tmp_path / "none.npz", np.zeros((0, 16)))
    assert read_embeddings(tmp_path / "none.npz").vectors.shape == (0, 16)


@pytest.mark.parametrize(("arrays", "message"), [
    ({}, r"which array is meant\? It holds nothing"),
    ({"a": VECTORS, "b": VECTORS}, r"which array is meant\? It holds a, b: .* call it 'embeddings'"),
    ({"embeddings": np.ones(3)}, r"embeddings has the shape \(3,\): \(boxes, dimensions\)"),
    ({"embeddings": np.ones((3, 2), dtype=int)}, "embeddings holds int64: float16, float32 or float64"),
    ({"embeddings": np.array([[1, 2], [np.nan, 1], [np.inf, 1]])}, r"row 2 of embeddings is not finite \(2 of 3 rows\)"),
    ({"embeddings": np.array([[1.0, None]], dtype=object)}, "pickled Python objects"),
    ({"embeddings": VECTORS, "frame": np.ones(2, dtype=int)}, r"frame has the shape \(2,\), but there are 3 embeddings"),
    ({"embeddings": VECTORS, "frame": np.array([1, 1.5, 2])}, "frame holds float64 that are not whole"),
])  # fmt: skip
def test_a_fault_of_embeddings_names_file_value_and_mend(tmp_path, arrays, message):
    with refused(message, saved(tmp_path, **arrays)):
        read_embeddings(tmp_path / "V1.npz")


def archive_with(name, content):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, content)
    return file.getvalue()


def array_bytes(shape, version=(1, 0), kind="<f4", rows=b""):
    """An array's file whose header says what it likes."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = len(header).to_bytes(2 if version == (1, 0) else 4, "little")
    return archive_with("embeddings.npy", b"\x93NUMPY" + bytes(version) + length + header + rows)


@pytest.mark.parametrize(("content", "message"), [
    (b"1,4,10,20\n", "npz"),
    (b"PK\x03\x04 broken", "npz"),
    (archive_with("embeddings.npy", b"no array"), "npz"),
    (archive_with("embeddings.npy", b"\x93NUMPY\x01\x00"), "npz"),
    (array_bytes((3, 4), rows=bytes(48)).replace(bytes(48), b"\1" + bytes(47)), "cannot be read"),  # not what its checksum says
    (array_bytes((3, 4), rows=bytes(40)), "embeddings says that it has 48 bytes, but 40 are there"),
    (array_bytes((3, 4), rows=bytes(56)), "embeddings says that it has 48 bytes, but 56 are there"),
    (array_bytes((3_000_000, 1_000_000)), "embeddings has 11176 GB: at most 2 GB are read"),
    (array_bytes((-3, 4), rows=bytes(48)), r"embeddings has the shape \(-3, 4\)"),
    (array_bytes((3, 4), version=(3, 0), rows=bytes(48)), r"embeddings is of version \(3, 0\) of numpy's format"),
])  # fmt: skip
def test_a_file_that_is_no_archive_of_arrays_is_refused(tmp_path, content, message):
    (tmp_path / "V1.npz").write_bytes(content)
    with refused(message, tmp_path / "V1.npz"):
        read_embeddings(tmp_path / "V1.npz")


@pytest.mark.parametrize(("owner", "name", "fault", "message"), [
    (archives.npy, "read_array", MemoryError(), "it does not fit into memory"),
    (archives.Path, "open", PermissionError(13, "No"), r"V1.npz: cannot be read \(No\): .* is needed"),
])  # fmt: skip
def test_an_archive_that_does_not_fit_into_memory_or_cannot_be_opened_is_refused(
    tmp_path, monkeypatch, owner, name, fault, message
):
    def failing(*arguments, **named):
        raise fault

    path = saved(tmp_path, embeddings=VECTORS)
    monkeypatch.setattr(owner, name, failing)
    with pytest.raises(InputError, match=message):
        read_embeddings(path)


def test_a_single_array_and_embeddings_that_do_not_fit_their_frames_are_refused(tmp_path):
    with pytest.raises(InputError, match="do not fit"):
        write_embeddings(tmp_path / "V1.npz", VECTORS, [1, 2])
    with pytest.raises(InputError, match="cannot be written"):
        write_embeddings(tmp_path / "V1.npz", [1.0, 2.0])
    assert not list(tmp_path.iterdir())
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, VECTORS)
    with pytest.raises(InputError, match="is a single numpy array"):
        read_embeddings(tmp_path / "array.npz")
