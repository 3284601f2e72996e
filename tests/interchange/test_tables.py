"""Tables of CSV and TOML: people's ways, true places, known points and positions of cameras; every fault with its line."""

import numpy as np
import pytest

from passerby.core.observations import Clock
from passerby.core.scale_cues import GPS_SD_M, POINT_SD_M, POSITION_SD_M
from passerby.core.trajectories import Trajectories
from passerby.interchange.storage.safe_parsing import FileFaults
from passerby.interchange.trajectories_csv import read_ground_positions, read_trajectories, write_trajectories
from passerby.interchange.world_files import read_known_points, read_known_positions
from support.refusals import refused

HEAD = "time_s,frame,id,x_m,y_m,z_m,sigma_m,cameras\n"
ROW = "0.2000,3,7,1.000,-2.000,0.900,0.050,2\n"
PLACES = "frame,id,x_m,y_m\n"
POINTS = "camera,u,v,x,y,z,point,sd_m\n"


def write(folder, text, ending="csv"):
    (folder / f"a.{ending}").write_text(text)
    return folder / f"a.{ending}"


def ways(frame, identity, clock):
    frame, identity = np.array(frame), np.array(identity)
    n = len(frame)
    xyz = np.column_stack([0.5 * frame, -0.25 * identity, np.full(n, 0.9)])
    sigma = np.where(np.arange(n) % 2, np.nan, 0.05)
    return Trajectories(identity, frame, clock.seconds(frame), xyz, sigma, np.arange(n) % 3, np.ones(n, dtype=int), clock)


@pytest.mark.parametrize(("frame", "identity", "parts", "clock"), [
    ([1, 2, 3, 9, 10, 2, 3], [4, 4, 4, 4, 4, 6, 6], [1, 1, 1, 2, 2, 1, 1], Clock(5.0, 0.25)),
    ([1, 3, 5], [1, 1, 1], [1, 1, 1], Clock(25.0, -2.0)),
    ([8, 8], [3, 4], [1, 1], Clock(5.0, 1.0)),
], ids=["two people", "every other frame", "one instant"])  # fmt: skip
def test_ways_come_back(tmp_path, frame, identity, parts, clock):
    found = ways(frame, identity, clock)
    write_trajectories(tmp_path / "a.csv", found)
    back = read_trajectories(tmp_path / "a.csv")
    for name in ("identity", "frame", "cameras"):
        assert np.array_equal(getattr(back, name), getattr(found, name))
    np.testing.assert_allclose(back.xyz, found.xyz, atol=6e-4)
    np.testing.assert_allclose(back.sigma_m, found.sigma_m, atol=6e-4)
    # The clock by which these frames have these times; of one instant the rate is not known.
    np.testing.assert_allclose(back.clock.seconds(back.frame), found.time_s, atol=1e-4)
    assert back.part.tolist() == parts


def test_true_places_have_a_persons_number_under_any_of_its_names(tmp_path):
    for name in ("id", "person", "identity"):
        path = write(tmp_path, f"frame,{name},x_m,y_m,more\n3,7,1.5,-2,x\n\n4,7,1.6,-2,y\n")
        found = read_ground_positions(path)
        assert (found.frame.tolist(), found.identity.tolist()) == ([3, 4], [7, 7])
        assert found.xy.tolist() == [[1.5, -2.0], [1.6, -2.0]]


def test_sightings_of_one_point_are_one_point(tmp_path):
    """By its name, or by its place."""
    without_names = "camera,u,v,x,y\nA,10,20,1,2\nB,30,40,1,2\n"
    for rows, sd_m in ((POINTS + "A,10,20,1,2,0,kerb,0.05\nB,30,40,1,2,0,kerb,0.01\n", 0.01), (without_names, POINT_SD_M)):
        (point,) = read_known_points(write(tmp_path, rows))
        assert (point.pixels, point.xyz.tolist()) == ({"A": (10.0, 20.0), "B": (30.0, 40.0)}, [1, 2, 0])
        assert point.sd_m == sd_m


def test_positions_are_metres_or_degrees(tmp_path):
    (metric,), is_geodetic = read_known_positions(write(tmp_path, "camera,x,y,note\nA,1,2,gate\n"))
    assert not is_geodetic
    assert (metric.camera, metric.sd_m) == ("A", POSITION_SD_M)
    (geodetic,), is_geodetic = read_known_positions(
        write(tmp_path, '[[positions]]\ncamera = "A"\nlat = 47.5\nlon = 8\n', "toml")
    )
    assert is_geodetic
    assert geodetic.sd_m == GPS_SD_M


FAULTS = [
    *((read_trajectories, text, message) for text, message in (
        ("time_s,frame\n", r"line 1: has no column id: give the trajectories\.csv that `passerby track` wrote"),
        (HEAD, "has no row: no person was followed"),
        (HEAD + ROW.replace("1.000", "far"), "line 2: x_m is 'far': a finite number is needed"),
        (HEAD + ROW.replace("0.2000,3", "0.2000,3.5"), "line 2: frame is 3.5: a whole number is needed"),
        (HEAD + ROW.replace("-2.000", "1e15"), r"line 2: y_m is 1e\+15: no trajectory has such a number"),
        (HEAD + ROW + ROW, "person 7 occurs twice in frame 3: delete one row"),
        (HEAD + ROW + ROW.replace("0.2000,3", "0.1000,4"), "time_s does not grow with frame: give the trajectories.csv"),
    )),
    *((read_ground_positions, text, message) for text, message in (
        ("", "line 1: has no column frame"),
        ("frame,x_m,y_m\n1,2,3\n", "line 1: has no column id"),
        (PLACES, "has no row"),
        (PLACES + "3,7,1.5\n", r"line 2: has 3 columns, the header has more: complete the row"),
        (PLACES + "3.5,7,1.5,2\n", "line 2: frame is 3.5: a whole number is needed"),
        (PLACES + "3,7,1.5,2\n3,7,1.6,2\n", r"line 3: id 7 occurs a second time in frame 3 \(first on line 2\): delete one"),
        (PLACES + "3,7,1.5,1e13\n", r"line 2: y_m is 1e\+13: no position and no frame has such a number"),
    )),
    *((read_known_points, text, message) for text, message in (
        (POINTS, "has no row: known points are needed"),
        ("camera,u,v,x\nA,1,2,3\n", "line 1: has no column y: give a header out of camera, u, v"),
        (POINTS + ",10,20,1,2,0,p,0.1\n", "line 2: camera is missing: name the camera"),
        (POINTS + "A,10,,1,2,0,p,0.1\n", "line 2: v is missing: give a number"),
        (POINTS + "A,10,left,1,2,0,p,0.1\n", "line 2: v is 'left': a number from"),
        (POINTS + "A,10,20,1e9,2,0,p,0.1\n", "line 2: x is '1e9': a number from"),
        (POINTS + "A,10,20,1,2,0,p,0\n", "line 2: sd_m is 0: give metres above 0"),
        (POINTS + "A,10,20,1,2,0,p,\nA,11,21,1,2,0,p,\n",
         r"line 3: point p occurs a second time in camera A \(first on line 2\)"),
        (POINTS + "A,10,20,1,2,0,p,\nB,11,21,1,2.5,0,p,\n",
         r"line 3: point p is at \[1.0, 2.5, 0.0\], but at \[1.0, 2.0, 0.0\] on line 2: correct one, or give them different"),
    )),
    *((read_known_positions, text, message) for text, message in (
        ("camera,x,y\nA,1,2\nA,1,2\n", "line 3: camera A occurs a second time: delete one"),
        ("camera,lat,lon\nA,90,8\n", "line 2: lat 90, lon 8 is not a place on earth: give degrees, latitude first"),
        ("camera,lat,lon\nA,8,400\n", "line 2: lat 8, lon 400 is not a place on earth"),
        ("camera,x,z\nA,1,2\n", "line 2: y is missing"),
        ("camera,lat\nA,8\n", "line 2: lon is missing: give a number"),
        ("positions = 3\n", r"has no tables \[\[positions\]\]: give one for each row, with the keys camera, x, y"),
        ('[[positions]]\ncamera = "A"\nx = 1\ny = 2\nhight = 3\n', r"\[\[positions\]\] 1: unknown key 'hight'"),
        ("[[positions]]\ncamera = true\nx = 1\ny = 2\n", "camera is True: give a name in quotes"),
        ('[[positions]]\ncamera = "A"\nx = true\ny = 2\n', "x is 'True': a number from"),
    )),
]  # fmt: skip


@pytest.mark.parametrize(("reader", "text", "message"), FAULTS)
def test_a_fault_is_refused_with_its_line_and_value(tmp_path, reader, text, message):
    path = write(tmp_path, text, "toml" if "positions" in text else "csv")
    with refused(message, path):
        reader(path)


def test_all_faults_of_points_are_listed(tmp_path):
    with pytest.raises(FileFaults) as error:
        read_known_points(write(tmp_path, POINTS + "A,x,20,1,2,0,p,\nB,1,2,3,4,5,q,\n,1,2,3,4,5,r,\n"))
    assert [fault.split(": ")[1] for fault in error.value.faults] == ["line 2", "line 4"]
