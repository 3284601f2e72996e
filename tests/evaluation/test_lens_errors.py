"""Estimated intrinsics against the true ones."""

import json
from dataclasses import replace

import numpy as np
import pytest

from passerby.cli.tables import show_comparison
from passerby.core.cameras import Camera, Lens, Rig
from passerby.evaluation.metrics import compare, lens_error
from support.scenes.people_and_rigs import ring

TRUE = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.array([-0.1, 0.01, 0, 0]))


def changed(focal=1.0, shift=(0.0, 0.0), k1=0.0):
    matrix = np.array(TRUE.matrix)
    matrix[:2, :2] *= focal
    matrix[:2, 2] += shift
    return replace(TRUE, matrix=matrix, distortions=TRUE.distortions + np.array([k1, 0, 0, 0]))


def test_each_part_is_measured():
    shifted, longer, bent = (
        lens_error(lens, TRUE) for lens in (changed(shift=(3.0, 4.0)), changed(focal=1.02), changed(k1=0.05))
    )
    assert (shifted.principal_point_px, shifted.ray_px) == (pytest.approx(5.0), pytest.approx(5.0, abs=1e-2))
    assert longer.focal_percent == pytest.approx(2.0)
    # Rays move away from the middle by 2 % of their distance from it, 0.02 * 207 px on the mean over this picture.
    assert 3.5 < longer.ray_px < 4.8
    assert bent.focal_percent == pytest.approx(0.0)
    assert bent.ray_px > 1.0
    assert bent.differs
    same = lens_error(TRUE, TRUE)
    assert same.to_dict() == pytest.approx({"focal_percent": 0.0, "principal_point_px": 0.0, "ray_px": 0.0}, abs=1e-3)
    assert not same.differs
    assert lens_error(replace(TRUE, size=(1280, 960)), TRUE) is None, "lenses for other images are not compared"


def test_a_comparison_shows_lenses_where_they_differ(capsys):
    truth = ring(3)
    show_comparison(compare(truth, truth))
    assert "intrinsics" not in capsys.readouterr().out
    first, *others = truth
    longer = first.lens.matrix * [[1.03, 1, 1], [1, 1.03, 1], [1, 1, 1]]
    found = compare(Rig((Camera(first.name, replace(first.lens, matrix=longer), first.pose), *others)), truth)
    lenses = json.loads(json.dumps(found.to_dict(), allow_nan=False))["lenses"]
    assert [lenses[one.name]["focal_percent"] for one in truth] == pytest.approx([3.0, 0.0, 0.0])
    show_comparison(found)
    assert "errors of the intrinsics" in capsys.readouterr().out
