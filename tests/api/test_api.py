"""What `import passerby` offers: every name, calibrating from arrays, one line and a picture for each result."""

import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.cli.main import run
from passerby.findings.finding import notice, refusal
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry
from passerby.simulation import SimulationOptions, simulate, write_scene

pytestmark = pytest.mark.smoke


@pytest.fixture(scope="module")
def made():
    return simulate(SimulationOptions(seconds=12.0, box_noise=0.02, seed=4))


@pytest.fixture(scope="module")
def scene(made, tmp_path_factory):
    return write_scene(made, tmp_path_factory.mktemp("api") / "scene")


@pytest.fixture(scope="module")
def calibration(scene):
    return passerby.calibrate(scene)


@pytest.fixture(scope="module")
def out(calibration, tmp_path_factory):
    folder = tmp_path_factory.mktemp("api") / "out"
    calibration.write(folder)
    return folder


def arrays(made):
    """Rows as in the files: rounded as they are, sorted by frame and identity."""
    found = {}
    for name in made.rig.names:
        boxes = made.observations[name].boxes
        rows = np.column_stack([boxes.frame, boxes.identity, boxes.ltwh, boxes.score])
        found[name] = rows[np.lexsort((boxes.identity, boxes.frame))]
    return found


def lenses(made):
    return {camera.name: camera.lens for camera in made.rig}


def apart(a, b):
    return max(np.abs(x.centre - y.centre).max() for x, y in zip(a, b, strict=True))


def test_every_name_is_there_and_documented():
    text = (Path(__file__).parents[2] / "docs" / "api.md").read_text(encoding="utf-8")
    for name in passerby.__all__:
        assert getattr(passerby, name) is not None
        assert f"`{name}`" in text, f"docs/api.md does not tell of {name}"
        assert name in dir(passerby)
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        passerby.calibrat  # noqa: B018
    for name in ("align", "calibrate_observations", "evaluate", "export_rig", "import_rig", "read_calibration", "trajectories"):
        assert getattr(passerby, name).__doc__.count("passerby.") >= 1, f"{name} has no example"


def test_import_loads_nothing_heavy():
    heavy = ("numpy", "cv2", "scipy", "pydantic", "plotly", "jinja2", "torch")
    code = f"import sys, passerby; print([n for n in {heavy} if n in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


@pytest.mark.slow
def test_arrays_give_what_files_give(made, calibration):
    found = passerby.calibrate_observations(lenses(made), arrays(made), fps=made.options.fps, association={"mode": "given"})
    assert found.accepted
    assert apart(found.rig, calibration.rig) < 0.02  # the files' boxes are rounded
    assert found.scene.name == "scene"
    assert found.to_dict()["cameras"][0]["boxes"] == calibration.to_dict()["cameras"][0]["boxes"]
    same = passerby.calibrate_observations(
        made.rig,
        {name: made.observations[name].boxes for name in made.rig.names},
        fps=dict.fromkeys(made.rig.names, made.options.fps),
        association={"mode": "given"},
    )
    assert apart(found.rig, same.rig) < 1e-3
    assert same.clocked == found.clocked


def test_a_calibration_from_arrays_is_written_and_read(made, tmp_path):
    found = passerby.calibrate_observations(
        lenses(made), arrays(made), fps=5.0, name="<b>", association={"mode": "given"}, world={"camera": "C3"}
    )
    assert found.rig["C3"].centre[:2] == pytest.approx((0, 0), abs=1e-9)
    found.write(tmp_path / "out")
    found.report(tmp_path / "out" / "report.html")
    assert "<b></b>" not in (tmp_path / "out" / "report.html").read_text()
    again = passerby.read_calibration(tmp_path / "out")
    assert apart(again.rig, found.rig) < 1e-9
    assert (again.verdict, run(["track", str(tmp_path / "out")])) == ("accepted", 0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"boxes": {"X": np.zeros((0, 6))}}, "camera X has people, but no intrinsics: add it to the lenses (C1, C2, C3, C4)"),
        ({"boxes": {"C1": np.zeros((3, 4))}}, "boxes of camera C1 have the shape (3, 4): give rows of frame, id"),
        ({"boxes": {"C1": [["a"] * 6]}}, "boxes of camera C1 are not numbers"),
        ({"boxes": {"C1": [[1, 1, 0, 0, -5, 9]]}}, "boxes of camera C1: box of frame 1, identity 1 has width and height"),
        ({"boxes": {"C1": [[1, 1, 0, 0, 5, 9]] * 2}}, "boxes: camera C1: 1 of 2 rows repeat an identity that has another row"),
        ({"fps": {"C9": 5.0}}, "fps: camera C9 has no lens"),
        ({"fps": -1.0}, "scene scene: [scene] fps"),
        ({"association": {"mode": "givn"}}, "scene scene: [association] mode is 'givn'"),
        ({"scale": {"person_hight_m": 1.7}}, "did you mean 'person_height_m'?"),
        ({"solver": {"options": {"round": 1}}}, "unknown key 'round': did you mean 'rounds'?"),
        ({"perception": {}}, "'perception' is not a table of the scene file that can be used here"),
        ({"boxes": {name: [[1, -1, 9, 9, 9, 9]] for name in ("C1", "C2", "C3", "C4")}}, "no row has an identity"),
        ({"lenses": ("C1",), "boxes": {"C1": np.zeros((0, 6))}}, "a calibration needs two or more"),
    ],
)
def test_impossible_input_is_one_clear_error(made, change, says):
    given = {"boxes": arrays(made), "fps": 5.0, "association": {"mode": "given"}, **change}
    names = given.pop("lenses", made.rig.names)
    with pytest.raises(passerby.InputError, match=re.escape(says)):
        passerby.calibrate_observations({name: made.rig[name].lens for name in names}, **given)


def test_rigs_go_to_other_tools_and_back(calibration, out, tmp_path):
    lost = passerby.export_rig(calibration, "opencv", tmp_path / "cv", lossy=True)
    assert isinstance(lost, tuple)
    again = passerby.import_rig(tmp_path / "cv", "opencv", lossy=True)
    assert {camera.name for camera in again} == set(calibration.rig.names)
    assert max(np.abs(again[name].centre - calibration.rig[name].centre).max() for name in again.names) < 1e-6
    passerby.write_rig(tmp_path / "copy.toml", calibration.rig)
    assert apart(passerby.read_rig(tmp_path / "copy.toml"), calibration.rig) < 1e-9
    with pytest.raises(passerby.InputError, match="no format is called 'opncv': did you mean 'opencv'"):
        passerby.export_rig(out, "opncv", tmp_path / "x")


def test_ways_of_people(calibration, out):
    written, fresh = passerby.trajectories(out), passerby.trajectories(calibration)
    assert len(written) == len(fresh) > 300
    assert np.abs(written.xyz - fresh.xyz).max() < 0.02
    assert len(passerby.trajectories(passerby.read_calibration(out), method="pairwise", max_gap_s=1.0)) > 300
    with pytest.raises(passerby.InputError, match="method 'x' does not exist"):
        passerby.trajectories(out, method="x")
    lost = replace(calibration, rig=replace(calibration.rig, cameras=tuple(replace(c, pose=None) for c in calibration.rig)))
    with pytest.raises(passerby.EvidenceError, match="no camera has a pose"):
        passerby.trajectories(lost)


def test_evaluate_takes_a_folder_for_a_rig_file(made, scene, calibration, out, tmp_path, capsys):
    truth = scene.parent / "truth.toml"
    by_path, by_value = passerby.evaluate(out, truth), passerby.evaluate(calibration, made.rig)
    assert by_path.similarity.mean_position_mm == pytest.approx(by_value.similarity.mean_position_mm, rel=1e-6)
    shown = []
    for rig, reference in ((out / "rig.toml", truth), (out, truth), (truth, out / "rig.toml"), (truth, out)):
        assert run(["evaluate", str(rig), str(reference), "--json"]) == 0
        shown.append(capsys.readouterr().out)
    assert (shown[0], shown[2]) == (shown[1], shown[3])
    assert passerby.evaluate(truth, out).to_dict() == passerby.evaluate(truth, out / "rig.toml").to_dict()
    assert run(["evaluate", str(tmp_path), str(truth)]) == 2
    assert "rig.toml: no such file" in capsys.readouterr().err


def test_align_by_values_and_by_files(calibration, out, tmp_path):
    assert passerby.align(out, camera="C2", towards="C1").rig["C1"].centre[1] == pytest.approx(0, abs=1e-9)
    moved = [passerby.KnownPosition(camera.name, camera.centre + np.array([10.0, 20.0, 0.0])) for camera in calibration.rig]
    rows = [f"{known.camera},{known.place[0]:.9f},{known.place[1]:.9f}" for known in moved]
    (tmp_path / "p.csv").write_text("\n".join(["camera,x,y", *rows]) + "\n")
    for found, positions in ((calibration, moved), (calibration.rig, tmp_path / "p.csv")):
        assert passerby.align(found, positions=positions).rig["C1"].centre[:2] == pytest.approx((10, 20), abs=1e-6)
    for wrong in ({}, {"camera": "C1", "points": []}, {"camera": "C1", "scale": True}, {"positions": moved, "towards": "C1"}):
        with pytest.raises(passerby.InputError):
            passerby.align(calibration, **wrong)


def test_one_clear_line_each(made, calibration, out):
    lost = replace(calibration.rig["C1"], pose=None, sigma=None)
    for value, wanted in (
        (calibration.rig, r"Rig\(4 cameras: C1, C2, C3, C4; accepted\)"),
        (passerby.Rig(tuple(replace(lost, name=f"C{k}") for k in range(9))), r"Rig\(9 cameras: C0, .*, C7, \.\.\.; 9 .*\)"),
        (lost, r"Camera\('C1', 720 x 576, without a pose\)"),
        (calibration.observations, r"Observations\(4 cameras, \d+ boxes\)"),
        (passerby.Boxes.empty(), r"Boxes\(none\)"),
        (passerby.trajectories(out), r"Trajectories\(7 people, \d+ positions, 11\.8 s\)"),
    ):  # fmt: skip
        assert re.fullmatch(wanted, repr(value)), repr(value)


class Checked(HTMLParser):
    """Counts elements, and fails where one is not closed or where a script or something from elsewhere is named."""

    VOID = frozenset({"br", "meta"})

    def __init__(self, text):
        super().__init__()
        self.open, self.count, self.words = [], {}, []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert tag not in ("script", "link", "iframe", "img", "style")
        for key, value in attrs:
            assert not key.startswith("on")
            assert "://" not in (value or "")
            assert "url(" not in (value or "")
        self.count[tag] = self.count.get(tag, 0) + 1
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_notebooks_show_a_rig(calibration):
    """Names from elsewhere stay text."""
    evil = '<img src="http://x/y" onerror=alert(1)>'
    rig = passerby.Rig((replace(calibration.rig["C1"], name=evil), *calibration.rig.cameras[1:]), evil)
    page = Checked(rig._repr_html_())
    assert (page.count["tr"], page.count["circle"]) == (5, 4)
    assert {part for camera in rig for part in (camera.name, f"{camera.centre[2]:.3f}")} <= set(page.words)
    assert page.words.count(evil) == 2  # the table and the picture
    assert any(evil in word and word != evil for word in page.words)  # the verdict
    assert "✓ accepted" in Checked(calibration.rig._repr_html_()).words
    bare = Checked(passerby.Rig(tuple(replace(camera, pose=None, sigma=None) for camera in calibration.rig))._repr_html_())
    assert "svg" not in bare.count
    assert "0 of 4 cameras with a pose" in bare.words
    assert Checked(passerby.Rig(())._repr_html_()).count["tr"] == 1


def test_notebooks_show_a_calibration_and_what_was_written(calibration, out):
    """Readable on light and dark: text and lines take the notebook's colour, and nothing is filled behind them."""
    text = calibration._repr_html_()
    page = Checked(text)
    assert page.count["tr"] == 5
    assert "residual px" in page.words
    assert "currentColor" in text
    assert not re.search(r"(?:color|fill|background)[:=]\"?\s*(?:#fff|#000|white|black)", text)
    few, odd = refusal("too_little_evidence", why="too <few> people"), notice("world_not_set", why="odd & strange")
    doubtful = replace(calibration, verdict="doubtful", diagnostics=(few, *[odd] * 20))
    assert {"! doubtful", "too <few> people", "and 8 more"} <= set(Checked(doubtful._repr_html_()).words)
    written = passerby.read_calibration(out)
    again, fresh = Checked(written._repr_html_()), Checked(calibration._repr_html_())
    assert again.count == fresh.count
    assert set(fresh.words) <= set(again.words)
    cameras = (CameraEntry(name="C1", median_residual_px=float("nan"), time_offset_s=1e300),)
    document = replace(written.document, name="<b>", findings=("odd & strange",) * 20, cameras=cameras)
    odd = replace(written, document=document, verdict="doubtful", reasons=("too <few> people",), all_cameras=5)
    told = {"<b>", "! doubtful", "too <few> people", "odd & strange", "and 8 more", "4 of 5 cameras registered"}
    assert told <= set(Checked(odd._repr_html_()).words)
    nothing = CalibrationDocument(verdict="accepted", cameras=())
    lost = passerby.Rig((replace(calibration.rig["C4"], pose=None, sigma=None),))
    assert Checked(replace(written, rig=lost, document=nothing)._repr_html_()).count["tr"] == 2
