"""The scene file: what it means, which error a wrong one is, and the heights that a stated population has."""

import re
import tomllib

import numpy as np
import pytest
from pydantic import ValidationError

from passerby.common.errors import InputError
from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.scene.scale_tables import ScaleTable
from passerby.scene.scene import TABLES, Scene
from passerby.scene.tables import AssociationTable, CameraTable
from support.paths import DOCS
from support.refusals import refused

CAMERAS = """
[cameras.A]
intrinsics = "rig.toml"
tracks = "a.txt"
[cameras.B]
intrinsics = "/somewhere/rig.toml"
keypoints = "b.json"
"""


def load(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return Scene.load(path)


def test_the_smallest_scene_has_the_usual_settings(tmp_path):
    scene = load(tmp_path, CAMERAS)
    assert scene.name == "scene"
    assert (scene.association.mode, scene.solver.method, scene.fps_of("A")) == ("combined", "people", None)
    cues = scene.scale_cues()
    assert (cues.population.mean_m, cues.population.sd_m) == (1.72, 0.09)
    assert cues.people == cues.lengths == cues.distances == cues.camera_heights == ()
    assert scene.resolve(scene.cameras["A"].intrinsics) == tmp_path / "rig.toml"
    assert str(scene.resolve(scene.cameras["B"].intrinsics)) == "/somewhere/rig.toml"
    searched = {"": 5.0, "mode = 'trajectory'": 5.0, "mode = 'given'": 0.0, "mode = 'appearance'\nmax_offset_s = 12.5": 12.5}
    for association, seconds in searched.items():
        assert load(tmp_path, CAMERAS + f"[association]\n{association}").association.search_s == seconds


def test_scale_cues(tmp_path):
    scale = """
[association]
mode = "given"
[scale]
person_height_m = 1.75
person_height_sd_m = 0.07
people = [{ identity = 3, height_m = 1.83 }]
lengths = [{ metres = 3.6, sd_m = 0.03, points = { A = [[1, 2], [3, 4]], B = [[5, 6], [7, 8]] } }]
distances = [{ between = ["A", "B"], metres = 12 }]
camera_heights = [{ camera = "B", metres = 2.5, sd_m = 0.1 }]
"""
    cues = load(tmp_path, CAMERAS + scale).scale_cues()
    assert (cues.population.mean_m, cues.population.sd_m) == (1.75, 0.07)
    assert (cues.people[0].identity, cues.people[0].metres, cues.people[0].sd_m) == (3, 1.83, 0.01)
    assert (cues.lengths[0].metres, cues.lengths[0].sd_m) == (3.6, 0.03)
    assert np.array_equal(cues.lengths[0].points["B"], [[5, 6], [7, 8]])
    assert (cues.distances[0].between, cues.distances[0].metres, cues.distances[0].sd_m) == (("A", "B"), 12, 0.05)
    assert (cues.camera_heights[0].camera, cues.camera_heights[0].metres, cues.camera_heights[0].sd_m) == ("B", 2.5, 0.1)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[scen]\nfps = 3", "unknown table 'scen': did you mean 'scene'"),
        ("[scene]\nfsp = 3", r"\[scene\]: unknown key 'fsp': did you mean 'fps'"),
        ("trakcs = 'x'", r"\[cameras.B\]: unknown key 'trakcs': did you mean 'tracks'"),
        ("zzz = 'x'", r"unknown key 'zzz': there are intrinsics, image_size, hfov_deg, video, video_names, video_times, "),
        ("[scene]\nfps = 0", r"\[scene\] fps is 0: "),
        ("[scene]\nfps = inf", r"\[scene\] fps: a finite number"),
        ("[scene]\nfps = 'fast'", r"\[scene\] fps is 'fast': "),
        ("[solver]\nmethod = 'magic'", r"\[solver\] method is 'magic': .*'people' or 'geopose'"),
        ("[solver]\nmethod = 'geopose'", r"geopose. needs a reference camera"),
        ("[solver]\nmethod = 'geopose'\nreference = 'A'\nrefine = ['focal']", r"geopose. refines nothing"),
        ("[solver]\nreference = 'C'", r"\[solver\] reference: camera 'C' is not declared: there are A, B"),
        ("[association]\nmode = 'guess'", r"\[association\] mode is 'guess': .*'combined', .* or 'given'"),
        ("[association]\nmax_offset_s = -1", r"\[association\] max_offset_s is -1: "),
        ("fps = 25", r"\[cameras.A\]: has no fps, but camera B has: set fps there, or under \[scene\] set fps"),
        ("embeddings = 'b.npz'", r"\[cameras.B\]: has embeddings, but no boxes .* add `tracks` or `detections`"),
        ("[[scale.people]]\nidentity = 1\nheight_m = 1.8",
         r"\[\[scale.people\]\]: names identities, but mode 'combined' does not know them .* mode = \"given\""),
        ("[scale]\nperson_height_m = 172", r"\[scale\] person_height_m: 172 is not a person's height: metres"),
        ("[[scale.people]]\nidentity = 1\nheight = 1.8", r"\[\[scale.people\]\] 1: unknown key 'height'"),
        ("[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2], [3, 4]] }", "marked in one camera: mark both ends"),
        ("[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2]], B = [[1, 2], [3, 4]] }", r"scale.lengths\]\] 1 points A"),
        ("[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2], [3, 4]], D = [[1, 2], [3, 4]] }", "camera 'D' is not"),
        ("[[scale.distances]]\nbetween = ['A', 'b']\nmetres = 3", r"between: camera 'b' is not declared"),
        ("[[scale.distances]]\nbetween = ['A', 'A']\nmetres = 3", r"between names one camera twice"),
        ("[[scale.camera_heights]]\ncamera = 'AA'\nmetres = 3", r"camera 'AA' is not declared: did you mean 'A'"),
        ("[cameras.C]\ntracks = 'x'", r"\[cameras.C\]: has neither intrinsics nor a video, so its image size is unknown"),
        ("[cameras.C]\nintrinsics = 'x'", r"\[cameras.C\]: has no observations"),
        ("[cameras.C]\nintrinsics = 'x'\nvideo = 'x.avi'\n[association]\nmode = 'given'",
         r"\[cameras.A\]: has no fps, but camera C has: set fps there"),
        ("[cameras.C]\nintrinsics = 'x'\nvideo = 'x.avi'\n[scene]\nfps = 5\n[association]\nmode = 'given'",
         r"\[cameras.C\]: has only a video, which has no identities: .* set mode = .combined."),
        ("[perception]\nmin_score = 2", r"\[perception\] min_score is 2: input should be less than or equal to 1"),
        ("[cameras.'../C']\nintrinsics = 'x'\ntracks = 'x'", r"'../C' cannot be a camera's name"),
        ("[cameras.metadata]\nintrinsics = 'x'\ntracks = 'x'", r"'metadata' cannot be a camera's name"),
        ("[sites]\ngroups = [['A', 'b']]", r"\[sites\] groups 1: camera 'b' is not declared: did you mean 'B'"),
        ("[sites]\ngroups = [['A', 'B'], ['A']]", r"\[sites\]: groups 2 holds only camera 'A': name two or more"),
        ("[sites]\ngroups = [[], ['A', 'B']]", r"\[sites\]: groups 1 is empty: name two or more"),
        ("[sites]\ngroups = [['A', 'B', 'A']]", r"\[sites\]: groups 1 names camera 'A' twice: name each once"),
        ("[sites]\ngroups = ['A', 'B']", r"\[sites\] groups: group 1 is 'A': give a list of groups, each a list"),
        ("[cameras.b]\nintrinsics = 'x'\ntracks = 'x'",
         r"\[cameras.b\]: differs from \[cameras.B\] only in capitals, but files are named after cameras: rename one"),
        ("[cameras.C]\nintrinsics = 'x'\ntracks = 'x'\n[sites]\ngroups = [['A', 'B']]",
         r"\[sites\] groups: camera C is in no group and would be compared with none: add it"),
        ("[sites]\ngroups = [['A', 'B']]\n[association]\nmode = 'given'",
         r"\[sites\] groups: .* mode \"given\" knows them: delete groups"),
        (None, r"1 camera is declared: a calibration needs two"),
    ],
)  # fmt: skip
def test_a_fault_names_file_key_value_and_fix(tmp_path, text, told):
    with refused(told, tmp_path / "scene.toml"):
        load(tmp_path, CAMERAS + text if text is not None else CAMERAS.split("[cameras.B]")[0])


def test_a_file_without_cameras_is_an_error_and_all_faults_are_gathered(tmp_path):
    for text, told in (("[solver", "is not TOML"), ("cameras = 3", r"\[cameras\] is 3"), ("", r"\[cameras\]: is missing")):
        with refused(told, tmp_path / "scene.toml"):
            load(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load(tmp_path, CAMERAS + "[scene]\nfsp = 3\n[solver]\nmethod = 'magic'\n")
    assert len(faults_of(caught.value)) == 2


def test_every_key_is_documented():
    text = (DOCS / "reference" / "scene-file.md").read_text()
    fields = [table.model_fields for place, table in TABLES.items() if place]
    keys = {field.alias or name for own in fields for name, field in own.items()}
    assert {key for key in keys if not re.search(rf"\b{key}\b", text)} == set()
    for example in re.findall(r"```toml\n(.*?)```", (DOCS / "scene-file.md").read_text(), re.DOTALL):
        read = tomllib.loads(example)
        for table in read["cameras"].values():
            CameraTable.model_validate(table)
        AssociationTable.model_validate(read.get("association", {}))


def heights(**stated):
    table = ScaleTable.model_validate(stated)
    return table.person_height_m, table.person_height_sd_m, table.person_height_mean_sd_m


def test_children_are_smaller_and_mixed_people_differ_more():
    children, mixed, adults = (heights(population=name) for name in ("children", "mixed", "adults"))
    assert adults == heights() == (PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M, None)
    assert children[0] < mixed[0] < adults[0]
    assert mixed[1] > children[1] > adults[1]
    assert mixed[0] == pytest.approx((children[0] + adults[0]) / 2, abs=0.005)
    # Half of each: the spread between the two beside that within each of them.
    within, between = (children[1] ** 2 + adults[1] ** 2) / 2, ((adults[0] - children[0]) / 2) ** 2
    assert mixed[1] == pytest.approx((within + between) ** 0.5, abs=0.005)
    # Among children of one age the sd is 6 cm, between ages 9 cm.
    assert children[1] == pytest.approx((0.06**2 + 0.09**2) ** 0.5, abs=0.005)


def test_a_stated_height_overrides_the_population_and_another_population_is_an_error():
    assert heights(population="children", person_height_m=1.8) == (1.8, PERSON_HEIGHT_SD_M, None)
    assert heights(population="children", person_height_sd_m=0.05) == (1.32, 0.05, 0.10)
    with pytest.raises(ValidationError, match="'adults', 'children' or 'mixed'"):
        heights(population="cats")
