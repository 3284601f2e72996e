"""A network exported to ONNX does in the perception stage what it does in PyTorch."""

import copy

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from passerby.common.errors import InputError
from passerby.perception.model_files import find_model
from passerby.perception.networks import IMAGENET
from passerby.perception.reid import ReidEmbedder
from passerby.training import export
from passerby.training.export import compare_outputs, export_network, torch_vectors
from passerby.training.network import Backbone, ReidNetwork, open_backbone
from passerby.training.options import train_options

SIZE = {"height": 64, "width": 32}


def options(**chosen):
    return train_options("small", **SIZE, weights="random", **chosen)


def network(chosen):
    """With batch normalisations that have seen something, so that each of them changes what passes."""
    torch.manual_seed(1)
    backbone = open_backbone(chosen.backbone, (chosen.height, chosen.width), "random", chosen.last_stride)
    made = ReidNetwork(backbone, 5, chosen).train()
    with torch.no_grad():
        if made.power is not None:
            made.power.fill_(2.5)
        for _ in range(3):
            made(2.0 * torch.randn(8, 3, chosen.height, chosen.width) + 1.0)
    return made


def crops(number, seed=3):
    """Of different sizes, larger and smaller than the input."""
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (*rng.integers((20, 10), (150, 80)), 3)).astype(np.uint8) for _ in range(number)]


@pytest.fixture(scope="module")
def trained():
    return network(options())


@pytest.fixture(scope="module")
def written(trained, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "net.onnx"
    report = export_network(trained, options(), path, pictures=crops(12), origin={"backbone": "small", "epochs": "3"})
    return path, report


@pytest.fixture
def quick(written, monkeypatch):
    """The conversion, which takes seconds, is taken as done."""
    model = onnx.load(written[0])
    del model.metadata_props[:]
    monkeypatch.setattr(export, "_convert_to_onnx", lambda network, options: model)


def test_the_perception_stage_opens_it_as_any_other_and_sees_the_same(written, trained):
    path, _ = written
    found = find_model(path, "embedder").network
    assert found.input == IMAGENET  # to the last bit of 1 / 255
    picture = np.random.default_rng(0).integers(0, 256, (200, 300, 3)).astype(np.uint8)
    boxes = np.array([[10.0, 20, 40, 90], [100.4, 3.2, 55.5, 150], [-5, 50, 60, 120]])
    embedder = ReidEmbedder(found)
    vectors = embedder(picture, boxes)
    reference = torch_vectors(copy.deepcopy(trained).eval(), (32, 64), [(picture, boxes)])
    assert embedder.dimensions == 256
    np.testing.assert_allclose(vectors, reference, atol=2e-6)
    assert np.abs(vectors[0] - vectors[1]).max() > 1e-3  # and not the same of all
    # Any number of pictures at once.
    session = onnxruntime.InferenceSession(str(path))
    for number in (1, 7, 16):
        pictures = torch.randn(number, 3, 64, 32, generator=torch.Generator().manual_seed(number))
        (given,) = session.run(None, {session.get_inputs()[0].name: pictures.numpy()})
        with torch.no_grad():
            expected = copy.deepcopy(trained).eval().embed(pictures).numpy()
        assert given.shape == (number, 256)
        np.testing.assert_allclose(given, expected, rtol=1e-4, atol=1e-5)


def test_the_file_states_its_input_and_its_origin_and_nothing_of_this_machine(written):
    path, report = written
    model = onnx.load(path)
    told = {entry.key: entry.value for entry in model.metadata_props}
    assert told["passerby.role"] == "embedder"
    assert told["passerby.colour"] == "rgb"
    assert float(told["passerby.scale"]) == 1 / 255
    assert told["trained.backbone"] == "small"
    assert told["trained.epochs"] == "3"
    assert not [weights.name for weights in model.graph.initializer if "classifier" in weights.name]
    data = path.read_bytes()
    for word in (b"site-packages", b".py", b"stack_trace", str(path.parent).encode(), onnx.__file__.encode()[:10]):
        assert word not in data
    assert report.bytes == len(data)
    assert [entry.name for entry in path.parent.iterdir()] == ["net.onnx"]
    # What was compared with PyTorch is reported.
    assert (report.random.pictures, report.real.pictures) == (19, 12)
    for compared in (report.random, report.real):
        assert compared.largest_difference < 2e-6
        assert compared.worst_cosine > 0.999999
        assert compared.same_ranking
    assert report.to_dict()["real"]["same_ranking"] is True
    assert report.to_dict()["dimensions"] == 256


def test_the_same_network_gives_the_same_bytes_and_stays_as_it_is(written, trained, tmp_path, capfd):
    before = copy.deepcopy(trained.state_dict())
    origin = {"epochs": "3", "backbone": "small"}
    report = export_network(trained, options(), tmp_path / "again.onnx", origin=origin)
    assert (tmp_path / "again.onnx").read_bytes() == written[0].read_bytes()
    assert report.real is None
    assert trained.training
    assert all(torch.equal(value, before[key]) for key, value in trained.state_dict().items())
    assert capfd.readouterr() == ("", "")


def test_generalised_mean_and_no_neck(tmp_path):
    chosen = options(pooling="gem", neck=False, last_stride=2)
    made = network(chosen)
    pictures = [*crops(6), np.zeros((6, 4, 3), dtype=np.uint8)]
    report = export_network(made, chosen, tmp_path / "net.onnx", pictures=pictures)
    assert report.too_small == 1
    assert report.real.pictures == 6
    assert report.real.largest_difference < 2e-6


@pytest.mark.usefixtures("quick")
def test_a_file_that_cannot_be_written_or_answers_otherwise_than_pytorch(trained, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(InputError, match=r"net\.onnx: cannot be written"):
        export_network(trained, options(), tmp_path / "file" / "net.onnx")
    right = export.normalise_pictures
    monkeypatch.setattr(export, "normalise_pictures", lambda batch: right(batch.flip(-1)))  # red and blue exchanged
    with pytest.raises(InputError, match=r"backbone small: on random images, .* other vectors than PyTorch"):
        export_network(trained, options(), tmp_path / "net.onnx")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


class DependsOnItsNumbers(torch.nn.Module):
    """A backbone that no graph can hold."""

    def __init__(self):
        super().__init__()
        self.layer = torch.nn.Conv2d(3, 4, 1)

    def forward(self, pictures):
        if pictures.sum() > 0:
            pictures = -pictures
        return type("Answer", (), {"last_hidden_state": self.layer(pictures)})


def test_a_network_that_is_not_a_number_and_a_backbone_that_cannot_be_exported(trained, tmp_path):
    chosen, broken = options(), copy.deepcopy(trained)
    with torch.no_grad():
        next(broken.backbone.parameters()).fill_(float("nan"))
    with pytest.raises(InputError, match="not finite"):
        export_network(broken, chosen, tmp_path / "net.onnx")
    made = ReidNetwork(Backbone(DependsOnItsNumbers(), 4, False, ""), 5, chosen)
    with pytest.raises(InputError, match=r"backbone small: cannot be exported to ONNX \(.{10,}\): train with another"):
        export_network(made, chosen, tmp_path / "net.onnx")
    assert not list(tmp_path.iterdir())


def test_a_ranking_that_differs_is_found_and_a_tie_is_not():
    def at(*degrees):
        return np.stack([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))], axis=1)

    same = compare_outputs(at(0, 10, 20), at(0, 10, 20))
    assert same.largest_swap == 0.0
    assert same.largest_difference == 0.0
    # From the first, the second and third change places: by the cosines of 10 and 20 degrees.
    swapped = compare_outputs(at(0, 10, -20), at(0, 20, -10))
    assert swapped.largest_swap == pytest.approx(np.cos(np.radians(10)) - np.cos(np.radians(20)))
    assert not swapped.same_ranking
    assert swapped.worst_cosine == pytest.approx(np.cos(np.radians(10)))
    assert compare_outputs(at(0, 30, -30.0001), at(0, 30.0001, -30)).same_ranking
