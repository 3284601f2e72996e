"""What a batch is made of."""

from pathlib import Path

import numpy as np
import pytest

from passerby.training.crops import CropSet
from passerby.training.pictures import BatchSampler


def crops_of(person, camera=None, apart=None):
    """A set of pictures that do not exist."""
    person = np.asarray(person)
    camera = np.zeros(len(person), np.int64) if camera is None else np.asarray(camera)
    names = (tuple(f"set/{letter}{number}" for number in range(one.max() + 1)) for letter, one in (("", person), ("c", camera)))
    return CropSet(tuple(Path(f"{row}.png") for row in range(len(person))), person, camera, *names, apart)


def rows(sampler, epoch=0):
    """The rows of each batch of an epoch."""
    sampler.epoch = epoch
    return [[row for row, _, _ in batch] for batch in sampler]


def all_apart(people):
    return ~np.eye(people, dtype=bool)


BOTH = pytest.mark.parametrize("known", [False, True], ids=["all apart", "apart by a table"])


def many(known):
    """12 people with 5 to 9 pictures, mixed up."""
    person = np.random.default_rng(0).permutation(np.repeat(np.arange(12), 5 + np.arange(12) % 5))
    return crops_of(person, apart=all_apart(12) if known else None)


@BOTH
def test_p_people_and_k_pictures_of_each(known):
    crops = many(known)
    sampler = BatchSampler(crops, 4, 3, seed=1)
    batches = rows(sampler)
    assert sampler.size == 12
    assert len(batches) == len(sampler) == round(len(crops) / 12)
    for batch in batches:
        people, counts = np.unique(crops.person[batch], return_counts=True)
        assert len(people) == 4
        assert (counts == 3).all()
        assert len(set(batch)) == 12, "no picture twice while there are others"
    sampler.epoch = 7
    draws = [draw for batch in sampler for draw in batch]
    assert [place for _, _, place in draws] == list(range(len(draws))), "every picture has a place of its own"
    assert {epoch for _, epoch, _ in draws} == {7}


@BOTH
def test_fewer_people_or_pictures_than_asked_for(known):
    crops = crops_of([0] * 5 + [1] * 5 + [2] * 5, apart=all_apart(3) if known else None)
    batches = rows(BatchSampler(crops, 16, 4, seed=0))
    assert len(batches) == round(15 / 12)
    assert np.bincount(crops.person[batches[0]]).tolist() == [4, 4, 4]
    crops = crops_of([0, 0] + [1] * 6 + [2] * 3, apart=all_apart(3) if known else None)
    for epoch in range(5):
        for batch in rows(BatchSampler(crops, 3, 4, seed=0), epoch):
            assert np.bincount(crops.person[batch]).tolist() == [4, 4, 4]
            assert len({row for row in batch if crops.person[row] == 1}) == 4
    crops = crops_of([0, 0, 3, 3, 5, 5], apart=all_apart(6) if known else None)
    for batch in rows(BatchSampler(crops, 6, 2, seed=0)):
        assert sorted(crops.person[batch].tolist()) == [0, 0, 3, 3, 5, 5], "people without pictures are left out"


@BOTH
def test_an_epoch_follows_from_seed_and_number(known):
    crops = many(known)
    sampler = BatchSampler(crops, 4, 3, seed=1)
    first = [rows(sampler, epoch) for epoch in range(4)]
    np.random.seed(99)  # noqa: NPY002 -- a generator of others, which must not matter
    np.random.default_rng(5).random(10)
    assert rows(BatchSampler(crops, 4, 3, seed=1), 2) == first[2]
    assert rows(sampler, 2) == first[2], "whatever was drawn before"
    assert all(first[a] != first[b] for a in range(4) for b in range(a))
    assert rows(BatchSampler(crops, 4, 3, seed=2), 2) not in first


@BOTH
def test_all_are_shown_in_time(known):
    crops = many(known)
    sampler = BatchSampler(crops, 4, 3, seed=3)
    counts = np.bincount([row for epoch in range(60) for batch in rows(sampler, epoch) for row in batch], minlength=len(crops))
    # 60 pictures' worth an epoch on the mean; who has few of them is seen oftener, by less than the ratio of numbers, 9 to 5.
    assert counts.min() > 20
    assert counts.max() < 140
    by_person = np.bincount(crops.person, weights=counts)
    assert by_person.max() < 1.5 * by_person.min(), "people come equally often"


def ring(people):
    """Each may be the same person as the one before and the one behind."""
    off = np.abs(np.subtract.outer(np.arange(people), np.arange(people)))
    return (off > 1) & (off < people - 1)


def test_batches_hold_only_people_who_are_apart():
    apart = ring(9)
    crops = crops_of(np.repeat(np.arange(9), 4), apart=apart)
    sizes = set()
    for epoch in range(20):
        for batch in rows(BatchSampler(crops, 4, 2, seed=0), epoch):
            people, counts = np.unique(crops.person[batch], return_counts=True)
            assert (counts == 2).all()
            assert all(apart[a, b] for a in people for b in people if a != b)
            free = [p for p in range(9) if p not in people and apart[p, people].all()]
            assert len(people) == 4 or not free, "nobody could have been added"
            sizes.add(len(people))
    assert sizes == {3, 4}
    # A person apart from no other is alone.
    apart = all_apart(4)
    apart[0], apart[:, 0] = False, False
    crops = crops_of(np.repeat(np.arange(4), 3), apart=apart)
    batches = [batch for epoch in range(30) for batch in rows(BatchSampler(crops, 4, 2, 0), epoch)]
    assert {frozenset(crops.person[batch].tolist()) for batch in batches} == {frozenset({0}), frozenset({1, 2, 3})}


def test_pictures_are_spread_over_the_cameras():
    """One camera has 20 pictures of each person, two have 2: each has its share of a batch all the same."""
    person = np.repeat(np.arange(3), 24)
    camera = np.tile([0] * 20 + [1] * 2 + [2] * 2, 3)
    crops = crops_of(person, camera, apart=all_apart(3))
    total = np.zeros(3)
    for epoch in range(10):
        for batch in rows(BatchSampler(crops, 3, 4, seed=0), epoch):
            for one in range(3):
                mine = [row for row in batch if person[row] == one]
                shares = np.bincount(camera[mine], minlength=3)
                assert sorted(shares.tolist()) == [1, 1, 2]
                assert len(set(mine)) == 4
                total += shares
    assert total.max() < 1.4 * total.min(), "the odd one is any camera's"
