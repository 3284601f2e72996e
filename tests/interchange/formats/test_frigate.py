import numpy as np
import pytest
import yaml

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.interchange.formats.frigate import (
    GOOD,
    SHORTEST_M,
    ground_points,
    metres_per_pixel,
    propose_zone,
    side_lengths,
    zone_at,
)
from support.scenes.handmade_rigs import SIZE, facing, written


def looking(down_deg, name="down", height=6.0, **lens):
    """A camera that looks so far below the horizon."""
    sine, cosine = np.sin(np.radians(down_deg)), np.cos(np.radians(down_deg))
    R_cw = np.array([[1, 0, 0], [0, -sine, -cosine], [0, cosine, -sine]])
    return Camera(name, facing(**lens).lens, Pose.from_centre(R_cw, (4.0, -3.0, height)))


def corners_of(camera, ground):
    return camera.project(np.column_stack([ground, np.zeros(len(ground))]))


def test_side_lengths_are_those_on_the_ground():
    ground = np.array([[2.0, 4.0], [6.0, 5.0], [6.0, 2.0], [3.0, 1.0]])
    expected = np.linalg.norm(np.roll(ground, -1, axis=0) - ground, axis=1)
    for lens in ({}, {"distortions": (-0.2, 0.03, 0.001, 0)}, {"distortions": (0.02, 0, 0, 0), "fisheye": True}):
        camera = looking(40, **lens)
        np.testing.assert_allclose(side_lengths(camera, corners_of(camera, ground)), expected, rtol=1e-6)


def test_what_shows_no_ground_has_no_length():
    camera = looking(20)
    above = np.array([[900.0, 2], [1000, 2], [1000, 900], [900, 900]])
    assert np.isnan(side_lengths(camera, above)).tolist() == [True, True, False, True]
    assert zone_at(camera, above) is None
    assert propose_zone(looking(-60)) is None


def test_metres_per_pixel_as_frigate_interpolates_them():
    """By hand: a rectangle of 100 x 50 pixels, with sides of 10, 4, 20 and 6 m."""
    corners = np.array([[100.0, 100], [200, 100], [200, 150], [100, 150]])
    sides = np.array([10.0, 4.0, 20.0, 6.0])
    # Upper side 0.1 and lower 0.2 m a pixel, left 0.12 and right 0.08.
    pixels = np.array([[100.0, 100], [200, 150], [150, 125]])
    np.testing.assert_allclose(metres_per_pixel(corners, sides, pixels), [0.11, 0.14, 0.125])
    # Whatever corner comes first.
    np.testing.assert_allclose(metres_per_pixel(np.roll(corners, 2, 0), np.roll(sides, 2), pixels), [0.11, 0.14, 0.125])


def test_the_proposed_zone_is_good_where_that_is_possible():
    good = propose_zone(looking(65))
    assert good.worst <= GOOD
    assert good.sides_m.min() >= SHORTEST_M
    poor = propose_zone(looking(25))
    assert poor.worst > 2 * GOOD


def test_the_file_is_a_part_of_frigates_configuration(tmp_path):
    rig = Rig((looking(60, "a b"), looking(20, "low"), looking(-60, "up")))
    with pytest.raises(InputError, match="no camera sees enough ground"):
        written("frigate", Rig((rig["up"],)), tmp_path / "none.yml")
    assert not (tmp_path / "none.yml").exists()
    with pytest.raises(InputError, match="camera up sees too little ground"):
        written("frigate", Rig((rig["low"], rig["up"])), tmp_path / "none.yml")
    (told,) = written("frigate", rig, tmp_path / "zones.yml", lossy=True)
    assert told.startswith("camera up ")
    text = (tmp_path / "zones.yml").read_text()
    cameras = yaml.safe_load(text)["cameras"]
    assert list(cameras) == ["a_b", "low"]
    zone = cameras["a_b"]["zones"]["ground_a_b"]
    shares = np.array([float(value) for value in zone["coordinates"].split(",")]).reshape(4, 2)
    assert ((shares > 0) & (shares < 1)).all()
    # What Frigate's validate_distances makes of it.
    sides = np.array(list(map(float, zone["distances"].split(","))))
    ground = ground_points(rig["a b"], shares * SIZE - 0.5)
    np.testing.assert_allclose(np.linalg.norm(np.roll(ground, -1, axis=0) - ground, axis=1), sides, rtol=2e-3)
    assert "# low: Frigate's speeds are off by -" in text
