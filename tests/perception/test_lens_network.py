"""A network that sees the field of view: its contract, what breaks it, and scenes that name one."""

import math
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.perception.lens_network import LensNetwork, median_vertical_fov
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from support.scenes.puppet_videos import write_video

FACTOR = 2.0


def network(
    path: Path, shape: tuple[object, ...] = (1, 3, "h", "w"), *, axes: tuple[int, ...] = (0, 1, 2, 3), factor: float = FACTOR,
    channels: tuple[int, ...] | None = None,
) -> Path:  # fmt: skip
    """Says `factor` times the mean of a picture's values, or of some channels': of a grey picture of 0.5 one radian."""
    keep = 0 if len(axes) == 4 else 1
    nodes = [
        helper.make_node("ReduceMean", ["some" if channels else "picture"], ["mean"], axes=list(axes), keepdims=keep),
        helper.make_node("Mul", ["mean", "factor"], ["fov"]),
    ]
    if channels:
        nodes.insert(0, helper.make_node("Gather", ["picture", "channels"], ["some"], axis=1))
    graph = helper.make_graph(
        nodes, "g", [helper.make_tensor_value_info("picture", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("fov", TensorProto.FLOAT, None)],
        [helper.make_tensor("factor", TensorProto.FLOAT, [], [factor]),
         helper.make_tensor("channels", TensorProto.INT64, [len(channels or ())], channels or ())],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    return path


def grey(value: float, size: tuple[int, int] = (120, 200)) -> np.ndarray:
    return np.full((*size, 3), round(255 * value), dtype=np.uint8)


@pytest.mark.parametrize("shape", [(1, 3, "h", "w"), (1, 3, 64, 96), ("n", 3, 32, 32)])
def test_values_from_0_to_1_enter_red_first_and_one_number_comes_out(tmp_path, shape):
    opened = LensNetwork(network(tmp_path / "lens.onnx", shape))
    assert opened.vertical_fov(grey(0.4)) == pytest.approx(FACTOR * 0.4, abs=0.005)
    assert median_vertical_fov(opened, [grey(0.2), grey(0.9), grey(0.3)]) == pytest.approx(FACTOR * 0.3, abs=0.01)
    picture = np.zeros((40, 40, 3), dtype=np.uint8)
    picture[..., 2] = 255  # red, as OpenCV has it
    opened = LensNetwork(network(tmp_path / "red.onnx", factor=1.0, channels=(0,)))
    assert opened.vertical_fov(picture) == pytest.approx(1.0)


@pytest.mark.parametrize("shape", [(1, 3, 64), (1, 1, 64, 64), (2, 3, 64, 64)])
def test_another_input_or_output_and_no_field_of_view_are_errors(tmp_path, shape):
    path = network(tmp_path / "lens.onnx", shape, axes=tuple(range(len(shape))))
    with pytest.raises(InputError, match=r"lens\.onnx: its inputs are .*takes one \[1, 3, height, width\] of float"):
        LensNetwork(path)
    with pytest.raises(InputError, match=r"lens\.onnx: its first output .*one number, the vertical field of view"):
        LensNetwork(network(path, (1, 3, 64, 64), axes=(1,))).vertical_fov(grey(0.5))
    for factor in (0.0, 100.0, math.inf):
        with pytest.raises(InputError, match=r"gives a vertical field of view of (0|50[.]\d*|inf) radians"):
            LensNetwork(network(path, factor=factor)).vertical_fov(grey(0.5))


@pytest.fixture
def scene(tmp_path):
    """Two cameras with videos and boxes, the second with a stated field of view."""
    for name, value in (("A", 0.5), ("B", 0.3)):
        write_video(tmp_path / f"{name}.mp4", (grey(value) for _ in range(30)), 5.0)
        left = {"A": 50, "B": 52}[name]
        rows = "".join(f"{frame},1,{left + frame},30,20,60,1,-1,-1,-1\n" for frame in range(1, 20))
        (tmp_path / f"{name}.txt").write_text(rows)
    path = tmp_path / "scene.toml"
    cameras = "".join(f'[cameras.{name}]\nvideo = "{name}.mp4"\ntracks = "{name}.txt"\n' for name in "AB")
    path.write_text(cameras + 'hfov_deg = 80.0\n[association]\nmode = "given"\n[perception]\nlens_network = "lens.onnx"\n')
    return path


def test_a_scene_that_names_one(scene):
    network(scene.parent / "lens.onnx")
    inputs = read_inputs(Scene.load(scene))
    assert inputs.rig["A"].lens.focal == pytest.approx(60 / math.tan(0.5), rel=0.03)
    assert (inputs.rig["A"].lens.focal_sd, inputs.rig["A"].lens.uncalibrated) == (0.07, True), "it is sought about what is seen"
    assert inputs.rig["B"].lens.focal == pytest.approx(100 / math.tan(math.radians(40)))
    assert [one.cameras for one in inputs.findings if one.code == "field_of_view_seen"] == [("A",)]
    # Cameras of one model share what is seen: the median of what the network sees in both videos, 1.0 and 0.6 radians.
    scene.write_text(scene.read_text().replace("hfov_deg = 80.0", 'lens = "same as A"'))
    a, b = (camera.lens.focal for camera in read_inputs(Scene.load(scene)).rig)
    assert a == b == pytest.approx(0.5 * (60 / math.tan(0.5) + 60 / math.tan(0.3)), rel=0.03)
    # Without one nothing is seen.
    scene.write_text(scene.read_text().replace('lens_network = "lens.onnx"\n', ""))
    assert read_inputs(Scene.load(scene)).rig["A"].lens.focal == 200.0


def test_a_network_that_is_not_there_ends_with_2(scene, capsys):
    assert run(["calibrate", str(scene), "-o", str(scene.parent / "out")]) == 2
    assert "[perception] lens_network: " in (error := capsys.readouterr().err)
    assert "lens.onnx: no such file" in error
