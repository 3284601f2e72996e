"""Tiny ONNX networks whose answers are known."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from passerby.perception.networks import InputConvention, Network, Output, Role


def network(path: Path, role: Role, output: Output, **convention: object) -> Network:
    return Network(path.stem, role, path, "0" * 64, output, InputConvention(**convention))  # type: ignore[arg-type]


def saved(path: Path, nodes: list, inputs: list, outputs: list, constants: dict[str, np.ndarray] | None = None) -> Path:
    held = [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()]
    graph = helper.make_graph(nodes, "test", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return path


def port(name: str, shape: list, kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def stripe_means(path: Path, batch: int | str = "n", channels_first: bool = True, kind: int = TensorProto.FLOAT) -> Path:
    """Mean of each channel in each of four stripes of a 16x32 crop: (N, 3, 4, 1)."""
    shape = [batch, 3, 32, 16] if channels_first else [batch, 32, 16, 3]
    nodes, last = [], "crop"
    if kind != TensorProto.FLOAT:
        nodes.append(helper.make_node("Cast", [last], ["cast"], to=TensorProto.FLOAT))
        last = "cast"
    if not channels_first:
        nodes.append(helper.make_node("Transpose", [last], ["turned"], perm=[0, 3, 1, 2]))
        last = "turned"
    nodes.append(helper.make_node("AveragePool", [last], ["mean"], kernel_shape=[8, 16], strides=[8, 16]))
    return saved(path, nodes, [port("crop", shape, kind)], [port("mean", [batch, 3, 4, 1])])


def brightest(path: Path, size: int, kind: int = TensorProto.INT32) -> Path:
    """MoveNet's shapes; all 17 joints lie at the centre of gravity of the crop's third channel, with score 0.9.

    The fractions are measured from the crop's outer edges.
    """
    places = ((np.arange(size) + 0.5) / size).astype(np.float32)
    nodes = [
        helper.make_node("Cast", ["crop"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("Gather", ["float", "third"], ["plane"], axis=3),
        helper.make_node("ReduceSum", ["plane", "all_axes"], ["total"], keepdims=1),
        helper.make_node("Add", ["total", "tiny"], ["divisor"]),
        helper.make_node("Mul", ["plane", "rows"], ["by_row"]),
        helper.make_node("Mul", ["plane", "columns"], ["by_column"]),
        helper.make_node("ReduceSum", ["by_row", "all_axes"], ["sum_row"], keepdims=1),
        helper.make_node("ReduceSum", ["by_column", "all_axes"], ["sum_column"], keepdims=1),
        helper.make_node("Div", ["sum_row", "divisor"], ["y"]),
        helper.make_node("Div", ["sum_column", "divisor"], ["x"]),
        helper.make_node("Reshape", ["score", "ones"], ["sure"]),
        helper.make_node("Concat", ["y", "x", "sure"], ["joint"], axis=3),
        helper.make_node("Tile", ["joint", "repeats"], ["joints"]),
    ]
    constants = {
        "third": np.array([2], dtype=np.int64),
        "all_axes": np.array([1, 2, 3], dtype=np.int64),
        "tiny": np.array(1e-6, dtype=np.float32),
        "rows": places[None, :, None, None],
        "columns": places[None, None, :, None],
        "score": np.array(0.9, dtype=np.float32),
        "ones": np.array([1, 1, 1, 1], dtype=np.int64),
        "repeats": np.array([1, 1, 17, 1], dtype=np.int64),
    }
    return saved(path, nodes, [port("crop", [1, size, size, 3], kind)], [port("joints", [1, 1, 17, 3])], constants)


def fixed(path: Path, answers: dict[str, np.ndarray], shape: list) -> Path:
    """Gives the same answers, arrays (1, ...), for each crop of a batch, whatever it shows."""
    nodes = [
        helper.make_node("ReduceMax", ["crop"], ["top"], axes=[1, 2, 3], keepdims=1),
        helper.make_node("Mul", ["top", "zero"], ["nothing4"]),
    ]
    constants: dict[str, np.ndarray] = {"zero": np.array(0.0, dtype=np.float32)}
    outputs = []
    for name, answer in answers.items():
        constants[f"{name}_held"] = answer.astype(np.float32)
        constants[f"{name}_rank"] = np.array([-1] + [1] * (answer.ndim - 1), dtype=np.int64)
        nodes.append(helper.make_node("Reshape", ["nothing4", f"{name}_rank"], [f"{name}_nothing"]))
        nodes.append(helper.make_node("Add", [f"{name}_held", f"{name}_nothing"], [name]))
        outputs.append(port(name, [shape[0], *answer.shape[1:]]))
    return saved(path, nodes, [port("crop", shape)], outputs, constants)
