"""The losses agree with numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn import functional

from passerby.training.network import Answers, ReidLoss, identity_loss
from passerby.training.options import TrainOptions

OPTIONS = TrainOptions(identity_weight=0, triplet_weight=1, margin=0.3)


def triplet(points, person, options=OPTIONS):
    """The triplet loss of embeddings (N, C), and its gradient."""
    pooled = torch.tensor(points, dtype=torch.float32, requires_grad=True)
    person = torch.tensor(person)
    answers = Answers(pooled, pooled, torch.zeros(len(person), int(person.max()) + 1))
    loss = ReidLoss(options)(answers, person)
    loss.total.backward()
    return loss.triplet.item(), pooled.grad.numpy()


def test_the_hardest_of_a_batch_count():
    # On a line: person 0 at 0, 1 and 4, person 1 at 6 and 9. For each picture its farthest positive and nearest negative:
    # 0: 4 - 6 + 3 = 1; 1: 3 - 5 + 3 = 1; 4: 4 - 2 + 3 = 5; 6: 3 - 2 + 3 = 4; 9: 3 - 5 + 3 = 1. Mean 12 / 5.
    value, gradient = triplet([[0.0], [1], [4], [6], [9]], [0, 0, 0, 1, 1], replace(OPTIONS, margin=3))
    assert value == pytest.approx(12 / 5, rel=1e-6)
    # d/dx of (4-0) - (6-0), (4-1) - (6-1), (4-0) - (6-4), (9-6) - (6-4), (9-6) - (9-4), each a fifth.
    by_hand = [1 - 1 - 1, 1 - 1, 1 + 1 + 1 + 1 + 1 + 1, -1 - 1 - 1 - 1 - 1 - 1, 1 + 1 - 1]
    np.testing.assert_allclose(gradient.ravel(), np.array(by_hand) / 5, atol=1e-6)
    # Distances are of the feature as it is: (0, 0) and (3, 4) are 5 apart; on the unit sphere they would not be. Negatives
    # at 10 and at sqrt(45).
    value, _ = triplet([[0.0, 0], [3, 4], [0, 10], [0, 10]], [0, 0, 1, 1], replace(OPTIONS, margin=6))
    assert value == pytest.approx((5 - 10 + 6 + 5 - np.sqrt(45) + 6 + 0 + 0) / 4, rel=1e-5)


def test_people_farther_than_the_margin_and_batches_without_triplets_cost_nothing():
    # Negatives are 1.4 away at the least and positives 1: 0.4 is more than 0.3; the triplets count for the mean all the same.
    value, gradient = triplet([[0.0], [1], [2.4], [3.4]], [0, 0, 1, 1])
    assert value == 0
    assert not gradient.any()
    value, _ = triplet([[0.0], [1], [2.2], [3.2]], [0, 0, 1, 1])  # 1 - 1.2 + 0.3 for the two in the middle, of four
    assert value == pytest.approx(0.1 / 2, rel=1e-5)
    for person in ([0, 0, 0], [0, 1, 2]):
        value, gradient = triplet([[0.0], [1], [3]], person)
        assert (value, gradient.any()) == (0, False)
    # A network that answers the same to all pays the margin.
    assert triplet([[1.0, 2]] * 4, [0, 0, 1, 1])[0] == pytest.approx(0.3, rel=1e-6)


def test_identity_loss_by_hand():
    # Shares 1/2, 1/4, 1/4 and 1/4, 1/2, 1/4.
    logits = torch.log(torch.tensor([[2.0, 1, 1], [1, 2, 1]]))
    assert identity_loss(logits, torch.tensor([0, 0]), 0).item() == pytest.approx((np.log(2) + np.log(4)) / 2, rel=1e-6)
    # 0.7 of the target on the person, 0.1 on each of the three.
    smooth = (0.8 * np.log(2) + 0.2 * np.log(4) + 0.8 * np.log(4) + 0.1 * np.log(4) + 0.1 * np.log(2)) / 2
    assert identity_loss(logits, torch.tensor([0, 0]), 0.3).item() == pytest.approx(smooth, rel=1e-6)


def test_the_parts_are_weighted():
    pooled = torch.tensor([[0.0], [1], [4], [6], [9]])
    person = torch.tensor([0, 0, 0, 1, 1])
    logits = torch.log(torch.tensor([[3.0, 1]] * 5))
    options = TrainOptions(identity_weight=0.5, triplet_weight=2, margin=3, label_smoothing=0)
    loss = ReidLoss(options)(Answers(pooled, pooled, logits), person)
    by_hand = (3 * np.log(4 / 3) + 2 * np.log(4)) / 5
    assert loss.identity.item() == pytest.approx(by_hand, rel=1e-6)
    assert loss.triplet.item() == pytest.approx(12 / 5, rel=1e-6)
    assert loss.total.item() == pytest.approx(0.5 * by_hand + 2 * 12 / 5, rel=1e-6)


def random_logits(seed=0, people=6, pictures=9):
    rng = np.random.default_rng(seed)
    logits = torch.tensor(rng.normal(0, 3, (pictures, people)), dtype=torch.float32, requires_grad=True)
    return logits, torch.tensor(rng.integers(0, people, pictures))


@pytest.mark.parametrize("smoothing", [0.0, 0.1, 0.5])
def test_where_all_are_apart_nothing_changes(smoothing):
    logits, person = random_logits()
    apart = ~torch.eye(6, dtype=torch.bool)
    options = TrainOptions(label_smoothing=smoothing)
    features = torch.zeros(9, 2)
    plain, masked = (ReidLoss(options, known)(Answers(features, features, logits), person) for known in (None, apart))
    assert masked.identity.item() == pytest.approx(plain.identity.item(), rel=1e-6)
    by_plain, by_masked = (torch.autograd.grad(loss.identity, logits)[0] for loss in (plain, masked))
    np.testing.assert_allclose(by_masked, by_plain, atol=1e-7)


@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_who_may_be_the_same_person_is_no_wrong_answer(smoothing):
    """Tracks 0 and 3 may be one person: the loss is that of a classifier without the other of them."""
    logits, _ = random_logits(pictures=4)
    person = torch.tensor([0, 3, 1, 5])
    unknown = torch.zeros(6, 6, dtype=torch.bool)
    unknown[0, 3] = unknown[3, 0] = True
    loss = identity_loss(logits, person, smoothing, unknown)
    without = [
        functional.cross_entropy(logits[:1, [0, 1, 2, 4, 5]], torch.tensor([0]), label_smoothing=smoothing),
        functional.cross_entropy(logits[1:2, [1, 2, 3, 4, 5]], torch.tensor([2]), label_smoothing=smoothing),
        functional.cross_entropy(logits[2:3], torch.tensor([1]), label_smoothing=smoothing),
        functional.cross_entropy(logits[3:], torch.tensor([5]), label_smoothing=smoothing),
    ]
    assert loss.item() == pytest.approx(torch.stack(without).mean().item(), rel=1e-6)
    gradient = torch.autograd.grad(loss, logits)[0].numpy()
    assert np.isfinite(gradient).all()
    assert gradient[0, 3] == 0
    assert gradient[1, 0] == 0
    assert (gradient != 0).sum() == 4 * 6 - 2
    # A person apart from no other teaches nothing.
    logits, _ = random_logits(people=3, pictures=2)
    loss = identity_loss(logits, torch.tensor([1, 1]), smoothing, ~torch.eye(3, dtype=torch.bool))
    assert loss.item() == 0
    assert not torch.autograd.grad(loss, logits)[0].any()
