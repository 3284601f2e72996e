"""The rig from above: what is drawn is where the rig has it, and the saved files hold it in forms that others read."""

import base64
import json
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from passerby.calibration.alignment.world import align_to_positions
from passerby.core.cameras import Camera, PoseSigma, Rig
from passerby.core.scale_cues import KnownPosition
from passerby.geometry.geodesy import east_north_up, geodetic
from passerby.interchange.calibration_json import PlanEntry
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.page.plan_pictures import PlanPictures
from passerby.page.plan_shapes import caption, drawing, geojson_text, shapes, svg_text
from passerby.page.plan_view import Backdrop, view_of
from passerby.report.fitted import FittedTrajectories

from .conftest import UNIT, DrawnPlan

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def truth(simulated):
    rig = read_rig(simulated / "truth.toml")
    covariance = np.diag([0.04, 0.01, 0.02, 1e-6, 1e-6, 1e-6])
    return Rig(tuple(Camera(one.name, one.lens, one.pose, PoseSigma.from_covariance(covariance)) for one in rig))


@pytest.fixture(scope="module")
def ways(truth):
    """Two people: one whose way has a gap, and one."""
    xy = np.array([[0, 0], [1, 0.5], [2, 0], [4, 1], [5, 1], [0, 3], [1, 3.0]])
    identity, part = np.array([1, 1, 1, 1, 1, 2, 2]), np.array([0, 0, 0, 1, 1, 2, 2])
    return FittedTrajectories(identity, np.arange(7.0), xy, part)


@pytest.fixture(scope="module")
def view(truth, ways):
    return view_of(truth, ways, None, [])


@pytest.fixture(scope="module")
def on_plan(truth, ways, tmp_path_factory):
    """The same rig with the plan that its frame is of."""
    plan, path = DrawnPlan(truth), tmp_path_factory.mktemp("plan") / "plan.png"
    path.write_bytes(plan.png)
    corner = (-plan.corner[0] / UNIT - 0.5, plan.corner[1] / UNIT - 0.5)
    entry = PlanEntry(image="plan.png", metres_per_pixel=UNIT, origin=corner)
    return view_of(truth, ways, Backdrop(PlanPictures().shown(path), entry), [])


def of_kind(view, kind):
    return [np.array(one["points"]) for one in shapes(view) if one["kind"] == kind]


def test_everything_is_drawn_where_the_rig_has_it_and_as_large_as_it_says(view, truth, ways):
    centres = np.array([camera.centre[:2] for camera in truth])
    assert np.concatenate(of_kind(view, "camera")) == pytest.approx(centres * (1, -1), abs=1e-3)
    for camera, stroke in zip(truth, of_kind(view, "heading"), strict=True):
        ahead = np.degrees(np.arctan2(-(stroke[1] - stroke[0])[1], (stroke[1] - stroke[0])[0]))
        assert ahead == pytest.approx(camera.pose.heading_deg, abs=0.5)
    paths = of_kind(view, "path")
    assert [len(one) for one in paths] == [3, 2, 2]
    assert np.concatenate(paths) == pytest.approx(ways.xy * (1, -1), abs=1e-3)
    x, y, width, height = drawing(view)["box"]
    everything = np.concatenate([np.concatenate(of_kind(view, kind)) for kind in ("camera", "path")])
    assert (everything >= [x, y]).all()
    assert (everything <= [x + width, y + height]).all()
    times = int(re.search(r"drawn (\d+) times", caption(view))[1]) if "times as large" in caption(view) else 1
    for outline in of_kind(view, "sigma"):
        assert np.ptp(outline, axis=0) / 2 == pytest.approx(times * np.array([0.2, 0.1]), rel=0.01)
    (bar,), (label,) = of_kind(view, "bar"), [one["text"] for one in shapes(view) if one["kind"] == "bar-label"]
    assert label == f"{bar[1][0] - bar[0][0]:g} m"
    for camera, outline in zip(truth, of_kind(view, "seen"), strict=True):
        middle = (outline[:-1].mean(axis=0) * (1, -1)).tolist()
        pixel = camera.project(np.array([[*middle, 0.0]]))[0]
        ahead = camera.pose.R_cw @ (np.array([*middle, 0.0]) - camera.centre)
        assert ahead[2] > 0
        assert -1 < pixel[0] < camera.lens.size[0] + 1


def test_the_plan_lies_where_its_pixels_say_also_in_the_saved_drawing(on_plan, truth):
    plan = DrawnPlan(truth)
    x, y, width, height = drawing(on_plan)["backdrop"]
    assert (width, height) == pytest.approx(np.array(plan.size) * UNIT, abs=1e-3)
    for camera, (at,) in zip(truth, of_kind(on_plan, "camera"), strict=True):
        pixel = (np.array(at) - (x, y)) / UNIT - 0.5
        assert pixel == pytest.approx(plan.pixel(camera.centre), abs=0.1)
    assert of_kind(on_plan, "grid") == []
    told = json.loads(geojson_text(on_plan))["plan"]
    assert (told["metres_per_pixel"], len(told["origin_px"])) == (UNIT, 2)
    root = ET.fromstring(svg_text(on_plan))
    assert {one.text for one in root.iter(f"{SVG}text")} >= set(truth.names)
    (image,) = root.iter(f"{SVG}image")
    kind, _, data = image.get("href").partition(",")
    assert kind == "data:image/png;base64"
    assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), 1).shape[:2] == DrawnPlan(truth).size[::-1]
    unit = float(image.get("width")) / (DrawnPlan(truth).size[0] * UNIT)
    squares = [one for one in root.iter(f"{SVG}rect") if one.get("stroke")]
    for camera, one in zip(truth, squares, strict=True):
        at = np.array([float(one.get(key)) + float(one.get(size)) / 2 for key, size in (("x", "width"), ("y", "height"))])
        off = (at - [float(image.get("x")), float(image.get("y"))]) / unit * (1, -1) + DrawnPlan(truth).corner
        assert off == pytest.approx(camera.centre[:2], abs=0.02)
    assert not re.search(r"(href|src)=\"(?!data:)", svg_text(on_plan))
    assert "style=" not in svg_text(on_plan)


def test_a_name_with_markup_is_text_and_cameras_without_a_pose_or_a_sigma_are_named(truth, ways):
    name = '<script>alert(1)</script>&"\x00\x1b'
    first, *others = truth
    rig = Rig((Camera(name, first.lens, first.pose), *others))
    found = view_of(rig, ways, None, ["<b>"])
    root = ET.fromstring(svg_text(found))
    assert not list(root.iter(f"{SVG}script"))
    assert any("<script>" in (one.text or "") for one in root.iter(f"{SVG}text"))
    assert json.loads(geojson_text(found))["features"][0]["properties"]["camera"] == name
    first, second, *others = truth
    rig = Rig((Camera(first.name, first.lens), Camera(second.name, second.lens, second.pose), *others))
    found = view_of(rig, ways, None, [])
    assert f"not registered: {first.name}" in caption(found)
    assert len(of_kind(found, "sigma")) == len(of_kind(found, "camera")) - 1 == 2
    properties = [one["properties"] for one in json.loads(geojson_text(found))["features"]]
    assert next(one["ground_sigma_m"] for one in properties if one["kind"] == "camera") is None


def check_rfc_7946(collection):
    """What the standard asks of the members and geometries that are written."""
    assert collection["type"] == "FeatureCollection"
    assert not {"coordinates", "geometry", "geometries", "properties", "crs"} & collection.keys()
    for feature in collection["features"]:
        assert feature.keys() == {"type", "geometry", "properties"}
        kind, places = feature["geometry"]["type"], feature["geometry"]["coordinates"]
        if kind == "Polygon":
            (ring,) = places
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            x, y = np.array(ring).T
            assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0, "counter-clockwise"
        elif kind == "LineString":
            assert len(places) >= 2
        else:
            assert kind == "Point"
        assert all(len(one) == 2 for one in np.array(places).reshape(-1, np.array(places).shape[-1]))


def test_geojson_of_a_local_rig_has_its_metres_and_says_so(view, truth, ways):
    collection = json.loads(geojson_text(view))
    check_rfc_7946(collection)
    assert "metres" in collection["coordinate_system"]
    assert "not longitude and latitude" in collection["coordinate_system"]
    cameras = [one for one in collection["features"] if one["properties"]["kind"] == "camera"]
    for camera, one in zip(truth, cameras, strict=True):
        assert one["geometry"]["coordinates"] == pytest.approx(camera.centre[:2], abs=1e-3)
        assert one["properties"]["heading_deg"] == pytest.approx(camera.pose.heading_deg, abs=1e-3)
        assert one["properties"]["ground_sigma_m"] == pytest.approx([0.2, 0.1], abs=1e-3)
        assert one["properties"]["height_m"] == pytest.approx(camera.centre[2], abs=1e-3)
    lines = [one for one in collection["features"] if one["properties"]["kind"] == "trajectory"]
    assert [one["properties"]["person"] for one in lines] == [1, 1, 2]
    assert np.concatenate([one["geometry"]["coordinates"] for one in lines]) == pytest.approx(ways.xy, abs=1e-3)


def test_geojson_of_a_rig_by_positions_in_degrees_has_longitude_and_latitude(truth):
    """A rig turned by a quarter and laid upon GPS positions: the file has the positions, not the rig's old frame."""
    origin = np.array([52.52, 13.405, 36.0])
    places = geodetic(np.array([camera.centre for camera in truth]), origin)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    known = [KnownPosition(camera.name, place, 0.1) for camera, place in zip(truth, places, strict=True)]
    aligned = align_to_positions(truth.moved(turn, np.array([3.0, 4.0, 0.0])), known, geodetic=True).rig
    none = np.zeros(0, np.int64)
    nobody = FittedTrajectories(none, np.zeros(0), np.zeros((0, 2)), none)
    collection = json.loads(geojson_text(view_of(aligned, nobody, None, [])))
    check_rfc_7946(collection)
    assert "WGS 84" in collection["coordinate_system"]
    cameras = [one for one in collection["features"] if one["properties"]["kind"] == "camera"]
    for camera, place, one in zip(truth, places, cameras, strict=True):
        longitude, latitude = one["geometry"]["coordinates"]
        off = east_north_up(np.array([[latitude, longitude, place[2]]]), place)[0]
        assert np.hypot(*off[:2]) < 0.01
        assert one["properties"]["azimuth_deg"] == pytest.approx((90 - camera.pose.heading_deg) % 360, abs=0.1)


def test_the_page_gets_the_view_and_its_files_and_they_follow_the_rig(client, session, truth):
    def cameras():
        return [one["points"] for one in client.get("/api/plan/view").json()["shapes"] if one["kind"] == "camera"]

    before = cameras()
    assert len(before) == 4
    assert client.get("/api/plan/view").json()["backdrop"] is None
    write_rig(session.out / "rig.toml", truth.moved(np.eye(3), np.array([5.0, 0.0, 0.0])))
    assert cameras() != before
    for path, kind in (("/plan/view.svg", "image/svg+xml"), ("/plan/view.geojson", "application/geo+json")):
        answer = client.get(path)
        assert answer.headers["content-type"] == kind
        assert "attachment" in answer.headers["content-disposition"]
    assert "default-src 'none'" in client.get("/plan/view.svg").headers["content-security-policy"]
    assert "no plan" in client.get("/plan/backdrop").json()["error"]
    (session.out / "rig.toml").unlink()
    assert "calibrate first" in client.get("/api/plan/view").json()["error"]
