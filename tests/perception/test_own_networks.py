"""Networks of a user's own: what they want is told by the file, by a note beside it, or by the role."""

import re

import onnx
import pytest
from onnx import helper

from passerby.common.errors import InputError
from passerby.perception.fetching import sha256_of
from passerby.perception.model_files import find_model
from passerby.perception.networks import InputConvention
from support.networks.crop_networks import port, saved
from support.networks.model_server import keep_to


@pytest.fixture(autouse=True)
def _nothing_else(tmp_path, monkeypatch):
    keep_to(tmp_path, monkeypatch)


def write(path, shapes=((1, 4),), metadata=None):
    """A network whose outputs, copies of its inputs, have these shapes."""
    nodes = [helper.make_node("Identity", [f"x{n}"], [f"y{n}"]) for n in range(len(shapes))]
    ports = [[port(f"{side}{n}", list(shape)) for n, shape in enumerate(shapes)] for side in "xy"]
    model = onnx.load(saved(path, nodes, *ports))
    helper.set_model_props(model, metadata or {})
    onnx.save(model, str(path))
    return path


def test_the_usual_of_a_role(tmp_path):
    file = write(tmp_path / "mine.onnx")
    detector = find_model("mine.onnx", "detector", base=tmp_path).network
    assert (detector.name, detector.path, detector.output, detector.licence) == ("mine.onnx", file, "yolox", "unknown")
    assert detector.sha256 == sha256_of(file)
    assert detector.input == InputConvention("bgr", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), "letterbox", 114.0)
    embedder = find_model(file, "embedder").network
    assert embedder.output == "embedding"
    assert (embedder.input.colour, embedder.input.fit, embedder.input.scale) == ("rgb", "stretch", 1 / 255)
    assert (embedder.input.mean, embedder.input.std) == ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


@pytest.mark.parametrize(
    ("shapes", "output", "scale"),
    [([(1, 1, 17, 3)], "movenet", 1.0), ([("n", 17, 384), ("n", 17, 512)], "simcc", 1 / 255),
     ([(1, 17, 64, 48)], "heatmaps", 1 / 255)],
)  # fmt: skip
def test_what_keypoints_are_like_is_seen_from_the_outputs(tmp_path, shapes, output, scale):
    network = find_model(write(tmp_path / "mine.onnx", shapes), "keypoints").network
    assert (network.output, network.input.colour, network.input.scale) == (output, "rgb", scale)


def test_outputs_of_no_known_kind(tmp_path):
    file = write(tmp_path / "mine.onnx", [(1, 51)])
    with pytest.raises(InputError, match=r"mine\.onnx: outputs of shapes .*1, 51.* say which in mine\.toml"):
        find_model(file, "keypoints")
    (tmp_path / "mine.toml").write_text('output = "simcc"')
    assert find_model(file, "keypoints").network.output == "simcc"


def test_the_file_tells_and_the_note_does_not_overrule_it(tmp_path):
    told = {"role": "embedder", "colour": "bgr", "scale": "0.5", "mean": "[1, 2.5, 3]", "std": "4 5 6", "licence": "MIT"}
    metadata = {f"passerby.{key}": value for key, value in told.items()} | {"somebody.else": "1"}
    file = write(tmp_path / "mine.onnx", metadata=metadata)
    (tmp_path / "mine.toml").write_text('licence = "none"')
    network = find_model(file, "embedder").network
    assert network.input == InputConvention("bgr", 0.5, (1.0, 2.5, 3.0), (4.0, 5.0, 6.0), "stretch")
    assert network.licence == "MIT"
    with pytest.raises(InputError, match=r"mine\.onnx: is a network of role embedder, not detector"):
        find_model(file, "detector")


def test_a_note_beside_it(tmp_path):
    file = write(tmp_path / "mine.onnx")
    note = tmp_path / "mine.toml"
    note.write_text(
        'role = "detector"\nlicence = "BSD"\nname = "net"\n[input]\ncolour = "rgb"\npadding = 0\nmean = [1, 2, 3]\n'
    )
    network = find_model(file, "detector").network
    assert (network.name, network.licence) == ("net", "BSD")
    assert network.input == InputConvention("rgb", 1.0, (1.0, 2.0, 3.0), fit="letterbox", padding=0.0)


@pytest.mark.parametrize(
    ("note", "message"),
    [
        ("[input]\ncolor = 'rgb'", "mine.toml: unknown key input.color: there are role, output, input"),
        ("[input]\ncolour = 'grey'", "mine.toml: input.colour is 'grey': input should be 'bgr' or 'rgb'"),
        ("[input]\nstd = [1, 0, 1]", "mine.toml: input.std.1 is 0: input should be greater than 0"),
        ("output = 'simcc'", "mine.onnx: output simcc is not one of detector: there are yolox"),
        (f"sha256 = '{'0' * 64}'", f"mine.toml: sha256 {'0' * 64} is not that of mine.onnx"),
        ("output = ", "mine.toml: is not TOML"),
    ],
)
def test_notes_that_cannot_be(tmp_path, note, message):
    write(tmp_path / "mine.onnx")
    (tmp_path / "mine.toml").write_text(note)
    refused(tmp_path, message)


def refused(folder, message):
    with pytest.raises(InputError, match=re.escape(message)):
        find_model(folder / "mine.onnx", "detector")


def test_metadata_and_files_that_cannot_be(tmp_path):
    write(tmp_path / "mine.onnx", metadata={"passerby.mean": "1, 2"})
    refused(tmp_path, "mine.onnx: metadata passerby.*: input.mean")
    (tmp_path / "mine.onnx").write_bytes(b"hello")
    refused(tmp_path, "mine.onnx: this is not an ONNX file")
