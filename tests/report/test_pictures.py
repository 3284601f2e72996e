"""Camera pictures: the grid, the boxes and the frame are those of the camera, and nothing in them can run."""

import base64
from dataclasses import replace

import cv2
import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.observations import BODY_17, Boxes, CameraObservations, Observations
from passerby.interchange.calibration_json import CalibrationDocument
from passerby.perception.sources.files import VideoSource
from passerby.report.contents import Contents
from passerby.report.fitted import fit_people
from passerby.report.layers import grid_lines, grid_region, grid_spacing
from passerby.report.pictures import camera_picture
from passerby.report.sheet import data_uri
from support.report.drawings import contents, only_boxes, only_joints, simulated
from support.report.svg import SVG, distance_to, layer, of_class, parsed, scripts, strokes
from support.scenes.puppet_videos import pictures, puppets, write_video

HOSTILE = '"><script>alert(1)</script><img src=x onerror="alert(2)">&lt;b&gt;\u202e\x00\n' + "x" * 300


def drawn(told, name):
    fit = fit_people(told)
    return camera_picture(told, fit, name), fit


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["terrace", "construction"])
def test_the_grid_lies_where_the_camera_projects_the_ground(preset):
    made = simulated(preset)
    told = contents(made, seen=only_boxes(made))
    name = made.rig.names[1]
    svg, fit = drawn(told, name)
    camera, root = made.rig[name], parsed(svg)
    assert root.get("viewBox") == f"0 0 {camera.lens.size[0]} {camera.lens.size[1]}"
    # Pixels count from the middle of the first one, the drawing from its corner.
    assert any(g.get("transform") == "translate(0.5 0.5)" for g in root.iter(f"{SVG}g"))
    (grid,) = of_class(layer(root, "grid"), "grid")
    low, high = grid_region(fit, np.zeros((0, 3)))
    begin, end = grid_lines(low, high, grid_spacing(low, high))
    assert f"grid {grid_spacing(low, high):g} m" in svg
    share = np.linspace(0, 1, 100)[:, None]
    lines = [camera.project(a + share * (b - a)) for a, b in zip(begin, end, strict=True)]
    inside = [line[((line > 0) & (line < camera.lens.size)).all(axis=1)] for line in lines]
    stretches = strokes(grid)
    for line in inside:
        if len(line):
            assert np.min([distance_to(line, one) for one in stretches], axis=0).max() < 0.3
    every = np.concatenate(inside)
    corners = np.concatenate(strokes(grid))
    ray = camera.lens.bearings(corners) @ camera.pose.R_cw
    ground = camera.centre + ray * (-camera.centre[2] / ray[:, 2:])
    spacing = grid_spacing(low, high)
    near = np.linalg.norm(ground - camera.centre, axis=1) < 15  # a tenth of a pixel is centimetres farther away
    off = np.abs(ground[:, :2] / spacing - np.rint(ground[:, :2] / spacing)).min(axis=1)
    assert len(every) > 300
    assert near.sum() > 10
    assert off[near].max() < 0.03


@pytest.mark.slow
def test_the_horizon_and_plumb_lines_are_drawn_and_named():
    made = simulated()
    for camera in made.rig:
        root = parsed(drawn(contents(made, seen=only_boxes(made)), camera.name)[0])
        lines = layer(root, "lines")
        (verticals,), horizon = of_class(lines, "verticals"), of_class(lines, "horizon")
        assert len(strokes(verticals)) >= 3
        for stroke in strokes(verticals):
            ray = camera.lens.bearings(stroke) @ camera.pose.R_cw
            across = np.cross(ray[0], ray[-1])  # the plane through the camera is upright
            assert abs(across[2]) / np.linalg.norm(across) < 2e-3
        names = [text.text for text in lines.iter(f"{SVG}text")]
        assert names == [*(["horizon"] if horizon else []), "vertical"]
        for text in lines.iter(f"{SVG}text"):
            assert 0 <= float(text.get("x")) <= camera.lens.size[0]
            assert 0 <= float(text.get("y")) <= camera.lens.size[1]
    assert horizon, "these cameras hang low"


def test_boxes_the_models_boxes_and_other_cameras_are_drawn_where_they_are():
    made = simulated()
    told, name = contents(made, seen=only_boxes(made)), made.rig.names[2]
    fit = fit_people(told)
    for camera in made.rig:
        root = parsed(camera_picture(told, fit, camera.name))
        for other in made.rig:
            pixel = camera.project(other.centre)[0]
            inside = np.isfinite(pixel).all() and (pixel > 0).all() and (pixel < camera.lens.size).all()
            named = other.name in [text.text for text in layer(root, "cameras").iter(f"{SVG}text")]
            assert named == (bool(inside) and other.name != camera.name)
    root, boxes = parsed(camera_picture(told, fit, name)), told.observations[name].boxes
    rows = np.flatnonzero(boxes.frame == int(root.get("data-frame")))
    assert len(rows) == max(np.bincount(boxes.frame))
    seen = [strokes(g.findall(f"{SVG}path")[-1])[0] for g in of_class(layer(root, "boxes"), "seen")]
    corners = np.array([np.concatenate([points.min(axis=0), np.ptp(points, axis=0)]) for points in seen])
    assert np.abs(corners - boxes.ltwh[rows]).max() < 0.11
    labels = [text.text for text in layer(root, "boxes").iter(f"{SVG}text")]
    assert labels == [str(one) for one in boxes.identity[rows]]
    centres, shares = boxes.ltwh[rows, :2] + boxes.ltwh[rows, 2:] / 2, []
    for path in of_class(layer(root, "model"), "model"):
        parts = strokes(path)
        if len(parts) == 2:  # the body's axis, and a box where this camera saw one
            low, high = parts[1].min(axis=0), parts[1].max(axis=0)
            shares.append(np.linalg.norm(centres - (low + high) / 2, axis=1).min() / (high - low)[1])
    assert len(shares) >= len(rows) - 2
    assert np.median(shares) < 0.015


def test_joints_are_drawn_as_seen_and_as_they_project():
    made = simulated(seconds=6.0)
    told = contents(made, seen=only_joints(made))
    name = made.rig.names[0]
    svg, _ = drawn(told, name)
    root = parsed(svg)
    keypoints = told.observations[name].keypoints
    rows = np.flatnonzero(keypoints.frame == int(root.get("data-frame")))
    (crosses,) = of_class(layer(root, "joints"), "model")
    found = np.array([[float(v) for v in part.split("h")[0].split("v")[0].split()] for part in crosses.get("d").split("M")[1:]])
    middles = np.column_stack([found[1::2, 0], found[::2, 1]])
    seen = keypoints.xy[rows][keypoints.score[rows] > 0]
    assert len(middles) > 10
    assert np.linalg.norm(middles[:, None] - seen, axis=2).min(axis=1).max() < 0.3
    assert len(of_class(layer(root, "joints"), "limbs")) >= len(rows)
    assert keypoints.joints == BODY_17


def test_a_camera_without_a_pose_shows_its_boxes_only_and_a_person_alone_or_without_a_number_is_drawn():
    made = simulated()
    name = made.rig.names[0]
    rig = Rig(tuple(replace(one, pose=None, sigma=None) if one.name == name else one for one in made.rig))
    svg, _ = drawn(contents(made, rig=rig), name)
    assert "not registered" in svg
    shown = {one: bool(list(layer(parsed(svg), one))) for one in ("grid", "lines", "cameras", "model", "boxes")}
    assert [one for one, anything in shown.items() if anything] == ["boxes"]
    boxes = Boxes(np.array([3, 3]), np.array([-1, 900]), np.array([[50.0, 60, 40, 90], [200, 80, 35, 100]]), np.ones(2))
    told = contents(made, seen=Observations({name: CameraObservations(boxes)}))
    svg, _ = drawn(told, name)
    labels = [text.text for text in layer(parsed(svg), "boxes").iter(f"{SVG}text")]
    assert labels == ["?", "900"]
    # A body that one camera alone saw fits its box, whatever the calibration: it is not drawn.
    assert not list(layer(parsed(svg), "model"))


@pytest.fixture(scope="module")
def numbered(tmp_path_factory):
    """Puppets whose pictures tell their number by a row of white and black squares."""
    folder = tmp_path_factory.mktemp("numbered")
    made = puppets(seconds=9.0, cameras=2, people=4)

    def marked(name):
        for number, picture in enumerate(pictures(made, name), 1):
            for bit in range(8):
                picture[4:24, 8 + 24 * bit : 28 + 24 * bit] = 255 if number >> bit & 1 else 0
            yield picture

    for name in made.rig.names:
        write_video(folder / f"{name}.mp4", marked(name), made.fps)
    return made, {name: folder / f"{name}.mp4" for name in made.rig.names}


def number_in(svg, width):
    image = next(parsed(svg).iter(f"{SVG}image"))
    data = base64.b64decode(image.get("href").split(",")[1])
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    scale = picture.shape[1] / width
    middles = [(round(14 * scale), round((18 + 24 * bit) * scale)) for bit in range(8)]
    return sum(1 << bit for bit, at in enumerate(middles) if picture[at] > 127)


def puppet_contents(made, videos, frames=None):
    """Contents with the boxes that are drawn into the videos, of some frames or of all."""
    seen = {
        name: CameraObservations(boxes if frames is None else boxes.take(np.isin(boxes.frame, frames)))
        for name, boxes in made.boxes.items()
    }
    sources = {name: VideoSource((path,)) for name, path in videos.items()}
    return Contents(CalibrationDocument(verdict="accepted", cameras=()), made.rig, Observations(seen, made.fps), {}, sources)


def test_the_picture_is_the_one_that_the_boxes_are_of_and_one_with_many_people_is_chosen(numbered):
    made, videos = numbered
    name = made.rig.names[1]
    for frame in (1, 47, 90):
        svg, _ = drawn(puppet_contents(made, videos, [frame]), name)
        assert int(parsed(svg).get("data-frame")) == frame
        assert number_in(svg, made.rig[name].lens.size[0]) == frame
    for name in made.rig.names:
        svg, _ = drawn(puppet_contents(made, videos), name)
        frame, boxes = int(parsed(svg).get("data-frame")), made.boxes[name]
        low, high = boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]
        whole = (low > 2).all(axis=1) & (high < np.array(made.rig[name].lens.size) - 2).all(axis=1)
        count = np.bincount(boxes.frame[whole])
        assert count[frame] == count.max()
        assert number_in(svg, made.rig[name].lens.size[0]) == frame
        assert svg == drawn(puppet_contents(made, videos), name)[0]


@pytest.mark.parametrize("what", ["missing", "broken", "empty", "other size"])
def test_a_video_that_cannot_be_used_leaves_a_canvas_that_says_so(numbered, tmp_path, what):
    made, videos = numbered
    name = made.rig.names[0]
    path = tmp_path / "video.mp4"
    if what == "broken":
        path.write_bytes(videos[name].read_bytes()[:2000])
    elif what == "empty":
        path.write_bytes(b"")
    elif what == "other size":
        small = (cv2.resize(one, (64, 48)) for one in pictures(made, name))
        write_video(path, (next(small) for _ in range(3)), 10.0)
    told = puppet_contents(made, {} if what == "missing" else {name: path})
    svg, _ = drawn(told, name)
    assert not list(parsed(svg).iter(f"{SVG}image"))
    assert "no video" in svg if what == "missing" else "no image: " in svg
    assert of_class(parsed(svg), "canvas")
    assert str(tmp_path) not in svg


def test_pictures_are_small_enough_whatever_they_show():
    def shown(uri):
        return cv2.imdecode(np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8), cv2.IMREAD_COLOR)

    noise = np.random.default_rng(0).integers(0, 255, (2160, 3840, 3), dtype=np.uint8)
    uri = data_uri(noise)
    assert len(uri) <= 100_000
    assert uri == data_uri(noise)
    assert shown(uri).shape[1] <= 960
    assert shown(data_uri(np.full((720, 1280, 3), 128, np.uint8))).shape == (540, 960, 3)


def test_no_name_becomes_markup():
    made = simulated()
    rig = Rig(tuple(replace(one, name=HOSTILE + str(place)) for place, one in enumerate(made.rig)))
    seen = Observations({new: made.observations[old] for new, old in zip(rig.names, made.rig.names, strict=True)})
    told = contents(made, rig=rig, seen=seen)
    fit = fit_people(told)
    for name in rig.names:
        svg = camera_picture(told, fit, name)
        assert not scripts(svg)
        assert all(line.isprintable() for line in svg.split("\n"))
        assert all((one.text or "").isprintable() for one in parsed(svg).iter(f"{SVG}text"))
        tags = {one.tag.removeprefix(SVG) for one in parsed(svg).iter()}
        assert tags <= {"svg", "g", "path", "rect", "text", "title", "circle"}
        assert len(svg) < 100_000
