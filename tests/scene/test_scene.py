"""The scene file: what it means, and what is told of a wrong one."""

import re
import tomllib

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.scene.scene import TABLES, Scene
from passerby.scene.tables import AssociationTable, CameraTable
from support.paths import DOCS

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


def test_the_smallest_scene_and_its_defaults(tmp_path):
    scene = load(tmp_path, CAMERAS)
    assert scene.name == "scene"
    assert scene.scene.fps is None
    assert scene.association.mode == "combined"
    assert scene.association.max_offset_s is None
    assert scene.fps_of("A") is None
    assert scene.solver.method == "people"
    cues = scene.scale_cues()
    assert (cues.population.mean_m, cues.population.sd_m) == (1.72, 0.09)
    assert cues.people == cues.lengths == cues.distances == cues.camera_heights == ()


def test_paths_are_relative_to_the_scene_file(tmp_path):
    scene = load(tmp_path, CAMERAS)
    assert scene.resolve(scene.cameras["A"].intrinsics) == tmp_path / "rig.toml"
    assert str(scene.resolve(scene.cameras["B"].intrinsics)) == "/somewhere/rig.toml"


def test_scale_cues(tmp_path):
    scene = load(
        tmp_path,
        CAMERAS
        + """
[association]
mode = "given"
[scale]
person_height_m = 1.75
person_height_sd_m = 0.07
[[scale.people]]
identity = 3
height_m = 1.83
[[scale.lengths]]
metres = 3.6
sd_m = 0.03
points = { A = [[1, 2], [3, 4]], B = [[5, 6], [7, 8]] }
[[scale.distances]]
between = ["A", "B"]
metres = 12
[[scale.camera_heights]]
camera = "B"
metres = 2.5
sd_m = 0.1
""",
    )
    cues = scene.scale_cues()
    assert (cues.population.mean_m, cues.population.sd_m) == (1.75, 0.07)
    assert (cues.people[0].identity, cues.people[0].metres, cues.people[0].sd_m) == (3, 1.83, 0.01)
    assert (cues.lengths[0].metres, cues.lengths[0].sd_m) == (3.6, 0.03)
    assert np.array_equal(cues.lengths[0].points["B"], [[5, 6], [7, 8]])
    assert (cues.distances[0].between, cues.distances[0].metres, cues.distances[0].sd_m) == (("A", "B"), 12, 0.05)
    assert (cues.camera_heights[0].camera, cues.camera_heights[0].metres, cues.camera_heights[0].sd_m) == ("B", 2.5, 0.1)


@pytest.mark.parametrize(
    ("association", "seconds"),
    [
        ("", 5.0),
        ("mode = 'combined'", 5.0),
        ("mode = 'trajectory'", 5.0),
        ("mode = 'appearance'", 0.0),
        ("mode = 'given'", 0.0),
        ("max_offset_s = 0", 0.0),
        ("mode = 'appearance'\nmax_offset_s = 12.5", 12.5),
    ],
)
def test_how_far_clocks_are_searched(tmp_path, association, seconds):
    assert load(tmp_path, CAMERAS + f"[association]\n{association}").association.search_s == seconds


def test_a_cameras_frame_rate_is_its_own_or_the_scenes(tmp_path):
    scene = load(tmp_path, CAMERAS + "fps = 30\n[scene]\nfps = 25")
    assert (scene.fps_of("A"), scene.fps_of("B")) == (25, 30)


def test_a_scene_cannot_be_changed(tmp_path):
    with pytest.raises(ValueError, match="frozen"):
        load(tmp_path, CAMERAS).cameras["A"].tracks = None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[solver", "is not TOML"),
        (CAMERAS + "[scen]\nfps = 3", "unknown table 'scen': did you mean 'scene'"),
        (CAMERAS + "[scene]\nfsp = 3", r"\[scene\]: unknown key 'fsp': did you mean 'fps'"),
        (CAMERAS + "trakcs = 'x'", r"\[cameras.B\]: unknown key 'trakcs': did you mean 'tracks'"),
        (
            CAMERAS + "zzz = 'x'",
            r"unknown key 'zzz': there are intrinsics, image_size, hfov_deg, video, video_names, video_times, times, ",
        ),
        (CAMERAS + "[scene]\nfps = 0", r"\[scene\] fps is 0: "),
        (CAMERAS + "[scene]\nfps = inf", r"\[scene\] fps: a finite number"),
        (CAMERAS + "[scene]\nfps = 'fast'", r"\[scene\] fps is 'fast': "),
        (CAMERAS + "[solver]\nmethod = 'magic'", r"\[solver\] method is 'magic': .*'people' or 'geopose'"),
        (CAMERAS + "[solver]\nmethod = 'geopose'", r"geopose. needs a reference camera"),
        (CAMERAS + "[solver]\nreference = 'C'", r"\[solver\] reference: camera 'C' is not declared: there are A, B"),
        (CAMERAS + "[association]\nmode = 'guess'", r"\[association\] mode is 'guess': .*'combined', .* or 'given'"),
        (CAMERAS + "[association]\nmax_offset_s = -1", r"\[association\] max_offset_s is -1: "),
        (CAMERAS + "[association]\nmax_offset_s = inf", r"\[association\] max_offset_s: a finite number"),
        (CAMERAS + "fps = 0", r"\[cameras.B\] fps is 0: "),
        (CAMERAS + "fps = 25", r"\[cameras.A\]: has no fps, but camera B has: set fps there, or under \[scene\] set fps"),
        (CAMERAS + "embeddings = 'b.npz'", r"\[cameras.B\]: has embeddings, but no boxes .* add `tracks` or `detections`"),
        (
            CAMERAS + "[[scale.people]]\nidentity = 1\nheight_m = 1.8",
            r"\[\[scale.people\]\]: names identities, but mode 'combined' does not know them .* mode = \"given\"",
        ),
        (CAMERAS + "[scale]\nperson_height_m = 172", r"\[scale\] person_height_m: 172 is not a person's height: metres"),
        (CAMERAS + "[scale]\nperson_height_sd_m = -0.1", r"person_height_sd_m is -0.1"),
        (CAMERAS + "[[scale.people]]\nidentity = 1\nheight = 1.8", r"\[\[scale.people\]\] 1: unknown key 'height'"),
        (CAMERAS + "[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2], [3, 4]] }", "marked in one camera: mark both ends"),
        (
            CAMERAS + "[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2]], B = [[1, 2], [3, 4]] }",
            r"scale.lengths\]\] 1 points A",
        ),
        (
            CAMERAS + "[[scale.lengths]]\nmetres = 1\npoints = { A = [[1, 2], [3, 4]], D = [[1, 2], [3, 4]] }",
            "camera 'D' is not",
        ),
        (CAMERAS + "[[scale.distances]]\nbetween = ['A', 'b']\nmetres = 3", r"between: camera 'b' is not declared"),
        (CAMERAS + "[[scale.distances]]\nbetween = ['A', 'A']\nmetres = 3", r"between names one camera twice"),
        (CAMERAS + "[[scale.camera_heights]]\ncamera = 'AA'\nmetres = 3", r"camera 'AA' is not declared: did you mean 'A'"),
        (
            CAMERAS + "[cameras.C]\ntracks = 'x'",
            r"\[cameras.C\]: has neither intrinsics nor a video, so its image size is unknown",
        ),
        (CAMERAS + "[cameras.C]\nintrinsics = 'x'", r"\[cameras.C\]: has no observations"),
        (
            CAMERAS + "[cameras.C]\nintrinsics = 'x'\nvideo = 'x.avi'\n[association]\nmode = 'given'",
            r"\[cameras.A\]: has no fps, but camera C has: set fps there",
        ),
        (
            CAMERAS + "[cameras.C]\nintrinsics = 'x'\nvideo = 'x.avi'\n[scene]\nfps = 5\n[association]\nmode = 'given'",
            r"\[cameras.C\]: has only a video, which has no identities: .* set mode = .combined.",
        ),
        (CAMERAS + "[perception]\nminscore = 0.5", r"\[perception\]: unknown key 'minscore': did you mean 'min_score'"),
        (CAMERAS + "[perception]\nmin_score = 2", r"\[perception\] min_score is 2: input should be less than or equal to 1"),
        (CAMERAS + "[cameras.'../C']\nintrinsics = 'x'\ntracks = 'x'", r"'../C' cannot be a camera's name"),
        (CAMERAS + "[cameras.metadata]\nintrinsics = 'x'\ntracks = 'x'", r"'metadata' cannot be a camera's name"),
        (CAMERAS.split("[cameras.B]")[0], r"1 camera is declared: a calibration needs two"),
        (CAMERAS + "[sites]\ngroups = [['A', 'C']]", r"\[sites\] groups 1: camera 'C' is not declared: there are A, B"),
        (CAMERAS + "[sites]\ngroups = [['A', 'b']]", r"\[sites\] groups 1: camera 'b' is not declared: did you mean 'B'"),
        (CAMERAS + "[sites]\ngroups = [['A', 'B'], ['A']]", r"\[sites\]: groups 2 holds only camera 'A': name two or more"),
        (CAMERAS + "[sites]\ngroups = [[], ['A', 'B']]", r"\[sites\]: groups 1 is empty: name two or more"),
        (CAMERAS + "[sites]\ngroups = [['A', 'B', 'A']]", r"\[sites\]: groups 1 names camera 'A' twice: name each once"),
        (CAMERAS + "[sites]\ngroups = ['A', 'B']", r"\[sites\] groups: group 1 is 'A': give a list of groups, each a list"),
        (CAMERAS + "[sites]\ngroups = [['A', 2]]", r"\[sites\] groups: group 1 is \['A', 2\]: give a list of groups"),
        (
            CAMERAS + "[cameras.b]\nintrinsics = 'x'\ntracks = 'x'",
            r"\[cameras.b\]: differs from \[cameras.B\] only in capitals, but files are named after cameras: rename one",
        ),
        (
            CAMERAS + "[cameras.B]\nintrinsics = 'x'\ntracks = 'x'",
            r"\[cameras.B\] occurs twice, in lines \d+ and \d+: merge the two into one",
        ),
        (
            CAMERAS + "[cameras.C]\nintrinsics = 'x'\ntracks = 'x'\n[sites]\ngroups = [['A', 'B']]",
            r"\[sites\] groups: camera C is in no group and would be compared with none: add it",
        ),
        (
            CAMERAS + "[sites]\ngroups = [['A', 'B']]\n[association]\nmode = 'given'",
            r"\[sites\] groups: .* mode \"given\" knows them: delete groups",
        ),
        ("cameras = 3", r"\[cameras\] is 3"),
        ("", r"\[cameras\]: is missing"),
    ],
)
def test_a_fault_names_file_key_value_and_mend(tmp_path, text, told):
    with pytest.raises(InputError, match=told) as caught:
        load(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "scene.toml"))
    assert "\n" not in str(caught.value)


def test_all_faults_are_gathered(tmp_path):
    with pytest.raises(InputError) as caught:
        load(tmp_path, CAMERAS + "[scene]\nfsp = 3\n[solver]\nmethod = 'magic'\n")
    assert len(faults_of(caught.value)) == 2


def _keys(table):
    return [field.alias or name for name, field in table.model_fields.items()]


def test_every_key_is_documented():
    text = (DOCS / "reference" / "scene-file.md").read_text()
    keys = {key for place, table in TABLES.items() if place for key in _keys(table)}
    assert {key for key in keys if not re.search(rf"\b{key}\b", text)} == set()
    for example in re.findall(r"```toml\n(.*?)```", (DOCS / "scene-file.md").read_text(), re.DOTALL):
        read = tomllib.loads(example)
        for table in read["cameras"].values():
            CameraTable.model_validate(table)
        AssociationTable.model_validate(read.get("association", {}))
