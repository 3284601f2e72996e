"""What a scene file states of lenses that were not calibrated: sources, cameras of one model, contradictions."""

import json
import struct

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Lens
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.observations import Boxes, Keypoints
from passerby.scene.check import check_scene
from passerby.scene.inputs import assemble_inputs, read_cameras, read_inputs
from passerby.scene.reading import input_from_memory
from passerby.scene.scene import Scene
from support.refusals import refused
from support.scenes.recorded_videos import FOCAL, SIGNED, write_recorded

SIZE = "image_size = [1280, 720]\n"
RIG = "".join(
    f"[{name}]\nsize = [1280, 720]\nmatrix = [[900.0, 0.0, 630.0], [0.0, 900.0, 365.0], [0.0, 0.0, 1.0]]\n"
    "distortions = [-0.2, 0.05, 0.0, 0.0, 0.0]\n"
    for name in "AB"
)


@pytest.fixture
def scene_of(tmp_path):
    """Writes a scene of cameras A, B, ... with the given lines in their tables, and somebody in each image."""

    def write(*tables):
        lines = []
        (tmp_path / "rig.toml").write_text(RIG)
        for number, table in enumerate(tables):
            name = chr(ord("A") + number)
            (tmp_path / f"{name}.txt").write_text(f"1,1,{300 + number},200,50,120,1,-1,-1,-1\n")
            lines.append(f'[cameras.{name}]\ntracks = "{name}.txt"\n{table}\n')
        path = tmp_path / "scene.toml"
        path.write_text('[association]\nmode = "given"\n' + "\n".join(lines))
        return path

    return write


def lenses(path):
    return {reading.name: reading.lens for reading in read_cameras(Scene.load(path))}


@pytest.mark.parametrize(
    ("lines", "focal", "sd"),
    [
        ("hfov_deg = 90", 640.0, 0.19258),
        ("hfov_deg = 90\nfocal_sd_percent = 4", 640.0, 0.04),
        ("focal_mm = 2.8\nsensor_width_mm = 5.6", 640.0, 0.15),
        ("focal_35mm = 43.2666\nfocal_sd_percent = 5", np.hypot(1280, 720), 0.05),
        ('hfov_deg = 200\nlens_model = "fisheye"', 640 / np.radians(100), 0.15),
        ("", 1280.0, LARGEST_FOCAL_SD),
    ],
)
def test_a_focal_length_is_stated_in_one_of_several_ways(scene_of, lines, focal, sd):
    lens = lenses(scene_of(SIZE + lines, SIZE))["A"]
    assert (lens.focal, lens.focal_sd) == (pytest.approx(focal, rel=1e-5), pytest.approx(sd, rel=1e-4))
    assert lens.uncalibrated
    assert lens.group is None
    assert lens.fisheye is ("fisheye" in lines)
    # The sensor lies along the longer side.
    upright = scene_of("image_size = [720, 1280]\nfocal_mm = 4.0\nsensor_width_mm = 5.0", SIZE)
    assert lenses(upright)["A"].focal == pytest.approx(1024.0)


def test_cameras_of_one_model_share_what_is_stated_of_any(scene_of):
    """Through a chain, and with the image size of the first; equal statements are no contradiction."""
    one = SIZE + 'lens_model = "fisheye"\nhfov_deg = 70.0'
    found = lenses(scene_of('lens = "same as B"', 'lens = "Same as C"\nhfov_deg = 70', one, SIZE))
    assert [found[name].group for name in "ABCD"] == ["C", "C", "C", None]
    assert all(found[name].focal == pytest.approx(640 / np.radians(35)) for name in "ABC")
    assert all(found[name].fisheye and found[name].size == (1280, 720) for name in "ABC")
    # The lens of a camera that was calibrated is the start of the others', each with a deviation of its own.
    same = 'lens = "same as A"'
    found = lenses(scene_of('intrinsics = "rig.toml"', same, f"{same}\nfocal_sd_percent = 3"))
    assert found["A"].focal_sd is None
    assert not found["A"].uncalibrated
    for name, sd in (("B", 0.01), ("C", 0.03)):
        np.testing.assert_array_equal(found[name].matrix, found["A"].matrix)
        np.testing.assert_array_equal(found[name].distortions, found["A"].distortions)
        assert (found[name].focal_sd, found[name].uncalibrated, found[name].group) == (sd, True, None)


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ((SIZE + "focal_mm = 2.8", SIZE), "[cameras.A]: states focal_mm = 2.8, but no sensor_width_mm: add"),
        ((SIZE + "sensor_width_mm = 5.6", SIZE), "[cameras.A]: states sensor_width_mm = 5.6, but no focal_mm: add"),
        ((SIZE, SIZE + "hfov_deg = 90\nfocal_mm = 2.8\nsensor_width_mm = 5.6"),
         "[cameras.B]: states its focal length more than once, by hfov_deg = 90 and focal_mm = 2.8: keep one"),
        ((SIZE + "focal_mm = -2.8\nsensor_width_mm = 5.6", SIZE), "[cameras.A] focal_mm is -2.8: "),
        ((SIZE + "focal_mm = inf\nsensor_width_mm = 5.6", SIZE), "[cameras.A] focal_mm: a finite number is needed"),
        (('intrinsics = "rig.toml"\nfocal_mm = 2.8', SIZE), "[cameras.A]: states both intrinsics and focal_mm: delete one"),
        (('intrinsics = "rig.toml"\nlens = "same as B"', SIZE), "states both intrinsics and lens: delete one"),
        ((SIZE + 'lens_model = "wide"', SIZE), "[cameras.A] lens_model is 'wide': input should be 'pinhole' or 'fisheye'"),
        ((SIZE + 'lens = "B"', SIZE), '[cameras.A] lens: write lens = "same as CAMERA"'),
        ((SIZE + 'lens = "same as X"', SIZE), "[cameras.A] lens: camera 'X' is not declared"),
        ((SIZE + 'lens = "same as A"', SIZE), "[cameras.A] lens: names the camera itself"),
        ((SIZE + 'lens = "same as B"', SIZE + 'lens = "same as C"', SIZE + 'lens = "same as A"'),
         "[cameras.A] lens: leads in a circle (A -> B -> C -> A): delete lens of one"),
        ((SIZE + "hfov_deg = 90", SIZE + 'lens = "same as A"\nhfov_deg = 80'),
         "[cameras.B]: states hfov_deg = 80, but A, which has the same lens, hfov_deg = 90: state it once"),
        (('intrinsics = "rig.toml"', 'lens = "same as A"\nhfov_deg = 80'),
         "[cameras.B]: states hfov_deg, but its lens is the same as that of A, which has intrinsics: delete"),
        ((SIZE + "hfov_deg = 90", SIZE + 'lens = "same as A"\nfocal_sd_percent = 5'),
         "[cameras.B]: states focal_sd_percent, but no focal length: state it beside the focal length of A"),
        ((SIZE, SIZE + "hfov_deg = 170"), "[cameras.B] hfov_deg is 170: a pinhole lens has up to 150 degrees; add lens_model"),
        ((SIZE, 'lens = "same as A"\nimage_size = [1920, 1080]'),
         "[cameras.B] lens: the images of B are 1920 x 1080, those of A, whose lens it shares, 1280 x 720: one lens"),
        (('intrinsics = "rig.toml"', 'lens = "same as A"\nimage_size = [640, 360]'),
         "[cameras.B] lens: the images of B are 640 x 360, those of A, whose lens it shares, 1280 x 720: one lens"),
        ((SIZE + "focal_mm = 2.8\nsensor_width_mm = 5600", SIZE),
         "[cameras.A] focal_mm and sensor_width_mm: a focal length of 0.64 px means"),
        (("image_size = [720, 1280]\nhfov_deg = 140", SIZE),
         "[cameras.A] a focal length of 131 px means 157 degrees over the 1280 px of a 720 x 1280 image"),
    ],
)  # fmt: skip
def test_halves_and_contradictions_are_errors(scene_of, capsys, tables, told):
    """Those of the file, and those of the file and the images."""
    path = scene_of(*tables)
    with pytest.raises(InputError) as error:
        read_inputs(Scene.load(path))
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{path}: [cameras.")
    assert told in line
    assert run(["check", str(path)]) == 2
    assert told in capsys.readouterr().err


def test_a_matrix_without_an_image_size_is_an_error(scene_of, tmp_path):
    path = scene_of('intrinsics = "half.toml"', 'lens = "same as A"')
    (tmp_path / "half.toml").write_text(RIG.replace("size = [1280, 720]\n", ""))
    with refused(r"^\S*half.toml: \[A\]: size is missing: give \[width, height\] in pixels$", tmp_path):
        read_inputs(Scene.load(path))


def test_metadata_of_a_video_unless_something_is_stated(scene_of, tmp_path):
    told, focal = {"com.apple.quicktime.model": "iPhone 13"}, {FOCAL: (SIGNED, struct.pack(">i", 26))}
    for name in "ABC":
        write_recorded(tmp_path / f"{name}.mov", told, focal, (1280, 720))
    path = scene_of('video = "A.mov"', 'video = "B.mov"\nfocal_35mm = 30', 'video = "C.mov"\nlens = "same as A"')
    found, checked = lenses(path), check_scene(path)
    diagonal = np.hypot(1280, 720) / np.hypot(36, 24)
    assert [found[name].focal for name in "ABC"] == pytest.approx([26 * diagonal, 30 * diagonal, 26 * diagonal])
    assert [found[name].group for name in "ABC"] == ["A", None, "A"]
    assert [one.cameras for one in checked.diagnostics if one.code == "focal_from_metadata"] == [("A",)]
    sources = [camera.to_dict()["intrinsics"] for camera in checked.cameras]
    expected = [("metadata", None), ("focal_35mm", None), ("metadata", "A")]
    assert [(source["source"], source["same_as"]) for source in sources] == expected
    assert sources[0]["file"] == str(tmp_path / "A.mov")
    video = checked.cameras[0].to_dict()["video"]
    assert (video["focal_35mm"], video["device"]) == (26.0, "iPhone 13")


def test_check_says_what_is_known_and_from_where(scene_of, tmp_path, capsys):
    path = scene_of(
        'intrinsics = "rig.toml"', 'lens = "same as A"', SIZE + "focal_mm = 2.8\nsensor_width_mm = 5.6",
        SIZE + 'hfov_deg = 200\nlens_model = "fisheye"\nfocal_sd_percent = 4', SIZE,
    )  # fmt: skip
    run(["check", str(path)])
    table = capsys.readouterr().out.split("Intrinsics\n")[1].splitlines()
    assert [line.split() for line in table[1:6]] == [
        ["A", "intrinsics", "file", "pinhole", "900", "px", "-", "as", "stated"],
        ["B", "intrinsics", "file,", "as", "A", "pinhole", "900", "px", "1", "%", "estimated"],
        ["C", "focal_mm", "pinhole", "640", "px", "15", "%", "estimated"],
        ["D", "hfov_deg", "fisheye", "367", "px", "4", "%", "estimated"],
        ["E", "nothing:", "estimated", "from", "people", "pinhole", "-", "-", "estimated"],
    ]
    run(["check", str(path), "--json"])
    first, *_, last = (camera["intrinsics"] for camera in json.loads(capsys.readouterr().out)["cameras"])
    assert first == {
        "source": "file", "file": str(tmp_path / "rig.toml"), "same_as": None, "model": "pinhole", "estimated": False,
        "focal_px": 900.0, "focal_sd_percent": None,
    }  # fmt: skip
    assert (last["source"], last["focal_px"], last["focal_sd_percent"], last["estimated"]) == ("people", None, None, True)

    run(["check", str(scene_of('intrinsics = "rig.toml"', 'intrinsics = "rig.toml"'))])
    out = capsys.readouterr().out
    assert f"intrinsics: {tmp_path / 'rig.toml'}\n" in out
    assert "Intrinsics" not in out


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (Lens.unknown((640, 480), group="x"), "image sizes differ: 1280 x 720 and 640 x 480"),
        (Lens.unknown((1280, 720), fisheye=True, group="x"), "lens models differ: pinhole and fisheye"),
        (Lens.unknown((1280, 720), hfov_deg=60.0, group="x"), "focal lengths differ: 1280 px and 1108.51 px"),
        (Lens.unknown((1280, 720), group="x"), None),
        (Lens.unknown((640, 480), group="y"), None),
    ],
)
def test_a_group_of_lenses_from_memory_is_one_lens(scene_of, other, told):
    scene = Scene.load(scene_of(SIZE, SIZE))
    boxes = Boxes(np.array([1]), np.array([1]), np.array([[300.0, 200, 50, 120]]), np.ones(1))
    readings = [
        input_from_memory(scene, name, lens, boxes, Keypoints.empty())
        for name, lens in (("A", Lens.unknown((1280, 720), group="x")), ("B", other))
    ]
    if told is None:
        assert len(assemble_inputs(scene, readings).rig.cameras) == 2
        return
    with pytest.raises(InputError, match=f"cameras A and B are of the group 'x', but their {told}"):
        assemble_inputs(scene, readings)
