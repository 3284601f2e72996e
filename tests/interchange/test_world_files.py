"""Known points and positions of cameras: what is read, and every fault with its line, value and fix."""

import pytest

from passerby.core.scale_cues import GPS_SD_M, POINT_SD_M, POSITION_SD_M
from passerby.interchange.storage.safe_parsing import FileFaults
from passerby.interchange.world_files import read_known_points, read_known_positions
from support.refusals import refused

POINTS = "camera,u,v,x,y,z,point,sd_m\n"
WITHOUT_NAMES = "camera,u,v,x,y\n"


def write(tmp_path, text, ending="csv"):
    (tmp_path / f"a.{ending}").write_text(text)
    return tmp_path / f"a.{ending}"


def test_sightings_of_one_point_are_one_point(tmp_path):
    """By its name, or by its place."""
    for rows in (POINTS + "A,10,20,1,2,0,kerb,0.05\nB,30,40,1,2,0,kerb,0.01\n", WITHOUT_NAMES + "A,10,20,1,2\nB,30,40,1,2\n"):
        (point,) = read_known_points(write(tmp_path, rows))
        assert (point.pixels, point.xyz.tolist()) == ({"A": (10.0, 20.0), "B": (30.0, 40.0)}, [1, 2, 0])
        assert point.sd_m == (0.01 if "kerb" in rows else POINT_SD_M)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (POINTS, "has no row: known points are needed"),
        ("camera,u,v,x\nA,1,2,3\n", "line 1: has no column y: give a header out of camera, u, v"),
        (POINTS + ",10,20,1,2,0,p,0.1\n", "line 2: camera is missing: name the camera"),
        (POINTS + "A,10,,1,2,0,p,0.1\n", "line 2: v is missing: give a number"),
        (POINTS + "A,10,left,1,2,0,p,0.1\n", "line 2: v is 'left': a number from"),
        (POINTS + "A,10,20,1e9,2,0,p,0.1\n", "line 2: x is '1e9': a number from"),
        (POINTS + "A,10,20,1,,0,p,0.1\n", "line 2: y is missing: give a number"),
        (POINTS + "A,10,20,1,2,0,p,0\n", "line 2: sd_m is 0: give metres above 0"),
        (
            POINTS + "A,10,20,1,2,0,p,\nA,11,21,1,2,0,p,\n",
            r"line 3: point p occurs a second time in camera A \(first on line 2\)",
        ),
        (
            POINTS + "A,10,20,1,2,0,p,\nB,11,21,1,2.5,0,p,\n",
            r"line 3: point p is at \[1.0, 2.5, 0.0\], but at \[1.0, 2.0, 0.0\] on line 2: correct one, or give them different",
        ),
    ],
)
def test_a_fault_of_points_is_told_with_its_line(tmp_path, text, told):
    path = write(tmp_path, text)
    with refused(told, path):
        read_known_points(path)


def test_all_faults_are_told(tmp_path):
    with pytest.raises(FileFaults) as error:
        read_known_points(write(tmp_path, POINTS + "A,x,20,1,2,0,p,\nB,1,2,3,4,5,q,\n,1,2,3,4,5,r,\n"))
    assert [fault.split(": ")[1] for fault in error.value.faults] == ["line 2", "line 4"]


def test_positions_are_metres_or_degrees(tmp_path):
    (metric,), is_geodetic = read_known_positions(write(tmp_path, "camera,x,y,note\nA,1,2,gate\n"))
    assert not is_geodetic
    assert (metric.camera, metric.sd_m) == ("A", POSITION_SD_M)
    (geodetic,), is_geodetic = read_known_positions(
        write(tmp_path, '[[positions]]\ncamera = "A"\nlat = 47.5\nlon = 8\n', "toml")
    )
    assert is_geodetic
    assert geodetic.sd_m == GPS_SD_M


@pytest.mark.parametrize(
    ("text", "ending", "told"),
    [
        ("camera,x,y\nA,1,2\nA,1,2\n", "csv", "line 3: camera A occurs a second time: delete one"),
        ("camera,lat,lon\nA,90,8\n", "csv", "line 2: lat 90, lon 8 is not a place on earth: give degrees, latitude first"),
        ("camera,lat,lon\nA,8,400\n", "csv", "line 2: lat 8, lon 400 is not a place on earth"),
        ("camera,x,z\nA,1,2\n", "csv", "line 2: y is missing"),
        ("camera,lat\nA,8\n", "csv", "line 2: lon is missing: give a number"),
        ("positions = 3\n", "toml", r"has no tables \[\[positions\]\]: give one for each row, with the keys camera, x, y"),
        ('[[positions]]\ncamera = "A"\nx = 1\ny = 2\nhight = 3\n', "toml", r"\[\[positions\]\] 1: unknown key 'hight'"),
        ("[[positions]]\ncamera = true\nx = 1\ny = 2\n", "toml", "camera is True: give a name in quotes"),
        ('[[positions]]\ncamera = "A"\nx = true\ny = 2\n', "toml", "x is 'True': a number from"),
    ],
)
def test_a_fault_of_positions_is_told_with_its_place(tmp_path, text, ending, told):
    path = write(tmp_path, text, ending)
    with refused(told, path):
        read_known_positions(path)
