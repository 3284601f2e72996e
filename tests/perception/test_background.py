"""People found before a learnt background, against pictures whose figures are known; and in videos that lie on their side."""

import io

import cv2
import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.perception.background import (
    BackgroundDetector,
    BackgroundModel,
    BackgroundOptions,
    learn_background,
    plan_sampling,
)
from passerby.perception.foreground import find_usual_colours
from passerby.perception.opening import turn_that_shows_people
from passerby.perception.pictures import Detections, Frame
from passerby.perception.video import TURNS, VideoReader, probe
from support.scenes.pictures_of_figures import COLOURS, HEIGHT, WIDTH, Figure, ground, picture, recording
from support.scenes.puppet_videos import pictures as pictures_of
from support.scenes.puppet_videos import puppets, write_video

COUNT = 30
RED = Figure(240, 300, COLOURS[0])


@pytest.fixture(scope="module")
def model() -> BackgroundModel:
    return learn_background(recording(COUNT), plan_sampling(COUNT))


@pytest.fixture(scope="module")
def sunny() -> BackgroundModel:
    return learn_background(recording(COUNT, shadow=0.55), plan_sampling(COUNT))


def drawn(*figures: Figure, seed: int = 77, **how: object) -> np.ndarray:
    return picture(list(figures), np.random.default_rng(seed), **how)


def found(model: BackgroundModel, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    people = BackgroundDetector(model)(Frame(1, 10.0, shown))
    return people.ltwh, people.score


def worst_edge(model: BackgroundModel, shown: np.ndarray, figure: Figure) -> float:
    """Pixels between the edges of the one box found and the figure's."""
    (box,), truth = found(model, shown)[0], np.array(figure.ltwh)
    return float(np.abs(np.concatenate([box[:2] - truth[:2], (box[:2] + box[2:]) - (truth[:2] + truth[2:])])).max())


def test_the_background_is_the_empty_scene_and_the_height_of_people_is_learnt(model: BackgroundModel) -> None:
    off = np.abs(model.colour[0] - cv2.blur(ground().astype(np.uint8), (3, 3)).astype(float))
    assert off.mean() < 1.5
    assert off.max() < 20
    feet = np.array([[150.0, 180.0], [240.0, 250.0], [300.0, 330.0]])
    assert model.stature.height(feet) == pytest.approx(0.45 * (feet[:, 1] - 60.0), rel=0.05)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("foot", [190, 320])
def test_a_person_alone_is_found_within_two_pixels(model: BackgroundModel, foot: float, colour: tuple[int, int, int]) -> None:
    shown, figure = drawn(Figure(211.3, foot, colour)), Figure(211.3, foot, colour)
    assert worst_edge(model, shown, figure) < 2.5
    assert found(model, shown)[1][0] == 1.0


@pytest.mark.parametrize("gain", [0.8, 0.93, 1.07, 1.2])
def test_another_exposure_makes_no_people_and_hides_none(model: BackgroundModel, gain: float) -> None:
    assert len(found(model, drawn(gain=gain))[0]) == 0
    assert worst_edge(model, drawn(RED, gain=gain), RED) < 3.0


def test_noise_and_low_things_and_a_shadow_without_a_person_are_no_people(
    model: BackgroundModel, sunny: BackgroundModel
) -> None:
    """A dog is a quarter as tall as a person, a car wider than tall."""
    low, shadow = ground().copy(), ground().copy()
    low[290:318, 100:150], low[200:280, 200:400] = (30, 30, 30), (200, 60, 60)
    shadow[240:330, 150:185] *= 0.55
    assert [len(found(model, drawn(**how))[0]) for how in ({"noise": 2.5}, {"noise": 6.0}, {"scene": low})] == [0, 0, 0]
    assert len(found(sunny, drawn(scene=shadow))[0]) == 0


def test_a_shadow_is_no_part_of_a_person_and_clothes_as_grey_as_one_are(sunny: BackgroundModel) -> None:
    """The clothes: legs that are the ground in half of the light, between a coloured trunk and light shoes."""
    assert sunny.tone == pytest.approx(0.55, abs=0.05)
    for foot in (190, 250, 320):
        figure = Figure(200, foot, COLOURS[0], shadow=0.55)
        assert worst_edge(sunny, drawn(figure), figure) < 0.05 * figure.tall + 2.0
    figure = Figure(200, 300, COLOURS[0])
    shown, still = drawn(figure, seed=1), drawn(seed=2)
    legs = slice(round(300 - 0.40 * figure.tall), round(300 - 0.06 * figure.tall))
    body = np.abs(shown[legs].astype(int) - still[legs]).max(axis=2) > 40
    shown[legs][body] = (0.55 * still[legs][body]).astype(np.uint8)
    assert worst_edge(sunny, shown, figure) < 5.0


@pytest.mark.slow
def test_a_person_who_stands_for_nearly_half_of_the_time_is_found() -> None:
    standing, frames, rng = Figure(240, 330, (40, 60, 170)), recording(COUNT), np.random.default_rng(8)
    frames[8:21] = [Frame(frame.number, frame.seconds, picture([standing], rng)) for frame in frames[8:21]]
    model = learn_background(frames, plan_sampling(COUNT))
    assert worst_edge(model, drawn(standing), standing) < 2.5
    assert len(found(model, drawn())[0]) == 0


def test_two_side_by_side_are_two_or_none(model: BackgroundModel) -> None:
    """A box is one person's, never both people's; where they only touch, both are found, with less certainty."""
    for gap in np.arange(0.16, 0.5, 0.04):
        pair = [Figure(200, 300, COLOURS[0]), Figure(200 + gap * 108, 303, COLOURS[1])]
        boxes, score = found(model, drawn(*pair))
        for box in boxes[score > 0.5]:
            assert min(abs(box[0] + 0.5 * box[2] - one.x) for one in pair) < 0.12 * pair[0].tall
            assert box[2] < 0.45 * pair[0].tall
    pair = [Figure(200, 300, COLOURS[0]), Figure(232, 302, COLOURS[1])]
    boxes, score = found(model, drawn(*pair))
    assert (score < 1.0).all()
    for box, one in zip(boxes[np.argsort(boxes[:, 0])], pair, strict=True):
        assert np.abs(box - one.ltwh).max() < 8.0


def test_a_person_behind_a_signpost_is_one_and_a_box_at_the_border_ends_there(model: BackgroundModel) -> None:
    """A thing of the background hides the belt: the two parts are joined."""
    figure = Figure(240, 310, COLOURS[0])
    shown, still = drawn(figure, seed=3), drawn(seed=4)
    shown[240:256] = still[240:256]
    assert worst_edge(model, shown, figure) < 3.0
    (box,), (score,) = found(model, drawn(Figure(8, 300, COLOURS[0])))
    assert box[0] == pytest.approx(0.0, abs=1.0)
    assert (box[:2] >= 0).all()
    assert (box[:2] + box[2:] <= (WIDTH, HEIGHT)).all()
    assert score < 1.0


@pytest.mark.slow
def test_swaying_leaves_are_no_people() -> None:
    """A region that changes from picture to picture is no evidence; beside it people are found."""
    rng, frames, figure = np.random.default_rng(9), recording(COUNT), Figure(200, 300, COLOURS[0])
    for frame in frames:
        frame.picture[80:200, 380:460] = rng.integers(30, 200, (120, 80, 1))
    model = learn_background(frames, plan_sampling(COUNT))
    shown = picture([figure], rng)
    shown[80:200, 380:460] = rng.integers(30, 200, (120, 80, 1))
    assert worst_edge(model, shown, figure) < 2.5


@pytest.mark.slow
def test_the_light_of_the_day_is_followed() -> None:
    """In each window of the recording another part of the scene lies in the shade of a house."""
    rng, frames = np.random.default_rng(4), []
    for second in range(40):
        scene = ground().copy()
        scene[:, : 120 + 6 * second] *= 0.7
        frames.append(Frame(second + 1, float(second), picture([], rng, scene=scene)))
    options = BackgroundOptions(window_s=10.0, pictures=10)
    model = learn_background(frames, plan_sampling(40.0, options), options)
    assert len(model.seconds) == 4
    detector = BackgroundDetector(model, options)
    assert sum(len(detector(frame)) for frame in frames[::5]) == 0


@pytest.mark.slow
def test_wide_pictures_give_the_boxes_of_narrow_ones(model: BackgroundModel) -> None:
    """Twice the pixels: twice the boxes, within a pixel of the working picture."""
    frames = recording(COUNT)
    large = [Frame(f.number, f.seconds, cv2.resize(f.picture, (2 * WIDTH, 2 * HEIGHT))) for f in frames]
    options = BackgroundOptions(working_width=WIDTH)
    wide = BackgroundDetector(learn_background(large, plan_sampling(COUNT), options), options)
    narrow = BackgroundDetector(model, options)
    for one, two in zip(frames[:6], large[:6], strict=True):
        a, b = narrow(one), wide(two)
        assert len(a) == len(b) > 0
        assert 0.5 * b.ltwh == pytest.approx(a.ltwh, abs=2.01)


def test_the_model_survives_its_arrays_and_the_order_of_pictures_decides_nothing(sunny: BackgroundModel) -> None:
    file = io.BytesIO()
    np.savez(file, **sunny.to_arrays())  # type: ignore[arg-type]
    file.seek(0)
    with np.load(file) as arrays:
        other = BackgroundDetector(BackgroundModel.from_arrays(arrays))
    one, frames = BackgroundDetector(sunny), recording(8, shadow=0.55)
    backwards = [other(frame) for frame in frames[::-1]][::-1]
    for a, b in zip(map(one, frames), backwards, strict=True):
        assert len(a) > 0
        assert (a.ltwh == b.ltwh).all()
        assert (a.score == b.score).all()


@pytest.mark.slow
def test_the_same_pictures_give_the_same_model_and_more_than_asked_for_are_passed_over(model: BackgroundModel) -> None:
    again = learn_background(recording(COUNT), plan_sampling(COUNT)).to_arrays()
    assert all((array == again[name]).all() for name, array in model.to_arrays().items())
    options, rng = BackgroundOptions(pictures=10), np.random.default_rng(3)
    thin = [Frame(i, float(i), picture([], rng)) for i in range(20)]
    grey = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    dense = [Frame(2 * i + k, i + 0.5 * k, frame.picture if k == 0 else grey) for i, frame in enumerate(thin) for k in (0, 1)]
    plan = plan_sampling(20.0, BackgroundOptions(pictures=20))
    one, other = learn_background(thin, plan, options), learn_background(dense, plan, options)
    assert (one.colour == other.colour).all()


@pytest.mark.slow
def test_too_few_or_odd_pictures_and_options_out_of_range_are_refused() -> None:
    frames, odd = recording(8), Frame(9, 9.0, np.zeros((10, 20, 3), np.uint8))
    with pytest.raises(EvidenceError, match="4 frames are too few"):
        learn_background(frames[:4], plan_sampling(4.0))
    for act, why in (
        (lambda: learn_background([*frames, odd], plan_sampling(8.0)), "20 x 10"),
        (lambda: BackgroundDetector(learn_background(frames, plan_sampling(8.0)))(odd), "its background 480 x 360"),
        (lambda: BackgroundOptions(pictures=2), "pictures = 2"),
        (lambda: plan_sampling(0.0), "recording of 0"),
    ):
        with pytest.raises(InputError, match=why):
            act()


def test_usual_colours_are_the_half_sample_modes_of_each_pixel() -> None:
    rng = np.random.default_rng(4)
    for count in (1, 2, 3, 5, 20, 61, 300):
        people = (rng.random((count, 6, 5, 1)) < 0.3) * rng.integers(-200, 200, (count, 6, 5, 1))
        shown = rng.integers(0, 256, (6, 5, 3)) + rng.normal(0, 6, (count, 6, 5, 3)) + people
        pictures = np.clip(shown, 0, 255).astype(np.uint8)
        colour, noise = find_usual_colours(list(pictures))
        for at in np.ndindex(6, 5, 3):
            every = np.sort(pictures[(slice(None), *at)].astype(int))
            samples, median = every, every[count // 2]
            for _ in range(2):
                half = (len(samples) + 1) // 2
                pieces = [samples[first : first + half] for first in range(len(samples) - half + 1)]
                samples = min(pieces, key=lambda piece: (piece[-1] - piece[0], abs(piece[(half - 1) // 2] - median)))
            assert colour[at] == samples[(len(samples) - 1) // 2]
            away = np.sort(np.abs(every - int(colour[at])))
            sigma = max(np.median(away) / 0.6745, away[: max(count // 2, 1)].mean() / 0.3247)
            assert abs(int(noise[at]) - min(8 * sigma, 255)) <= 0.51


def upright_picture(number: int) -> np.ndarray:
    """Red heads above blue trousers, two of them."""
    shown = np.full((240, 320, 3), 128, np.uint8)
    for left in (60 + number, 200 - number):
        shown[60:100, left : left + 40], shown[100:180, left : left + 40] = (0, 0, 255), (255, 0, 0)
    return shown


def heads_above_trousers(frame: Frame) -> Detections:
    """Finds people who stand: red right above blue."""
    shown = frame.picture.astype(int)
    red, blue = shown[..., 2] - shown[..., 0] > 100, shown[..., 0] - shown[..., 2] > 100
    standing = (red[:-8] & blue[8:]).any(axis=0)
    count = int(np.count_nonzero(np.diff(standing.astype(int)) == 1))
    return Detections(np.tile([10.0, 10.0, 20.0, 60.0], (count, 1)), np.full(count, 0.9))


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_the_turn_that_shows_people_is_found(tmp_path, turn):
    """A video filmed so that `turn` degrees clockwise stand its people upright."""
    upright = (upright_picture(number) for number in range(30))
    info = probe(write_video(tmp_path / "a.mp4", (cv2.rotate(one, TURNS[turn]) if turn else one for one in upright), 5.0))
    assert turn_that_shows_people(info, heads_above_trousers) == turn
    assert turn_that_shows_people(info.turned(turn), heads_above_trousers) == 0


@pytest.mark.parametrize("turn", [90, 270])
def test_background_subtraction_sees_people_on_their_side(tmp_path, turn):
    """Whether these stand on their heads after a turn it cannot see."""
    made = puppets(24.0, 5.0, 2, 3)
    path = write_video(tmp_path / "a.mp4", (cv2.rotate(one, TURNS[turn]) for one in pictures_of(made, "C1")), made.fps)
    for degrees, expected in ((0, {90, 270}), (turn, {0})):
        info = probe(path).turned(degrees)
        sampling = plan_sampling(info.seconds)
        model = learn_background(VideoReader(info, rate=1.0 / sampling.interval_s), sampling)
        assert turn_that_shows_people(info, BackgroundDetector(model)) in expected
