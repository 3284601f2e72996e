"""The benchmark of the local page: what its page says of outcomes, which faults its rules find, and what it reads of files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import local_page_page
from local_page import kills
from local_page.hand import access_faults, against, ends_of
from passerby.geometry.rotations import exp_rotation
from support.browser import CHROMIUM
from support.scenes.people_and_rigs import simulated


def click(scale: float, heading: float, seconds: float, **more: object) -> dict[str, object]:
    return {
        "scale": scale, "scale_before": 0.02, "heading_deg": heading, "solving_s": seconds, "solving_cpu_s": seconds,
        "clicks": 6, "errors": [], "foreign": [], "faults": [], "load": 1.0, **more,
    }  # fmt: skip


def goals(found: object) -> list[str]:
    return [goal[-1] for goal in found.goals]  # type: ignore[attr-defined]


def test_the_median_hand_decides_errors_have_no_sign_and_complaints_are_missed():
    hands = [click(-0.003, 0.1, 2.0), click(0.005, -0.5, 7.0), click(0.02, 0.6, 9.0)]
    done = {str(number): hand for number, hand in enumerate(hands)}
    found = local_page_page.tabulate_clicks(done, done)
    assert goals(found) == ["acceptable", "acceptable", "acceptable", "aim", "aim"]
    assert "| scale, %              | 0.50   | 2.00    |" in found.text
    done = {"0": click(0.0, 0.0, 1.0, errors=["no such file"], faults=["control has a name: button"])}
    found = local_page_page.tabulate_clicks(done, done)
    assert goals(found)[3:] == ["**missed**", "**missed**"]
    assert "- control has a name: button" in found.text


def test_lost_marks_and_half_files_are_counted():
    kill = {"solving": True, "marked": 9, "missing": [], "unacknowledged": 1, "broken": [], "temporary": 0}
    assert goals(local_page_page.tabulate_kills({}, {"0": kill})) == ["aim", "aim"]
    worse = kill | {"missing": [3.001], "broken": ["rig.toml: is cut off", "scene.toml: is cut off"]}
    found = local_page_page.tabulate_kills({}, {"0": kill, "1": worse})
    assert [goal[1] for goal in found.goals] == ["1", "2"]
    assert goals(found) == ["**missed**", "**missed**"]


def test_what_is_left_of_files_is_read(tmp_path: Path):
    scene = tmp_path / "scene" / "scene.toml"
    scene.parent.mkdir()
    points = "{ A = [[1, 1], [2, 2]], B = [[1, 1], [2, 2]] }"
    cameras = '[cameras.A]\nvideo = "a.mp4"\n[cameras.B]\nvideo = "b.mp4"\n'
    scene.write_text(f"{cameras}[[scale.lengths]]\nmetres = 3.001\npoints = {points}\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".rig.toml.abcdefgh.part").write_text("half")
    left = kills._left(scene, tmp_path / "out", [3.0, 3.001])
    assert (left["missing"], left["unacknowledged"], left["temporary"]) == ([3.0], 0, 1)
    assert [one.partition(":")[0] for one in left["broken"]] == ["calibration.json", "rig.toml"]


def test_a_rig_in_the_clicked_frame_has_no_error_and_others_theirs():
    truth = simulated("terrace", 2.0, 5, people=2).rig
    ends = ends_of(truth)
    along = ends[1] - ends[0]
    turn = exp_rotation(np.array([0.0, 0.0, -np.arctan2(along[1], along[0])]))
    right = truth.moved(turn, -turn @ ends[0], 1.0)
    assert against(truth, ends, right) == pytest.approx((0.0, 0.0), abs=1e-9)
    off = exp_rotation(np.array([0.0, 0.0, np.radians(2.0)]))
    assert against(truth, ends, right.moved(off, np.zeros(3), 1.01)) == pytest.approx((0.01, 2.0), abs=1e-6)


BAD = """<html lang="en"><title>t</title><header>h</header><main><nav>n</nav><h2>two</h2><h4>four</h4><img src="data:,">
<button></button><button style="outline: none">never outlined</button><p style="color: #999; background: #fff">pale</p>
<i id="a"></i><i id="a"></i></main></html>"""
GOOD = """<html lang="en"><title>t</title><header>h</header><main><nav>n</nav><h2>two</h2><h3>three</h3>
<img src="data:," alt=""><button>named</button><label>field <input></label><p>dark</p></main></html>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")
def test_serious_faults_are_found_and_nothing_else(browser):
    page = browser.new_page()
    page.set_content(GOOD)
    assert access_faults(page) == []
    page.set_content(BAD)
    assert {one.partition(":")[0] for one in access_faults(page)} == {"image-alt", "button-name", "color-contrast"}
