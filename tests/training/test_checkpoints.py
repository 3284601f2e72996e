"""Checkpoints come back as they were kept; checkpoints, options and backbones that cannot be are refused in one line."""

import zipfile

import numpy as np
import pytest
import torch

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.training.checkpoints import FORMAT, load_checkpoint, save_checkpoint
from passerby.training.network import RESNETS, ReidNetwork, open_backbone
from passerby.training.options import RECIPES, TrainOptions, train_options

OPTIONS = train_options("small", height=32, width=16, weights="random", pooling="gem")
SIZE = (32, 16)


@pytest.fixture
def network():
    torch.manual_seed(0)
    return ReidNetwork(open_backbone("small", SIZE, "random", 1), 3, OPTIONS)


@pytest.fixture
def kept(network, tmp_path):
    path = tmp_path / "run" / "checkpoint.pt"
    optimizer = torch.optim.AdamW(network.parameters())
    save_checkpoint(path, network, optimizer, 7, OPTIONS, "key", {"data": "court"})
    return path


def test_what_was_kept_comes_back(network, kept):
    for given in (kept, kept.parent):
        found = load_checkpoint(given)
        assert (found.path, found.epoch, found.options, found.people, found.data) == (kept, 7, OPTIONS, 3, "key")
        assert found.origin == {"data": "court"}
    pictures = torch.from_numpy(np.random.default_rng(0).normal(size=(4, 3, *SIZE)).astype(np.float32))
    with torch.no_grad():
        assert torch.equal(found.restored().eval()(pictures).embedding, network.eval()(pictures).embedding)
        assert torch.equal(found.restored().eval()(pictures).logits, network(pictures).logits)


def test_of_a_later_version(kept, capsys):
    state = torch.load(kept, weights_only=True)
    torch.save({**state, "format": "passerby-reid-2"}, kept)
    assert run(["reid", "export", str(kept.parent), "-o", str(kept.parent / "network.onnx")]) == 2
    said = f"error: {kept}: format is 2, of a later Passerby; this one reads up to 1: install a later one\n"
    assert capsys.readouterr().err == said


def turned(content, place):
    """One bit turned."""
    return content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :]


def test_what_is_no_checkpoint_that_can_be_read(kept):
    """Cut short, of another kind, or with a bit that turned, wherever it lies: the weights are kept with sums."""
    content = kept.read_bytes()
    with zipfile.ZipFile(kept) as archive:
        largest = max(archive.infolist(), key=lambda one: one.file_size)
    spoilt = [content[: int(share * len(content))] for share in (0.0, 0.01, 0.5, 0.99)]
    spoilt += [turned(content, place) for place in (largest.header_offset + 2000, len(content) // 2)]
    for damaged in spoilt:
        kept.write_bytes(damaged)
        with pytest.raises(InputError, match=r"checkpoint.pt: is not a checkpoint that can be read \(.*\): train again"):
            load_checkpoint(kept)
    for other in (b"", b"\0" * 100, b"backbone = 'small'\n", b"\x80\x02}q\x00.", b"PK\x03\x04 and more"):
        kept.write_bytes(other)
        with pytest.raises(InputError, match=r"checkpoint.pt: is no"):
            load_checkpoint(kept)
    kept.unlink()
    with pytest.raises(InputError, match=r"checkpoint.pt: no such file: the folder of a training, or its checkpoint.pt"):
        load_checkpoint(kept.parent)


class Wish:
    """What a file could do when it is read by one who trusts it."""

    def __reduce__(self):
        return (open, ("/dev/null",))


def without(*keys):
    """A change of a state that takes a part of it away."""

    def change(state):
        for key in keys[:-1]:
            state = state[key]
        state.pop(keys[-1])

    return change


PARTS = ("epoch", "options", "architecture", "people", "data", "origin", "network", "optimizer")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        *((without(key), f"checkpoint.pt: .*{key}") for key in PARTS),
        (lambda state: {"state_dict": {}}, rf"is not a checkpoint of passerby reid train \({FORMAT}\)"),
        (lambda state: [1, 2], "is not a checkpoint of passerby reid train"),
        (lambda state: {"format": FORMAT, "epoch": Wish()}, "is not a checkpoint that can be read"),
        (lambda state: state["options"].update(pooling="largest"), "its options are not understood .*pooling"),
        (without("network", "neck.weight"), "its weights do not fit its own description of the network .*neck.weight"),
    ],
)
def test_a_checkpoint_of_other_content_is_refused_and_runs_nothing(kept, change, why):
    state = torch.load(kept, weights_only=True)
    torch.save(change(state) or state, kept)
    with pytest.raises(InputError, match=why):
        load_checkpoint(kept).restored()


def test_backbones_without_published_weights(tmp_path, monkeypatch):
    """Also where there is a folder that is called like one, such as that of a run: `-o small`."""
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        with pytest.raises(InputError, match=r"backbone small: no published weights .*weights = random"):
            open_backbone("small", SIZE, "published")
        opened = open_backbone("small", SIZE, "auto")
        assert (opened.published, "none are published" in opened.note) == (False, True)
        (tmp_path / "small").mkdir(exist_ok=True)


@pytest.mark.parametrize(
    ("name", "stride", "why"),
    [
        *((name, 1, f"backbone {name}: is not one of small, resnet-18, .*no model of this name")
          for name in ("resnet-51", "resnet50", "", "small ")),
        ("mobilenet_v2", 1, "backbone mobilenet_v2: only a resnet has a last stride to set: give last_stride = 2"),
        ("bert", 2, "backbone bert: does not turn an image of 16x32 pixels into features"),
    ],
)  # fmt: skip
def test_backbones_that_cannot_be(name, stride, why):
    with pytest.raises(InputError, match=why):
        open_backbone(name, SIZE, "random", stride)


def test_backbones_and_their_last_stride():
    assert open_backbone("mobilenet_v2", SIZE, "random", 2).channels == 1280
    for stride, rows in ((1, 4), (2, 2)):
        features = open_backbone("small", (64, 32), "random", stride).network(torch.zeros(1, 3, 64, 32)).last_hidden_state
        assert features.shape[2:] == (rows, rows // 2)
    small = open_backbone("small", (128, 64), "random", 1).network
    assert sum(value.numel() for value in small.parameters()) == pytest.approx(1.2e6, rel=0.05)
    assert set(RESNETS) >= {"small", "resnet-18", "resnet-34", "resnet-50", "resnet-101", "resnet-152"}


def test_generalised_mean(network, monkeypatch):
    """(mean x^3)^(1/3); the plain one without a power."""
    monkeypatch.setattr("passerby.training.network.feature_map", lambda answer: torch.tensor([[[[1.0, 2.0], [3.0, 0.0]]]]))
    picture = torch.zeros(1, 3, *SIZE)
    network.eval()
    assert network.pooled(picture).item() == pytest.approx(((1 + 8 + 27) / 4) ** (1 / 3), rel=1e-5)
    network.power = None
    assert network.pooled(picture).item() == pytest.approx(1.5)


def test_the_recipes():
    """Of the paper: Xu et al., CVPR 2021, 3.1: ResNet-50, average pooling, identity and triplet loss, nothing more."""
    paper = train_options("paper")
    assert (paper.backbone, paper.pooling, paper.last_stride, paper.neck) == ("resnet-50", "average", 2, False)
    assert (paper.identity_weight, paper.triplet_weight, paper.margin, paper.label_smoothing) == (1, 1, 0.3, 0)
    assert (paper.flip, paper.shift, paper.erasing, paper.colour) == (0.5, 0, 0, 0)
    assert (paper.warm_up_epochs, paper.schedule) == (0, "constant")
    assert (paper.height, paper.width) == (256, 128)
    strong, small = train_options("strong"), train_options("small")
    assert strong == TrainOptions()
    assert (strong.backbone, strong.neck, strong.last_stride, strong.label_smoothing) == ("resnet-50", True, 1, 0.1)
    assert (small.backbone, small.height, small.width) == ("small", 128, 64)
    with pytest.raises(InputError, match=f"recipe 'best' does not exist: choose one of {', '.join(RECIPES)}"):
        train_options("best")


def test_what_is_chosen_stands_over_the_file_and_that_over_the_recipe(tmp_path):
    config = tmp_path / "run.toml"
    config.write_text("epochs = 5\nseed = 3\nmargin = 0.5\n")
    found = train_options("paper", config, seed=4, epochs=None)
    assert (found.epochs, found.seed, found.margin, found.neck) == (5, 4, 0.5, False)
    start = train_options("small", width=32)
    assert train_options(config=config, start=start) == train_options("small", config, width=32)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("epoch = 5", "run.toml: unknown key epoch: there are backbone, "),
        ("epochs = 0", "run.toml: epochs = 0 is out of range: give a value from 1 to"),
        ("epochs = 'many'", "run.toml: epochs is 'many'"),
        ("pooling = 'largest'", "run.toml: pooling is 'largest'"),
        ("learning_rate = nan", "run.toml: learning_rate = nan is out of range"),
        ("identity_weight = 0\ntriplet_weight = 0", "run.toml: triplet_weight and identity_weight are both 0"),
        ("people_per_batch = 1", "run.toml: people_per_batch = 1 is out of range"),
    ],
)
def test_options_that_cannot_be(tmp_path, text, said):
    (tmp_path / "run.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        train_options("small", tmp_path / "run.toml")
