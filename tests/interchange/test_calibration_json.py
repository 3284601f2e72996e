"""`calibration.json` as values: what is written is read, and what is no such file is told in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.association_figures import AssociationFigures, AssociationRound
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma
from passerby.core.figures import (
    AdjustedFigures,
    ClockCorrection,
    CueFigures,
    FittedRate,
    GroundFigures,
    MotionFigures,
    ScaleFigures,
    SolvedCamera,
    SolverFigures,
    StarFigures,
    StarPair,
    StarScale,
)
from passerby.core.lens_figures import FocalFigures, LensFigures
from passerby.interchange.calibration_json import (
    CalibrationDocument,
    CameraEntry,
    DiagnosticEntry,
    PerceptionEntry,
    WorldEntry,
    entry_of,
    parse_document,
    read_document,
    write_document,
)
from passerby.interchange.declared_scene import DeclaredScene
from passerby.interchange.storage.text_formats import plain, to_json

CUE = CueFigures(cue="population of 3", stated_m=1.72, measured_m=1.7, sd_m=0.05, residual_sigmas=-0.4, share=1.0)
FOCAL = FocalFigures(stated_px=1000.0, refined_px=1043.0, sigma_px=4.2, people_sigma_px=None, far=False, told=True)
MOTION = MotionFigures(
    camera="A", frames=(3, 9), seconds=None, left_out="after", metres=0.3, degrees=2.0, sigmas=20.0, shift=0.1
)
ADJUSTED = AdjustedFigures(
    cameras=(SolvedCamera(name="A", shape_position_sigma_mm=12.5),), scale=ScaleFigures(relative_sigma=0.03, cues=(CUE,)),
    clocks={"A": ClockCorrection(correction_s=0.0, sigma_s=0.0)}, undetermined=("vertical",),
    lenses={"A": LensFigures(focal=FOCAL)},
    clock_rates={"A": FittedRate(fps=25.0, stated=24.0, sigma=0.01)}, moved=(MOTION,),
    ground=GroundFigures(rise_m=0.1, sigma_m=0.01, low=(1.0, 2.0), high=(3.0, 4.0), chance_sigmas=2.0),
)  # fmt: skip
STAR = StarFigures(
    points="joints", reference="A", scale=StarScale(from_="known lengths", factor=1.2, relative_sd=0.02, lengths=2),
    pairs=(StarPair(camera="B", correspondences=90, inliers=80, rms_px=1.5, parallax_deg=20.0),), merged_points=80,
    pair_disagreement=0.01, rms_px=1.4, iterations=9, converged=True,
)  # fmt: skip
SCENE = {"scene": {"fps": 25.0, "later": [1, 2]}, "cameras": {"A": {"video": "a.mp4", "from_s": 3.0}}, "later": {"key": None}}
DOUBT = DiagnosticEntry(code="x", severity="doubt", cameras=("A",), values={"share": 0.5})
PLACED = {"by": "points p.csv", "rotation": [0.0, 0.0, 1.0], "residuals": [{"camera": "A", "off_px": None}]}
NETWORK = {"network": "people.onnx", "sha256": "00", "licence": "MIT"}
VIDEO = {
    "pictures": 90, "boxes": 40, "ended_early": None, "broken": 2, "first_broken_s": 1.5,
    "moves": [{"seconds": 3.0, "until": None, "pixels": 20.0}], "shake_px": 0.4,
}  # fmt: skip
SEEN = {"detector": NETWORK, "embedder": "stripes", "keypoints": "none", "cameras": {"A": VIDEO}}
WHOLE = CalibrationDocument(
    scene_file="/there/scene.toml", files={"rig.toml": "00"}, name="yard", passerby="1", versions={"numpy": "2", "av": None},
    verdict="doubtful", reasons=("one: do this",), findings=("two",), diagnostics=(DOUBT,),
    cameras=(CameraEntry(name="A", boxes=3, fps=25.0, time_offset_s=0.5), CameraEntry(name="B")),
    perception=entry_of(PerceptionEntry, SEEN),
    association=AssociationFigures(mode="combined", people=3, rounds=(AssociationRound(registered=2, unchanged=1.0),)),
    method="people", seed=4, options={"rounds": 3}, scene=entry_of(DeclaredScene, SCENE), figures=ADJUSTED,
    world=entry_of(WorldEntry, PLACED),
)  # fmt: skip
LEAST = {"verdict": "accepted", "cameras": [{"name": "A"}]}


@pytest.mark.parametrize("figures", [ADJUSTED, STAR, SolverFigures()], ids=lambda figures: type(figures).__name__)
def test_what_is_written_is_read(tmp_path, figures):
    document = replace(WHOLE, figures=figures)
    write_document(tmp_path, document)
    assert read_document(tmp_path) == document
    assert to_json(read_document(tmp_path)) == (tmp_path / "calibration.json").read_text()


def test_keys_are_those_of_the_file():
    tables = plain(WHOLE)
    assert (tables["schema_version"], tables["figures"]["lenses"]["A"]) == (1, {"focal": plain(FOCAL)})
    assert (tables["scene"], tables["world"]["rotation"]) == (SCENE | {"association": {}, "scale": {}}, [0.0, 0.0, 1.0])
    assert tables["world"]["residuals"][0]["off_px"] is None
    assert plain(STAR)["scale"] == {"from": "known lengths", "factor": 1.2, "relative_sd": 0.02, "lengths": 2}
    assert not {"undetermined", "clock_rates"} & set(plain(AdjustedFigures()))
    assert tables["perception"] == SEEN
    assert "perception" not in plain(replace(WHOLE, perception=None))


def test_an_older_file_is_read():
    document = parse_document(json.dumps(LEAST))
    assert document.files is None
    assert document.entries["A"].boxes is None
    assert type(document.figures) is SolverFigures
    assert document.entry("C9") == CameraEntry(name="C9")


def test_a_pose_that_is_not_known_has_no_figures():
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(5))
    camera = Camera("A", lens, Pose(np.eye(3), np.array([0.0, 0.0, 2.0])), PoseSigma(float("inf"), 0.5))
    entry = CameraEntry(name="A", boxes=3).with_pose(camera)
    assert (entry.registered, entry.centre_m, entry.height_m) == (True, (0.0, 0.0, -2.0), -2.0)
    assert (entry.position_sigma_mm, entry.orientation_sigma_deg) == (None, 0.5)
    lost = entry.with_pose(replace(camera, pose=None, sigma=None))
    assert (lost.registered, lost.centre_m, lost.orientation_sigma_deg) == (False, None, None)
    assert entry.boxes == 3


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"verdict": None}, "verdict is None, which should be 'accepted', 'doubtful' or 'refused'"),
        ({"cameras": 3}, "cameras is 3, which should be a valid list"),
        ({"cameras": [{"name": "A", "fps": -1}]}, "camera A has fps -1, which should be greater than 0"),
        ({"cameras": [{"name": "A", "time_offset_s": True}]}, "camera A has time_offset_s True"),
        ({"cameras": [{"fps": 5.0}]}, "camera number 1 has no name"),
        ({"figures": 3}, "figures is 3"),
        ({"files": ["rig.toml"]}, "files is ['rig.toml'], which should be a table"),
        ({"figures": {"scale": {"relative_sigma": "3 %"}}}, "figures.scale.relative_sigma is '3 %'"),
        ({"figures": {"scale": {}, "people": {"identities": 1, "heights_m": {"7": ""}}}}, "figures.people.heights_m.7 is ''"),
        ({"seed": 10**300}, "it holds a number of 300 digits"),
        ({"schema_version": "1.0"}, "schema_version is '1.0'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_key_and_value(tables, says):
    with pytest.raises(InputError) as raised:
        parse_document(json.dumps(LEAST | tables))
    told = str(raised.value)
    assert told.startswith("calibration.json: is not what `passerby calibrate` writes: ")
    assert says in told
    assert told.endswith(": calibrate again")
    assert "\n" not in told


def test_what_is_no_json_and_what_is_of_a_later_schema_is_told():
    with pytest.raises(InputError, match=r"is not JSON \(.*\): calibrate again"):
        parse_document(json.dumps(LEAST | {"name": "\ud800"}))
    with pytest.raises(InputError, match=r"schema_version is 2, of a later Passerby; this one reads up to 1: install"):
        parse_document(json.dumps(LEAST | {"schema_version": 2, "verdict": "new"}))


def test_a_file_that_is_missing_or_holds_something_else_is_told(tmp_path):
    with pytest.raises(InputError, match=r"calibration.json: no such file: name the folder that `passerby calibrate SCENE"):
        read_document(tmp_path)
    (tmp_path / "calibration.json").write_text("[1, 2]")
    with pytest.raises(InputError, match=r"calibration.json: is not what .*: it is not a table: calibrate again"):
        read_document(tmp_path)
