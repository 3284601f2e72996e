"""What people are found with: what was asked for, or what takes its place."""

import hashlib

import pytest

from passerby.common.errors import InputError
from passerby.findings.texts import text_of, texts_of
from passerby.perception.networks import Network
from passerby.perception.plan import STRIPES, Plan, foresee, make_plan
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


@pytest.fixture
def files(tmp_path):
    constant_file(tmp_path / "people.onnx", raw_rows())
    stripe_means(tmp_path / "looks.onnx")
    return tmp_path


def planned(detector="background", embedder="none", keypoints="none", base=None):
    return make_plan(detector, embedder, keypoints, models=None, base=base)


def test_without_weights():
    plan = planned("background", "stripes")
    assert plan == Plan(None, STRIPES, None)
    assert plan.figures == {"detector": "background", "embedder": "stripes", "keypoints": "none"}
    assert planned().figures["embedder"] == "none"


def test_what_cannot_be_had_is_done_without_and_told(nowhere):
    plan = planned("auto", "auto")
    assert (plan.detector, plan.embedder, plan.keypoints) == (None, STRIPES, None)
    people, appearance = texts_of(plan.notes)
    assert [notice.code for notice in plan.notes] == ["network_missing"] * 2
    assert people.startswith("tiny is not on this computer and cannot be fetched")
    assert people.endswith(": people are detected by background subtraction, without a neural network")
    assert appearance.endswith(": appearance is described by colour histograms of horizontal stripes, without a neural network")


@pytest.mark.parametrize("role", ["detector", "embedder"])
def test_what_was_named_is_not_done_without(nowhere, role):
    name = {"detector": "tiny", "embedder": "looks"}[role]
    with pytest.raises(InputError, match=rf"\[perception\] {role} = '{name}': {name} is not on this computer and cannot be"):
        planned(**{role: name})


def test_networks_by_path(files):
    plan = planned("people.onnx", "looks.onnx", base=files)
    assert isinstance(plan.detector, Network)
    assert isinstance(plan.embedder, Network)
    assert plan.notes == ()
    told = plan.figures["detector"]
    assert told["network"] == "people.onnx"
    assert told["licence"] == "unknown"
    assert len(told["sha256"]) == 64


@pytest.fixture
def joints(nowhere, monkeypatch):
    """Networks for joints that are known: a small and a large one, and a default that an address would serve."""
    known = [
        entry("small", "keypoints"),
        entry("large", "keypoints", sha256=LARGE_SHA256, bytes=len(LARGE)),
        entry("served", "keypoints", url="http://127.0.0.1:9/served.onnx"),
        entry("tiny", url="http://127.0.0.1:9/tiny.onnx"),
    ]
    for module in ("plan", "model_files", "networks"):
        monkeypatch.setattr(f"passerby.perception.{module}.catalogue", lambda: tuple(known))
    default = {"keypoints": known[2], "detector": known[3]}
    for module in ("plan", "model_files"):
        monkeypatch.setattr(f"passerby.perception.{module}.default_of", default.get)
    return nowhere


LARGE = b"large" * 70_000
LARGE_SHA256 = hashlib.sha256(LARGE).hexdigest()


def test_auto_means_the_largest_network_for_joints_at_hand(joints):
    folder = joints / "kept" / "cache" / "models"
    folder.mkdir(parents=True)
    (folder / "small.onnx").write_bytes(BODY)
    assert planned(keypoints="auto").keypoints.name == "small"
    (folder / "large.onnx").write_bytes(LARGE)
    assert planned(keypoints="auto").keypoints.name == "large"
    assert foresee("", "", "auto", models=None, base=None)[0]["keypoints"]["network"] == "large"
    # A file of its name that is another is no network at hand.
    (folder / "large.onnx").write_bytes(LARGE[:-1])
    assert planned(keypoints="auto").keypoints.name == "small"
    assert planned(keypoints="auto").notes == ()


def test_without_a_network_at_hand_auto_means_none(joints):
    """Nothing is fetched for people who work without networks, and nothing is said of it."""
    assert planned(keypoints="auto") == Plan(None, None, None)
    assert foresee("background", "none", "auto", models=None, base=None) == (
        {"detector": "background", "embedder": "none", "keypoints": "none"},
        [],
    )


def test_one_reason_is_enough_where_nothing_can_be_fetched(joints):
    plan = planned("auto", keypoints="auto")
    assert (plan.detector, plan.keypoints) == (None, None)
    assert [note.values["role"] for note in plan.notes] == ["detector"]


def test_joints_that_cannot_be_fetched_are_done_without(joints, files):
    plan = planned("people.onnx", keypoints="auto", base=files)
    assert plan.detector is not None
    assert plan.keypoints is None
    (told,) = texts_of(plan.notes)
    assert told.startswith("served is not on this computer and cannot be fetched")
    assert told.endswith(": keypoints are not detected")


def test_joints_to_be_fetched_are_foreseen(joints, monkeypatch):
    choices, notes = foresee("", "", "auto", models=None, base=None)
    assert choices == {"keypoints": {"network": "served"}}
    assert texts_of(notes)[0].endswith("; no keypoints are used if it is unavailable")
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    assert foresee("", "", "auto", models=None, base=None) == ({"keypoints": "none"}, [])


@pytest.mark.parametrize("name", ["small", "joints.onnx", "unheard-of"])
def test_joints_that_were_named_are_never_left_out_silently(joints, name):
    with pytest.raises(InputError, match=rf"\[perception\] keypoints = '{name}': "):
        planned(keypoints=name)


def test_a_fault_names_the_key(files):
    with pytest.raises(InputError, match=r"\[perception\] embedder = 'none.onnx': .*none.onnx: no such file"):
        planned(embedder="none.onnx", base=files)


def test_what_is_foreseen_is_what_is_planned(files):
    choices, notes = foresee("people.onnx", "looks.onnx", "none", models=None, base=files)
    assert choices == planned("people.onnx", "looks.onnx", base=files).figures
    assert notes == []
    assert foresee("background", "stripes", "", models=None, base=None)[0] == {"detector": "background", "embedder": "stripes"}


def test_nothing_is_fetched_to_foresee(nowhere):
    choices, (note,) = foresee("auto", "", "", models=None, base=None)
    assert choices == {"detector": {"network": "tiny"}}
    assert text_of(note) == (
        "tiny is not on this computer: `passerby models fetch` downloads it, and so does `passerby calibrate`; background is "
        "used if it is unavailable"
    )
    choices, (note,) = foresee("tiny", "", "", models=None, base=None)
    assert choices == {"detector": {"network": "tiny"}}
    assert text_of(note).endswith("and so does `passerby calibrate`")
