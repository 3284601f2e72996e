"""The rig in space, from above and on its plan: what is drawn stands where the cameras, the sigmas and the people are."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.lens_figures import border_rays
from passerby.core.observations import CameraObservations, Observations
from passerby.findings.finding import notice
from passerby.interchange.calibration_json import PlanEntry, ResidualEntry, WorldEntry
from passerby.report.fitted import fit_people
from passerby.report.rendering import render
from passerby.report.rig_geometry import escape_name as told_name
from passerby.report.rig_geometry import frustum, magnification, stage_of, wedge
from passerby.report.rig_plots import rig_from_above, rig_in_space
from passerby.report.site_map import plan_drawing
from support.report.drawings import contents, only_boxes, simulated
from support.report.pages import changed, diagnosed

HOSTILE = ('<a href="javascript:alert(1)">A</a>', "<b>B</b>&lt;i&gt;&#60;", "%{x}$\\frac{1}{2}$", "x" * 300 + "\n\x00")


def covariance(longer, shorter, degrees):
    """(6, 6) of a place with these semi-axes, metres, the longer one at an angle from x."""
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    out = np.zeros((6, 6))
    out[:3, :3] = turn @ np.diag([longer**2, shorter**2, 0.01**2]) @ turn.T
    return out


def with_sigmas(rig, longer=0.04, shorter=0.01, degrees=30.0):
    """The rig with the same uncertainty of each camera."""
    matrix = covariance(longer, shorter, degrees)
    sigma = PoseSigma(float(np.sqrt(np.trace(matrix[:3, :3]))), 0.1, matrix)
    return Rig(tuple(replace(one, sigma=sigma) for one in rig))


@pytest.fixture(scope="module")
def made():
    return simulated("terrace")


@pytest.fixture(scope="module")
def drawn_rig(made):
    told = contents(made, rig=with_sigmas(made.rig), seen=only_boxes(made))
    fit = fit_people(told)
    return told, fit, rig_from_above(told, fit), rig_in_space(told, fit)


def trace(figure, start):
    return next(one for one in figure["data"] if one.get("name", "").startswith(start))


def points(one, axes="xy"):
    """(N, D) of a trace, NaN at gaps."""
    return np.array([[np.nan if value is None else value for value in one[axis]] for axis in axes], dtype=float).T


def test_ellipses_stand_at_their_cameras_as_large_and_turned_as_they_say(drawn_rig):
    told, _, plan, _ = drawn_rig
    factor, one = plan["layout"]["meta"]["magnification"], trace(plan, "1 sigma")
    assert f"drawn {factor} times as large" in one["name"]
    outline = points(one)
    parts = np.split(outline, np.flatnonzero(np.isnan(outline[:, 0])))
    assert len(parts) == len(told.rig)
    for part, camera in zip(parts, told.rig, strict=True):
        own = part[np.isfinite(part[:, 0])]
        assert own[:-1].mean(axis=0) == pytest.approx(camera.centre[:2], abs=1e-3)
        away = own - camera.centre[:2]
        assert np.linalg.norm(away, axis=1).max() == pytest.approx(0.04 * factor, rel=0.01)
        # Every point is so many sigmas away by the covariance itself.
        weight = np.linalg.inv(camera.sigma.covariance[:2, :2])
        assert np.sqrt(np.einsum("ni,ij,nj->n", away, weight, away)) == pytest.approx(factor, rel=0.01)


def test_sigmas_without_directions_are_circles_and_said_to_be_and_magnification_is_a_whole_factor(made):
    rig = Rig(tuple(replace(one, sigma=PoseSigma(0.3, 0.1)) for one in made.rig))
    told = contents(made, rig=rig, seen=only_boxes(made))
    plan = rig_from_above(told, fit_people(told))
    one = trace(plan, "1 sigma")
    assert "directions unknown" in one["name"]
    outline = points(one)[:49]
    radius = np.linalg.norm(outline - made.rig.cameras[0].centre[:2], axis=1)
    assert radius == pytest.approx(0.3 / np.sqrt(3) * plan["layout"]["meta"]["magnification"], abs=2e-4)
    without = contents(made, rig=Rig(tuple(replace(one, sigma=None) for one in made.rig)), seen=only_boxes(made))
    assert not [one for one in rig_from_above(without, fit_people(without))["data"] if one["name"].startswith("1 sigma")]
    assert [magnification(sigma_m, 20.0) for sigma_m in (0.001, 0.1, 5.0, 0.0)] == [1000, 10, 1, 1]


def test_groups_that_people_join_have_a_dashed_line_between_them(made):
    joint = notice("groups_joined", "C2", "C3", people=40, sizes=[2, 2])
    told = contents(made, seen=only_boxes(made))
    assert not [one for one in rig_from_above(told, fit_people(told))["data"] if one["name"].startswith("joined by")]
    joined = changed(told, **diagnosed(joint))
    plan = rig_from_above(joined, fit_people(told))
    line = points(trace(plan, "joined by people"))
    assert line[:2] == pytest.approx(np.array([made.rig[name].centre[:2] for name in ("C2", "C3")]), abs=0.05)
    # A camera without a pose has no place on the plan.
    lost = Rig(tuple(replace(one, pose=None) if one.name == "C3" else one for one in made.rig))
    without = replace(joined, rig=lost)
    assert not [one for one in rig_from_above(without, fit_people(told))["data"] if one["name"].startswith("joined by")]


def test_cameras_stand_where_they_are_and_colours_are_left_to_the_page(drawn_rig):
    told, _, plan, space = drawn_rig
    for figure in drawn_rig[2:]:
        assert not {"paper_bgcolor", "plot_bgcolor", "font", "template"} & set(figure["layout"])
        axes = [figure["layout"], *([figure["layout"]["scene"]] if "scene" in figure["layout"] else [])]
        assert not any("gridcolor" in value for one in axes for value in one.values() if isinstance(value, dict))
    for camera in told.rig:
        mark = next(one for one in plan["data"] if camera.name in one.get("text", []))
        assert (mark["x"][0], mark["y"][0]) == pytest.approx(camera.centre[:2], abs=2e-3)
        ahead = np.array([mark["x"][1] - mark["x"][0], mark["y"][1] - mark["y"][0]])
        assert ahead @ camera.pose.R_cw[2, :2] / np.linalg.norm(ahead) == pytest.approx(
            np.linalg.norm(camera.pose.R_cw[2, :2]), abs=0.01
        )
        mark = next(one for one in space["data"] if one.get("text") == [camera.name])
        assert points(mark, "xyz")[0] == pytest.approx(camera.centre, abs=2e-3)
        assert f"height {camera.centre[2]:.2f} m" in mark["hovertext"][0]
        assert "± 42 mm" in mark["hovertext"][0]


def test_a_frustum_is_the_border_of_the_picture_and_a_wedge_the_ground_that_is_seen(made):
    for camera in made.rig:
        corners = frustum(camera, 2.0)[::8]
        size = np.array(camera.lens.size)
        assert np.abs(camera.project(corners) - np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size + 0.5).max() < 0.01
        assert (corners - camera.centre) @ camera.pose.R_cw[2] == pytest.approx(2.0)
        outline = wedge(camera, 5.0)
        away = np.linalg.norm(outline - camera.centre[:2], axis=1)
        assert away.min() < 1e-5
        assert away.max() == pytest.approx(5.0, abs=1e-3)
        far = outline[away > 4.9]
        pixels = camera.project(np.column_stack([far, np.zeros(len(far))]))
        assert (pixels[:, 0] > -3).all()
        assert (pixels[:, 0] < camera.lens.size[0] + 3).all()


def test_a_fisheye_with_black_corners_has_a_frustum():
    lens = Lens(
        (1000, 1000), np.array([[290.0, 0, 500], [0, 290.0, 500], [0, 0, 1]]), np.array([-0.05, 0.0, 0.0, 0.0]), fisheye=True
    )
    camera = Camera("F", lens, Pose.from_centre(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 4.0])))
    assert np.isfinite(border_rays(camera.lens)).all()
    border = frustum(camera, 1.0)
    assert np.linalg.norm(border - camera.centre, axis=1).max() < 5
    # It looks straight down: the ground that it sees surrounds it.
    around = wedge(camera, 6.0)
    angle = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    assert np.diff(angle).max() < 1.0
    assert np.linalg.norm(around, axis=1).max() <= 6.0 + 1e-6


def test_people_are_drawn_where_they_walked(drawn_rig, made):
    _, fit, plan, space = drawn_rig
    true = made.ground_positions[np.isfinite(made.ground_positions[:, :, 0])]

    def away(places):
        return np.quantile(np.linalg.norm(places[:, None] - true, axis=2).min(axis=1), 0.95)

    crowd = trace(plan, "where people were")
    z = np.array([[np.nan if v is None else v for v in row] for row in crowd["z"]])
    assert np.nanmax(z) == 1.0
    row, column = np.nonzero(np.isfinite(z))
    assert away(np.column_stack([np.array(crowd["x"])[column], np.array(crowd["y"])[row]])) < 0.5
    every = np.concatenate([points(one, "xyz") for one in space["data"] if one.get("legendgroup") == "ways"])
    every = every[np.isfinite(every[:, 0])]
    assert len(every) >= 0.95 * len(fit.ways)
    assert away(every[:, :2]) < 0.4


def test_views_look_at_the_people_and_out_of_each_camera(drawn_rig):
    told, fit, _, space = drawn_rig
    layout, stage = space["layout"], stage_of(told.rig, fit.ways.xy)
    scene = layout["scene"]
    size = np.array([scene[f"{k}axis"]["range"][1] - scene[f"{k}axis"]["range"][0] for k in "xyz"])
    low = np.array([scene[f"{k}axis"]["range"][0] for k in "xyz"])
    ratio = np.array([scene["aspectratio"][k] for k in "xyz"])
    # Metres are as long in all directions.
    assert ratio / size == pytest.approx(np.full(3, ratio[0] / size[0]), rel=1e-3)
    views = {view["label"]: view["camera"] for view in layout["meta"]["views"]}
    assert list(views)[:4] == ["Oblique", "From above", "Along x", "Along y"]
    assert scene["camera"] == views["Oblique"]

    def metres(point):
        return np.array([point[k] for k in "xyz"]) * size[0] / ratio[0] + low + size / 2

    for camera in told.rig:
        view = views[f"From {camera.name}"]
        assert metres(view["eye"]) == pytest.approx(camera.centre, abs=0.01)
        ahead = metres(view["center"]) - metres(view["eye"])
        assert ahead / np.linalg.norm(ahead) == pytest.approx(camera.pose.R_cw[2], abs=1e-3)
    for label, most_deg in (("Oblique", 8), ("Along x", 1), ("Along y", 1)):
        eye, centre = metres(views[label]["eye"]), metres(views[label]["center"])
        people = stage.middle + (0, 0, 1.0) - eye
        cosine = people @ (centre - eye) / np.linalg.norm(people) / np.linalg.norm(centre - eye)
        assert np.degrees(np.arccos(min(cosine, 1.0))) < most_deg
    assert metres(views["Oblique"]["eye"])[2] > stage.high[2]


def test_cameras_without_a_pose_are_listed_and_not_drawn_and_a_refused_rig_gives_empty_figures(made):
    lost = made.rig.names[1]
    cameras = [replace(one, pose=None, sigma=None) if one.name == lost else one for one in made.rig]
    told = contents(made, rig=Rig(tuple(cameras)), seen=only_boxes(made))
    above, space = (draw(told, fit_people(told)) for draw in (rig_from_above, rig_in_space))
    for figure in (above, space):
        assert figure["layout"]["meta"]["unregistered"] == [lost]
        assert not [one for one in figure["data"] if one.get("name") == lost]
    assert f"not registered: {lost}" in above["layout"]["annotations"][0]["text"]
    nothing = Observations(dict.fromkeys(made.rig.names, CameraObservations()))
    for rig in (Rig(tuple(replace(one, pose=None) for one in made.rig)), Rig(made.rig.cameras[:1])):
        told = contents(made, rig=rig, seen=nothing)
        for draw in (rig_from_above, rig_in_space):
            assert json.dumps(draw(told, fit_people(told)), allow_nan=False)


def test_names_are_inert_and_figures_are_plain_small_and_the_same_again(made):
    rig = Rig(tuple(replace(one, name=name) for one, name in zip(with_sigmas(made.rig), HOSTILE, strict=True)))
    boxes = (CameraObservations(made.observations[name].boxes) for name in made.rig.names)
    told = contents(made, rig=rig, seen=Observations(dict(zip(HOSTILE, boxes, strict=True))))
    fit = fit_people(told)
    for draw in (rig_from_above, rig_in_space):
        text = json.dumps(draw(told, fit), allow_nan=False, ensure_ascii=False)
        assert text == json.dumps(draw(told, fit_people(told)), allow_nan=False, ensure_ascii=False)
        assert all(rest.startswith("br>") for rest in text.split("<")[1:])
        assert not re.search("&lt;|template", text)
        assert len(text) < 300_000
    assert (told_name("R&D, a < b"), told_name("&#60;&amp;")) == ("R&D, a ‹ b", "& #60;& amp;")


UNIT, WIDTH, HEIGHT, ORIGIN = 0.02, 600, 800, (120.0, 700.0)
ROWS = (
    ResidualEntry(camera="C1", off_m=0.05, stated_m=(1.0, 2.0), found_m=(1.0, 2.05)),
    ResidualEntry(point="kerb", camera="C2", off_m=1.5, used=False, stated_m=(3.0, 2.0), found_m=(4.5, 2.0)),
    ResidualEntry(point="sky", camera="C1", off_m=None, used=False, stated_m=(3.5, 2.0)),
)


def plan_of(image, tmp_path):
    made = simulated("terrace")
    told = contents(made, seen=only_boxes(made))
    world = WorldEntry(by="plan plan.png", plan=PlanEntry(image=image, metres_per_pixel=UNIT, origin=ORIGIN), residuals=ROWS)
    told = replace(told, document=replace(told.document, world=world, scene_file=str(tmp_path / "scene.toml")))
    drawn = plan_drawing(told, fit_people(told))
    html = render("rig.html", site=False, plan=drawn, plots=[drawn.plot])
    figure = re.search(r'<script[^>]*id="rig-plan-figure"[^>]*>(.*?)</script>', html, re.DOTALL)
    return html, json.loads(figure[1])


@pytest.fixture
def drawn_plan(tmp_path):
    cv2.imwrite(str(tmp_path / "plan.png"), np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
    return plan_of("plan.png", tmp_path)


def test_the_plans_picture_lies_where_its_pixels_are_and_placements_lead_from_click_to_rig(drawn_plan):
    (image,) = drawn_plan[1]["layout"]["images"]
    # The outer corner of the first pixel, half a pixel from its centre.
    assert (image["x"], image["y"]) == (pytest.approx(UNIT * (-0.5 - ORIGIN[0])), pytest.approx(UNIT * (ORIGIN[1] + 0.5)))
    assert (image["sizex"], image["sizey"]) == (pytest.approx(UNIT * WIDTH), pytest.approx(UNIT * HEIGHT))
    assert image["source"].startswith("data:image/jpeg;base64,")
    assert image["layer"] == "below"
    low, high = drawn_plan[1]["layout"]["xaxis"]["range"]
    assert low < image["x"]
    assert high > image["x"] + image["sizex"]

    html, figure = drawn_plan
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


def test_without_the_picture_the_rest_is_drawn_and_the_page_says_so(tmp_path):
    html, figure = plan_of("gone.png", tmp_path)
    assert "is not where it was" in html
    assert figure["layout"]["images"] == []
    assert any(one.get("mode") == "markers" for one in figure["data"])
    told = contents(simulated("terrace"))
    assert plan_drawing(told, fit_people(told)) is None, "a world without a plan"
