"""Rigs in Tsai's XML: one file, several cameras in a file, folders; names, units, sizes. The reader has tests of its own."""

import numpy as np
import pytest
from typer.testing import CliRunner

from passerby.cli.main import app
from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from passerby.interchange.rig_toml import read_rig


def camera(tz="9000", name="", width=720):
    called = f' name="{name}"' if name else ""
    # 20 mm on pixels of 0.02 mm: a focal length of 1000 pixels.
    return (
        f'<Camera{called}><Geometry width="{width}" height="576" ncx="1" nfx="1" dx="1" dy="1" dpx="0.02" dpy="0.02"/>'
        '<Intrinsic focal="20" kappa1="0" cx="360" cy="288" sx="1"/>'
        f'<Extrinsic tx="1000" ty="-2000" tz="{tz}" rx="0" ry="0" rz="1.5707963267948966"/></Camera>'
    )


def test_cameras_of_files_are_called_as_they_are_and_see_what_they_should(tmp_path):
    (tmp_path / "View_001.xml").write_text(camera())
    rig, losses = read_rig_as("tsai", tmp_path / "View_001.xml")
    assert (rig.names, losses) == (("View_001",), ())
    # x_c = Rz(90 degrees) X + t: the world's x becomes the camera's y. X = (2, 0, 1) m lies at (1, -2 + 2, 10) m.
    np.testing.assert_allclose(rig["View_001"].project(np.array([[2.0, 0.0, 1.0]])), [[360 + 1000 * 0.1, 288.0]], atol=1e-9)
    (tmp_path / "rig.xml").write_text(f"<Cameras>{camera()}{camera('8000')}{camera(name='door')}</Cameras>")
    rig, _ = read_rig_as("tsai", tmp_path / "rig.xml")
    assert [(c.name, c.pose.t_cw[2]) for c in rig] == [("rig_1", 9), ("rig_2", 8), ("door", 9)]


def test_a_folder_of_files(tmp_path):
    for number in (2, 1):
        (tmp_path / f"View_00{number}.xml").write_text(camera(str(1000 * number)))
    (tmp_path / "boxes.xml").write_text("<dataset/>")
    (tmp_path / "readme.txt").write_text("")
    out = tmp_path / "rig.toml"
    result = CliRunner().invoke(app, ["import", str(tmp_path), "--format", "tsai", "-o", str(out)])
    assert result.exit_code == 0, result.output
    rig = read_rig(out)
    assert rig.names == ("View_001", "View_002")
    np.testing.assert_allclose(rig["View_002"].pose.t_cw, (1, -2, 2))


def test_other_units_and_smaller_pictures(tmp_path):
    (tmp_path / "c.xml").write_text(camera("9"))
    rig, _ = read_rig_as("tsai", tmp_path / "c.xml", Given(size=(360, 288), metres_per_unit=1.0))
    np.testing.assert_allclose(rig["c"].pose.t_cw, (1000, -2000, 9))
    assert rig["c"].lens.size == (360, 288)
    np.testing.assert_allclose(rig["c"].lens.matrix[0], (500, 0, 360.5 / 2 - 0.5))


def test_broken_rigs_are_told(tmp_path):
    with pytest.raises(InputError, match="holds no XML file with a <Camera>"):
        read_rig_as("tsai", tmp_path)
    (tmp_path / "a.xml").write_text(camera(name="door"))
    (tmp_path / "b.xml").write_text(camera(name="door"))
    with pytest.raises(InputError, match="camera door is in another file"):
        read_rig_as("tsai", tmp_path)
    (tmp_path / "c.xml").write_text(f"<r>{camera(name='1')}{camera(name='1')}</r>")
    with pytest.raises(InputError, match=r"c\.xml: two cameras are called 1"):
        read_rig_as("tsai", tmp_path / "c.xml")
    with pytest.raises(InputError, match="another shape"):
        read_rig_as("tsai", tmp_path / "a.xml", Given(size=(640, 360)))
