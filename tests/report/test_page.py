"""The page holds what the calibration tells, whatever came of it, and no more than that; and what each lens rests on."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.calibration import contents_of
from passerby.cli.main import run
from passerby.core.cameras import Lens, Rig
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures, field_of_view_deg
from passerby.core.usability import doubt_missing_pose
from passerby.findings.finding import doubt, notice, refusal
from passerby.interchange.calibration_json import read_document
from passerby.interchange.storage.text_formats import plain
from passerby.report.contents import contents_from
from passerby.report.page import report_page
from support.report.drawings import contents as contents_of_simulated
from support.report.drawings import simulated
from support.report.pages import HOSTILE, Page, busy_place, changed, diagnosed, named, solved, with_figures, without_poses
from support.scenes.handmade_files import rows, write_scene

pytestmark = pytest.mark.smoke

SECTIONS = (
    "summary", "cameras", "rig", "views", "graph", "timeline", "heights", "scale", "distances", "stages", "settings", "files",
)  # fmt: skip


@pytest.fixture(scope="session")
def page(calibrated):
    return Page(report_page(contents_from(calibrated[1])))


def test_the_page_holds_every_section_and_the_figures_of_calibration_json(page, calibrated):
    assert tuple(page.sections) == SECTIONS
    assert page.title == f"{calibrated[0].scene.name}: accepted – Passerby"
    assert "Accepted" in page.sections["summary"]
    assert "4 of 4" in page.sections["summary"]
    told = json.loads((calibrated[1] / "calibration.json").read_text())
    rows = page.rows("cameras-table")
    assert [row["Camera"] for row in rows] == [one["name"] for one in told["cameras"]]
    keys = {
        "Heading °": "heading_deg", "Tilt °": "tilt_deg", "Roll °": "roll_deg", "Position std mm": "position_sigma_mm",
        "Rotation std °": "orientation_sigma_deg", "Residual px": "median_residual_px", "People": "people", "Boxes": "boxes",
    }  # fmt: skip
    for row, one in zip(rows, told["cameras"], strict=True):
        assert [float(row[key]) for key in ("x m", "y m", "Height m")] == pytest.approx(one["centre_m"], abs=1e-12)
        assert {key: float(row[key]) for key in keys} == {key: one[name] for key, name in keys.items()}
    centres = {camera.name: camera.centre for camera in calibrated[0].rig}
    for row in page.rows("distances-table"):
        for name, centre in centres.items():
            if name != row["Camera"]:
                assert float(row[f"{name} m"]) == pytest.approx(sum((centre - centres[row["Camera"]]) ** 2) ** 0.5)


@pytest.fixture(scope="module")
def geopose(scene):
    """Output folder of a calibration by the paper's method."""
    change = '"geopose"\nreference = "C1"'
    return solved(scene, "geopose", "keypoints", lambda text: text.replace('"people"', change))[1]


@pytest.mark.slow
def test_every_key_of_calibration_json_is_read(calibrated, geopose):
    for out, key in ((calibrated[1], "tree"), (geopose, "reference")):
        told = json.loads((out / "calibration.json").read_text())
        assert key in told["figures"]
        assert plain(read_document(out)) == told
        assert {"schema_version", "scene_file", "files"} <= told.keys()


@pytest.mark.slow
def test_a_calibration_and_its_folder_give_the_same_figures_and_the_same_bytes(page, calibrated):
    calibration, out = calibrated
    fresh = Page(report_page(contents_of(calibration)))
    # A rig file keeps rotations as vectors, so distances differ in the last digit.
    assert {name: rows for name, rows in fresh.tables.items() if name != "distances-table"} == {
        name: rows for name, rows in page.tables.items() if name != "distances-table"
    }
    assert report_page(contents_from(out)) == report_page(contents_from(out))


@pytest.mark.slow
def test_a_frame_that_was_set_is_told_with_what_it_rests_on(calibrated):
    contents = contents_from(calibrated[1])
    assert "Alignment of the world frame" not in Page(report_page(contents)).sections["stages"]
    residuals = [{"camera": "C1", "off_m": 0.084, "used": True}, {"point": "<b>", "camera": "C2", "off_m": 3.2, "used": False}]
    world = {
        "by": "positions gps.csv", "scale": 1.02, "scale_fitted": True, "turn_sigma_deg": 0.64, "place_sigma_mm": 133.0,
        "residuals": residuals, "notes": ["the scale grew by 2 %"],
    }  # fmt: skip
    stages = Page(report_page(changed(contents, world=world))).sections["stages"]
    for sentence in (
        "Origin and heading are set by positions gps.csv.", "The heading is known to 0.64°, the position to 0.13 m",
        "Lengths were multiplied by 1.0200.", "C1 has a residual of 0.08 m.", "The scale grew by 2 %.",
        "Point <b> in C2 has a residual of 3.20 m, left out.",
    ):  # fmt: skip
        assert sentence in stages


def test_a_refused_one_has_dashes_and_says_why_in_every_section(calibrated):
    contents = without_poses(contents_from(calibrated[1]), refusal("no_shared_people", given=True))
    page = Page(report_page(contents))
    assert "Refused" in page.sections["summary"]
    assert "0 of 4" in page.sections["summary"]
    assert all(row["x m"] == row["Position std mm"] == row["Residual px"] == "" for row in page.rows("cameras-table"))
    for section, words in {
        "rig": "No camera has a pose", "heights": "no heights", "scale": "was not determined", "distances": "Fewer than two",
    }.items():  # fmt: skip
        assert words in page.sections[section]
    assert page.rows("cameras-table")[0]["Boxes"] == str(contents.document.cameras[0].boxes)


def test_a_scene_that_shares_nobody_is_refused_and_the_page_says_so(tmp_path):
    path = write_scene(tmp_path, files={"A.txt": rows(identities=(1,)), "B.txt": rows(identities=(2,))})
    assert run(["calibrate", str(path), "-o", str(tmp_path / "out")]) == 3
    page = Page(report_page(contents_from(tmp_path / "out")))
    assert "Refused" in page.sections["summary"]
    assert "nothing connects them" in page.sections["graph"]


def test_a_doubtful_one_tells_what_is_wrong_and_what_to_do(calibrated):
    contents = contents_from(calibrated[1])
    cameras = (replace(one, pose=None, sigma=None) if one.name == "C3" else one for one in contents.rig)
    why = doubt_missing_pose(notice("cameras_share_nobody", "C3", main=["C1"], given=True))
    told = changed(contents, verdict="doubtful", **diagnosed(doubt("few_observations", "C2", agreeing=3), why))
    page = Page(report_page(replace(told, rig=replace(contents.rig, cameras=tuple(cameras)))))
    for said in ("Doubtful", "Camera C2 has only 3 supporting observations.", "Record more people in its view.", "3 of 4"):
        assert said in page.sections["summary"]
    assert "no pose: Camera C3 shares no people with C1." in page.sections["cameras"]
    assert [row["x m"] == "" for row in page.rows("cameras-table")] == [False, False, True, False]


@pytest.mark.slow
def test_the_papers_method_and_joints_give_sound_pages(scene, geopose):
    page = Page(report_page(contents_from(geopose)))
    assert tuple(page.sections) == SECTIONS
    assert "equally tall" in page.sections["heights"]
    assert "essential matrix" in page.sections["graph"]
    joints = solved(scene, "joints", "tracks")[1]
    page = Page(report_page(contents_from(joints)))
    assert tuple(page.sections) == SECTIONS
    row = page.rows("cameras-table")[0]
    assert float(row["Keypoints"]) > 0
    assert float(row["People"]) == 5
    assert len(page.rows("pairs-table")) == 6


def test_a_folder_of_an_older_passerby_gives_a_sound_page(calibrated, tmp_path):
    told = json.loads((calibrated[1] / "calibration.json").read_text())
    cameras = [{key: one[key] for key in ("name", "registered", "centre_m", "boxes", "keypoints")} for one in told["cameras"]]
    old = {"name": told["name"], "verdict": "doubtful", "reasons": ["camera C2 is odd: see why"], "cameras": cameras}
    (tmp_path / "calibration.json").write_text(json.dumps(old))
    (tmp_path / "rig.toml").write_bytes((calibrated[1] / "rig.toml").read_bytes())
    page = Page(report_page(contents_from(tmp_path)))
    assert tuple(page.sections) == SECTIONS
    assert "There are no tracks with identities" in page.sections["timeline"]
    assert "Camera C2 is odd: see why." in page.sections["summary"]
    new = Page(report_page(contents_from(calibrated[1]))).rows("cameras-table")
    for row, other in zip(page.rows("cameras-table"), new, strict=True):
        assert float(row["Heading °"]) == pytest.approx(float(other["Heading °"]))


def test_names_are_text_and_nothing_else(calibrated):
    contents = named(contents_from(calibrated[1]), HOSTILE)
    odd = doubt("camera_without_pose", HOSTILE[1], why=None), notice("world_not_set", place="scene.toml", why=HOSTILE[2])
    page = Page(report_page(changed(contents, name=HOSTILE[0], **diagnosed(*odd))))
    assert [row["Camera"] for row in page.rows("cameras-table")] == list(HOSTILE)
    runs = [attributes for attributes, _ in page.scripts if attributes.get("type") != "application/json"]
    assert runs == [{}, {}]  # plotly and the page's own
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    figures = [json.loads(text) for attributes, text in page.scripts if attributes.get("type") == "application/json"]
    assert all({"data", "layout"} <= figure.keys() for figure in figures)


def test_nothing_is_fetched_only_two_scripts_may_run_and_labels_lead_somewhere(page):
    policy = next(attributes["content"] for tag, attributes in page.elements if tag == "meta" and "http-equiv" in attributes)
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    assert "unsafe" not in policy.split("script-src")[1].split(";")[0]
    assert not [attributes for _, attributes in page.elements if "src" in attributes]
    links = [attributes["href"] for tag, attributes in page.elements if tag == "a"]
    assert all(link.startswith("#") for link in links)
    assert {link[1:] for link in links} <= {attributes.get("id") for _, attributes in page.elements}

    identifiers = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(identifiers) == len(set(identifiers))
    labels = {attributes["aria-labelledby"] for _, attributes in page.elements if "aria-labelledby" in attributes}
    assert labels <= set(identifiers)
    assert not re.search(r"\b20[23]\d-\d\d-\d\d\b", page.text), "no date and no wall time stands in it"


@pytest.mark.slow
def test_an_hour_of_a_hundred_people_before_sixteen_cameras_stays_small():
    contents = busy_place(cameras=16, people=100, seconds=3600, fps=2.0)
    assert sum(len(seen.boxes) for seen in contents.observations.cameras.values()) > 300_000
    html = report_page(contents)
    assert len(html.encode()) < 8_400_000  # sixteen pictures of 100 kB fit into 10 MB beside it
    timeline = json.loads(next(text for told, text in Page(html).scripts if told.get("id") == "timeline-plot-figure"))
    crowd, _ = timeline["data"]
    assert len(crowd["z"]) == 16
    assert 2 < np.mean(crowd["z"]) < 5  # four people at once, as made
    kept = timeline["layout"]["meta"]["bars"]
    assert 5000 < len(kept["who"]) <= 20_000
    assert len(set(kept["who"])) == 100


@pytest.mark.slow
def test_the_command_makes_the_page_again(calibrated, tmp_path, capsys):
    out, there = calibrated[1], tmp_path / "page.html"
    assert run(["report", str(out), "-o", str(there)]) == 0
    assert str(there) in capsys.readouterr().out
    assert there.read_text() == report_page(contents_from(out))
    assert run(["report", str(tmp_path / "nowhere")]) == 2
    assert "calibration.json" in capsys.readouterr().err


FOUND = Lens((720, 576), np.array([[500.0, 0, 361], [0, 500, 287], [0, 0, 1]]), np.array([-0.12, 0, 0, 0]))
PARTS = LensFigures(
    focal=FocalFigures(
        stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True, prior_sigma_px=48.0,
        prior="search", people_share=1.0,
    ),
    principal_point=PrincipalPointFigures(
        stated_px=(359.5, 287.5), refined_px=(361.0, 287.0), sigma_px=(6.0, 5.0), people_sigma_px=(50.0, None), far=False,
        told=False, prior_sigma_px=(7.2, 7.2), prior="assumed", people_share=(0.02, 0.0),
    ),
    distortion=DistortionFigures(
        refined=-0.12, sigma=0.03, stated=0.0, prior_sigma=0.15, people_sigma=0.031, prior="assumed", people_share=0.95
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def lenses_told():
    """Four cameras, the lenses of two of them estimated."""
    made = simulated(seconds=4.0)
    rig = Rig(tuple(replace(one, lens=FOUND) if one.name in ("C2", "C3") else one for one in made.rig))
    poor = replace(PARTS, focal=replace(PARTS.focal, sigma_px=40.0), group="yard")
    lenses = {"C2": plain(replace(PARTS, group="yard")), "C3": plain(poor)}
    return with_figures(contents_of_simulated(made, rig=rig), lenses=lenses)


@pytest.fixture(scope="module")
def lens_page(lenses_told):
    return Page(report_page(lenses_told))


def test_each_lens_that_was_estimated_has_a_row_and_each_number_its_prior_and_the_share_of_people(lens_page):
    rows = lens_page.rows("lenses-table")
    assert [row["Camera"] for row in rows] == ["C2", "C3"]
    across, down = field_of_view_deg(FOUND)
    row, keys = rows[0], ("Focal length px", "Principal point x, px", "Principal point y, px", "Distortion k1")
    assert [float(row[key]) for key in keys] == [500.0, 361.0, 287.0, -0.12]
    assert (float(row["Field of view ° across"]), float(row["Field of view ° down"])) == pytest.approx((across, down))
    assert (row["From people"], row["From the prior"]) == ("focal length, k1", "principal point")

    rows = lens_page.rows("lens-priors-table")
    assert len(rows) == 8
    names = "focal length, px", "principal point x, px", "principal point y, px", "distortion k1"
    assert tuple(row["Parameter"] for row in rows[:4]) == names
    keys = ("Estimate", "Std", "Prior", "Prior std", "Std by people alone", "From people %", "Determined by")
    assert [rows[0][key] for key in keys] == ["500.0", "10.0", "", "", "", "100.0", "people"]
    assert [rows[1][key] for key in keys] == ["361.0", "6.0", "359.5", "7.2", "50.0", "2.0", "assumed"]
    assert [rows[3][key] for key in keys] == ["-0.12", "0.03", "0.0", "0.15", "0.031", "95.0", "people"]

    for said in ("the focal length of C3 is uncertain by more than 4 %", "± 8.0 %", "Grey: people barely determine",
                 "C2 and C3 have one lens", "Focal length", "Field of view", "Principal point", "Distortion k1", "Prior",
                 "bends straight lines"):  # fmt: skip
        assert said in lens_page.sections["lenses"]


def test_the_section_is_not_there_without_a_lens_and_a_number_that_was_not_refined_is_as_it_was_stated(lenses_told):
    page = Page(report_page(with_figures(lenses_told, lenses={})))
    assert "lenses" not in page.sections
    assert not any(attributes.get("href") == "#lenses" for _, attributes in page.elements)
    stated = LensFigures(focal=replace(PARTS.focal, prior="stated"))
    page = Page(report_page(with_figures(lenses_told, lenses={"C2": plain(stated)})))
    (row,) = page.rows("lenses-table")
    assert (float(row["Principal point x, px"]), float(row["Distortion k1"])) == (361.0, -0.12)
    assert len(page.rows("lens-priors-table")) == 1
    assert "± 6" not in page.sections["lenses"]
