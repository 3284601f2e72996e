"""The page: everybody in both views, the cameras, offline, small, the same bytes."""

import json
import re
from dataclasses import replace

import numpy as np

from passerby.core.colours import camera_colour, person_colour
from passerby.people.trajectories.trajectories import trajectories
from passerby.report import page as page
from passerby.report.page import trajectories_page
from support.scenes.people_to_track import POLES, clocks_of, ring, watched


def drawn(html):
    """The traces that plotly is given."""
    text = html[html.rindex("Plotly.newPlot(") :]
    start = text.index("[")
    traces, _ = json.JSONDecoder().raw_decode(text[start:])
    return traces


def example(people=3, seconds=12.0):
    rig = ring(3)
    return trajectories(rig, watched(rig, people, seconds), clocks_of(rig), POLES), rig


def test_one_line_a_person_in_each_view_and_the_cameras():
    found, rig = example()
    html = trajectories_page(found, rig, "a <title>", "a note")
    traces = drawn(html)
    lines = [trace for trace in traces if trace["name"].startswith("person")]
    assert sorted((trace["type"], trace["name"]) for trace in lines) == sorted(
        (kind, f"person {number}") for kind in ("scatter", "scatter3d") for number in (1, 2, 3)
    )
    first = next(trace for trace in lines if trace["name"] == "person 1" and trace["type"] == "scatter3d")
    own = found.identity == 1
    assert np.allclose(first["x"], found.xyz[own, 0], atol=0.006)
    assert np.allclose(first["z"], found.xyz[own, 2], atol=0.006)
    for kind in ("scatter", "scatter3d"):
        named = [trace for trace in traces if "text" in trace and trace["type"] == kind]
        assert [trace["text"][0] for trace in named] == ["C1", "C2", "C3"]
        for trace, camera in zip(named, rig, strict=True):
            assert np.allclose((trace["x"][0], trace["y"][0]), camera.centre[:2], atol=0.006)
    assert "a &lt;title&gt;" in html
    assert "a note" in html


def test_names_are_no_markup():
    found, rig = example()
    hostile = type(rig)(tuple(replace(camera, name=f"<b>{camera.name}</b>&lt;") for camera in rig))
    for trace in drawn(trajectories_page(found, hostile, "t")):
        shown = [trace["name"], *trace.get("text", ())]
        assert not any("<b>" in text or "&lt;" in text for text in shown)


def test_everybody_has_the_colour_of_the_report():
    found, rig = example()
    colours = {trace["name"]: trace["line"]["color"] for trace in drawn(trajectories_page(found, rig, "t")) if "line" in trace}
    for number in (1, 2, 3):
        assert colours[f"person {number}"] == person_colour(number)
    for place, camera in enumerate(rig):
        assert colours[camera.name] == camera_colour(place)


def test_it_needs_no_network_and_is_the_same_again():
    found, rig = example()
    html = trajectories_page(found, rig, "t")
    assert html == trajectories_page(found, rig, "t")
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", html)


def test_parts_are_not_joined():
    found, rig = example()
    keep = (found.frame < 20) | (found.frame > 40)
    part = np.where(found.frame > 40, 2, 1)
    cut = type(found)(
        found.identity[keep], found.frame[keep], found.time_s[keep], found.xyz[keep], found.sigma_m[keep],
        found.cameras[keep], part[keep], found.clock,
    )  # fmt: skip
    line = next(trace for trace in drawn(trajectories_page(cut, rig, "t")) if trace["name"] == "person 2")
    assert line["x"].count(None) == 1


def test_much_is_thinned_and_says_so(monkeypatch):
    found, rig = example()
    whole = trajectories_page(found, rig, "t")
    monkeypatch.setattr(page, "MOST_PLACES", 60)
    thin = trajectories_page(found, rig, "t")
    assert "Every 3th position" not in whole
    assert "Every 3rd position" in thin
    lines = [trace for trace in drawn(thin) if trace["name"].startswith("person") and trace["type"] == "scatter"]
    assert sum(len(line["x"]) for line in lines) <= 60 + 2 * 3
    # Ends are kept.
    assert lines[0]["x"][-1] == round(float(found.xyz[found.identity == 1][-1, 0]), 2)
