"""`calibration.json`, `monitor.json` and the scene file of an output folder: what is written is read, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core import figures as fig
from passerby.core.association_figures import AssociationFigures, AssociationRound
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma
from passerby.core.lens_figures import FocalFigures, LensFigures
from passerby.interchange import calibration_json as calibration
from passerby.interchange.declared_scene import DeclaredScene
from passerby.interchange.monitor_json import MONITOR_FILE, MonitoredCamera, read_monitor
from passerby.interchange.output_folder import read_report, scene_of
from passerby.interchange.storage.text_formats import plain, to_json
from support.refusals import refused
from support.scenes.output_folders import written_output

CUE = fig.CueFigures(cue="population of 3", stated_m=1.72, measured_m=1.7, sd_m=0.05, residual_sigmas=-0.4, share=1.0)
FOCAL = FocalFigures(stated_px=1000.0, refined_px=1043.0, sigma_px=4.2, people_sigma_px=None, far=False, told=True)
MOTION = fig.MotionFigures(
    camera="A", frames=(3, 9), seconds=None, left_out="after", metres=0.3, degrees=2.0, sigmas=20.0, shift=0.1
)
ADJUSTED = fig.AdjustedFigures(
    cameras=(fig.SolvedCamera(name="A", shape_position_sigma_mm=12.5),), undetermined=("vertical",),
    scale=fig.ScaleFigures(relative_sigma=0.03, cues=(CUE,)), clocks={"A": fig.ClockCorrection(correction_s=0.0, sigma_s=0.0)},
    lenses={"A": LensFigures(focal=FOCAL)},
    clock_rates={"A": fig.FittedRate(fps=25.0, stated=24.0, sigma=0.01)}, moved=(MOTION,),
    ground=fig.GroundFigures(rise_m=0.1, sigma_m=0.01, low=(1.0, 2.0), high=(3.0, 4.0), chance_sigmas=2.0),
)  # fmt: skip
STAR = fig.StarFigures(
    points="joints", reference="A", scale=fig.StarScale(from_="known lengths", factor=1.2, relative_sd=0.02, lengths=2),
    pairs=(fig.StarPair(camera="B", correspondences=90, inliers=80, rms_px=1.5, parallax_deg=20.0),), merged_points=80,
    pair_disagreement=0.01, rms_px=1.4, iterations=9, converged=True,
)  # fmt: skip
SCENE = {"scene": {"fps": 25.0, "later": [1, 2]}, "cameras": {"A": {"video": "a.mp4", "from_s": 3.0}}, "later": {"key": None}}
DOUBT = calibration.DiagnosticEntry(code="x", severity="doubt", cameras=("A",), values={"share": 0.5})
PLACED = {"by": "points p.csv", "rotation": [0.0, 0.0, 1.0], "residuals": [{"camera": "A", "off_px": None}]}
NETWORK = {"network": "people.onnx", "sha256": "00", "licence": "MIT"}
VIDEO = {
    "pictures": 90, "boxes": 40, "ended_early": None, "broken": 2, "first_broken_s": 1.5,
    "moves": [{"seconds": 3.0, "until": None, "pixels": 20.0}], "shake_px": 0.4,
}  # fmt: skip
SEEN = {"detector": NETWORK, "embedder": "stripes", "keypoints": "none", "cameras": {"A": VIDEO}}
WHOLE = calibration.CalibrationDocument(
    scene_file="/there/scene.toml", files={"rig.toml": "00"}, name="yard", passerby="1", versions={"numpy": "2", "av": None},
    verdict="doubtful", reasons=("one: do this",), findings=("two",), diagnostics=(DOUBT,),
    cameras=(calibration.CameraEntry(name="A", boxes=3, fps=25.0, time_offset_s=0.5), calibration.CameraEntry(name="B")),
    perception=calibration.entry_of(calibration.PerceptionEntry, SEEN),
    association=AssociationFigures(mode="combined", people=3, rounds=(AssociationRound(registered=2, unchanged=1.0),)),
    method="people", seed=4, options={"rounds": 3}, scene=calibration.entry_of(DeclaredScene, SCENE), figures=ADJUSTED,
    world=calibration.entry_of(calibration.WorldEntry, PLACED),
)  # fmt: skip
LEAST = {"verdict": "accepted", "cameras": [{"name": "A"}]}


@pytest.mark.parametrize("figures", [ADJUSTED, STAR, fig.SolverFigures()], ids=lambda figures: type(figures).__name__)
def test_a_calibration_comes_back(tmp_path, figures):
    document = replace(WHOLE, figures=figures)
    calibration.write_document(tmp_path, document)
    assert calibration.read_document(tmp_path) == document
    assert to_json(calibration.read_document(tmp_path)) == (tmp_path / "calibration.json").read_text()


def test_keys_of_calibrations_are_those_of_the_file():
    tables = plain(WHOLE)
    assert (tables["schema_version"], tables["figures"]["lenses"]["A"]) == (1, {"focal": plain(FOCAL)})
    assert (tables["scene"], tables["world"]["rotation"]) == (SCENE | {"association": {}, "scale": {}}, [0.0, 0.0, 1.0])
    assert tables["world"]["residuals"][0]["off_px"] is None
    assert plain(STAR)["scale"] == {"from": "known lengths", "factor": 1.2, "relative_sd": 0.02, "lengths": 2}
    assert not {"undetermined", "clock_rates"} & set(plain(fig.AdjustedFigures()))
    assert tables["perception"] == SEEN
    assert "perception" not in plain(replace(WHOLE, perception=None))


def test_an_older_calibration_is_read():
    document = calibration.parse_document(json.dumps(LEAST))
    assert document.files is None
    assert document.entries["A"].boxes is None
    assert type(document.figures) is fig.SolverFigures
    assert document.entry("C9") == calibration.CameraEntry(name="C9")


def test_a_pose_that_is_not_known_has_no_figures():
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(5))
    camera = Camera("A", lens, Pose(np.eye(3), np.array([0.0, 0.0, 2.0])), PoseSigma(float("inf"), 0.5))
    entry = calibration.CameraEntry(name="A", boxes=3).with_pose(camera)
    assert (entry.registered, entry.centre_m, entry.height_m) == (True, (0.0, 0.0, -2.0), -2.0)
    assert (entry.position_sigma_mm, entry.orientation_sigma_deg) == (None, 0.5)
    lost = entry.with_pose(replace(camera, pose=None, sigma=None))
    assert (lost.registered, lost.centre_m, lost.orientation_sigma_deg) == (False, None, None)
    assert entry.boxes == 3


@pytest.mark.parametrize(("content", "message"), [
    (LEAST | {"verdict": None}, "verdict is None, which should be 'accepted', 'doubtful' or 'refused'"),
    (LEAST | {"cameras": 3}, "cameras is 3, which should be a valid list"),
    (LEAST | {"cameras": [{"name": "A", "fps": -1}]}, "camera A has fps -1, which should be greater than 0"),
    (LEAST | {"cameras": [{"name": "A", "time_offset_s": True}]}, "camera A has time_offset_s True"),
    (LEAST | {"cameras": [{"fps": 5.0}]}, "camera number 1 has no name"),
    (LEAST | {"figures": 3}, "figures is 3"),
    (LEAST | {"files": ["rig.toml"]}, r"files is \['rig.toml'\], which should be a table"),
    (LEAST | {"figures": {"scale": {"relative_sigma": "3 %"}}}, "figures.scale.relative_sigma is '3 %'"),
    (LEAST | {"figures": {"scale": {}, "people": {"identities": 1, "heights_m": {"7": ""}}}},
     "figures.people.heights_m.7 is ''"),
    (LEAST | {"seed": 10**300}, "it holds a number of 300 digits"),
    (LEAST | {"schema_version": "1.0"}, "schema_version is '1.0'"),
    ([1, 2], "it is not a table"),
])  # fmt: skip
def test_a_broken_calibration_is_refused_with_key_and_value(tmp_path, content, message):
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    with refused(f"calibration.json: is not what `passerby calibrate` writes: .*{message}.*: calibrate again$", tmp_path):
        calibration.read_document(tmp_path)


def test_what_is_no_json_or_of_a_later_schema_or_missing_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not JSON \(.*\): calibrate again"):
        calibration.parse_document(json.dumps(LEAST | {"name": "\ud800"}))
    with pytest.raises(InputError, match=r"schema_version is 2, of a later Passerby; this one reads up to 1: install"):
        calibration.parse_document(json.dumps(LEAST | {"schema_version": 2, "verdict": "new"}))
    with pytest.raises(InputError, match=r"calibration.json: no such file: name the folder that `passerby calibrate SCENE"):
        calibration.read_document(tmp_path)
    with pytest.raises(InputError, match=r"monitor\.json: no such file: name the folder that `passerby monitor RIG SCENE"):
        read_monitor(tmp_path)


MONITORED = {
    "schema_version": 1, "from_s": 0.0, "until_s": 60.0, "window_s": 10.0, "threshold": 5.0,
    "cameras": [{"name": "A", "state": "steady"}, {"name": "B", "state": "moved", "fps": 25.0, "new_pose": True}],
}  # fmt: skip
MOVE = {"camera": "B", "or": ["C"], "noticed_s": 12.5, "shift_m": [0.1, None, 0.0], "metres": 0.1}


def monitor_of(folder, content):
    (folder / MONITOR_FILE).write_text(content if isinstance(content, str) else json.dumps(content))
    return read_monitor(folder)


def test_a_monitor_file_is_read(tmp_path):
    windows = [{"from_s": 0.0, "until_s": 10.0, "cameras": {"A": {"score": None, "told": True}}}]
    found = monitor_of(tmp_path, MONITORED | {"moves": [MOVE], "windows": windows, "of a later Passerby": {"any": [1]}})
    assert found.entries["A"] == MonitoredCamera(name="A", state="steady")
    assert (found.entries["B"].fps, found.entries["B"].new_pose) == (25.0, True)
    (move,) = found.moves
    assert (move.camera, move.or_, move.noticed_s, move.shift_m) == ("B", ("C",), 12.5, (0.1, None, 0.0))
    assert found.windows[0].cameras["A"].told
    older = monitor_of(tmp_path, MONITORED)
    assert (older.moves, older.windows, older.scene_file, older.judged_by) == ((), (), None, None)


@pytest.mark.parametrize(("content", "message"), [
    ("{", r"is not JSON \(.*\): monitor again"),
    ("[1, 2]", "it is not a table"),
    (MONITORED | {"schema_version": 2}, "schema_version is 2, of a later Passerby"),
    ({key: value for key, value in MONITORED.items() if key != "threshold"}, "it has no threshold"),
    (MONITORED | {"cameras": [{"name": "A"}]}, r"it has no cameras\.0\.state"),
    (MONITORED | {"cameras": [{"name": "A", "state": "gone"}]}, r"cameras\.0\.state is 'gone', which should be 'steady', "),
    (json.dumps(MONITORED).replace("60.0", "NaN"), "until_s is nan"),
])  # fmt: skip
def test_a_broken_monitor_file_is_refused_with_key_and_remedy(tmp_path, content, message):
    with refused(message, tmp_path / MONITOR_FILE):
        monitor_of(tmp_path, content)


def found(out: Path) -> Path:
    return scene_of(out, read_report(out), "name it")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return written_output(tmp_path / "site")


@pytest.mark.parametrize("place", ["out", "results/first/out"])
def test_a_copy_of_an_output_folder_edits_no_file_of_the_original(out: Path, tmp_path: Path, place: str) -> None:
    shutil.copytree(out.parent, tmp_path / "copy")
    copied = tmp_path / "copy" / place
    if place != "out":
        shutil.move(tmp_path / "copy" / "out", copied)
    with refused("seems to be a copy", tmp_path / "copy" / "scene.toml"):
        found(copied)


def test_the_scene_file_is_found_where_the_folder_was_written_or_moved_with_it(out: Path, tmp_path: Path) -> None:
    assert found(out) == out.parent / "scene.toml"
    (tmp_path / "elsewhere").mkdir()
    shutil.move(out, tmp_path / "elsewhere" / "out")
    (tmp_path / "elsewhere" / "scene.toml").write_text('[cameras.X]\nvideo = "x.mp4"\n')  # of other cameras
    assert found(tmp_path / "elsewhere" / "out") == out.parent / "scene.toml"
    shutil.move(tmp_path / "elsewhere" / "out", out)
    out.parent.rename(tmp_path / "moved")
    assert found(tmp_path / "moved" / "out") == tmp_path / "moved" / "scene.toml"
    (tmp_path / "moved" / "scene.toml").unlink()
    with pytest.raises(InputError, match=r"no such file: .* name it"):
        found(tmp_path / "moved" / "out")
