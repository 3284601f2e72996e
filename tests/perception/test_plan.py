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


def test_what_cannot_be_had_is_done_without_and_told(nowhere):
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


def test_networks_by_path(files):
    plan = planned("people.onnx", "looks.onnx", base=files)
    assert isinstance(plan.detector, Network)
    assert isinstance(plan.embedder, Network)
    assert plan.notes == ()
    told = plan.figures["detector"]
    assert (told["network"], told["licence"], len(told["sha256"])) == ("people.onnx", "unknown", 64)
    assert foresee("people.onnx", "looks.onnx", "none", models=None, base=files) == (plan.figures, [])


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


LARGE = b"large" * 70_000


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


def test_joints_that_cannot_be_fetched_are_done_without(joints, files):
    plan = planned("people.onnx", keypoints="auto", base=files)
    assert plan.detector is not None
    assert plan.keypoints is None
    (told,) = plan.notes
    assert (told.code, told.values["role"]) == ("network_missing", "keypoints")
    assert text_of(told).startswith("served is not on this computer and cannot be fetched")


def test_joints_to_be_fetched_are_foreseen(joints, monkeypatch):
    choices, (note,) = foresee("", "", "auto", models=None, base=None)
    assert choices == {"keypoints": {"network": "served"}}
    assert "no keypoints are used" in text_of(note)
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    assert foresee("", "", "auto", models=None, base=None) == ({"keypoints": "none"}, [])


@pytest.mark.parametrize("name", ["small", "joints.onnx", "unheard-of"])
def test_joints_that_were_named_are_never_left_out_silently(joints, name):
    with pytest.raises(InputError, match=rf"\[perception\] keypoints = '{name}': "):
        planned(keypoints=name)


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
