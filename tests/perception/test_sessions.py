"""Network files that open, and files that do not: the message names the file and the remedy."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from passerby.common.errors import InputError
from passerby.perception.sessions import inputs_of, open_session, outputs_of, provider_of
from support.refusals import refused


def doubling(opset: int = 13, operator: str = "Add") -> onnx.ModelProto:
    """y = x + x."""
    graph = helper.make_graph(
        [helper.make_node(operator, ["x", "x"], ["y"])],
        "doubling",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", 3])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, ["batch", 3])],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)


def saved(model: onnx.ModelProto, folder: Path) -> Path:
    path = folder / "network.onnx"
    path.write_bytes(model.SerializeToString())
    return path


def test_a_session_computes_on_one_thread_and_says_on_what(tmp_path):
    session = open_session(saved(doubling(), tmp_path), allow_cuda=False)
    assert provider_of(session) == "CPU"
    options = session.get_session_options()
    assert options.intra_op_num_threads == options.inter_op_num_threads == 1
    assert options.get_session_config_entry("session.intra_op.allow_spinning") == "0"
    x = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert np.array_equal(session.run(None, {"x": x})[0], 2 * x)


def test_open_dimensions_are_none(tmp_path):
    session = open_session(saved(doubling(), tmp_path))
    (taken,), (given,) = inputs_of(session), outputs_of(session)
    assert (taken.name, taken.shape, taken.kind, given.name) == ("x", (None, 3), "tensor(float)", "y")


WHOLE = doubling().SerializeToString()


@pytest.mark.parametrize("content", [b"", b"<html>404</html>", bytes(1000), WHOLE[: len(WHOLE) // 2]])
def test_no_onnx_file(tmp_path, content, capfd):
    path = tmp_path / "network.onnx"
    with pytest.raises(InputError, match=r"network\.onnx: no such file: give"):
        open_session(path)
    path.write_bytes(content)
    with refused(r".*fetch it again", path):
        open_session(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", [b"x", b"y"])
def test_names_that_are_no_text(name, tmp_path):
    path = saved(doubling(), tmp_path)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"\n\x01" + name, b"\n\x01\xee").replace(b"\x12\x01" + name, b"\x12\x01\xee"))
    with refused(r"network\.onnx: its names are not text: the file is damaged; fetch it again", path):
        open_session(path)


@pytest.mark.parametrize("model", [doubling(opset=999), doubling(operator="NoSuchOperator")])
def test_operators_that_are_not_known(tmp_path, model):
    path = saved(model, tmp_path)
    with refused(r"network\.onnx: needs operators .*older opset", path):
        open_session(path)
