"""Errors of `[world.plan]` through the command line: status 2, and one line that names file, key, value and fix."""

import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from support.scenes.handmade_files import write_scene

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


def write(folder, text):
    cv2.imwrite(str(folder / "plan.png"), np.full((240, 320, 3), 200, np.uint8))
    return write_scene(folder, extra=text)


def refused(folder, capsys, command, told, place):
    """The command ends with status 2 and one line that tells this and names the place, and writes nothing."""
    assert run([*command, "-o", str(folder / "out.toml")]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"error: {place}")
    assert told in error
    assert not (folder / "out.toml").exists()


def test_a_sound_plan_has_no_fault(tmp_path, capsys):
    run(["check", str(write(tmp_path, PLAN))])
    assert "plan" not in capsys.readouterr().err


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
def test_what_is_wrong_is_told_with_its_key(tmp_path, capsys, old, new, told):
    assert old in PLAN
    refused(tmp_path, capsys, ["calibrate", str(write(tmp_path, PLAN.replace(old, new)))], told, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("0.02", "0", "[metres_per_pixel] is 0: input should be greater than 0"),
        ("[10, 20]", "[10, 4000]", "cameras A: [10, 4000] lies outside the 320 x 240 plan"),
        ("at =", "where =", "[[points]] 1: unknown key 'where'"),
    ],
)
def test_a_plan_of_its_own_is_read_as_strictly(tmp_path, capsys, old, new, told):
    """`passerby align --plan`."""
    write(tmp_path, "")
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.replace("[world.plan]\n", "").replace("world.plan.points", "points").replace(old, new))
    refused(tmp_path, capsys, ["align", str(tmp_path / "rig.toml"), "--plan", str(path)], told, path)
