"""Broken tracklets that are joined again, and those that are not."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from metrics.tracklets import score_tracklets
from passerby.association.tracking.matching import clear_matches
from passerby.association.tracking.stitching import StitchingOptions, find_stitches, stitch_tracklets
from passerby.association.tracking.tracking import track
from passerby.common.errors import InputError
from passerby.core.observations import Boxes
from support.scenes.simulated import scene
from support.tiers import thinned

FPS = 10.0


def walker(identity: int, frames: np.ndarray, start: tuple[float, float], velocity: tuple[float, float]) -> Boxes:
    """Somebody of 100 pixels: top left corner at frame 0, pixels per second, and a detector's noise of 2 pixels."""
    noise = np.random.default_rng([0, identity]).normal(0.0, 2.0, (len(frames), 4))
    corner = np.array(start) + np.array(velocity) * (frames / FPS)[:, None]
    ltwh = np.hstack([corner, np.tile([40.0, 100.0], (len(frames), 1))]) + noise
    return Boxes(frames, np.full(len(frames), identity), ltwh, np.ones(len(frames)))


def together(*parts: Boxes) -> Boxes:
    columns = [np.concatenate([getattr(part, name) for part in parts]) for name in ("frame", "identity", "ltwh", "score")]
    embeddings = [part.embedding for part in parts if part.embedding is not None]
    return Boxes(*columns, np.concatenate(embeddings) if embeddings else None)


def worn(boxes: Boxes, appearance: dict[int, int]) -> Boxes:
    """With embeddings: one direction for each look, and noise of its length. `appearance`: of the identities."""
    directions = np.random.default_rng(99).standard_normal((100, 32))
    worn_by = np.array([appearance.get(number, number) for number in boxes.identity.tolist()])
    noise = np.random.default_rng(0).standard_normal((len(boxes), 32))
    return replace(boxes, embedding=directions[worn_by] + noise)


def others() -> Boxes:
    """People who pass far above and below, whole: the camera's other people, numbered from 50 on."""
    frames = np.arange(0, 60)
    return together(*(walker(50 + k, frames, (150.0 * (k % 12), -900.0 if k < 12 else 1200.0), (0.0, 60.0)) for k in range(24)))


def crossing() -> Boxes:
    """Two whose ways cross at a right angle, and who are not seen for 0.8 s about the crossing."""
    frames = np.arange(60)
    hidden = np.abs(frames - 29.5) <= 0.8 * FPS / 2
    parts = []
    for number, side in ((0, -1.0), (1, 1.0)):
        velocity = 100.0 * np.array([np.cos(np.pi / 4), side * np.sin(np.pi / 4)])
        own = walker(number, frames, tuple(np.array([300.0, 300.0]) - 2.95 * velocity), tuple(velocity)).take(~hidden)
        parts.append(replace(own, identity=own.identity + np.where(own.frame < 30, 10, 20)))
    return together(*parts)


def merging(appearance: dict[int, int] | None = None) -> Boxes:
    """Two who walk towards each other, stand together unseen and part: 10 and 11, then 20 and 21 who may be either.

    They come from the left and the right and leave upwards and downwards.
    """
    frames = np.arange(0, 25)
    left, right = walker(10, frames, (200.0, 100.0), (60.0, 0.0)), walker(11, frames, (500.0, 100.0), (-60.0, 0.0))
    later = np.arange(45, 70)
    up, down = walker(20, later, (350.0, 370.0), (0.0, -60.0)), walker(21, later, (350.0, -170.0), (0.0, 60.0))
    boxes = together(left, right, up, down, others())
    return boxes if appearance is None else worn(boxes, appearance)


def hidden() -> Boxes:
    """Somebody behind a pillar for two seconds."""
    frames = np.arange(80)
    seen = walker(0, frames, (100.0, 100.0), (80.0, 0.0)).take((frames < 30) | (frames > 50))
    return replace(seen, identity=np.where(seen.frame < 40, 4, 9))


def turned_round() -> Boxes:
    """At the moment at which one person would reappear somebody comes from there at a run: no walker turned round like that."""
    running = walker(9, np.arange(50, 80), (1500.0, 100.0), (-200.0, 0.0))
    return together(walker(4, np.arange(30), (100.0, 100.0), (80.0, 0.0)), running)


def look_alikes(end: int, place: float, pace: float, begin: int, other_place: float, other_pace: float) -> Boxes:
    """Two of one look: the frame of the end or begin, how far right, and pixels per second."""
    first = walker(1, np.arange(end), (place, 100.0), (pace, 0.0))
    second = walker(2, np.arange(begin, begin + 30), (other_place, 100.0), (other_pace, 0.0))
    return worn(together(first, second, others()), {1: 7, 2: 7})


CASES = {
    "hidden behind a pillar": (hidden(), {4: 4, 9: 4}),
    "another person comes out on the other side": (turned_round(), {4: 4, 9: 9}),
    "two who cross go on straight": (crossing(), {10: 10, 20: 10, 11: 11, 21: 11}),
    "merged and parted, no looks": (merging(), {10: 10, 11: 11, 20: 20, 21: 21}),
    "merged and parted, all alike": (merging({10: 1, 11: 1, 20: 1, 21: 1}), {10: 10, 11: 11, 20: 20, 21: 21}),
    "merged and turned back": (merging({20: 10, 21: 11}), {10: 10, 11: 11, 20: 10, 21: 11}),
    "merged and passed each other": (merging({20: 11, 21: 10}), {10: 10, 11: 11, 20: 11, 21: 10}),
    "alike ten seconds later at the very place": (look_alikes(30, 100.0, 80.0, 130, 100.0, 80.0), {1: 1, 2: 2}),
    "alike after two at the other end of the picture": (look_alikes(30, 100.0, 80.0, 50, 1900.0, -80.0), {1: 1, 2: 2}),
    "alike but seen together": (look_alikes(40, 0.0, 50.0, 38, 10.0, 50.0), {1: 1, 2: 2}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_tracklet_goes_on_as_another_where_nothing_else_is_possible(case: str) -> None:
    boxes, wanted = CASES[case]
    found = stitch_tracklets(boxes, FPS).identity
    assert {number: set(found[boxes.identity == number].tolist()) for number in wanted} == {
        number: {fixed} for number, fixed in wanted.items()
    }
    if case == "hidden behind a pillar":
        assert [column.tolist() for column in find_stitches(boxes, FPS)] == [[4], [9]]


@pytest.mark.slow
@thinned(
    ("preset", "embeddings", "people", "least", "purity"),
    [
        ("terrace", "distinct", 7, 0.8, 0.99),
        ("basketball", "distinct", 14, 0.9, 0.99),
        ("terrace", "distinct", 12, 0.85, 0.99),
        ("construction", "none", 8, 0.85, 0.99),
        ("terrace", "none", 7, 0.4, 0.88),
        ("basketball", "alike", 14, 0.4, 0.9),
    ],
)
def test_simulated_people_are_followed(preset: str, embeddings: str, people: int, least: float, purity: float) -> None:
    """IDF1 and purity over two seeds, of tracked detections, fixed.

    Measured 0.87, 0.96, 0.96, 0.97, 0.49 and 0.51 (before 0.55, 0.73, 0.49, 0.83, 0.24 and 0.22), with purities of 1.00 but for
    the last two, 0.93.
    """
    before, after, pure = [], [], []
    for seed in (2, 3):
        truth = scene(
            preset=preset, seconds=40.0, fps=7.0, seed=seed, people=people, cameras=1, box_noise=0.02, missing=0.1,
            false_boxes=0.1, embeddings=embeddings,
        ).observations["C1"].boxes  # fmt: skip
        found = track(replace(truth, identity=np.full(len(truth), -1)), 7.0)
        fixed = stitch_tracklets(found, 7.0)
        np.testing.assert_array_equal(fixed.identity < 0, found.identity < 0)
        scores = [score_tracklets(boxes, truth) for boxes in (found, fixed)]
        before.append(scores[0].idf1)
        after.append(scores[1].idf1)
        pure.append(scores[1].purity)
    assert np.mean(after) > least
    assert np.mean(after) > np.mean(before) + 0.05
    assert np.mean(pure) > purity


def test_neither_the_order_of_the_rows_nor_the_numbers_of_people_or_frames_matter() -> None:
    boxes = merging({20: 11, 21: 10})
    shuffle = np.random.default_rng(0).permutation(len(boxes))
    found = stitch_tracklets(boxes, FPS).identity
    np.testing.assert_array_equal(stitch_tracklets(boxes.take(shuffle), FPS).identity, found[shuffle])
    renamed = replace(boxes, identity=boxes.identity * 3 + 5)
    np.testing.assert_array_equal(stitch_tracklets(renamed, FPS).identity, found * 3 + 5)
    np.testing.assert_array_equal(stitch_tracklets(replace(boxes, frame=boxes.frame * 5 + 3), 5 * FPS).identity, found)


def test_boxes_of_no_tracklet_stay_alone_and_options_out_of_range_are_named() -> None:
    boxes = crossing()
    none = replace(boxes, identity=np.where(boxes.identity == 21, -1, boxes.identity))
    assert (stitch_tracklets(none, FPS).identity[none.identity < 0] == -1).all()
    nothing = replace(boxes, identity=np.full(len(boxes), -1))
    np.testing.assert_array_equal(stitch_tracklets(nothing, FPS).identity, nothing.identity)
    assert [len(column) for column in find_stitches(nothing, FPS)] == [0, 0]
    assert len(stitch_tracklets(Boxes.empty(), FPS)) == 0
    for named, value in (("max_gap_s", 0.0), ("margin", float("nan"))):
        with pytest.raises(InputError, match=f"{named} = {value:g}"):
            StitchingOptions(**{named: value})
    with pytest.raises(InputError, match="fps"):
        stitch_tracklets(boxes, 0.0)


def least(table: np.ndarray) -> tuple[float, list[int]]:
    """Cost and columns of the best assignment of a table of costs, by trying all."""
    ways = permutations(range(len(table)))
    return min((float(sum(table[row, column] for row, column in enumerate(way))), list(way)) for way in ways)


def expected(table: np.ndarray, margin: float) -> list[tuple[int, int]]:
    best, way = least(table)
    out = []
    for row, column in enumerate(way):
        without = table.copy()
        without[row, column] = 0.0
        if table[row, column] < 0 and least(without)[0] - best >= margin:
            out.append((row, column))
    return out


def matched(table: np.ndarray, margin: float) -> list[tuple[int, int]]:
    first, second = np.nonzero(table)
    rows, columns = clear_matches(len(table), first, second, table[first, second], margin)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def test_clear_matches_are_those_that_trying_all_finds() -> None:
    rng, seen = np.random.default_rng(0), 0
    for _ in range(60):
        table = np.where(rng.random((5, 5)) < 0.6, -rng.exponential(4.0, (5, 5)), 0.0)
        assert matched(table, 2.0) == expected(table, 2.0)
        seen += len(expected(table, 2.0))
    assert 60 < seen < 240
    # Two ways alike; one is better; the best link alone would leave the other two with nothing; no links.
    for costs, margin, matches in (
        ([[-5.0, -5.0], [-5.0, -5.0]], 1.0, []),
        ([[-5.0, -5.0], [-5.0, -3.0]], 1.0, [(0, 1), (1, 0)]),
        ([[-6.0, -5.0], [-5.0, 0.0]], 2.0, [(0, 1), (1, 0)]),
        (np.zeros((3, 3)), 1.0, []),
    ):
        assert matched(np.array(costs), margin) == matches


@pytest.mark.slow
def test_ten_thousand_in_a_row_are_matched() -> None:
    """They compete with their neighbours only: nothing of the size of their square is made."""
    n = 10_000
    row = np.arange(n)
    first, second = np.concatenate([row, row[1:]]), np.concatenate([row, row[:-1]])
    cost = np.concatenate([np.full(n, -5.0), np.full(n - 1, -4.0)])
    before, after = clear_matches(n, first, second, cost, 0.5)
    np.testing.assert_array_equal(before, row)
    np.testing.assert_array_equal(after, row)
