"""The plan in the report: its picture lies where its pixels are, and placements are drawn where they were clicked."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from passerby.interchange.calibration_json import PlanEntry, ResidualEntry, WorldEntry
from passerby.report.fitted import fit_people
from passerby.report.rendering import render
from passerby.report.site_map import plan_drawing
from support.report.drawings import contents, only_boxes, simulated

UNIT, WIDTH, HEIGHT, ORIGIN = 0.02, 600, 800, (120.0, 700.0)
ROWS = (
    ResidualEntry(camera="C1", off_m=0.05, stated_m=(1.0, 2.0), found_m=(1.0, 2.05)),
    ResidualEntry(point="kerb", camera="C2", off_m=1.5, used=False, stated_m=(3.0, 2.0), found_m=(4.5, 2.0)),
    ResidualEntry(point="sky", camera="C1", off_m=None, used=False, stated_m=(3.5, 2.0)),
)


def drawing(image: str, tmp_path) -> tuple[str, dict]:
    made = simulated("terrace")
    told = contents(made, seen=only_boxes(made))
    world = WorldEntry(by="plan plan.png", plan=PlanEntry(image=image, metres_per_pixel=UNIT, origin=ORIGIN), residuals=ROWS)
    told = replace(told, document=replace(told.document, world=world, scene_file=str(tmp_path / "scene.toml")))
    drawn = plan_drawing(told, fit_people(told))
    html = render("rig.html", site=False, plan=drawn, plots=[drawn.plot])
    figure = re.search(r'<script[^>]*id="rig-plan-figure"[^>]*>(.*?)</script>', html, re.DOTALL)
    return html, json.loads(figure[1])


@pytest.fixture
def drawn(tmp_path):
    cv2.imwrite(str(tmp_path / "plan.png"), np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
    return drawing("plan.png", tmp_path)


def test_the_picture_lies_where_its_pixels_are(drawn) -> None:
    (image,) = drawn[1]["layout"]["images"]
    # The outer corner of the first pixel, half a pixel from its centre.
    assert (image["x"], image["y"]) == (pytest.approx(UNIT * (-0.5 - ORIGIN[0])), pytest.approx(UNIT * (ORIGIN[1] + 0.5)))
    assert (image["sizex"], image["sizey"]) == (pytest.approx(UNIT * WIDTH), pytest.approx(UNIT * HEIGHT))
    assert image["source"].startswith("data:image/jpeg;base64,")
    assert image["layer"] == "below"
    low, high = drawn[1]["layout"]["xaxis"]["range"]
    assert low < image["x"]
    assert high > image["x"] + image["sizex"]


def test_placements_are_drawn_from_click_to_rig_and_wrong_ones_apart(drawn) -> None:
    html, figure = drawn
    marks = {one["name"]: one for one in figure["data"] if one.get("mode") == "markers"}
    assert (marks["placed on the plan"]["x"], marks["placed on the plan"]["y"]) == ([1.0], [2.0])
    assert (marks["left out"]["x"], marks["left out"]["y"]) == ([3.0, 3.5], [2.0, 2.0])
    assert marks["left out"]["hovertext"] == [
        "point kerb in camera C2: 1.50 m, 75 px off",
        "point sky in camera C1: above the horizon",
    ]
    lines = {one["name"]: one for one in figure["data"] if one.get("mode") == "lines" and one.get("name") in marks}
    assert lines["left out"]["x"] == [3.0, 4.5, None, 3.5, 3.5]
    assert "3 placements of cameras and points" in html
    assert "Red: 2 left out." in html
    assert any(one.get("name") == "people" for one in figure["data"])


def test_without_the_picture_the_rest_is_drawn_and_the_page_says_so(tmp_path) -> None:
    html, figure = drawing("gone.png", tmp_path)
    assert "is not where it was" in html
    assert figure["layout"]["images"] == []
    assert any(one.get("mode") == "markers" for one in figure["data"])
    told = contents(simulated("terrace"))
    assert plan_drawing(told, fit_people(told)) is None, "a world without a plan"
