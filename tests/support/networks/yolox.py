"""Tiny ONNX files that speak like a YOLOX network and give what a test prescribes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from passerby.perception.networks import InputConvention, Network

SIDE = 64
"""Of the input: 8 x 8, 4 x 4 and 2 x 2 cells."""
ROWS = 64 + 16 + 4
STRIDES = np.repeat([8.0, 16.0, 32.0], [64, 16, 4])
CORNERS = np.concatenate([[(c, r) for r in range(n) for c in range(n)] for n in (8, 4, 2)]).astype(float)


def row_of(stride: int, column: int, row: int) -> int:
    """The row of a cell."""
    return {8: 0, 16: 64, 32: 80}[stride] + row * (SIDE // stride) + column


def raw_rows(classes: int = 2) -> np.ndarray:
    """Rows (84, 5 + C) of a network that sees nothing."""
    rows = np.zeros((ROWS, 5 + classes))
    rows[:, :2] = 0.5
    return rows


def decoded(rows: np.ndarray) -> np.ndarray:
    """The same rows with boxes in pixels of the input."""
    rows = rows.copy()
    rows[:, :2] = (rows[:, :2] + CORNERS) * STRIDES[:, None]
    rows[:, 2:4] = np.exp(rows[:, 2:4]) * STRIDES[:, None]
    return rows


def network(path: Path, convention: InputConvention | None = None) -> Network:
    return Network(path.name, "detector", path, "0" * 64, "yolox", convention or InputConvention())


def saved(path: Path, nodes: list, shape: list, output: list, constants: dict, kind: int = TensorProto.FLOAT) -> Path:
    graph = helper.make_graph(
        nodes,
        "yolox",
        [helper.make_tensor_value_info("images", kind, shape)],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, output)],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    path.write_bytes(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8).SerializeToString())
    return path


def constant_file(path: Path, rows: np.ndarray, *, shape: list | None = None, kind: int = TensorProto.FLOAT) -> Path:
    """Gives the same rows whatever it is shown."""
    constants = {"rows": rows[None].astype(np.float32)}
    node = helper.make_node("Identity", ["rows"], ["output"])
    return saved(path, [node], shape or [1, 3, SIDE, SIDE], [1, *rows.shape], constants, kind)


def bright_file(path: Path, width: float, height: float) -> Path:
    """Finds a person of this size, pixels of the input, centred in each cell of 8 pixels, as certain as the cell is blue."""
    rest = raw_rows(1)[None].astype(np.float32)
    fine = np.concatenate([rest[:, :64, :2], np.full((1, 64, 2), np.log([width / 8, height / 8]))], axis=2).astype(np.float32)
    constants = {
        "zero": np.array([0], dtype=np.int64),
        "one": np.array([1], dtype=np.int64),
        "channel": np.array([1], dtype=np.int64),
        "share": np.array(1 / 255, dtype=np.float32),
        "column": np.array([1, 64, 1], dtype=np.int64),
        "boxes": fine,
        "certain": np.ones((1, 64, 1), dtype=np.float32),
        "coarse": rest[:, 64:],
    }
    nodes = [
        helper.make_node("Slice", ["images", "zero", "one", "channel"], ["blue"]),
        helper.make_node("AveragePool", ["blue"], ["mean"], kernel_shape=[8, 8], strides=[8, 8]),
        helper.make_node("Mul", ["mean", "share"], ["portion"]),
        helper.make_node("Reshape", ["portion", "column"], ["objectness"]),
        helper.make_node("Concat", ["boxes", "objectness", "certain"], ["fine"], axis=2),
        helper.make_node("Concat", ["fine", "coarse"], ["output"], axis=1),
    ]
    return saved(path, nodes, [1, 3, SIDE, SIDE], [1, ROWS, 6], constants)
