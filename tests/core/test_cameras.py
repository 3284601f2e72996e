"""Lenses, poses and rigs: rays and pixels there and back, derivatives, and what cannot be a camera."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.geometry.rotations import exp_rotation
from support.scenes.people_and_rigs import looking_at

MATRIX = np.array([[820.0, 1.5, 650.0], [0.0, 810.0, 350.0], [0.0, 0.0, 1.0]])
SQUARE = np.array([[820.0, 0.0, 650.0], [0.0, 810.0, 350.0], [0.0, 0.0, 1.0]])
PINHOLES = {
    0: [],
    4: [-0.25, 0.08, 0.001, -0.0005],
    5: [-0.3, 0.12, -0.0008, 0.0006, -0.02],
    8: [-0.2, 0.05, 0.0005, 0.0004, -0.01, 0.05, -0.02, 0.003],
    12: [-0.2, 0.05, 0.0005, 0.0004, -0.01, 0.05, -0.02, 0.003, 1e-4, -2e-4, 1e-4, 2e-4],
    14: [-0.2, 0.05, 0.0005, 0.0004, -0.01, 0.05, -0.02, 0.003, 1e-4, -2e-4, 1e-4, 2e-4, 0.01, -0.02],
}
FISHEYE = [-0.02, 0.004, -0.001, 0.0002]
SIZE = (1280, 720)
SKEWED = np.array([[700.0, 3.0, 630.0], [0.0, 690.0, 350.0], [0.0, 0.0, 1.0]])
seeds = st.integers(0, 2**32 - 1)


def pinhole(coefficients: int) -> Lens:
    return Lens(SIZE, SQUARE, np.array(PINHOLES[coefficients]))


def fisheye(coefficients: int = 4, focal: float = 330.0) -> Lens:
    matrix = np.array([[focal, 0.8, 640.0], [0.0, focal * 1.01, 360.0], [0.0, 0.0, 1.0]])
    return Lens(SIZE, matrix, np.array(FISHEYE[:coefficients]), fisheye=True)


def directions(rng: np.random.Generator, count: int, largest: float) -> np.ndarray:
    """Unit rays up to `largest` radians off the axis."""
    theta, phi = rng.uniform(0, largest, count), rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


@settings(max_examples=15)
@given(seeds, st.sampled_from(sorted(PINHOLES)))
def test_pinhole_pixels_and_rays_lead_to_each_other(seed: int, coefficients: int) -> None:
    """OpenCV's own inversion stops half a pixel short at the border of such lenses."""
    lens, rng = pinhole(coefficients), np.random.default_rng(seed)
    pixels, rays = rng.uniform((0, 0), SIZE, (50, 2)), directions(rng, 50, 0.7)
    found = lens.bearings(pixels)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(lens.project_rays(found * 7.3), pixels, atol=1e-5)
    np.testing.assert_allclose(lens.bearings(lens.project_rays(rays)), rays, atol=1e-7)


@settings(max_examples=15)
@given(seeds, st.sampled_from([0, 4]))
def test_fisheye_rays_come_back_beyond_ninety_degrees_and_project_as_opencv_does_before(seed: int, coefficients: int) -> None:
    lens, rays = fisheye(coefficients), directions(np.random.default_rng(seed), 80, np.deg2rad(125))
    assert (rays[:, 2] < 0).any()
    pixels = lens.project_rays(3 * rays)
    assert np.isfinite(pixels).all()
    np.testing.assert_allclose(lens.bearings(pixels), rays, atol=1e-9)
    lens, rays = fisheye(), directions(np.random.default_rng(seed), 100, np.deg2rad(80))
    matrix = lens.matrix.copy()
    alpha, matrix[0, 1] = matrix[0, 1] / matrix[0, 0], 0.0
    expected, _ = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), matrix, lens.distortions, alpha=alpha)
    np.testing.assert_allclose(lens.project_rays(rays), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize(("lens", "point"), [(pinhole(5), (650, 350)), (fisheye(), (640, 360))])
def test_the_axis_itself_is_the_principal_point_and_no_points_are_no_pixels(lens: Lens, point: tuple[int, int]) -> None:
    np.testing.assert_allclose(lens.project_rays(np.array([[0.0, 0.0, 2.0]])), [point], atol=1e-9)
    np.testing.assert_allclose(lens.bearings(np.array([point])), [[0, 0, 1]], atol=1e-9)
    none = np.zeros((0, 3))
    assert (lens.project_rays(none).shape, lens.tangents(none).shape) == ((0, 2), (0, 2, 3))
    assert lens.bearings(np.zeros((0, 2))).shape == (0, 3)


def test_what_a_lens_does_not_show_is_nowhere() -> None:
    pixels = pinhole(5).project_rays(np.array([[0.1, 0.1, 1.0], [0.1, 0.1, -1.0], [1.0, 0.0, 0.0]]))
    assert np.isfinite(pixels).all(axis=1).tolist() == [True, False, False]
    # With strong barrel distortion the model folds back: no ray lands in the corner of a large picture.
    lens = Lens((4000, 3000), np.array([[800.0, 0, 2000], [0, 800.0, 1500], [0, 0, 1]]), np.array([-0.3, 0.0, 0.0, 0.0]))
    found = lens.bearings(np.array([[2100.0, 1500.0], [10.0, 10.0]]))
    assert np.isfinite(found).all(axis=1).tolist() == [True, False]


@pytest.mark.parametrize("lens", [*(pinhole(n) for n in PINHOLES), fisheye(0), fisheye(4), replace(pinhole(4), matrix=SKEWED)])
def test_tangents_and_derivatives_are_those_of_the_pixel(lens: Lens) -> None:
    rng, h = np.random.default_rng(3), 1e-5
    rays = directions(rng, 40, np.deg2rad(115) if lens.fisheye else 0.6)
    points = rays * rng.uniform(1, 9, (40, 1))
    tangents, (pixels, by_point, by_lens) = lens.tangents(rays), lens.derivatives(points)
    np.testing.assert_allclose(np.einsum("nki,ni->nk", tangents, rays), 0, atol=1e-6)
    np.testing.assert_allclose(pixels, lens.project_rays(points), atol=1e-8)
    for axis in np.eye(3):
        for at, found in ((rays, tangents), (points, by_point)):
            numerical = (lens.project_rays(at + h * axis) - lens.project_rays(at - h * axis)) / (2 * h)
            np.testing.assert_allclose(found @ axis, numerical, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(by_lens, lens.by_intrinsics(points), rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (0, 720)}, "image size"),
        ({"matrix": np.eye(2)}, "3 x 3"),
        ({"matrix": np.where(np.eye(3) > 0, np.nan, 0)}, "finite"),
        ({"matrix": np.diag([-800.0, 800, 1])}, "focal lengths above 0"),
        ({"matrix": np.diag([800.0, 800, 2])}, "last row"),
        ({"distortions": np.zeros(3)}, "distortions has 3 values; a pinhole lens takes 0, 4, 5, 8, 12, 14"),
        ({"distortions": np.array([0.1, np.inf, 0, 0])}, "finite"),
        ({"distortions": np.zeros(5), "fisheye": True}, "distortions has 5 values; a fisheye lens takes 0, 4"),
        ({"distortions": np.zeros((2, 2))}, r"distortions has the shape \(2, 2\): give one list of coefficients"),
    ],
)
def test_what_cannot_be_a_lens_is_refused(changes: dict[str, object], message: str) -> None:
    values = {"size": SIZE, "matrix": SQUARE, "distortions": np.zeros(5), **changes}
    with pytest.raises(InputError, match=message):
        Lens(**values)  # type: ignore[arg-type]


def test_values_cannot_be_changed_and_distortions_come_as_a_row_or_a_column_too() -> None:
    """As `cv2.calibrateCamera` and `cv2.FileStorage` return them."""
    given_array = np.zeros(3)
    lens, pose = pinhole(5), Pose(np.eye(3), given_array)
    for array in (lens.matrix, lens.distortions, pose.R_cw, pose.t_cw, pose.centre):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    given_array[0] = 5
    assert pose.t_cw[0] == 0
    for shape in ((1, 5), (5, 1)):
        np.testing.assert_array_equal(Lens(SIZE, SQUARE, lens.distortions.reshape(shape)).distortions, PINHOLES[5])


@given(seeds, st.floats(0.1, 10))
def test_a_moved_world_looks_the_same(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    rotation, translation = exp_rotation(rng.normal(size=3)), rng.normal(size=3) * 5
    camera = Camera("A", pinhole(5), looking_at((4.0, -3.0, 2.0), (0, 0, 1)))
    points = rng.uniform(-1, 1, (20, 3))
    rig = Rig((camera, Camera("B", pinhole(0)))).moved(rotation, translation, scale)
    np.testing.assert_allclose(rig["A"].project(scale * points @ rotation.T + translation), camera.project(points), atol=1e-7)
    np.testing.assert_allclose(rig["A"].centre, scale * rotation @ camera.centre + translation, atol=1e-9)
    assert rig["B"].pose is None


def test_a_rig_knows_its_cameras() -> None:
    posed = Camera("A", pinhole(0), Pose(np.eye(3), np.zeros(3)))
    rig = Rig((posed, Camera("B", pinhole(0))))
    assert (rig.names, len(rig), rig.posed().names) == (("A", "B"), 2, ("A",))
    with pytest.raises(KeyError, match="no camera C in this rig; it has A, B"):
        rig["C"]
    for read in (lambda: rig["B"].centre, lambda: rig["B"].P):
        with pytest.raises(InputError, match="camera B has no pose"):
            read()
    with pytest.raises(InputError, match="camera A occurs twice"):
        Rig((posed, posed))


def three_cameras() -> Rig:
    """A strong pinhole lens, a fisheye and one without distortion, around the origin."""
    centres = ((4.0, -3.0, 2.0), (-5.0, 1.0, 3.0), (1.0, 6.0, 2.5))
    lenses = pinhole(5), fisheye(), Lens(SIZE, MATRIX, np.zeros(0))
    return Rig(tuple(Camera(name, lens, looking_at(centre, (0, 0, 1)))
                     for name, lens, centre in zip("ABC", lenses, centres, strict=True)))  # fmt: skip


def test_a_rig_triangulates_what_its_cameras_project() -> None:
    rig, points = three_cameras(), np.random.default_rng(5).uniform(-1, 1, (20, 3)) + (0, 0, 1)
    pixels = {name: rig[name].project(points) for name in rig.names}
    np.testing.assert_allclose(rig.triangulate(pixels), points, atol=1e-6)
    np.testing.assert_allclose(rig.triangulate({name: pixels[name].tolist() for name in "CA"}), points, atol=1e-6)
    pixels["B"][3], pixels["C"][7:9] = np.nan, np.nan
    np.testing.assert_allclose(rig.triangulate(pixels), points, atol=1e-6)
    assert rig.triangulate({name: np.zeros((0, 2)) for name in "AB"}).shape == (0, 3)
    # With the projection matrix, the pixels are those that OpenCV undistorts; it stops after five rounds.
    camera = rig["A"]
    seen = cv2.undistortPoints(camera.project(points)[:, None], camera.K, camera.lens.distortions, P=camera.K)[:, 0]
    homogeneous = np.column_stack([points, np.ones(20)]) @ camera.P.T
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], seen, atol=0.1)


def test_a_camera_with_more_pixels_a_degree_counts_more() -> None:
    """Of rays that miss each other the point is nearer to the longer lens's, so that the errors in pixels are alike."""
    near, far = Lens(SIZE, SQUARE, np.zeros(0)), Lens(SIZE, np.diag([10.0, 10.0, 1.0]) @ SQUARE, np.zeros(0))
    cameras = (Camera("A", near, looking_at((8.0, 0, 0), (0, 0, 0))), Camera("B", far, looking_at((0, 8.0, 0), (0, 0, 0))))
    rig, point = Rig(cameras), np.zeros((1, 3))
    pixels = {camera.name: camera.project(point) + (0.0, 5.0) for camera in cameras}
    pixels["B"] -= (0.0, 10.0)
    found = rig.triangulate(pixels)
    misses = [np.linalg.norm(camera.project(found) - pixels[camera.name]) for camera in cameras]
    assert misses[1] < misses[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"X": [[1.0, 2.0]]}, "no camera X in this rig; it has A, B, C"),
        ({"B": [[1.0, 2.0], [3.0, 4.0]]}, r"pixels of camera B have the shape \(2, 2\): give \(1, 2\), a row per point"),
        ({"B": [1.0, 2.0]}, r"pixels of camera B have the shape \(2,\)"),
        ({"B": None}, "pixels of two cameras or more, not of 1"),
        ({"B": [[np.nan, 2.0]]}, "point 0 cannot be triangulated: 1 camera of the two or more that are needed see it"),
        ({"B": "mirrored"}, "point 0 cannot be triangulated: its rays meet behind a camera: leave it out"),
    ],
)
def test_triangulation_names_what_it_cannot_use(change: dict[str, object], message: str) -> None:
    rig = three_cameras()
    pixels = {name: rig[name].project(np.array([[0.3, 0.2, 1.0]])) for name in "AB"}
    if change.get("B") == "mirrored":  # the pixels of a point behind the other camera
        centre = rig["A"].centre
        change = {"B": rig["B"].project((centre + 3 * (centre - (0.3, 0.2, 1.0)))[None])}
    given_pixels = {name: values for name, values in (pixels | change).items() if values is not None}
    with pytest.raises(InputError, match=message):
        rig.triangulate(given_pixels)  # type: ignore[arg-type]


def test_parallel_rays_have_no_point() -> None:
    poses = looking_at((0.0, -3.0, 2.0), (0, 5, 2)), looking_at((1.0, -3.0, 2.0), (1, 5, 2))
    rig = Rig(tuple(Camera(name, pinhole(0), pose) for name, pose in zip("AB", poses, strict=True)))
    middle = np.array([[650.0, 350.0], [650.0, 350.0]])
    with pytest.raises(InputError, match=r"point 0 \(and 1 more\) cannot be triangulated: its rays are parallel"):
        rig.triangulate({"A": middle, "B": middle})
    with pytest.raises(InputError, match="camera B has no pose"):
        Rig((rig["A"], Camera("B", pinhole(0)))).triangulate({"A": middle, "B": middle})


def test_where_a_camera_looks():
    # Columns of R_cw.T are the camera's axes in the world: right, down, forward.
    def pose(heading, tilt, roll):
        h, t, r = np.radians([heading, tilt, roll])
        forward = np.array([np.cos(h) * np.cos(t), np.sin(h) * np.cos(t), -np.sin(t)])
        level = np.array([np.sin(h), -np.cos(h), 0.0])
        down = np.cross(forward, level)
        right = np.cos(r) * level + np.sin(r) * down
        return Pose(np.stack([right, np.cross(forward, right), forward]), np.zeros(3))

    for angles in ((0, 0, 0), (90, 30, 0), (-135, 10, 20), (179, -5, -60), (45, 80, 180)):
        appearance = pose(*angles)
        np.testing.assert_allclose((appearance.heading_deg, appearance.tilt_deg, appearance.roll_deg), angles, atol=1e-9)
    # A pixel right of the centre of a camera turned clockwise is seen lower in the world.
    camera = Camera("A", Lens((100, 100), np.diag([100.0, 100, 1]), np.zeros(0)), pose(0, 0, 20))
    assert camera.project(np.array([[10.0, 0.0, 1.0]]))[0, 0] < 0
    down = Pose(np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]), np.zeros(3))
    assert (down.heading_deg, down.tilt_deg, down.roll_deg) == (None, 90, None)


@pytest.mark.parametrize("distortions", [[], [-0.2, 0.05, 0.001, -0.002]])
@pytest.mark.parametrize("fisheye", [False, True])
def test_skew_is_part_of_every_lens(distortions, fisheye):
    coefficients = np.array(distortions) * (0.1 if fisheye else 1)
    straight = np.array([[500.0, 0, 310], [0, 480, 250], [0, 0, 1]])
    points = np.array([[0.2, -0.3, 1.5], [-0.4, 0.3, 2.0], [0.0, 0.0, 1.0]])
    lens = Lens((640, 480), straight + [[0, 7, 0], [0, 0, 0], [0, 0, 0]], coefficients, fisheye)
    without = Lens((640, 480), straight, coefficients, fisheye).project_rays(points)
    expected = without + np.column_stack([7 * (without[:, 1] - 250) / 480, np.zeros(3)])
    np.testing.assert_allclose(lens.project_rays(points), expected, atol=1e-9)
    np.testing.assert_allclose(lens.bearings(expected), points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-7)
