"""Embeddings as npz: round trips, what other tools write, and every fault told with its place and fix."""

import io
import zipfile

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.motchallenge import read_embeddings, write_embeddings
from passerby.interchange.storage import archives
from support.refusals import refused

VECTORS = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 7.0]])
UNIT = [[0.6, 0.8, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def saved(tmp_path, **arrays):
    path = tmp_path / "V1.npz"
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize(
    ("dtype", "save", "name", "others"),
    [
        (np.float16, np.savez, "embeddings", {"b": np.ones((5, 5)), "names": np.array(["a", None], dtype=object)}),
        (np.float32, np.savez_compressed, "feats", {"score": np.ones(3)}),
        (np.float64, np.savez, "arr_0", {}),
    ],
)
def test_rows_come_to_length_one_and_keep_their_order(tmp_path, dtype, save, name, others):
    save(tmp_path / "V1.npz", **{name: VECTORS.astype(dtype)}, **others)
    found = read_embeddings(tmp_path / "V1.npz")
    np.testing.assert_allclose(found.vectors, UNIT, atol=1e-6)
    assert found.vectors.dtype == np.float32
    assert found.frame is None


def test_round_trip(tmp_path):
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


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        ({}, "which array is meant? It holds nothing"),
        ({"a": VECTORS, "b": VECTORS}, "which array is meant? It holds a, b: .* call it 'embeddings'"),
        ({"embeddings": np.ones(3)}, r"embeddings has the shape \(3,\): \(boxes, dimensions\)"),
        ({"embeddings": np.ones((3, 2), dtype=int)}, "embeddings holds int64: float16, float32 or float64"),
        ({"embeddings": np.array([[1, 2], [np.nan, 1], [np.inf, 1]])}, r"row 2 of embeddings is not finite \(2 of 3 rows\)"),
        ({"embeddings": np.array([[1.0, None]], dtype=object)}, "pickled Python objects"),
        ({"embeddings": VECTORS, "frame": np.ones(2, dtype=int)}, r"frame has the shape \(2,\), but there are 3 embeddings"),
        ({"embeddings": VECTORS, "frame": np.array([1, 1.5, 2])}, "frame holds float64 that are not whole"),
    ],
)
def test_a_fault_names_file_value_and_mend(tmp_path, arrays, told):
    path = saved(tmp_path, **arrays)
    with refused(told.replace("?", r"\?"), path):
        read_embeddings(path)


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


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"1,4,10,20\n", "npz"),
        (b"PK\x03\x04 broken", "npz"),
        (archive_with("embeddings.npy", b"no array"), "npz"),
        (archive_with("embeddings.npy", b"\x93NUMPY\x01\x00"), "npz"),
        (array_bytes((3, 4), rows=bytes(40)), "embeddings says that it has 48 bytes, but 40 are there"),
        (array_bytes((3, 4), rows=bytes(56)), "embeddings says that it has 48 bytes, but 56 are there"),
        (array_bytes((3_000_000, 1_000_000)), "embeddings has 11176 GB: at most 2 GB are read"),
        (array_bytes((-3, 4), rows=bytes(48)), r"embeddings has the shape \(-3, 4\)"),
        (array_bytes((3, 4), version=(3, 0), rows=bytes(48)), r"embeddings is of version \(3, 0\) of numpy's format"),
    ],
)
def test_a_file_that_is_no_archive_of_arrays(tmp_path, content, told):
    path = tmp_path / "V1.npz"
    path.write_bytes(content)
    with refused(told, path):
        read_embeddings(path)


@pytest.mark.parametrize(
    ("owner", "name", "fault", "told"),
    [
        (archives.npy, "read_array", MemoryError(), "it does not fit into memory"),
        (archives.Path, "open", PermissionError(13, "No"), r"V1.npz: cannot be read \(No\): .* is needed"),
    ],
)
def test_an_archive_that_does_not_fit_into_memory_or_cannot_be_opened(tmp_path, monkeypatch, owner, name, fault, told):
    def failing(*arguments, **named):
        raise fault

    path = saved(tmp_path, embeddings=VECTORS)
    monkeypatch.setattr(owner, name, failing)
    with pytest.raises(InputError, match=told):
        read_embeddings(path)


def test_a_damaged_archive(tmp_path):
    path = saved(tmp_path, embeddings=np.random.default_rng(0).normal(size=(50, 8)))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        read_embeddings(path)


def test_a_file_that_is_not_there_or_something_else(tmp_path):
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, VECTORS)
    with pytest.raises(InputError, match="is a single numpy array"):
        read_embeddings(tmp_path / "array.npz")


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="do not fit"):
        write_embeddings(tmp_path / "V1.npz", VECTORS, [1, 2])
    with pytest.raises(InputError, match="cannot be written"):
        write_embeddings(tmp_path / "V1.npz", [1.0, 2.0])
    assert not list(tmp_path.iterdir())
