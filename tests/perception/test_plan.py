"""What people are found with: what was asked for, or what takes its place; and the people whose keypoints are measured."""

import hashlib

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.findings.texts import text_of, texts_of
from passerby.perception.networks import Network
from passerby.perception.plan import STRIPES, JointBudget, Plan, choose_for_keypoints, foresee, make_plan
from support.networks.crop_networks import stripe_means
from support.networks.model_server import BODY, entry, keep_to, know_only
from support.networks.yolox import constant_file, raw_rows


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """Models that are known, but cannot be had; returns a folder."""
    keep_to(tmp_path / "kept", monkeypatch)
    url = "http://127.0.0.1:9/tiny.onnx"
    know_only([entry("tiny", url=url), entry("looks", "embedder", url=url, default=True)], monkeypatch)
    monkeypatch.setattr("passerby.perception.plan.default_of", lambda role: {"detector": entry("tiny", url=url)}.get(role))
    return tmp_path


def planned(detector="background", embedder="none", keypoints="none", base=None):
    return make_plan(detector, embedder, keypoints, models=None, base=base)


def test_what_cannot_be_had_is_done_without_and_named(nowhere):
    plan = planned("auto", "auto")
    assert (plan.detector, plan.embedder, plan.keypoints) == (None, STRIPES, None)
    assert [notice.code for notice in plan.notes] == ["network_missing"] * 2
    people, appearance = texts_of(plan.notes)
    assert people.startswith("tiny is not on this computer and cannot be fetched")
    assert "background subtraction" in people
    assert "colour histograms of horizontal stripes" in appearance


@pytest.mark.parametrize(("role", "name"), [("detector", "tiny"), ("embedder", "looks"), ("embedder", "none.onnx")])
def test_what_was_named_is_not_done_without(nowhere, role, name):
    why = "no such file" if "." in name else f"{name} is not on this computer and cannot be"
    with pytest.raises(InputError, match=rf"\[perception\] {role} = '{name}': .*{why}"):
        planned(**{role: name})


def test_networks_by_path(tmp_path):
    constant_file(tmp_path / "people.onnx", raw_rows())
    stripe_means(tmp_path / "looks.onnx")
    plan = planned("people.onnx", "looks.onnx", base=tmp_path)
    assert isinstance(plan.detector, Network)
    assert isinstance(plan.embedder, Network)
    assert plan.notes == ()
    told = plan.figures["detector"]
    assert (told["network"], told["licence"], len(told["sha256"])) == ("people.onnx", "unknown", 64)
    assert foresee("people.onnx", "looks.onnx", "none", models=None, base=tmp_path) == (plan.figures, [])


LARGE = b"large" * 70_000


@pytest.fixture
def joints(nowhere, monkeypatch):
    """Networks for joints that are known: a small and a large one, and a default that an address would serve."""
    known = [
        entry("small", "keypoints"),
        entry("large", "keypoints", sha256=hashlib.sha256(LARGE).hexdigest(), bytes=len(LARGE)),
        entry("served", "keypoints", url="http://127.0.0.1:9/served.onnx"),
        entry("tiny", url="http://127.0.0.1:9/tiny.onnx"),
    ]
    for module in ("plan", "model_files", "networks"):
        monkeypatch.setattr(f"passerby.perception.{module}.catalogue", lambda: tuple(known))
    for module in ("plan", "model_files"):
        monkeypatch.setattr(f"passerby.perception.{module}.default_of", {"keypoints": known[2], "detector": known[3]}.get)
    return nowhere


def test_auto_means_the_largest_network_for_joints_at_hand(joints):
    """A file of its name that is another is no network at hand."""
    folder = joints / "kept" / "cache" / "models"
    folder.mkdir(parents=True)
    for name, content, chosen in (("small", BODY, "small"), ("large", LARGE, "large"), ("large", LARGE[:-1], "small")):
        (folder / f"{name}.onnx").write_bytes(content)
        plan = planned(keypoints="auto")
        assert (plan.keypoints.name, plan.notes) == (chosen, ())
        assert foresee("", "", "auto", models=None, base=None)[0]["keypoints"]["network"] == chosen


def test_without_a_network_at_hand_auto_means_none(joints):
    """Nothing is fetched for people who work without networks, and nothing is said of it; one reason is enough."""
    assert planned(keypoints="auto") == Plan(None, None, None)
    nothing = {"detector": "background", "embedder": "none", "keypoints": "none"}
    assert foresee("background", "none", "auto", models=None, base=None) == (nothing, [])
    plan = planned("auto", keypoints="auto")
    assert (plan.detector, plan.keypoints, [note.values["role"] for note in plan.notes]) == (None, None, ["detector"])


def test_joints_that_cannot_be_fetched_are_done_without_but_those_that_were_named_are_not(joints):
    constant_file(joints / "people.onnx", raw_rows())
    plan = planned("people.onnx", keypoints="auto", base=joints)
    assert plan.detector is not None
    assert plan.keypoints is None
    (told,) = plan.notes
    assert (told.code, told.values["role"]) == ("network_missing", "keypoints")
    assert text_of(told).startswith("served is not on this computer and cannot be fetched")
    for name in ("small", "joints.onnx", "unheard-of"):
        with pytest.raises(InputError, match=rf"\[perception\] keypoints = '{name}': "):
            planned(keypoints=name)


def test_joints_to_be_fetched_are_foreseen(joints, monkeypatch):
    choices, (note,) = foresee("", "", "auto", models=None, base=None)
    assert choices == {"keypoints": {"network": "served"}}
    assert "no keypoints are used" in text_of(note)
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    assert foresee("", "", "auto", models=None, base=None) == ({"keypoints": "none"}, [])


def test_what_is_foreseen_is_what_is_planned():
    plan = planned("background", "stripes")
    assert plan == Plan(None, STRIPES, None)
    assert plan.figures == {"detector": "background", "embedder": "stripes", "keypoints": "none"}
    assert planned().figures["embedder"] == "none"
    assert foresee("background", "stripes", "", models=None, base=None)[0] == {"detector": "background", "embedder": "stripes"}


@pytest.mark.parametrize(("asked", "instead"), [("auto", True), ("tiny", False)])
def test_nothing_is_fetched_to_foresee(nowhere, asked, instead):
    choices, (note,) = foresee(asked, "", "", models=None, base=None)
    assert choices == {"detector": {"network": "tiny"}}
    told = text_of(note)
    assert told.startswith("tiny is not on this computer: `passerby models fetch` downloads it, and so does `passerby calib")
    assert ("background is used" in told) == instead


SIZE = (640, 480)
FPS = 5.0


def steps_of(times: dict[float, int]) -> list[int]:
    return np.round(np.array(list(times)) * FPS).astype(int).tolist()


def people(count: int) -> np.ndarray:
    """So many people side by side."""
    return np.array([[20.0 + 60 * k, 100, 40, 120] for k in range(count)]).reshape(-1, 4)


def chosen(count: int, images: int = 1500, *, fps: float = FPS, known: bool = True, from_s: float = 0.0) -> dict[float, int]:
    """Time -> how many people are chosen there, of so many who are always there."""
    budget = JointBudget(3.0, fps, images if known else None)
    ltwh, score = people(count), np.ones(count)
    times = (from_s + np.arange(images) / fps).tolist()
    return {at: len(rows) for at in times if len(rows := budget.choose(at, ltwh, score, SIZE))}


@pytest.mark.parametrize("count", [1, 3, 9])
@pytest.mark.parametrize("known", [True, False])
def test_the_budget_is_spent_and_not_overdrawn(count: int, known: bool) -> None:
    """Three crops a second of video, and 250 for any length."""
    images = 3000
    allowed = 3.0 * images / FPS
    spent = sum(chosen(count, images, known=known).values())
    assert spent <= allowed + 250
    assert spent >= 0.75 * min(allowed, count * images)


def test_the_times_are_spread_over_the_recording_and_common_to_cameras() -> None:
    """Neighbouring images are chosen together: between them, a camera whose clock differs by part of a step is interpolated."""
    steps = steps_of(chosen(6))
    parts = np.histogram(steps, bins=10, range=(0.0, 1500.0))[0]
    assert parts.min() > 0.3 * parts.mean()
    assert sum(not {step - 1, step + 1} & set(steps) for step in steps) < 0.1 * len(steps)
    # Clocks that differ have times in common, whatever the difference.
    first = set(steps_of(chosen(4, 3000)))
    common = [len(first & {step + shift for step in first}) for shift in range(1, 40)]
    assert min(common) > 0.3 * len(first) ** 2 / 3000
    # A short recording has keypoints at all times.
    assert len(chosen(1, 100, fps=60.0)) == 100
    assert len(chosen(6, 10)) > 5
    assert chosen(0, 10) == {}


def test_cameras_with_more_people_choose_among_the_times_of_those_with_fewer() -> None:
    """The first and last seconds aside, where the estimate of how many people there are differs; everybody is chosen then."""
    few, many = chosen(3), chosen(9)
    assert (set(few.values()), set(many.values())) == ({3}, {9})
    assert len(set(many) - set(few)) < 0.1 * len(many)


@pytest.mark.parametrize(
    ("second", "score", "worth"),
    [
        ([300.0, 100, 40, 120], 1.0, [True, True]),
        ([300.0, 100, 5, 15], 1.0, [True, False]),
        ([300.0, 100, 40, 120], 0.1, [True, False]),
        ([600.0, 100, 40, 120], 1.0, [True, False]),  # cut off at the right
        ([25.0, 90, 40, 120], 1.0, [True, False]),  # behind the first, whose feet are lower
        ([25.0, 110, 40, 120], 1.0, [False, True]),  # in front of the first
        ([55.0, 110, 40, 120], 1.0, [True, True]),  # a little of the first is covered
    ],
)
def test_who_is_worth_it(second: list[float], score: float, worth: list[bool]) -> None:
    ltwh = np.vstack([people(1), [second]])
    assert choose_for_keypoints(ltwh, np.array([1.0, score]), SIZE).tolist() == worth


def test_people_who_are_cut_off_count_where_no_one_is_whole() -> None:
    cut = np.array([[100.0, 200, 100, 280]])
    assert choose_for_keypoints(cut, np.ones(1), SIZE).tolist() == [True]
    assert choose_for_keypoints(np.vstack([cut, people(1)]), np.ones(2), SIZE).tolist() == [False, True]
