"""Bad input through the command line: the exit status, and one line that names file, place, value and fix."""

import json

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
def test_bad_input_is_told_in_one_line(tmp_path, capsys, changes, told, command):
    scene = write_scene(tmp_path, **changes)
    out = ["-o", str(tmp_path / "out")] if command == "calibrate" else []
    assert run([command, str(scene), *out]) == BAD
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1 or command == "check"
    assert errors[0].startswith(f"error: {tmp_path}")
    assert told in errors[0]
    assert not (tmp_path / "out").exists()


def test_a_scene_file_that_is_missing(tmp_path, capsys):
    assert run(["calibrate", str(tmp_path / "none.toml")]) == BAD
    assert "none.toml: no such file: a scene file (TOML) is needed" in capsys.readouterr().err


def test_check_tells_all_that_is_wrong(tmp_path, capsys):
    files = {"A.txt": rows() + "11,1,nan,300,40,110,1,-1,-1,-1\n12,1,5,300,40,0,1,-1,-1,-1\n", "B.txt": None}
    scene = write_scene(tmp_path, files=files)
    assert run(["check", str(scene), "--json"]) == BAD
    out, errors = capsys.readouterr()
    report = json.loads(out)
    assert not report["ok"]
    assert len(report["faults"]) == len(errors.splitlines()) == 3
    assert [len(camera["faults"]) for camera in report["cameras"]] == [2, 1]


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


def test_check_warns_of_odd_input(tmp_path, capsys):
    files = {"A.txt": rows(60), "rig.toml": lens("A", 2560, 1440) + lens("B")}
    scene = write_scene(tmp_path, files=files, extra="[[scale.people]]\nidentity = 77\nheight_m = 1.8")
    assert run(["check", str(scene)]) == 0
    out = capsys.readouterr().out
    assert "all people lie within 20% of the width and 28% of the height: wrong image size?" in out
    assert "identity 77 is not seen by any camera" in out


def test_check_tells_who_shares_nobody(tmp_path, capsys):
    scene = write_scene(tmp_path, ("A", "B", "C"), files={"C.txt": rows(identities=(8, 9))})
    assert run(["check", str(scene)]) == 3
    assert "camera C shares no people with A, B" in capsys.readouterr().err


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
