"""Checkpoints, options and backbones that are not what they should be are told of in one line."""

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


def test_there_is_none(tmp_path):
    with pytest.raises(InputError, match=r"checkpoint.pt: no such file: the folder of a training, or its checkpoint.pt"):
        load_checkpoint(tmp_path)


def test_cut_short(kept):
    content = kept.read_bytes()
    for share in (0.0, 0.01, 0.5, 0.99):
        kept.write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match=r"checkpoint.pt: is not a checkpoint that can be read \(.*\): train again"):
            load_checkpoint(kept)


def test_of_a_later_version(kept, capsys):
    state = torch.load(kept, weights_only=True)
    torch.save({**state, "format": "passerby-reid-2"}, kept)
    assert run(["reid", "export", str(kept.parent), "-o", str(kept.parent / "network.onnx")]) == 2
    said = f"error: {kept}: format is 2, of a later Passerby; this one reads up to 1: install a later one\n"
    assert capsys.readouterr().err == said


@pytest.mark.parametrize("content", [b"", b"\0" * 100, b"backbone = 'small'\n", b"\x80\x02}q\x00.", b"PK\x03\x04 and more"])
def test_something_else(tmp_path, content):
    (tmp_path / "checkpoint.pt").write_bytes(content)
    with pytest.raises(InputError, match=r"checkpoint.pt: is no"):
        load_checkpoint(tmp_path)


def test_a_bit_that_turned(kept):
    """Wherever it lies: the weights are kept with sums that tell."""
    content = kept.read_bytes()
    with zipfile.ZipFile(kept) as archive:
        largest = max(archive.infolist(), key=lambda one: one.file_size)
    for place in (largest.header_offset + 2000, len(content) // 2):
        kept.write_bytes(content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :])
        with pytest.raises(InputError, match="is not a checkpoint that can be read"):
            load_checkpoint(kept)


def rewritten(path, change):
    state = torch.load(path, weights_only=True)
    change(state)
    torch.save(state, path)


@pytest.mark.parametrize(
    "key", ["epoch", "options", "architecture", "people", "data", "origin", "network", "optimizer"]
)  # fmt: skip
def test_a_part_is_missing(kept, key):
    rewritten(kept, lambda state: state.pop(key))
    with pytest.raises(InputError, match=f"checkpoint.pt: .*{key}"):
        load_checkpoint(kept)


def test_weights_of_other_software(kept):
    torch.save({"state_dict": {}}, kept)
    with pytest.raises(InputError, match=rf"is not a checkpoint of passerby reid train \({FORMAT}\)"):
        load_checkpoint(kept)
    torch.save([1, 2], kept)
    with pytest.raises(InputError, match="is not a checkpoint of passerby reid train"):
        load_checkpoint(kept)


class Wish:
    """What a file could do when it is read by one who trusts it."""

    def __reduce__(self):
        return (open, ("/dev/null",))


def test_a_file_that_would_run_something(kept):
    torch.save({"format": FORMAT, "epoch": Wish()}, kept)
    with pytest.raises(InputError, match="is not a checkpoint that can be read"):
        load_checkpoint(kept)


def test_options_of_another_time(kept):
    rewritten(kept, lambda state: state["options"].update(pooling="largest"))
    with pytest.raises(InputError, match=r"its options are not understood .*pooling"):
        load_checkpoint(kept)


def test_weights_that_do_not_fit(kept):
    rewritten(kept, lambda state: state["network"].pop("neck.weight"))
    with pytest.raises(InputError, match=r"its weights do not fit its own description of the network .*neck.weight"):
        load_checkpoint(kept).restored()


# Backbones.


def test_small_has_no_published_weights():
    with pytest.raises(InputError, match=r"backbone small: no published weights .*weights = random"):
        open_backbone("small", SIZE, "published")
    opened = open_backbone("small", SIZE, "auto")
    assert not opened.published
    assert "none are published" in opened.note


def test_a_folder_that_is_called_like_a_backbone(tmp_path, monkeypatch):
    """Such as that of a run: `-o small`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small").mkdir()
    with pytest.raises(InputError, match="no published weights"):
        open_backbone("small", SIZE, "published")
    assert "none are published" in open_backbone("small", SIZE, "auto").note


@pytest.mark.parametrize("name", ["resnet-51", "resnet50", "", "small "])
def test_a_backbone_that_does_not_exist(name):
    with pytest.raises(InputError, match=f"backbone {name}: is not one of small, resnet-18, .*no model of this name"):
        open_backbone(name, SIZE, "random")


def test_a_last_stride_that_cannot_be_set():
    with pytest.raises(InputError, match="backbone mobilenet_v2: only a resnet has a last stride to set: give last_stride = 2"):
        open_backbone("mobilenet_v2", SIZE, "random", 1)
    assert open_backbone("mobilenet_v2", SIZE, "random", 2).channels == 1280


def test_pictures_that_a_backbone_does_not_take():
    with pytest.raises(InputError, match="backbone bert: does not turn an image of 16x32 pixels into features"):
        open_backbone("bert", SIZE, "random", 2)


@pytest.mark.parametrize(("stride", "rows"), [(1, 4), (2, 2)])
def test_the_last_stride(stride, rows):
    features = open_backbone("small", (64, 32), "random", stride).network(torch.zeros(1, 3, 64, 32)).last_hidden_state
    assert features.shape[2:] == (rows, rows // 2)


def test_small_is_small():
    assert sum(value.numel() for value in open_backbone("small", (128, 64), "random", 1).network.parameters()) == pytest.approx(
        1.2e6, rel=0.05
    )
    assert set(RESNETS) >= {"small", "resnet-18", "resnet-34", "resnet-50", "resnet-101", "resnet-152"}


def test_generalised_mean(network, monkeypatch):
    """(mean x^3)^(1/3); the plain one without a power."""
    monkeypatch.setattr("passerby.training.network.feature_map", lambda answer: torch.tensor([[[[1.0, 2.0], [3.0, 0.0]]]]))
    picture = torch.zeros(1, 3, *SIZE)
    network.eval()
    assert network.pooled(picture).item() == pytest.approx(((1 + 8 + 27) / 4) ** (1 / 3), rel=1e-5)
    network.power = None
    assert network.pooled(picture).item() == pytest.approx(1.5)


# Options.


def test_the_recipe_of_the_paper():
    """Xu et al., CVPR 2021, section 3.1: ResNet-50, global average pooling, identity and triplet loss, nothing more."""
    paper = train_options("paper")
    assert (paper.backbone, paper.pooling, paper.last_stride, paper.neck) == ("resnet-50", "average", 2, False)
    assert (paper.identity_weight, paper.triplet_weight, paper.margin, paper.label_smoothing) == (1, 1, 0.3, 0)
    assert (paper.flip, paper.shift, paper.erasing, paper.colour) == (0.5, 0, 0, 0)
    assert (paper.warm_up_epochs, paper.schedule) == (0, "constant")
    assert (paper.height, paper.width) == (256, 128)


def test_the_other_recipes():
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
    ("text", "told"),
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
def test_options_that_are_none(tmp_path, text, told):
    (tmp_path / "run.toml").write_text(text)
    with pytest.raises(InputError, match=told):
        train_options("small", tmp_path / "run.toml")
