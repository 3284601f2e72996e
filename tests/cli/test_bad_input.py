"""Bad input and bad plans through the command line: the exit status, and one line that names file, place, value and fix."""

import json

import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from support.scenes.handmade_files import lens, rows, write_scene

BAD = 2


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"extra": "[solver]\nmetod = 'people'"}, r"scene.toml: [solver]: unknown key 'metod': did you mean 'method'?"),
        ({"extra": "[cameras.C]\nintrinsics = 'rig.toml'\ntracks = 'A.txt'"}, "rig.toml: no table [C]: camera C needs one"),
        ({"files": {"A.txt": None}}, "A.txt: no such file: a text file of boxes"),
        ({"files": {"rig.toml": None}}, "rig.toml: no such file: a rig file (TOML)"),
        ({"files": {"A.txt": rows() + "11,1,nan,300,40,110,1,-1,-1,-1\n"}}, "A.txt: line 21: left is nan"),
        ({"files": {"A.txt": rows() + "11,1,100,300,-40,110,1,-1,-1,-1\n"}}, "A.txt: line 21: width is -40"),
        ({"files": {"A.txt": rows() + "3,9,9,9,9,9,1,-1,-1,-1\n"}}, "A.txt: line 21: frame 3 comes after frame 10: sort"),
        ({"files": {"A.txt": rows() + 2 * "10,2,700,300,40,110,1,-1,-1,-1\n"}},
         "A.txt: camera A: 2 of 22 rows repeat an identity that has another row in the same frame (first: id 2 in frame 10)"),
        ({"files": {"A.txt": rows() + "11,1,100\n"}}, "A.txt: line 21: 3 columns instead of 7 to 10"),
        ({"files": {"rig.toml": lens("A", 320, 240) + lens("B")}}, "point [640.0, 360.0] lies outside the 320 x 240 image"),
        ({"files": {"A.txt": rows(left=1400)}}, "20 of 20 people lie outside the 1280 x 720 image (first: frame 1,"),
        ({"files": {"rig.toml": lens("A", distortions="[0.1, 0, 0]") + lens("B")}}, "[A]: distortions has 3 values; a pinhole"),
        ({"files": {"A.txt": rows(identities=(-1,))}}, "A.txt: camera A: no row has an identity"),
        ({"extra": "[cameras.C]\nintrinsics = 'more.toml'\ndetections = 'A.txt'", "files": {"more.toml": lens("C")}},
         "[cameras.C] has only detections"),
        ({"extra": "video = 'B.avi'"}, "B.avi: no such file: a video"),
        ({"extra": "[[scale.lengths]]\nmetres = 3.6\npoints = { A = [[1, 2], [3, 4]], B = [[1, 2], [3, 4000]] }"},
         "[[scale.lengths]] 1 points: [[1.0, 2.0], [3.0, 4000.0]] lies outside the 1280 x 720 image of camera B"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_bad_input_is_one_line_of_error(tmp_path, capsys, changes, told, command):
    scene = write_scene(tmp_path, **changes)
    out = ["-o", str(tmp_path / "out")] if command == "calibrate" else []
    assert run([command, str(scene), *out]) == BAD
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1 or command == "check"
    assert errors[0].startswith(f"error: {tmp_path}")
    assert told in errors[0]
    assert not (tmp_path / "out").exists()


def test_check_reports_all_that_is_wrong(tmp_path, capsys):
    files = {"A.txt": rows() + "11,1,nan,300,40,110,1,-1,-1,-1\n12,1,5,300,40,0,1,-1,-1,-1\n", "B.txt": None}
    scene = write_scene(tmp_path, files=files)
    assert run(["check", str(scene), "--json"]) == BAD
    out, errors = capsys.readouterr()
    report = json.loads(out)
    assert not report["ok"]
    assert len(report["faults"]) == len(errors.splitlines()) == 3
    assert [len(camera["faults"]) for camera in report["cameras"]] == [2, 1]
    assert run(["calibrate", str(tmp_path / "none.toml")]) == BAD
    assert "none.toml: no such file: a scene file (TOML) is needed" in capsys.readouterr().err


def test_check_warns_of_odd_input_and_of_a_camera_that_shares_no_people(tmp_path, capsys):
    files = {"A.txt": rows(60), "rig.toml": lens("A", 2560, 1440) + lens("B")}
    scene = write_scene(tmp_path, files=files, extra="[[scale.people]]\nidentity = 77\nheight_m = 1.8")
    assert run(["check", str(scene)]) == 0
    out = capsys.readouterr().out
    assert "all people lie within 20% of the width and 28% of the height: wrong image size?" in out
    assert "identity 77 is not seen by any camera" in out
    (tmp_path / "three").mkdir()
    scene = write_scene(tmp_path / "three", ("A", "B", "C"), files={"C.txt": rows(identities=(8, 9))})
    assert run(["check", str(scene)]) == 3
    assert "camera C shares no people with A, B" in capsys.readouterr().err


def test_check_of_a_sound_scene(tmp_path, capsys):
    files = {"A.txt": rows(8, (1, 2, 3)), "B.txt": rows(12, (2, 3, 4)) + "13,-1,9,9,9,9,1,-1,-1,-1\n"}
    scene = write_scene(tmp_path, files=files)
    assert run(["check", str(scene), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["ok"]
    intrinsics = {
        "source": "file", "file": str(tmp_path / "rig.toml"), "same_as": None, "model": "pinhole", "estimated": False,
        "focal_px": 900.0, "focal_sd_percent": None,
    }  # fmt: skip
    assert report["cameras"][1] == {
        "name": "B", "size": [1280, 720], "frames": 13, "first_frame": 1, "last_frame": 13, "boxes": 37, "identities": 3,
        "keypoints": 0, "joints": 0, "embedding_dimensions": None, "fps": None,
        "shared": {"A": {"people": 2, "sightings": 16}}, "faults": [], "intrinsics": intrinsics,
    }  # fmt: skip
    (told,) = report["diagnostics"]
    assert (told["code"], told["severity"], told["cameras"]) == ("rows_without_identity", "notice", ["B"])
    assert told["values"] == {"place": str(tmp_path / "B.txt"), "unknown": 1, "rows": 37}
    assert report["findings"] == [told["text"]]


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"], ["calibrate"], ["calibrate", "x.toml", "--sed", "1"],
        *(["simulate", "-o", "new", *wrong]
          for wrong in (("--fps", "x"), ("--clock-offsets", "fast"), ("--preset", "moon"), ("--missing", "2"))),
    ],
    ids=lambda arguments: arguments[-1],
)  # fmt: skip
def test_wrong_use_of_the_command_line(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == BAD
    assert capsys.readouterr().err.startswith("error: ")
    assert not list(tmp_path.iterdir())


POINT = """
[[world.plan.points]]
at = [100, 100]
pixels = { A = [640, 500] }
"""
PLAN = f"""
[world.plan]
image = "plan.png"
metres_per_pixel = 0.02
cameras = {{ A = [10, 20], B = [300, 200] }}
{POINT}"""


def write_plan(folder, text):
    cv2.imwrite(str(folder / "plan.png"), np.full((240, 320, 3), 200, np.uint8))
    return write_scene(folder, extra=text)


def assert_refused(folder, capsys, command, told, place):
    """The command ends with status 2 and one line that says this and names the place, and writes nothing."""
    assert run([*command, "-o", str(folder / "out.toml")]) == BAD
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"error: {place}")
    assert told in error
    assert not (folder / "out.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[10, 20]", "[10, 400]", "[world.plan] cameras A: [10, 400] lies outside the 320 x 240 plan plan.png"),
        ("[100, 100]", "[-5, 100]", "[world.plan] points 1 at: [-5, 100] lies outside the 320 x 240 plan plan.png"),
        ("[640, 500]", "[640, 900]", "[world.plan] points 1 pixels: [640, 900] lies outside the 1280 x 720 image of camera A"),
        ("B = [300, 200]", "Z = [300, 200]", "[world.plan] cameras: camera 'Z' is not declared"),
        ("pixels = { A", "pixels = { Z", "[[world.plan.points]] 1 pixels: camera 'Z' is not declared"),
        ("metres_per_pixel = 0.02", "", "[world.plan]: has no scale: give one of metres_per_pixel and distance"),
        ("metres_per_pixel = 0.02", "metres_per_pixel = 0.02\ndistance = { between = [[1, 2], [3, 4]], metres = 5 }",
         "[world.plan]: has metres_per_pixel and distance: give one"),
        ("metres_per_pixel = 0.02", "distance = { between = [[1, 2], [1, 2]], metres = 5 }",
         "[world.plan.distance]: between names the pixel [1.0, 2.0] twice"),
        ("metres_per_pixel = 0.02", "distance = { between = [[1, 2], [319, 900]], metres = 5 }",
         "[world.plan] distance between: [319, 900] lies outside the 320 x 240 plan"),
        ("metres_per_pixel = 0.02", "metres_per_pixel = 0",
         "[world.plan] metres_per_pixel is 0: input should be greater than 0"),
        ("[10, 20]", "[nan, 20]", "[world.plan] cameras A 0: a finite number is needed"),
        ("[300, 200]", "[10, 20]", "camera A and camera B are at the same pixel of the plan, [10.0, 20.0]"),
        ("pixels = { A = [640, 500] }", "pixels = {}", "[[world.plan.points]] 1: pixels is empty"),
        ("[[world.plan.points]]", "[[world.plan.point]]", "[world.plan]: unknown key 'point': did you mean 'points'?"),
        ("[world.plan]", "[world]\ncamera = 'A'\n[world.plan]", "[world]: has camera and plan: give one of"),
        ("[world.plan]", "[world]\ntilt = true\n[world.plan]",
         "[world]: tilt needs points or positions: a plan knows no heights"),
        ("cameras = { A = [10, 20], B = [300, 200] }\n", "",
         "[world.plan]: 1 camera or point is placed on the plan: place two or more"),
        (POINT, POINT + POINT.replace("[100, 100]", "[50, 50]"),
         "points 1 and 2 are at the same pixel of camera A, [640.0, 500.0]"),
        ("plan.png", "none.png", "none.png: no such file: a picture of the plan (PNG or JPEG)"),
        ("plan.png", "A.txt", "A.txt: is no picture that can be read: give a PNG or JPEG"),
    ],
)  # fmt: skip
def test_an_error_of_a_plan_names_its_key(tmp_path, capsys, old, new, told):
    assert old in PLAN
    assert_refused(tmp_path, capsys, ["calibrate", str(write_plan(tmp_path, PLAN.replace(old, new)))], told, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("0.02", "0", "[metres_per_pixel] is 0: input should be greater than 0"),
        ("[10, 20]", "[10, 4000]", "cameras A: [10, 4000] lies outside the 320 x 240 plan"),
        ("at =", "where =", "[[points]] 1: unknown key 'where'"),
    ],
)
def test_a_plan_of_its_own_is_read_as_strictly(tmp_path, capsys, old, new, told):
    """`passerby align --plan`; a sound plan has no fault."""
    run(["check", str(write_plan(tmp_path, PLAN))])
    assert "plan" not in capsys.readouterr().err
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.replace("[world.plan]\n", "").replace("world.plan.points", "points").replace(old, new))
    assert_refused(tmp_path, capsys, ["align", str(tmp_path / "rig.toml"), "--plan", str(path)], told, path)
