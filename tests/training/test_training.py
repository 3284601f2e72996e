"""A training learns, and goes on bit for bit where it was stopped; what cannot go on says why."""

from __future__ import annotations

import math
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
import torch

from passerby.common.errors import InputError
from passerby.training import training
from passerby.training.checkpoints import load_checkpoint
from passerby.training.crops import CropSet
from passerby.training.curves import TrainingLog
from passerby.training.data import read_all
from passerby.training.network import ReidLoss, open_backbone
from passerby.training.options import TrainOptions, train_options
from passerby.training.runs import course, fine_tuning, run_embedder, train_run
from passerby.training.training import learning_rate, train
from support.datasets.coloured_people import coloured_people, coloured_person
from support.faults.killed_training import train_until

TINY = {"height": 32, "width": 16, "weights": "random", "epochs": 4, "validate_every": 2, "warm_up_epochs": 1,
        "people_per_batch": 4, "pictures_per_person": 2, "learning_rate": 1e-3}  # fmt: skip
BATCHES = 3
"""In an epoch of 24 pictures."""


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return coloured_people(tmp_path_factory.mktemp("data") / "court")


def options(**chosen):
    return train_options("small", **{**TINY, **chosen})


def run(data, folder, **chosen):
    return train_run(read_all([data], folder / "crops"), options(**chosen), folder, device="cpu")


@pytest.fixture(scope="module")
def whole(data, tmp_path_factory):
    """A training that nothing befell."""
    folder = tmp_path_factory.mktemp("whole")
    run(data, folder)
    return folder


def stopped(data, folder, batch, **chosen):
    """A training that a user interrupts after a batch, counted from 1."""

    def tell(stage, done=0, total=0, *, part=""):
        if stage == "training" and done == batch:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_run(read_all([data], folder / "crops"), options(**chosen), folder, device="cpu", tell=tell)
    return folder


def state(folder):
    """All that a checkpoint keeps of network and optimizer, as bytes by name."""
    kept = load_checkpoint(folder)
    found = {name: value.numpy().tobytes() for name, value in kept.network.items()}
    for number, of_one in kept.optimizer["state"].items():
        found |= {f"{number} {name}": value.numpy().tobytes() for name, value in of_one.items()}
    return kept.epoch, kept.options, dict(kept.origin), kept.optimizer["param_groups"], found


def same(folder, other):
    assert state(folder) == state(other)
    for name in ("log.csv", "run.toml", "curves.html"):
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    """Eight people, trained long enough to be known; and the network as it was at first."""
    data = coloured_people(tmp_path_factory.mktemp("data") / "court", people=8, learnt=8)
    folder = tmp_path_factory.mktemp("learnt")
    chosen = {"people_per_batch": 8, "pictures_per_person": 4, "epochs": 16, "validate_every": 16, "warm_up_epochs": 2,
              "learning_rate": 2e-3}  # fmt: skip
    return data, folder, run(data, folder, **chosen)


def test_who_was_learnt_is_found_again(learnt):
    data, folder, trained = learnt
    rows = TrainingLog(folder).rows()
    assert len(rows) == 16
    assert rows[0].identity_loss > 0.9 * np.log(8)  # which is what guessing costs
    assert rows[-1].identity_loss < 0.75 * np.log(8)
    assert rows[-1].triplet_loss < rows[0].triplet_loss
    assert rows[-1].loss == pytest.approx(rows[-1].identity_loss + rows[-1].triplet_loss, rel=1e-6)
    # Other pictures than those learnt from, among 8 people: 1 in 8 by chance.
    assert rows[-1].rank_1 > 4 / 8
    assert trained.last == rows[-1]
    split = course(read_all([data], folder / "crops"), options())
    embed, _ = run_embedder(folder)
    distance = 1 - embed(split.query) @ embed(split.gallery).T
    right = split.gallery.person[distance.argmin(axis=1)] == split.query.person
    assert right.mean() == rows[-1].rank_1, "the checkpoint is the network that was validated"


def test_the_record_of_a_training(whole):
    rows = TrainingLog(whole).rows()
    assert [row.epoch for row in rows] == [1, 2, 3, 4]
    assert [row.step for row in rows] == [BATCHES * row.epoch for row in rows]
    assert [row.rank_1 is not None for row in rows] == [False, True, False, True]
    assert [row.learning_rate for row in rows] == [learning_rate(options(), row.step - 1, BATCHES) for row in rows]
    kept = load_checkpoint(whole)
    assert (kept.epoch, kept.options, kept.people) == (4, options(), 6)
    assert (kept.origin["data"], kept.origin["pictures"]) == ("court", "24")
    # The options as a file that `--config` takes.
    path = whole / "again.toml"
    path.write_text(tomli_w.dumps(tomllib.loads((whole / "run.toml").read_text())["options"]))
    assert train_options(config=path) == options()


def test_the_learning_rate_rises_then_falls():
    chosen = TrainOptions(epochs=20, warm_up_epochs=4, learning_rate=1e-3)
    rates = np.array([learning_rate(chosen, step, 5) for step in range(100)])
    np.testing.assert_allclose(rates[:20], 1e-3 * np.arange(1, 21) / 20)
    assert rates[20] == pytest.approx(1e-3)
    assert rates[60] == pytest.approx(0.5e-3)
    assert (np.diff(rates[20:]) < 0).all()
    assert 0 < rates[-1] < 2e-6
    constant = replace(chosen, schedule="constant")
    assert {learning_rate(constant, step, 5) for step in range(20, 100)} == {1e-3}
    assert learning_rate(replace(chosen, warm_up_epochs=0), 0, 5) == pytest.approx(1e-3)


def test_weights_without_decay():
    """Biases and the normalisations' scales are not drawn to nothing."""
    network = training.ReidNetwork(open_backbone("small", (32, 16), "random", 1), 5, options(pooling="gem"))
    decayed, exempt = training._parameters(network, options())
    assert decayed["weight_decay"] == options().weight_decay
    assert exempt["weight_decay"] == 0
    assert all(value.ndim > 1 for value in decayed["params"])
    assert any(value is network.power for value in exempt["params"])
    learnt = sum(value.numel() for value in network.parameters() if value.requires_grad)
    assert sum(value.numel() for group in (decayed, exempt) for value in group["params"]) == learnt


def test_a_picture_is_varied_anew_each_time(data, tmp_path):
    """By seed, epoch and place in it, and by nothing else."""
    crops = read_all([data], tmp_path)[0].train
    draws = [(3, 0, 5), (3, 1, 5), (3, 0, 6)]
    shown = [training._Pictures(crops, options(seed=seed))[draw][0].numpy() for seed in (0, 1) for draw in draws]
    again = [training._Pictures(crops, options(seed=seed))[draw][0].numpy() for seed in (0, 1) for draw in draws]
    assert len({one.tobytes() for one in shown}) == 6
    assert [one.tobytes() for one in again] == [one.tobytes() for one in shown]


def test_people_who_may_be_the_same(data, tmp_path):
    """A set of which only some people are known to be two is learnt from, and the same way each time."""
    crops = read_all([data], tmp_path)[0].train
    apart = ~np.eye(6, dtype=bool)
    apart[0, 1] = apart[1, 0] = False
    crops = CropSet(crops.paths, crops.person, crops.camera, crops.people, crops.cameras, apart)
    for name in ("a", "b"):
        train(crops, options(epochs=2), tmp_path / name, origin={}, device="cpu")
    assert state(tmp_path / "a") == state(tmp_path / "b")


def test_a_seed_gives_one_network(data, whole, tmp_path):
    run(data, tmp_path / "again")
    same(tmp_path / "again", whole)
    run(data, tmp_path / "other", seed=1)
    assert (tmp_path / "other" / "log.csv").read_bytes() != (whole / "log.csv").read_bytes()
    assert state(tmp_path / "other")[-1] != state(whole)[-1]


@pytest.mark.parametrize("batch", [1, BATCHES, 2 * BATCHES + 2, 4 * BATCHES])
def test_interrupted_and_begun_again(data, whole, tmp_path, batch):
    stopped(data, tmp_path, batch)
    assert (tmp_path / "checkpoint.pt").exists() == (batch > BATCHES)
    trained = run(data, tmp_path)
    assert trained.resumed_after == (batch - 1) // BATCHES
    same(tmp_path, whole)


@pytest.mark.parametrize("moment", [("batch", 2 * BATCHES + 2), ("name", 6)])
def test_killed_and_begun_again(data, whole, tmp_path, moment):
    """In the middle of an epoch; with an epoch in the log whose checkpoint is written, but has no name yet."""
    train_until(data, tmp_path, TINY, moment)
    trained = run(data, tmp_path)
    assert 0 < trained.resumed_after < 4
    same(tmp_path, whole)


def test_interrupted_when_begun_with_a_run(data, whole, tmp_path):
    chosen = {"weights": str(whole), "seed": 3}
    other = coloured_people(tmp_path / "yard", seed=9)
    run(other, tmp_path / "whole", **chosen)
    stopped(other, tmp_path / "stopped", 2 * BATCHES + 1, **chosen)
    trained = run(other, tmp_path / "stopped", **chosen)
    assert trained.resumed_after == 2
    same(tmp_path / "stopped", tmp_path / "whole")
    assert load_checkpoint(tmp_path / "whole").origin["began_with"] == "court, 4 epochs"


def test_what_a_run_begins_with(data, whole, tmp_path):
    """All weights but those of the classifier, which is of other people."""
    network, note, _ = training._begin_training(
        read_all([coloured_people(tmp_path / "yard", people=5, seed=9)], tmp_path)[0].train,
        options(weights=str(whole)), {}, None,
    )  # fmt: skip
    kept = load_checkpoint(whole).network
    found = network.state_dict()
    assert found["classifier.weight"].shape == (5, network.channels)
    assert all(torch.equal(found[name], value) for name, value in kept.items() if name != "classifier.weight")
    assert "after 4 epochs on court" in note


def test_a_finished_training_stays_as_it_is(data, whole, tmp_path):
    shutil.copytree(whole, tmp_path / "run")
    trained = run(data, tmp_path / "run")
    assert trained.resumed_after == 4
    assert trained.last == TrainingLog(whole).rows()[-1]
    same(tmp_path / "run", whole)
    assert (tmp_path / "run" / "checkpoint.pt").read_bytes() == (whole / "checkpoint.pt").read_bytes()


def test_going_on_in_a_folder_that_was_moved_and_with_more_readers(data, whole, tmp_path):
    """Where pictures and run lie is not what a training is made of."""
    shutil.copytree(data, tmp_path / "elsewhere" / "court")
    stopped(data, tmp_path / "run", 2 * BATCHES)
    shutil.move(tmp_path / "run", tmp_path / "moved")
    run(tmp_path / "elsewhere" / "court", tmp_path / "moved")
    same(tmp_path / "moved", whole)
    # How many processes read pictures changes nothing either.
    stopped(data, tmp_path / "more", 3 * BATCHES + 1)
    assert run(data, tmp_path / "more", workers=1).resumed_after == 3
    assert state(tmp_path / "more")[-1] == state(whole)[-1]
    assert (tmp_path / "more" / "log.csv").read_bytes() == (whole / "log.csv").read_bytes()


def poisoned(monkeypatch, call, how):
    """The loss of one batch, counted from 1, is `how(loss, answers)`."""
    calls, plain = 0, ReidLoss.forward

    def forward(self, answers, person):
        nonlocal calls
        calls += 1
        loss = plain(self, answers, person)
        return how(loss, answers) if calls == call else loss

    monkeypatch.setattr(ReidLoss, "forward", forward)


def broken_gradient(loss, answers):
    """A loss that is a number, with a gradient that is none: 0 times the infinite slope of the root at 0."""
    return replace(loss, total=loss.total + (0 * answers.pooled.sum()).sqrt())


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_loss_that_is_no_number(data, whole, tmp_path, monkeypatch, value):
    with monkeypatch.context() as patched:
        poisoned(patched, 1, lambda loss, answers: replace(loss, total=loss.total * value))
        with pytest.raises(InputError, match="in epoch 1, batch 1: nothing was stored, it was the first epoch"):
            run(data, tmp_path)
        assert not (tmp_path / "checkpoint.pt").exists()
    with monkeypatch.context() as patched:
        poisoned(patched, 2 * BATCHES + 2, lambda loss, answers: replace(loss, total=loss.total * value))
        said = rf"the loss is {value} in epoch 3, batch 2: checkpoint.pt has the network after epoch 2: lower learning_rate"
        with pytest.raises(InputError, match=said):
            run(data, tmp_path)
    assert load_checkpoint(tmp_path).epoch == 2
    load_checkpoint(tmp_path).restored()
    assert len(TrainingLog(tmp_path).rows()) == 2
    run(data, tmp_path)
    same(tmp_path, whole)


@pytest.mark.parametrize("epoch", [2, 3, 4])
def test_weights_that_are_no_numbers_are_never_kept(data, tmp_path, monkeypatch, epoch):
    """The last step of an epoch breaks the network; whether the epoch is validated or not makes no difference."""
    poisoned(monkeypatch, epoch * BATCHES, broken_gradient)
    told = f"weights are not numbers in epoch {epoch}, batch {BATCHES}: checkpoint.pt has the network after epoch {epoch - 1}"
    with pytest.raises(InputError, match=told):
        run(data, tmp_path)
    kept = load_checkpoint(tmp_path)
    assert kept.epoch == epoch - 1
    assert all(bool(value.isfinite().all()) for value in kept.network.values())
    assert [row.epoch for row in TrainingLog(tmp_path).rows()] == list(range(1, epoch))


def test_steps_that_are_far_too_large(data, tmp_path):
    told = r"the loss is \S+ in epoch 1, batch \d: nothing was stored.* lower learning_rate \(10\)"
    with pytest.raises(InputError, match=told):
        run(data, tmp_path, learning_rate=10, warm_up_epochs=0, neck=False, pooling="gem")


OTHERS = {"learning_rate": 2e-3, "epochs": 5, "seed": 1, "neck": False, "height": 48, "backbone": "resnet-18"}


@pytest.mark.parametrize(("key", "value"), OTHERS.items(), ids=OTHERS)
def test_going_on_with_other_options(data, whole, key, value):
    was = (whole / "checkpoint.pt").read_bytes()
    known = options().to_dict()[key]
    with pytest.raises(InputError, match=f"checkpoint.pt: an earlier training had {key} = {known!r}, this one has {value!r}"):
        run(data, whole, **{key: value})
    assert (whole / "checkpoint.pt").read_bytes() == was


def test_going_on_with_other_pictures(data, whole, tmp_path):
    more, named = (shutil.copytree(data, tmp_path / name / "court") for name in ("more", "named"))
    coloured_person(more / "train" / "0001" / "0001_c1s1_000099_00.png", 1, np.random.default_rng(0), 1.0)
    (named / "train" / "0001").rename(named / "train" / "0077")
    for other in (coloured_people(tmp_path / "court", seed=1), more, named):
        with pytest.raises(InputError, match=r"checkpoint.pt: an earlier training was on other images: give another folder"):
            run(other, whole)


def test_weights_that_do_not_fit_or_are_not_there(data, whole, tmp_path):
    weights, fit = str(whole), "does not fit the options neck and pooling"
    for chosen, told in (
        ({"weights": weights, "backbone": "resnet-18"}, 'is of the backbone small, not resnet-18: give backbone = "small"'),
        ({"weights": weights, "neck": False}, fit),
        ({"weights": weights, "pooling": "gem"}, fit),
        ({"weights": str(tmp_path / "nowhere")}, "nowhere: no such file"),
    ):
        with pytest.raises(InputError, match=told):
            run(data, tmp_path / "run", **chosen)
        assert not (tmp_path / "run" / "checkpoint.pt").exists()


def test_too_few_to_learn_from(data, tmp_path):
    crops = read_all([data], tmp_path)[0].train
    for few, told in (
        (crops.of_people(np.array([2])), "training: 1 people with two images or more: at least two are needed"),
        (crops.take(np.arange(21)), "a person with one image only"),
        (CropSet(), "training: 0 people"),
    ):
        with pytest.raises(InputError, match=told):
            train(few, options(), tmp_path / "run", origin={})
    assert not (tmp_path / "run").exists()


def test_people_are_held_out_where_nothing_else_validates(tmp_path):
    people = coloured_people(tmp_path / "court", people=30, learnt=2, searched=0)
    sets = read_all([people], tmp_path)
    split = course(sets, options(hold_out=0.1))
    assert len(split.learnt.people) == 27
    assert len(split.query.people) == 3
    assert len(split.gallery) == 0
    assert not set(split.learnt.people) & set(split.query.people)
    assert len(split.learnt) + len(split.query) == 60
    assert course(sets, options()).query.paths == course(sets, options()).query.paths
    assert course(sets, options(seed=1)).query.paths != split.query.paths
    assert not len(course(sets, options(hold_out=0)).query)
    # Few people are all learnt from.
    few = course(read_all([coloured_people(tmp_path / "few", people=10, searched=0)], tmp_path), options(hold_out=0.5))
    assert (len(few.learnt.people), len(few.query)) == (10, 0)
    assert few.validated_on.startswith("no person")


def test_fine_tuning_is_gentler(whole, tmp_path):
    chosen = fine_tuning(load_checkpoint(whole), whole)
    assert chosen.learning_rate == pytest.approx(0.3e-3)
    assert chosen.epochs == 40
    assert chosen.weights == str(whole)
    assert (chosen.backbone, chosen.height, chosen.width) == ("small", 32, 16)
