"""A rig laid upon points or positions: truth from rigs that were moved by a known motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.calibration.alignment.world import align_to_camera, align_to_points, align_to_positions
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.scale_cues import KnownPoint, KnownPosition
from passerby.geometry.alignment import KnownPositions, fit_world
from passerby.geometry.rotations import exp_rotation
from support.scenes.people_and_rigs import looking_at

LENS = Lens((1280, 720), np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]), np.array([-0.1, 0.02, 0, 0, 0]))


SPOTS = ((-9.0, -8.0, 3.1), (9.0, -7.0, 2.7), (8.0, 9.0, 4.2), (-8.0, 8.0, 3.6))


def looking(spot, at=(0.0, 0.0, 0.5), name="C1", **rest):
    return Camera(name, LENS, looking_at(spot, at), **rest)


def square(sigma=None):
    return Rig(tuple(looking(spot, name=f"C{k}", sigma=sigma) for k, spot in enumerate(SPOTS, start=1)), "accepted", {"a": "b"})


def turned(yaw, shift, scale=1.0):
    """The motion from the rig's world to the wanted one."""
    return exp_rotation(np.array([0.0, 0.0, yaw])), np.array(shift, dtype=float), scale


def points_in(rig, count, rng, height=0.0, noise_px=0.0, one_camera=False):
    """Points that the rig sees; coordinates in its world."""
    found = []
    centre = np.mean([camera.centre for camera in rig], axis=0)
    size = np.linalg.norm(rig["C1"].centre - rig["C3"].centre)
    while len(found) < count:
        xyz = np.array([*(centre[:2] + rng.uniform(-0.25, 0.25, 2) * size), height * rng.uniform()])
        pixels = {}
        for camera in rig:
            u, v = camera.project(xyz)[0] + noise_px * rng.normal(size=2)
            if 0 < u < 1280 and 0 < v < 720 and not (one_camera and pixels):
                pixels[camera.name] = (float(u), float(v))
        if pixels:
            found.append(KnownPoint(str(len(found) + 1), xyz, pixels))
    return found


def positions_in(rig, rng=None, sd=0.0):
    rng = rng or np.random.default_rng(0)
    return [KnownPosition(camera.name, camera.centre + sd * rng.normal(size=3), max(sd, 0.01)) for camera in rig]


def apart(a, b):
    """Largest difference of two rigs: centres in metres, rotations."""
    pairs = zip(a, b, strict=True)
    return max(
        np.abs(np.subtract(getattr(x.pose, of), getattr(y.pose, of))).max() for x, y in pairs for of in ("centre", "R_cw")
    )


yaws = st.floats(-3.1, 3.1)


shifts = st.tuples(st.floats(-500, 500), st.floats(-500, 500))
scales = st.floats(0.5, 2.0)


@settings(max_examples=20)
@given(yaws, shifts, st.integers(2, 6), st.booleans(), st.integers(0, 1000))
def test_points_bring_back_a_known_motion(yaw, shift, count, one_camera, seed):
    rig = square()
    wanted = rig.moved(*turned(yaw, (*shift, 0.0)))
    points = points_in(wanted, count, np.random.default_rng(seed), height=1.5, one_camera=one_camera)
    aligned = align_to_points(rig, points)
    assert apart(aligned.rig, wanted) < 1e-6
    assert aligned.notes == ()
    assert all(row["off_m"] < 1e-6 and row["off_px"] < 1e-5 for row in aligned.residuals)


@settings(max_examples=40)
@given(yaws, st.tuples(*[st.floats(-0.6, 0.6)] * 2), shifts, st.floats(-100, 100), scales, st.booleans(), st.booleans())
def test_scale_comes_back_too_and_any_rotation_and_height_where_the_rig_may_tilt(yaw, leans, shift, up, scale, tilt, by_points):
    rig = square()
    rotation = exp_rotation(np.array([0, 0, yaw])) @ exp_rotation(np.array([*leans, 0]) * tilt)
    wanted = rig.moved(rotation, np.array([*shift, up * tilt]), scale)
    if tilt:
        rig, wanted = wanted, rig
    options = {"with_scale": True, "tilt": tilt}
    if by_points:
        points = points_in(wanted, 8 if tilt else 5, np.random.default_rng(2), 2.0 if tilt else 1.0)
        aligned = align_to_points(rig, points, **options)
    else:
        aligned = align_to_positions(rig, positions_in(wanted), **options)
    assert apart(aligned.rig, wanted) < (1e-5 if tilt else 1e-6)
    assert aligned.motion.scale == pytest.approx(1 / scale if tilt else scale, rel=1e-7)


def test_coordinates_of_a_national_grid():
    """Millions of metres from the origin, to a tenth of a millimetre; the same digits each time."""
    wanted = square().moved(*turned(2.0, (465_000.0, 5_822_000.0, 0.0)))
    assert apart(align_to_positions(square(), positions_in(wanted)).rig, wanted) < 1e-4
    points = points_in(wanted, 5, np.random.default_rng(3), 1.0)
    first, second = (align_to_points(square(), points, with_scale=True) for _ in range(2))
    assert apart(first.rig, wanted) < 1e-4
    assert first.figures == second.figures


def test_tilt_without_scale_from_single_sightings():
    wanted = square()
    rig = wanted.moved(exp_rotation(np.array([0.05, -0.03, 2.0])), np.array([3.0, 4.0, 0.4]))
    points = points_in(wanted, 7, np.random.default_rng(3), one_camera=True)
    aligned = align_to_points(rig, points, tilt=True)
    assert apart(aligned.rig, wanted) < 1e-5
    assert "is now tilted by" in aligned.notes[-1]


def test_the_ground_stays_where_it_is():
    """Heights of points and positions are told, not used."""
    rig = square()
    positions = [KnownPosition(name, rig[name].centre + (5.0, -3.0, 0.7)) for name in rig.names]
    aligned = align_to_positions(rig, positions)
    assert [camera.centre[2] for camera in aligned.rig] == pytest.approx([spot[2] for spot in SPOTS])
    assert [row["height_off_m"] for row in aligned.residuals] == pytest.approx([-0.7] * 4)
    assert aligned.rig["C1"].centre == pytest.approx(rig["C1"].centre + (5.0, -3.0, 0.0))
    raised = [KnownPoint(p.name, p.xyz + (0, 0, 0.2), p.pixels) for p in points_in(rig, 4, np.random.default_rng(0), 1.0)]
    told = [row["height_off_m"] for row in align_to_points(rig, raised).residuals if row["height_off_m"] is not None]
    assert told == pytest.approx([-0.2] * len(told), abs=0.02)


def test_origin_and_heading_are_those_of_a_camera_or_of_another_where_it_looks_straight_down():
    rig = square().moved(*turned(0.7, (3, 4, 0)))
    aligned = align_to_camera(rig, "C2")
    assert aligned.rig["C2"].centre == pytest.approx((0, 0, SPOTS[1][2]), abs=1e-12)
    for along in (aligned.rig["C2"].pose.R_cw[2], align_to_camera(rig, "C2", "C4").rig["C4"].centre):
        assert along[1] == pytest.approx(0, abs=1e-12)
        assert along[0] > 0
    assert aligned.rig.metadata == {"a": "b", "world": "camera C2"}
    assert aligned.rig.verdict == "accepted"
    down = Camera("D", LENS, Pose.from_centre(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]), np.array([1.0, 2, 5])))
    rig = Rig((*square(), down, Camera("N", LENS)))
    with pytest.raises(EvidenceError, match=r"straight down.*`towards`"):
        align_to_camera(rig, "D")
    assert align_to_camera(rig, "D", "C1").rig["D"].centre == pytest.approx((0, 0, 5))
    with pytest.raises(EvidenceError, match="camera N has no pose: choose one of C1"):
        align_to_camera(rig, "N")
    with pytest.raises(InputError, match="no camera X: it has C1"):
        align_to_camera(rig, "C1", "X")
    with pytest.raises(EvidenceError, match="is where camera C1 is"):
        align_to_camera(rig, "C1", "C1")


def test_sigmas_move_with_the_world():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6)) * 0.01
    covariance = root @ root.T
    sigma = PoseSigma(np.sqrt(np.trace(covariance[:3, :3])), np.degrees(np.sqrt(np.trace(covariance[3:, 3:]))), covariance)
    rotation, shift, scale = exp_rotation(np.array([0.3, -0.2, 1.0])), np.array([1.0, 2.0, 3.0]), 1.7
    rig = square(sigma)
    moved = rig.moved(rotation, shift, scale)["C1"].sigma
    assert moved.position_m == pytest.approx(scale * sigma.position_m)
    assert moved.position_m == pytest.approx(np.sqrt(np.trace(moved.covariance[:3, :3])))
    assert moved.orientation_deg == sigma.orientation_deg
    # By drawing: disturb the pose in its own frame of parameters, move it, and measure the spread.
    pose, draws = rig["C1"].pose, rng.multivariate_normal(np.zeros(6), 1e-4 * covariance, 4000)
    spread = []
    for centre, turn in ((draw[:3], draw[3:]) for draw in draws):
        other = Pose.from_centre(exp_rotation(turn) @ pose.R_cw, pose.centre + centre).moved(rotation, shift, scale)
        here = pose.moved(rotation, shift, scale)
        off = other.R_cw @ here.R_cw.T
        spread.append([*(other.centre - here.centre), *[(off[j, i] - off[i, j]) / 2 for i, j in ((1, 2), (2, 0), (0, 1))]])
    assert np.cov(np.array(spread).T) * 1e4 == pytest.approx(moved.covariance, abs=0.06 * np.abs(moved.covariance).max())


@pytest.mark.slow
@pytest.mark.parametrize("with_scale", [False, True])
def test_the_stated_sigmas_are_right(with_scale):
    """Errors over stated sigmas over 80 seeds; a root mean square of 80 normal numbers is within 0.75 and 1.25."""
    heading, place, growth = [], [], []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        rig = square()
        many = Rig((*rig, *(looking(spot, name=f"D{k}") for k, spot in enumerate(rng.uniform(4, 15, (6, 3))))))
        fit = fit_world(KnownPositions(
            np.array([camera.centre for camera in many]),
            np.array([known.place for known in positions_in(many, rng, 0.5)]), np.full(len(many), 0.5), False,
        ), with_scale=with_scale)  # fmt: skip
        middle = np.mean([camera.centre for camera in many], axis=0)
        heading.append(np.arctan2(fit.motion.rotation[1, 0], fit.motion.rotation[0, 0]) / fit.turn_sigma)
        place.append(np.linalg.norm((fit.motion.apply(middle) - middle)[:2]) / fit.place_sigma)
        if with_scale:
            growth.append((fit.motion.scale - 1) / fit.scale_sigma)
    for ratios in (heading, place, growth) if with_scale else (heading, place):
        assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.25


@pytest.mark.slow
def test_sound_places_are_kept():
    """20 sets of noisy points: at most one is called a gross error, and the rig comes back."""
    lost = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        wanted = square().moved(*turned(1.0, (20, 30, 0)))
        aligned = align_to_points(square(), points_in(wanted, 5, rng, noise_px=2.0))
        lost += sum(not row["used"] for row in aligned.residuals)
        assert apart(aligned.rig, wanted) < 0.15
    assert lost <= 1


@pytest.mark.parametrize("seed", range(6))
def test_a_wrong_position_is_named(seed):
    rng = np.random.default_rng(seed)
    wanted = square().moved(*turned(-2.0, (100, 50, 0)))
    positions = positions_in(wanted, rng, 0.1)
    wrong = int(rng.integers(4))
    positions[wrong] = KnownPosition(f"C{wrong + 1}", positions[wrong].place + (4.0, 1.0, 0.0), 0.1)
    aligned = align_to_positions(square(), positions)
    assert len(aligned.notes) == 1
    assert aligned.notes[0].startswith(f"the position of camera C{wrong + 1} has a residual of 4.")
    assert apart(aligned.rig, wanted) < 0.4


@pytest.mark.parametrize(
    ("count", "with_scale", "tilt"), [(3, False, False), (4, True, False), (5, False, True), (5, True, True)]
)
def test_so_few_positions_are_enough_to_name_a_wrong_one(count, with_scale, tilt):
    """One fewer, and nobody is named rather than somebody wrongly."""
    more = looking((0.0, 6.0, 3.0), name="C5")
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rig = Rig((*square(), more)[:count])
        known = positions_in(rig.moved(*turned(1.0, (5.0, 5.0, 0.0))), rng, 0.05)
        wrong = int(rng.integers(count))
        known[wrong] = KnownPosition(f"C{wrong + 1}", known[wrong].place + rng.choice([-1, 1], 3) * (2.5, 2.5, 1.0), 0.05)
        aligned = align_to_positions(rig, known, with_scale=with_scale, tilt=tilt)
        assert [row["camera"] for row in aligned.residuals if not row["used"]] == [f"C{wrong + 1}"]
        if count > 3 and wrong < count - 1:
            fewer = Rig(rig.cameras[:-1])
            aligned = align_to_positions(fewer, known[:-1], with_scale=with_scale, tilt=tilt)
            assert all(row["used"] for row in aligned.residuals)
            assert aligned.notes


def test_a_wrong_point_is_named():
    wanted = square().moved(*turned(1.0, (10, 0, 0)))
    points = points_in(wanted, 6, np.random.default_rng(7), noise_px=1.0)
    sightings = len(points[2].pixels)
    assert sightings > 1
    coordinates = [*points[:2], KnownPoint("3", points[2].xyz + (0.0, 4.0, 0.0), points[2].pixels), *points[3:]]
    aligned = align_to_points(square(), coordinates)
    assert aligned.notes[0].startswith(f"point 3 has a residual of 4.0 m in all {sightings} cameras: check its coordinates")
    camera, (u, v) = next(iter(points[2].pixels.items()))
    clicked = [*points[:2], KnownPoint("3", points[2].xyz, {**points[2].pixels, camera: (u / 2, v)}), *points[3:]]
    aligned = align_to_points(square(), clicked)
    assert aligned.notes[0].startswith(f"point 3 in camera {camera} has a residual of")
    assert [row["used"] for row in aligned.residuals].count(False) == 1
    assert apart(aligned.rig, wanted) < 0.1


@pytest.mark.parametrize(("with_scale", "tilt"), [(False, False), (True, True)])
def test_left_handed_coordinates_are_named(with_scale, tilt):
    flipped = [KnownPoint(p.name, p.xyz * (1, -1, 1), p.pixels) for p in points_in(square(), 6, np.random.default_rng(8), 1.0)]
    with pytest.raises(InputError, match="left-handed"):
        align_to_points(square(), flipped, with_scale=with_scale, tilt=tilt)
    exchanged = [KnownPosition(known.camera, known.place[[1, 0, 2]]) for known in positions_in(square())]
    with pytest.raises(InputError, match="left-handed"):
        align_to_positions(square(), exchanged, with_scale=with_scale, tilt=tilt)


def test_too_little_is_reported():
    rig, rng = square(), np.random.default_rng(9)
    one = points_in(rig, 1, rng)
    with pytest.raises(EvidenceError, match="1 point cannot fix the heading: give 2 or more"):
        align_to_points(rig, one)
    with pytest.raises(EvidenceError, match="1 camera with a known position cannot fix the heading"):
        align_to_positions(rig, positions_in(rig)[:1])
    with pytest.raises(EvidenceError, match="2 points cannot fix the up direction: give 3 or more"):
        align_to_points(rig, points_in(rig, 2, rng), tilt=True)
    spot = [KnownPoint(name, one[0].xyz, one[0].pixels) for name in "ab"]
    with pytest.raises(EvidenceError, match="lie within 0 mm"):
        align_to_points(rig, spot)
    near = [KnownPosition(f"C{k}", np.array([0.1 * k, 0.0, 3.0]), 3.0) for k in (1, 2)]
    with pytest.raises(EvidenceError, match="fix no heading: give positions that are further apart"):
        align_to_positions(Rig(tuple(looking((0.1 * k, 0, 3), (0, 9, 0), name=f"C{k}") for k in (1, 2))), near)
    line = [KnownPoint(str(x), np.array([x, 0.0, 0.0]), {"C1": tuple(rig["C1"].project(np.array([x, 0.0, 0.0]))[0])}) for x in
            (-2.0, 0.0, 2.0, 3.0)]  # fmt: skip
    assert apart(align_to_points(rig, line).rig, rig) < 1e-6
    single = [KnownPoint(p.name, p.xyz, {"C1": p.pixels["C1"]}) for p in points_in(rig, 12, rng) if "C1" in p.pixels]
    assert apart(align_to_points(rig, single, with_scale=True).rig, rig) < 1e-6
    with pytest.raises(EvidenceError, match="fix no scale: give points that are further apart, in two cameras or more"):
        align_to_points(rig, single, with_scale=True, tilt=True)
    row = Rig(tuple(looking((4.0 * k, 0, 3), (4.0 * k, 9, 0), name=f"C{k}") for k in range(4)))
    with pytest.raises(EvidenceError, match="on one line"):
        align_to_positions(row, positions_in(row), tilt=True)


def test_cameras_without_a_pose_are_left_out_and_reported():
    whole = square()
    rig = Rig((*whole.cameras[:3], Camera("C4", LENS)))
    points = points_in(whole, 5, np.random.default_rng(10))
    aligned = align_to_points(rig, points)
    seen = sum("C4" in point.pixels for point in points)
    assert aligned.notes == (f"camera C4 has no pose: its {seen} points are left out",)
    assert align_to_positions(rig, positions_in(whole)).notes == ("camera C4 has no pose: its position is left out",)
    with pytest.raises(EvidenceError, match=r"\(camera C4 has no pose.*\): give 2"):
        align_to_points(rig, [KnownPoint("a", np.zeros(3), {"C4": (5.0, 5.0)})])
    with pytest.raises(InputError, match="no camera C9"):
        align_to_points(rig, [KnownPoint("a", np.zeros(3), {"C9": (5.0, 5.0)})])
    with pytest.raises(InputError, match="outside its 1280 x 720 image"):
        align_to_points(rig, [KnownPoint("a", np.zeros(3), {"C1": (1500.0, 5.0)})])


def test_positions_that_fit_poorly_are_reported_with_the_scale_that_would_fit():
    """Two that are apart by another length than in the rig may as well be wrong themselves."""
    wanted = square().moved(*turned(0.5, (1, 2, 0), 1.06))
    poor, scale = align_to_positions(square(), positions_in(wanted, sd=0.02)).diagnostics[:2]
    assert (poor.code, scale.code, scale.values["larger"]) == ("places_fit_poorly", "places_want_scale", True)
    assert poor.values["off_m"] == pytest.approx(0.7, abs=0.05)
    assert scale.values["percent"] == pytest.approx(6.0, abs=0.15)
    for count, told in ((2, False), (3, True)):
        aligned = align_to_positions(square(), [replace(one, sd_m=0.3) for one in positions_in(wanted)[:count]])
        percents = [one.values["percent"] for one in aligned.diagnostics if one.code == "places_want_scale"]
        assert percents == [pytest.approx(6.0, abs=0.1)] * told


@pytest.mark.parametrize("tilt", [False, True])
def test_a_rig_by_latitude_and_longitude(tilt):
    wanted = square().moved(*turned(0.4, (0, 0, 0)))
    metres = np.radians(1) * 6378137.0
    # On the equator east and north are the meridians and parallels, of nearly the same length.
    places = [KnownPosition(c.name, np.array([c.centre[1] / (metres * (1 - 0.00669437999)), 20 + c.centre[0] / metres,
                                              80 + c.centre[2]]), 0.01) for c in wanted]  # fmt: skip
    aligned = align_to_positions(square(), places, geodetic=True, tilt=tilt)
    assert apart(aligned.rig, wanted.moved(np.eye(3), -np.mean([c.centre for c in wanted], axis=0) * (1, 1, 0))) < 2e-3
    latitude, longitude, altitude = aligned.figures["geodetic_origin"]
    assert longitude == pytest.approx(20, abs=1e-5)
    assert latitude == pytest.approx(0, abs=1e-5)
    assert altitude == pytest.approx(80, abs=0.01)
    assert aligned.rig.metadata["geodetic_origin"].endswith(" 80.000")


def test_what_all_cameras_are_unsure_of_together_is_the_scale():
    """With the scale fitted, a position that is off by a metre stands out, though every sigma is about a metre."""
    rig = Rig((*square(), looking((0.0, 6.0, 3.0), name="C5"), looking((6.0, 0.0, 3.0), name="C6")))
    middle = np.mean([camera.centre for camera in rig], axis=0)
    unsure = Rig(tuple(
        replace(camera, sigma=PoseSigma(float(np.hypot(0.1 * np.linalg.norm(camera.centre - middle), 0.02)), 0.2))
        for camera in rig
    ))  # fmt: skip
    wanted = unsure.moved(*turned(0.3, (5.0, 6.0, 0.0), 1.08))
    known = positions_in(wanted)
    known[4] = KnownPosition("C5", known[4].place + (1.0, 0.0, 0.0), 0.01)
    aligned = align_to_positions(unsure, known, with_scale=True)
    assert aligned.notes[0].startswith("the position of camera C5 has a residual of 1.0 m")
    assert apart(aligned.rig, wanted) < 0.01
