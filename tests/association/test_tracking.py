"""Detections followed into tracklets of one person, and given tracklets split where they change person."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.association.tracking.splitting import SplittingOptions, find_continuations, find_motion_links, split_tracklets
from passerby.association.tracking.tracking import TrackingOptions, track
from passerby.common.errors import InputError
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import read_boxes
from support.scenes.simulated import faulty_scene
from support.tiers import thinned

FAULTS = {"box_noise": 0.02, "missing": 0.1, "false_boxes": 0.05, "cameras": 2, "seconds": 20.0}


def seen(preset: str, fps: float, **changes: object) -> Boxes:
    """The boxes of a simulated camera, with the true identities."""
    return faulty_scene(preset=preset, fps=fps, **{**FAULTS, **changes}).observations["C1"].boxes


def forgotten(boxes: Boxes) -> Boxes:
    return replace(boxes, identity=np.full(len(boxes), -1))


def purity(tracklet: np.ndarray, truth: np.ndarray) -> float:
    """Share of the boxes in tracklets whose tracklet's commonest person is theirs; boxes without one (-1) count as one more."""
    use = tracklet >= 0
    _, inverse = np.unique(tracklet[use], return_inverse=True)
    people, person = np.unique(truth[use], return_inverse=True)
    table = np.zeros((inverse.max() + 1, len(people)))
    np.add.at(table, (inverse, person), 1)
    return float(table.max(axis=1).sum() / table.sum())


def count(tracklet: np.ndarray) -> int:
    return len(np.unique(tracklet[tracklet >= 0]))


def covered(tracklet: np.ndarray, truth: np.ndarray) -> float:
    """Share of the people's boxes that are in a tracklet."""
    return float((tracklet >= 0)[truth >= 0].mean())


def worn(boxes: Boxes, spread: float, seed: int = 0, alike: bool = False) -> Boxes:
    """The boxes with embeddings: one direction a person, and noise of so many times its length; nothing but noise if alike."""
    rng = np.random.default_rng(seed)
    person = 0.0 if alike else rng.standard_normal((boxes.identity.max() + 2, 64))[boxes.identity]
    return replace(boxes, embedding=person + spread * rng.standard_normal((len(boxes), 64)))


def walker(start: tuple[float, float], velocity: tuple[float, float], frames: np.ndarray, identity: int, fps: float) -> Boxes:
    """A person of 100 pixels who walks straight: top left corner at frame 0 and velocity in pixels per second."""
    corner = np.array(start) + np.array(velocity) * (frames / fps)[:, None]
    size = np.tile([40.0, 100.0], (len(frames), 1))
    return Boxes(frames, np.full(len(frames), identity), np.hstack([corner, size]), np.ones(len(frames)))


def together(*parts: Boxes) -> Boxes:
    columns = ("frame", "identity", "ltwh", "score")
    return Boxes(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))


def with_swaps(boxes: Boxes, fps: float, every_s: float) -> tuple[Boxes, int]:
    """Every so many seconds the two people nearest to each other exchange their numbers for good."""
    identity, swaps = np.array(boxes.identity), 0
    for second in np.arange(every_s, boxes.frame.max() / fps, every_s):
        frame = int(second * fps)
        here = np.flatnonzero((boxes.frame == frame) & (identity >= 0))
        place = boxes.ltwh[here, :2] + boxes.ltwh[here, 2:] / 2
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + 1e9 * np.eye(len(here))
        one, two = identity[here[list(np.unravel_index(np.argmin(apart), apart.shape))]]
        later = boxes.frame >= frame
        first, second_one = later & (identity == one), later & (identity == two)
        identity[first], identity[second_one] = two, one
        swaps += 1
    return replace(boxes, identity=identity), swaps


@thinned(
    ("preset", "fps", "changes", "least_pure", "most"),
    [
        ("terrace", 5.0, {}, 0.985, 0.65),
        ("terrace", 25.0, {}, 0.985, 0.88),
        ("basketball", 5.0, {}, 0.985, 0.75),
        ("basketball", 10.0, {}, 0.985, 0.85),
        ("construction", 2.0, {}, 0.985, 0.6),
        ("construction", 10.0, {}, 0.985, 0.9),
        # A crowd: fourteen people on 80 square metres; without the margin the purity is 0.94.
        ("terrace", 5.0, {"people": 14}, 0.985, 0.5),
        ("terrace", 10.0, {"false_boxes": 1.0}, 0.98, 0.75),
    ],
)
def test_tracklets_are_of_one_person(preset: str, fps: float, changes: dict, least_pure: float, most: float) -> None:
    boxes = seen(preset, fps, **changes)
    found = track(forgotten(boxes), fps)
    assert purity(found.identity, boxes.identity) > least_pure
    assert covered(found.identity, boxes.identity) > most
    np.testing.assert_array_equal(found.ltwh, boxes.ltwh)
    np.testing.assert_array_equal(found.frame, boxes.frame)
    if "false_boxes" in changes:
        assert (found.identity[boxes.identity < 0] >= 0).mean() < 0.05


@pytest.mark.slow
def test_scores_that_say_nothing_do_not_matter() -> None:
    boxes = seen("basketball", 10.0)
    found = track(replace(forgotten(boxes), score=np.ones(len(boxes))), 10.0).identity
    assert purity(found, boxes.identity) > 0.985
    assert covered(found, boxes.identity) > 0.85


def test_neither_the_order_of_the_rows_nor_the_numbers_of_frames_matter() -> None:
    boxes = forgotten(seen("terrace", 10.0))
    found = track(boxes, 10.0).identity
    shuffle = np.random.default_rng(0).permutation(len(boxes))
    np.testing.assert_array_equal(track(boxes.take(shuffle), 10.0).identity, found[shuffle])
    np.testing.assert_array_equal(track(replace(boxes, frame=boxes.frame * 10 + 3), 100.0).identity, found)


@pytest.mark.parametrize("nearest", [0.0, 16.0])
def test_two_who_merge_and_part_are_not_guessed(nearest: float) -> None:
    """Two walk towards each other, stand together for a while and part: whether they passed or turned back cannot be seen.

    Their boxes come as near as so many pixels, and are off by two: at 16 the best guess would go on.
    """
    frames, rng = np.arange(60), np.random.default_rng(0)
    still = walker((300, 50), (0, 0), frames, -1, 10.0)
    there = np.concatenate([np.linspace(150, nearest / 2, 25), np.full(10, nearest / 2), np.linspace(nearest / 2, 150, 25)])
    offset = np.stack([there, *np.zeros((3, 60))], axis=1)
    left, right = (replace(still, ltwh=still.ltwh + side * offset + rng.normal(0, 2, (60, 4))) for side in (-1, 1))
    found = track(together(left, right), 10.0).identity
    before, after = {int(found[10]), int(found[70])}, {int(found[50]), int(found[110])}
    assert -1 not in before | after
    assert len(before) == len(after) == 2
    assert not before & after


def test_embeddings_help_where_people_differ_and_harm_nowhere() -> None:
    boxes = seen("terrace", 5.0)
    plain = track(forgotten(boxes), 5.0).identity
    told = track(forgotten(worn(boxes, 1.0)), 5.0).identity
    assert purity(told, boxes.identity) >= purity(plain, boxes.identity)
    assert covered(told, boxes.identity) > covered(plain, boxes.identity) + 0.05
    assert count(told) < 0.8 * count(plain)
    alike = track(forgotten(worn(boxes, 1.0, alike=True)), 5.0).identity
    np.testing.assert_array_equal(alike, plain)


LONE = walker((0, 0), (0, 0), np.arange(1), -1, 5.0)


def going(left: float, top: float, pace: float, frames: np.ndarray, number: int = -1, score: float = 1.0) -> Boxes:
    return replace(walker((left, top), (pace, 0), frames, number, 10.0), score=np.full(len(frames), score))


FRAMES = np.arange(60)
DIM = replace(going(100, 50, 60, FRAMES[:30]), score=np.where(np.isin(FRAMES[:30], (12, 13)), 0.4, 1.0))


def repeated(numbers: dict[int, int]) -> np.ndarray:
    """So many boxes of each number follow one another."""
    return np.repeat(np.array(list(numbers), dtype=int), np.array(list(numbers.values()), dtype=int))


@pytest.mark.parametrize(
    ("boxes", "numbers"),
    [
        ([going(100, 50, 60, FRAMES), going(400, 200, -60, FRAMES)], {0: 60, 1: 60}),
        # A gap of 0.6 s is bridged, one of 1.3 s is not.
        ([going(100, 50, 60, np.setdiff1d(FRAMES, [*range(20, 26), *range(40, 53)]))], {0: 34, 1: 7}),
        # Found twice.
        ([going(102, 51, 60, FRAMES[:20], score=0.9), going(100, 50, 60, FRAMES[:20])], {-1: 20, 0: 20}),
        # Weak boxes continue a tracklet but begin none.
        ([DIM, going(100, 400, 60, FRAMES[:30], score=0.4), going(700, 700, 0, FRAMES[:10], score=0.3)], {0: 30, -1: 40}),
        ([Boxes.empty()], {}),
        ([LONE], {-1: 1}),
        ([LONE, LONE, walker((300, 0), (0, 0), np.arange(1), -1, 5.0)], {-1: 3}),
    ],
    ids=["pass at different distances", "gaps", "twice", "weak", "nothing", "one box", "three boxes"],
)
def test_a_few_people_are_followed(boxes: list[Boxes], numbers: dict[int, int]) -> None:
    np.testing.assert_array_equal(track(together(*boxes), 10.0).identity, repeated(numbers))


STEADY = going(100, 50, 30, FRAMES[:20], 3)
GROWN = going(60, 0, 30, FRAMES[20:40], 3)


@pytest.mark.parametrize(
    ("boxes", "numbers"),
    [
        ([STEADY, going(400, 50, 30, FRAMES[20:40], 3)], {3: 20, 4: 20}),
        ([STEADY, going(100, 50, 30, FRAMES[31:51], 3)], {3: 20, 4: 20}),
        ([STEADY, replace(GROWN, ltwh=GROWN.ltwh * [1, 1, 2, 2])], {3: 20, 4: 20}),
        # Unknown rows are left, and numbers stay unique.
        ([going(100, 50, 30, FRAMES[:20], 7), going(600, 50, 30, FRAMES[40:], 7), going(100, 400, 30, FRAMES, 2),
          going(500, 500, 0, FRAMES[:5])], {7: 20, 8: 20, 2: 60, -1: 5}),
        ([Boxes.empty()], {}),
    ],
    ids=["jump", "gap", "change of size", "numbers", "nothing"],
)  # fmt: skip
def test_tracklets_are_split(boxes: list[Boxes], numbers: dict[int, int]) -> None:
    np.testing.assert_array_equal(split_tracklets(together(*boxes), 10.0).identity, repeated(numbers))


def test_one_misplaced_or_misnamed_box_and_a_half_hidden_person_do_not_split() -> None:
    """Not even the second box of all, though what came before it is the very first one."""
    whole = going(100, 50, 30, FRAMES[:40], 3)
    ltwh = np.array(whole.ltwh)
    ltwh[20, 0] += 300
    ltwh[30:34, 3] = 45
    np.testing.assert_array_equal(split_tracklets(replace(whole, ltwh=ltwh), 10.0).identity, whole.identity)
    for frame in (1, 20):
        one, two = (going(100, top, 10, FRAMES[:40], number) for number, top in ((0, 50), (1, 900)))
        boxes = together(replace(one, identity=np.where(one.frame == frame, 1, 0)), two.take(two.frame != frame))
        np.testing.assert_array_equal(split_tracklets(boxes, 10.0).identity, boxes.identity)


def test_bad_input_is_named() -> None:
    for act, told in (
        (lambda: track(LONE, 0.0), "fps = 0"),
        (lambda: split_tracklets(LONE, float("nan")), "fps = nan"),
        (lambda: TrackingOptions(max_gap_s=-1.0), "max_gap_s = -1"),
        (lambda: SplittingOptions(size_ratio=0.5), r"size_ratio = 0\.5"),
    ):
        with pytest.raises(InputError, match=told):
            act()


def test_true_tracklets_stay_whole_whatever_the_embeddings() -> None:
    boxes = seen("construction", 5.0, false_boxes=0.0)
    gaps_only = SplittingOptions(max_speed=1e6, size_ratio=1e6, cross_check=False)
    by_gaps = count(split_tracklets(boxes, 5.0, gaps_only).identity)
    for told in (boxes, worn(boxes, 1.0), worn(boxes, 3.0), worn(boxes, 1.0, alike=True)):
        assert count(split_tracklets(told, 5.0).identity) <= by_gaps + 2


@thinned("preset", ["terrace", "basketball"])
def test_swapped_tracklets_are_split(preset: str) -> None:
    boxes = seen(preset, 10.0, false_boxes=0.0)
    wrong, swaps = with_swaps(boxes, 10.0, 3.0)
    pieces = count(split_tracklets(boxes, 10.0).identity)
    before = purity(wrong.identity, boxes.identity)
    by_motion = split_tracklets(wrong, 10.0).identity
    told = worn(boxes, 1.0)
    by_both = split_tracklets(replace(told, identity=wrong.identity), 10.0).identity
    assert before < 0.85
    assert purity(by_motion, boxes.identity) > 0.93
    assert purity(by_both, boxes.identity) > 0.99
    assert count(by_both) <= pieces + 3 * swaps


def test_a_tracklet_that_broke_goes_on_as_the_next_whatever_the_order_of_the_rows() -> None:
    """The other person stays one, boxes without a number are left out, and links that are known change nothing."""
    one, two = (walker((100, top), (10, 0), np.arange(40), number, 10.0) for number, top in ((3, 50), (7, 900)))
    broken = replace(one, identity=np.where(one.frame < 20, 3, 9)).take((one.frame < 18) | (one.frame > 21))
    nobody = replace(two, ltwh=two.ltwh + [800, 0, 0, 0], identity=np.full(len(two), -1))
    boxes = together(broken, nobody, two)
    shuffled = boxes.take(np.random.default_rng(0).permutation(len(boxes)))
    for rows in (boxes, shuffled):
        links = find_motion_links(rows, 10.0)
        before, after = find_continuations(rows, links)
        assert (before.tolist(), after.tolist()) == ([3], [9])
        np.testing.assert_array_equal(split_tracklets(rows, 10.0, links=links).identity, split_tracklets(rows, 10.0).identity)


def test_a_change_of_appearance_alone_splits_where_it_is() -> None:
    """And where only every tenth box has an embedding, these tell as much as if there were no others."""
    rng = np.random.default_rng(3)
    people = rng.standard_normal((3, 64))
    one, two = (going(100, top, 10, np.arange(100), number) for number, top in ((0, 50), (1, 400)))
    wears = np.concatenate([np.repeat([0, 2], [60, 40]), np.repeat(1, 100)])
    boxes = replace(together(one, two), embedding=people[wears] + 1.5 * rng.standard_normal((200, 64)))
    found = split_tracklets(boxes, 10.0).identity
    assert count(found) == 3
    assert abs(int(np.flatnonzero(found[:100] != 0)[0]) - 60) <= 1
    wears = np.repeat([0, 3, 1, 2], [60, 60, 120, 120])
    boxes = together(*(going(100 + 200 * number, 50, 0, np.arange(120), number) for number in range(3)))
    rare = replace(boxes, embedding=np.where(boxes.frame % 10 == 0, 1.0, 0.0)[:, None] * np.eye(4)[wears])
    np.testing.assert_array_equal(split_tracklets(rare, 10.0).identity, np.where(wears == 3, 3, boxes.identity))


@pytest.mark.real
@pytest.mark.parametrize(("camera", "least"), [("V1", 0.98), ("V5", 0.945)])
def test_pets(data_root: Path, camera: str, least: float) -> None:
    """Real detections at 7 fps. The labels flicker between people who walk side by side: 0.96 is about all there is."""
    folder = data_root / "pets2009"
    if not folder.is_dir():
        pytest.skip(f"no data set {folder}")
    boxes, labelled = (read_boxes(folder / kind / f"{camera}.txt") for kind in ("detections", "identities"))
    rows = zip(labelled.frame.tolist(), labelled.ltwh.tolist(), labelled.identity.tolist(), strict=True)
    person = {(frame, *box): number for frame, box, number in rows}
    truth = np.array(
        [person.get((frame, *box), -1) for frame, box in zip(boxes.frame.tolist(), boxes.ltwh.tolist(), strict=True)]
    )
    found = track(boxes, 7.0).identity
    assert (truth >= 0).mean() > 0.8
    known = truth >= 0
    assert purity(found[known], truth[known]) > least
    assert covered(found, truth) > 0.9
