"""Cameras that stand, shake, are knocked and turned, in pictures with people, lights and noise."""

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.perception.pictures import Frame, Picture
from passerby.perception.places import find_moves_between
from passerby.perception.steadiness import Steadiness, SteadinessWatcher
from passerby.perception.video import frames, probe
from support.tiers import thinned

SIZE = (480, 320)
MARGIN = 200
COUNT = 40


def texture(seed: int) -> Picture:
    """A wide random scene: soft ground and some hundred sharp things on it."""
    rng = np.random.default_rng(seed)
    width, height = SIZE[0] + 2 * MARGIN, SIZE[1] + 2 * MARGIN
    rough = cv2.GaussianBlur(rng.uniform(0, 255, (height, width, 3)).astype(np.float32), (0, 0), 6)
    scene = np.asarray(np.clip(120 + (rough - rough.mean()) * 4, 0, 255), dtype=np.uint8)
    for _ in range(250):
        x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
        w, h = rng.integers(5, 40, 2)
        scene[y : y + h, x : x + w] = rng.integers(0, 255, 3)
    return np.asarray(cv2.GaussianBlur(scene, (0, 0), 0.8), dtype=np.uint8)


SCENE = texture(1)


def seen(dx: float = 0.0, dy: float = 0.0, degrees: float = 0.0, scene: Picture = SCENE, zoom: float = 1.0) -> Picture:
    """The scene by a camera whose picture is shifted, turned and zoomed."""
    centre = (MARGIN + SIZE[0] / 2, MARGIN + SIZE[1] / 2)
    motion = cv2.getRotationMatrix2D(centre, degrees, zoom)
    motion[:, 2] += np.array([dx - MARGIN, dy - MARGIN])
    return np.asarray(cv2.warpAffine(scene, motion, SIZE, flags=cv2.INTER_LINEAR), dtype=np.uint8)


def crowded(picture: Picture, rng: np.random.Generator, part: float) -> Picture:
    """Textured people over at least this part of the picture."""
    picture, hidden = picture.copy(), np.zeros(picture.shape[:2], dtype=bool)
    while hidden.mean() < part:
        x, y = int(rng.integers(-20, SIZE[0])), int(rng.integers(-60, SIZE[1]))
        body = rng.integers(0, 255, (12, 5, 3)).astype(np.uint8)
        body = np.asarray(cv2.resize(body, (40, 110), interpolation=cv2.INTER_LINEAR))
        left, top = max(x, 0), max(y, 0)
        inside = picture[top : y + 110, left : x + 40]
        inside[:] = body[top - y : top - y + inside.shape[0], left - x : left - x + inside.shape[1]]
        hidden[top : y + 110, left : x + 40] = True
    return picture


def watching(pictures: Iterable[Picture]) -> SteadinessWatcher:
    watcher = SteadinessWatcher(SIZE)
    for k, picture in enumerate(pictures):
        watcher.look(Frame(k + 1, float(k), picture))
    return watcher


def watched(pictures: Iterable[Picture]) -> Steadiness:
    return watching(pictures).result()


def changed(after: Picture, at: int = 17, crowd: float = 0.0) -> Steadiness:
    """The usual view up to a second and another from there on, with noise and people."""
    rng = np.random.default_rng(0)
    return watched(crowded(noisy(seen() if k < at else after, rng), rng, crowd) for k in range(COUNT))


def noisy(picture: Picture, rng: np.random.Generator, sigma: float = 6.0) -> Picture:
    return np.asarray(np.clip(picture + rng.normal(0, sigma, picture.shape), 0, 255), dtype=np.uint8)


def test_a_camera_that_stands_and_one_that_shakes_a_little() -> None:
    rng = np.random.default_rng(0)
    told = watched(noisy(seen(), rng) for _ in range(COUNT))
    assert (told.moves, told.pictures, told.recognised) == ((), COUNT, COUNT)
    assert told.largest_shake_px < 0.1
    shifts = rng.uniform(-0.8, 0.8, (COUNT, 2))
    shifts[0] = 0.0
    told = watched(noisy(seen(*shift), rng) for shift in shifts)
    assert told.moves == ()
    assert told.largest_shake_px == pytest.approx(np.linalg.norm(shifts, axis=1).max(), abs=0.25)


@pytest.mark.slow
@thinned("part", [0.1, 0.3, 0.5, 0.7], quick=2)
def test_people_are_no_move(part: float) -> None:
    rng = np.random.default_rng(0)
    told = watched(crowded(noisy(seen(), rng), rng, part) for _ in range(COUNT))
    assert told.moves == ()
    assert told.recognised >= (0.9 * COUNT if part <= 0.3 else 1)
    if part == 0.1:  # a crowd in one half of every picture
        crowds, free = [crowded(seen(), rng, 0.97) for _ in range(COUNT)], seen()
        halves = [(np.concatenate([free[:160], crowd[160:]]), np.hstack([free[:, :240], crowd[:, 240:]])) for crowd in crowds]
        told = watched(pair[k % 20 >= 10] for k, pair in enumerate(halves))
        assert (told.moves, told.recognised) == ((), COUNT)


LIGHTS: dict[str, Callable[[Picture, int], np.ndarray]] = {
    "half the lights go off": lambda p, k: p * (0.4 if k >= 20 else 1.0),
    "a lamp at one side": lambda p, k: p * np.linspace(0.4, 1.5, SIZE[0])[:, None] if k >= 20 else p,
    "automatic exposure": lambda p, k: p * (1 + 0.4 * np.sin(k / 3)) + 10 * np.cos(k),
    "blinking": lambda p, k: p * (0.15 if k % 2 else 1.0),
    "dark": lambda p, k: p * (0.0 if k >= 20 else 1.0),
    "overexposed": lambda p, k: p * 0 + 255 if k >= 20 else p,
}


@thinned("light", LIGHTS, quick=2)
def test_lights_are_no_move(light: str) -> None:
    rng = np.random.default_rng(0)
    lit = (np.asarray(np.clip(LIGHTS[light](seen(), k), 0, 255), dtype=np.uint8) for k in range(COUNT))
    told = watched(noisy(p, rng, 2.0) for p in lit)
    assert told.moves == ()
    assert told.recognised >= 20


@thinned(
    ("dx", "dy", "degrees"),
    [(0.0075 * 480, 0, 0), (-3, 3, 0), (0, -15, 0), (60, 25, 0), (150, 0, 0), (0, 0, 2), (20, 10, 6), (-40, 10, -3)],
    quick=2,
)
@thinned("crowd", [0.0, 0.35])
def test_a_camera_that_is_moved_for_good(dx: float, dy: float, degrees: float, crowd: float) -> None:
    told = changed(seen(dx, dy, degrees), crowd=crowd)
    (move,) = told.moves
    assert (move.seconds, move.until, told.lasting) == (17.0, None, told.moves)
    assert move.pixels is not None
    x, y = np.meshgrid(np.linspace(0, SIZE[0], 9) - SIZE[0] / 2, np.linspace(0, SIZE[1], 9) - SIZE[1] / 2)
    turn = np.deg2rad(degrees)
    shift = np.hypot(np.cos(turn) * x + np.sin(turn) * y + dx - x, np.cos(turn) * y - np.sin(turn) * x + dy - y)
    assert move.pixels == pytest.approx(float(np.median(shift)), rel=0.25, abs=0.4)


@pytest.mark.slow
def test_a_move_is_no_zoom_and_a_camera_that_is_turned_to_something_else_is_not_measured() -> None:
    for dx, degrees in ((3.6, 0), (60, 0), (-40, -3), (0, 2)):
        (move,) = changed(seen(dx, 0, degrees)).moves
        assert move.zoom == 1.0
    told = changed(seen(scene=texture(2)), at=12)
    (move,) = told.moves
    assert (move.seconds, move.until, move.pixels, told.recognised) == (12.0, None, None, 12)
    assert len({changed(seen(0.5, 0, 4.0), crowd=0.3) for _ in range(2)}) == 1, "the same pictures give the same bits"


@thinned(("zoom", "until"), [(1.03, None), (1.1, None), (1.1, 21.0), (1.3, None), (0.8, None)], every=2)
def test_a_zoom_is_named_and_measured(zoom: float, until: float | None) -> None:
    rng = np.random.default_rng(0)
    (move,) = watched(noisy(seen(zoom=zoom if 17 <= k < (until or COUNT) else 1.0), rng) for k in range(COUNT)).moves
    assert (move.seconds, move.until, move.zoom) == (17.0, until, pytest.approx(zoom, rel=0.005))


def test_a_knock_is_over_and_the_camera_stands_again_but_there_and_back_after_long_are_two_moves() -> None:
    told = watched(seen(9.0, 2.0) if 15 <= k < 18 else seen() for k in range(COUNT))
    (move,) = told.moves
    assert (move.seconds, move.until, move.pixels) == (15.0, 18.0, pytest.approx(np.hypot(9, 2), abs=0.5))
    assert told.lasting == ()
    told = watched(seen(9.0) if 10 <= k < 25 else seen() for k in range(COUNT))
    assert [(move.seconds, move.until) for move in told.moves] == [(10.0, None), (25.0, None)]
    sags = watched(seen(0.0, 0.15 * k) for k in range(COUNT))
    assert sags.lasting, "a mount that sags"
    assert 15 <= sags.lasting[0].seconds <= 20


def test_somebody_before_the_lens_or_a_crowd_that_comes_and_stays_is_no_move() -> None:
    coat, crowd = seen(scene=texture(3)), crowded(seen(), np.random.default_rng(0), 0.6)
    told = watched(coat if 10 <= k < 25 else seen() for k in range(COUNT))
    assert (told.moves, told.recognised) == ((), COUNT - 15)
    told = watched([seen()] * 10 + [crowd] * 30)
    assert (told.moves, told.recognised) == ((), COUNT)
    crowd = crowded(seen(), np.random.default_rng(0), 0.95)
    (move,) = watched([crowd] + [seen()] * 20 + [seen(8.0)] * 19).moves
    assert (move.seconds, move.until) == (21.0, None), "after a first picture full of people"
    told = watched([np.full((SIZE[1], SIZE[0], 3), 127, dtype=np.uint8)] * 20)
    assert told.moves == (), "nothing to hold on to"
    assert told.recognised <= 1
    assert watched([]) == Steadiness((), 0.0, 0, 0)


def test_a_move_between_two_stretches_is_found_once() -> None:
    rng = np.random.default_rng(5)
    places = [(0.0, 0.0), (0.0, 0.3), (7.0, 0.0), (7.0, 0.0), (0.0, 0.0)]
    shown = [watching(crowded(noisy(seen(*at), rng), rng, 0.2) for _ in range(10)).view for at in places]
    views = [(100.0 * k, view) for k, view in enumerate(shown)]
    moves = [(move.seconds, move.until, move.pixels) for move in find_moves_between(views, SIZE)]
    assert moves == [(seconds, None, pytest.approx(7.0, abs=0.5)) for seconds in (200.0, 400.0)]


def test_another_scene_says_nothing_of_a_move() -> None:
    """After an hour the light may be another; moves are found by what is recognised, and the first place is remembered."""
    other = texture(2)
    first, second, third, back = (
        watching([one] * 4).view for one in (seen(), seen(scene=other), seen(9.0, scene=other), seen(7.0))
    )
    for views, moves in (((first, second, third), [200.0]), ((first, second), []), ((first, second, back), [200.0]), ((), [])):
        timed = [(100.0 * k, view) for k, view in enumerate(views)]
        assert [move.seconds for move in find_moves_between(timed, SIZE)] == moves


def test_real_cameras_stand(data_root: Path) -> None:
    for path, rate in [(data_root / "pets2009" / "V1.avi", 0.5), (data_root / "pose2sim_single" / "videos" / "cam02.mp4", 6.0)]:
        info = probe(path)
        watcher = SteadinessWatcher(info.size)
        for frame in frames(info, rate):
            watcher.look(frame)
        told = watcher.result()
        assert told.moves == ()
        assert told.recognised == told.pictures
        assert told.largest_shake_px < 0.3
