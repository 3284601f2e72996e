"""People found before a learnt background, against pictures whose figures are known."""

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
from passerby.perception.pictures import Frame
from support.scenes.pictures_of_figures import COLOURS, HEIGHT, WIDTH, Figure, ground, picture, recording

COUNT = 30


@pytest.fixture(scope="module")
def model() -> BackgroundModel:
    return learn_background(recording(COUNT), plan_sampling(COUNT))


@pytest.fixture(scope="module")
def sunny() -> BackgroundModel:
    return learn_background(recording(COUNT, shadow=0.55), plan_sampling(COUNT))


def found(model: BackgroundModel, figures: list[Figure], **how: object) -> tuple[np.ndarray, np.ndarray]:
    return shown_to(model, picture(figures, np.random.default_rng(77), **how))


def shown_to(model: BackgroundModel, shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    people = BackgroundDetector(model)(Frame(1, 10.0, shown))
    return people.ltwh, people.score


def worst_edge(boxes: np.ndarray, figure: Figure) -> float:
    """Pixels between the edges of the one box and the figure's."""
    (box,) = boxes
    edges = [np.concatenate([one[:2], one[:2] + one[2:]]) for one in (box, np.array(figure.ltwh))]
    return float(np.abs(edges[0] - edges[1]).max())


def test_the_background_is_the_empty_scene_and_the_height_of_people_is_learnt(model: BackgroundModel) -> None:
    off = np.abs(model.colour[0] - cv2.blur(ground().astype(np.uint8), (3, 3)).astype(float))
    assert off.mean() < 1.5
    assert off.max() < 20
    feet = np.array([[150.0, 180.0], [240.0, 250.0], [300.0, 330.0]])
    assert model.stature.height(feet) == pytest.approx(0.45 * (feet[:, 1] - 60.0), rel=0.05)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("foot", [190, 320])
def test_a_person_alone_is_found_within_two_pixels(model: BackgroundModel, foot: float, colour: tuple[int, int, int]) -> None:
    figure = Figure(211.3, foot, colour)
    boxes, score = found(model, [figure])
    assert worst_edge(boxes, figure) < 2.5
    assert score[0] == 1.0


@pytest.mark.parametrize("gain", [0.8, 0.93, 1.07, 1.2])
def test_another_exposure_is_nobody_and_hides_nobody(model: BackgroundModel, gain: float) -> None:
    assert len(found(model, [], gain=gain)[0]) == 0
    figure = Figure(240, 300, COLOURS[0])
    assert worst_edge(found(model, [figure], gain=gain)[0], figure) < 3.0


def test_noise_and_low_things_and_a_shadow_without_a_person_are_nobody(model: BackgroundModel, sunny: BackgroundModel) -> None:
    """A dog is a quarter as tall as a person, a car wider than tall."""
    low, shadow = ground().copy(), ground().copy()
    low[290:318, 100:150], low[200:280, 200:400] = (30, 30, 30), (200, 60, 60)
    shadow[240:330, 150:185] *= 0.55
    assert [len(found(model, [], **how)[0]) for how in ({"noise": 2.5}, {"noise": 6.0}, {"scene": low})] == [0, 0, 0]
    assert len(found(sunny, [], scene=shadow)[0]) == 0


@pytest.mark.parametrize("foot", [190, 250, 320])
def test_a_shadow_is_no_part_of_a_person(sunny: BackgroundModel, foot: float) -> None:
    assert sunny.tone == pytest.approx(0.55, abs=0.05)
    figure = Figure(200, foot, COLOURS[0], shadow=0.55)
    assert worst_edge(found(sunny, [figure])[0], figure) < 0.05 * figure.tall + 2.0


def test_clothes_as_grey_as_a_shadow_leave_the_person_whole(sunny: BackgroundModel) -> None:
    """Legs that are the ground in half of the light, between a coloured trunk and light shoes."""
    figure = Figure(200, 300, COLOURS[0])
    shown = picture([figure], np.random.default_rng(1))
    still = picture([], np.random.default_rng(2))
    legs = slice(round(300 - 0.40 * figure.tall), round(300 - 0.06 * figure.tall))
    body = np.abs(shown[legs].astype(int) - still[legs]).max(axis=2) > 40
    shown[legs][body] = (0.55 * still[legs][body]).astype(np.uint8)
    assert worst_edge(shown_to(sunny, shown)[0], figure) < 5.0


@pytest.mark.slow
def test_who_stands_for_nearly_half_of_the_time_is_found() -> None:
    standing = Figure(240, 330, (40, 60, 170))
    frames = recording(COUNT)
    rng = np.random.default_rng(8)
    frames[8:21] = [Frame(frame.number, frame.seconds, picture([standing], rng)) for frame in frames[8:21]]
    model = learn_background(frames, plan_sampling(COUNT))
    assert worst_edge(found(model, [standing])[0], standing) < 2.5
    assert len(found(model, [])[0]) == 0


def test_two_side_by_side_are_two_or_none(model: BackgroundModel) -> None:
    """A box is one person's, never both people's."""
    for gap in np.arange(0.16, 0.5, 0.04):
        pair = [Figure(200, 300, COLOURS[0]), Figure(200 + gap * 108, 303, COLOURS[1])]
        boxes, score = found(model, pair)
        for box in boxes[score > 0.5]:
            assert min(abs(box[0] + 0.5 * box[2] - one.x) for one in pair) < 0.12 * pair[0].tall
            assert box[2] < 0.45 * pair[0].tall


def test_two_who_touch_are_both_found(model: BackgroundModel) -> None:
    pair = [Figure(200, 300, COLOURS[0]), Figure(232, 302, COLOURS[1])]
    boxes, score = found(model, pair)
    assert (score < 1.0).all()
    for box, one in zip(boxes[np.argsort(boxes[:, 0])], pair, strict=True):
        assert np.abs(box - one.ltwh).max() < 8.0


def test_one_behind_a_signpost_is_one(model: BackgroundModel) -> None:
    """A thing of the background hides the belt: the two parts are joined."""
    figure = Figure(240, 310, COLOURS[0])
    shown, still = picture([figure], np.random.default_rng(3)), picture([], np.random.default_rng(4))
    shown[240:256] = still[240:256]
    assert worst_edge(shown_to(model, shown)[0], figure) < 3.0


@pytest.mark.slow
def test_swaying_leaves_are_nobody() -> None:
    """A region that changes from picture to picture is no evidence; beside it people are found."""
    rng = np.random.default_rng(9)
    frames = recording(COUNT)
    for frame in frames:
        frame.picture[80:200, 380:460] = rng.integers(30, 200, (120, 80, 1))
    model = learn_background(frames, plan_sampling(COUNT))
    figure = Figure(200, 300, COLOURS[0])
    shown = picture([figure], rng)
    shown[80:200, 380:460] = rng.integers(30, 200, (120, 80, 1))
    assert worst_edge(BackgroundDetector(model)(Frame(1, 1.0, shown)).ltwh, figure) < 2.5


def test_a_box_at_the_border_ends_there(model: BackgroundModel) -> None:
    (box,), (score,) = found(model, [Figure(8, 300, COLOURS[0])])
    assert box[0] == pytest.approx(0.0, abs=1.0)
    assert (box[:2] >= 0).all()
    assert (box[:2] + box[2:] <= (WIDTH, HEIGHT)).all()
    assert score < 1.0


@pytest.mark.slow
def test_the_light_of_the_day_is_followed() -> None:
    """In each window of the recording another part of the scene lies in the shade of a house."""
    rng = np.random.default_rng(4)
    frames = []
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


def test_the_model_survives_its_arrays(sunny: BackgroundModel) -> None:
    file = io.BytesIO()
    np.savez(file, **sunny.to_arrays())  # type: ignore[arg-type]
    file.seek(0)
    with np.load(file) as arrays:
        other = BackgroundDetector(BackgroundModel.from_arrays(arrays))
    one = BackgroundDetector(sunny)
    for frame in recording(8, shadow=0.55):
        a, b = one(frame), other(frame)
        assert len(a) > 0
        assert (a.ltwh == b.ltwh).all()
        assert (a.score == b.score).all()


@pytest.mark.slow
def test_the_same_recording_gives_the_same_model_and_order_matters_not_to_the_detector(model: BackgroundModel) -> None:
    again = learn_background(recording(COUNT), plan_sampling(COUNT))
    for name, array in model.to_arrays().items():
        assert (array == again.to_arrays()[name]).all(), name
    frames = recording(6)
    forwards, backwards = BackgroundDetector(model), BackgroundDetector(model)
    ahead = [forwards(frame).ltwh for frame in frames]
    back = [backwards(frame).ltwh for frame in frames[::-1]][::-1]
    assert all((a == b).all() for a, b in zip(ahead, back, strict=True))


@pytest.mark.slow
def test_more_pictures_than_asked_for_are_passed_over() -> None:
    options = BackgroundOptions(pictures=10)
    rng = np.random.default_rng(3)
    thin = [Frame(i, float(i), picture([], rng)) for i in range(20)]
    grey = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    dense = [Frame(2 * i + k, i + 0.5 * k, frame.picture if k == 0 else grey) for i, frame in enumerate(thin) for k in (0, 1)]
    plan = plan_sampling(20.0, BackgroundOptions(pictures=20))
    one, other = learn_background(thin, plan, options), learn_background(dense, plan, options)
    assert (one.colour == other.colour).all()


@pytest.mark.slow
def test_what_cannot_be_learnt_from_is_said() -> None:
    frames = recording(8)
    with pytest.raises(EvidenceError, match="4 frames are too few"):
        learn_background(frames[:4], plan_sampling(4.0))
    odd = Frame(9, 9.0, np.zeros((10, 20, 3), np.uint8))
    with pytest.raises(InputError, match="20 x 10"):
        learn_background([*frames, odd], plan_sampling(8.0))
    model = learn_background(frames, plan_sampling(8.0))
    with pytest.raises(InputError, match="its background 480 x 360"):
        BackgroundDetector(model)(odd)
    with pytest.raises(InputError, match="pictures = 2"):
        BackgroundOptions(pictures=2)
    with pytest.raises(InputError, match="recording of 0"):
        plan_sampling(0.0)


def test_usual_colours_are_the_half_sample_modes_of_each_pixel() -> None:
    rng = np.random.default_rng(4)
    for count in (1, 2, 3, 5, 20, 61, 300):
        usual = rng.integers(0, 256, (6, 5, 3))
        people = (rng.random((count, 6, 5, 1)) < 0.3) * rng.integers(-200, 200, (count, 6, 5, 1))
        pictures = np.clip(usual + rng.normal(0, 6, (count, 6, 5, 3)) + people, 0, 255).astype(np.uint8)
        colour, noise = find_usual_colours(list(pictures))
        for at in np.ndindex(6, 5, 3):
            samples = np.sort(pictures[(slice(None), *at)].astype(int))
            median = samples[count // 2]
            for _ in range(2):
                half = (len(samples) + 1) // 2
                pieces = [samples[first : first + half] for first in range(len(samples) - half + 1)]
                samples = min(pieces, key=lambda piece: (piece[-1] - piece[0], abs(piece[(half - 1) // 2] - median)))
            assert colour[at] == samples[(len(samples) - 1) // 2]
            away = np.sort(np.abs(pictures[(slice(None), *at)].astype(int) - int(colour[at])))
            sigma = max(np.median(away) / 0.6745, away[: max(count // 2, 1)].mean() / 0.3247)
            assert abs(int(noise[at]) - min(8 * sigma, 255)) <= 0.51
