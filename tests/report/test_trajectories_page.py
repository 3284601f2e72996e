"""The page of trajectories: everybody in both views, the cameras, offline, small, the same bytes."""

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
    return json.JSONDecoder().raw_decode(text[text.index("[") :])[0]


def example():
    rig = ring(3)
    return trajectories(rig, watched(rig, 3, 12.0), clocks_of(rig), POLES), rig


def test_one_line_a_person_in_each_view_and_the_cameras():
    found, rig = example()
    html = trajectories_page(found, rig, "a <title>", "a note")
    traces = drawn(html)
    lines = {(trace["type"], trace["name"]): trace for trace in traces if trace["name"].startswith("person")}
    assert set(lines) == {(kind, f"person {number}") for kind in ("scatter", "scatter3d") for number in (1, 2, 3)}
    first, own = lines["scatter3d", "person 1"], found.identity == 1
    assert np.allclose(np.column_stack([first["x"], first["z"]]), found.xyz[own][:, [0, 2]], atol=0.006)
    for kind in ("scatter", "scatter3d"):
        named = [trace for trace in traces if "text" in trace and trace["type"] == kind]
        assert [trace["text"][0] for trace in named] == ["C1", "C2", "C3"]
        for trace, camera in zip(named, rig, strict=True):
            assert np.allclose((trace["x"][0], trace["y"][0]), camera.centre[:2], atol=0.006)
    assert "a &lt;title&gt;" in html
    assert "a note" in html
    assert html == trajectories_page(found, rig, "a <title>", "a note")
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", html), "it needs no network"
    colours = {trace["name"]: trace["line"]["color"] for trace in traces if "line" in trace}
    assert [colours[f"person {number}"] for number in (1, 2, 3)] == [person_colour(number) for number in (1, 2, 3)]
    assert [colours[camera.name] for camera in rig] == [camera_colour(place) for place in range(3)]
    hostile = type(rig)(tuple(replace(camera, name=f"<b>{camera.name}</b>&lt;") for camera in rig))
    for trace in drawn(trajectories_page(found, hostile, "t")):
        assert not any("<b>" in text or "&lt;" in text for text in (trace["name"], *trace.get("text", ())))


def test_parts_are_not_joined_and_much_is_thinned_and_says_so(monkeypatch):
    found, rig = example()
    keep = (found.frame < 20) | (found.frame > 40)
    columns = {name: getattr(found, name)[keep] for name in ("identity", "frame", "time_s", "xyz", "sigma_m", "cameras")}
    cut = replace(found, **columns, part=np.where(found.frame > 40, 2, 1)[keep])
    line = next(trace for trace in drawn(trajectories_page(cut, rig, "t")) if trace["name"] == "person 2")
    assert line["x"].count(None) == 1
    assert "Every 3" not in trajectories_page(found, rig, "t")
    monkeypatch.setattr(page, "MOST_PLACES", 60)
    thin = trajectories_page(found, rig, "t")
    assert "Every 3rd position" in thin
    lines = [trace for trace in drawn(thin) if trace["name"].startswith("person") and trace["type"] == "scatter"]
    assert sum(len(line["x"]) for line in lines) <= 60 + 2 * 3
    # Ends are kept.
    assert lines[0]["x"][-1] == round(float(found.xyz[found.identity == 1][-1, 0]), 2)
