"""Lenses that were never calibrated: what is stated of them, fields of view, the choice of focal lengths."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.data_sheet import DATA_SHEET_SD, focal_of_field, sd_of_field
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.lens_figures import (
    DistortionFigures,
    FocalFigures,
    LensFigures,
    PrincipalPointFigures,
    field_of_view_deg,
    lens_parameters,
    names_in_words,
)
from passerby.core.unknown_focals import begin_with, choose_focals, focals_to_try, needs_focal_search, shared_lenses

SIZE = (1280, 720)


def field_deg(lens, pixels):
    first, second = lens.bearings(np.array(pixels, dtype=float))
    return np.degrees(2 * np.arcsin(0.5 * np.linalg.norm(first - second)))


@pytest.mark.parametrize(("degrees", "fisheye"), [(2, False), (60, False), (150, False), (60, True), (150, True), (240, True)])
def test_the_image_shows_the_stated_field_of_view(degrees, fisheye):
    lens = Lens.unknown(SIZE, hfov_deg=degrees, fisheye=fisheye)
    centre = field_deg(lens, [(0, 360), (640, 360)]) + field_deg(lens, [(640, 360), (1280, 360)])
    assert centre == pytest.approx(degrees, rel=1e-6)
    assert field_of_view_deg(lens)[0] == pytest.approx(degrees, rel=1e-6)
    assert (lens.fisheye, lens.uncalibrated) == (fisheye, True)


def test_a_focal_length_in_pixels_is_known_well_and_a_wide_field_of_view_less_well():
    """An equidistant lens has the same field with a longer focal length: two sigmas of what is added at most."""
    lens = Lens.unknown(SIZE, focal_px=900.0, group="A")
    assert (lens.focal, lens.focal_sd, lens.group) == (pytest.approx(900.0), DATA_SHEET_SD, "A")
    assert Lens.unknown(SIZE, focal_px=900.0, focal_sd=0.03).focal_sd == 0.03
    assert Lens.unknown(SIZE).focal_sd == LARGEST_FOCAL_SD
    sds = [sd_of_field(degrees) for degrees in (2, 40, 90, 120, 150)]
    assert sds == sorted(sds)
    assert sds[0] == pytest.approx(DATA_SHEET_SD, abs=1e-3)
    apart = np.log(focal_of_field(90, 1280, fisheye=True) / focal_of_field(90, 1280))
    assert sd_of_field(90) == pytest.approx(np.hypot(DATA_SHEET_SD, apart / 2))
    assert sd_of_field(150) < LARGEST_FOCAL_SD
    assert sd_of_field(150, fisheye=True) == DATA_SHEET_SD


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"hfov_deg": 0.0}, "hfov_deg 0 is not the field of view of a pinhole lens: give 2 to 150"),
        ({"hfov_deg": float("nan")}, "hfov_deg nan"),
        ({"hfov_deg": 180.0}, "give 2 to 150 degrees, or up to 240 of a fisheye"),
        ({"hfov_deg": 300.0, "fisheye": True}, "hfov_deg 300 is not the field of view of a fisheye lens: give 2 to 240"),
        ({"focal_px": 0.0}, "a focal length of 0 px is none"),
        ({"focal_px": float("inf")}, "a focal length of inf px is none"),
        ({"focal_px": 2.8}, "a focal length of 2.8 px means 179 degrees over the 1280 px of a 1280 x 720 image"),
        ({"focal_px": 1e6}, "a pinhole lens sees 2 to 150: check the units"),
        # 130 degrees over the width of an upright image mean 150.6 over its height.
        ({"size": (1080, 1920), "hfov_deg": 130.0}, "151 degrees over the 1920 px of a 1080 x 1920 image"),
        ({"hfov_deg": 90.0, "focal_px": 640.0}, "state the focal length twice"),
        ({"focal_sd": 0.1}, "the sigma of a focal length that is not stated"),
        ({"hfov_deg": 90.0, "focal_sd": 0.6}, "focal_sd 0.6 is out of range"),
        ({"hfov_deg": 90.0, "focal_sd": 0.0}, "focal_sd 0 is out of range"),
    ],
)
def test_a_statement_that_no_lens_can_have_is_refused(arguments, what):
    with pytest.raises(InputError) as error:
        Lens.unknown(**{"size": SIZE, **arguments})
    assert what in str(error.value)


@pytest.mark.parametrize("size", [(0, 720), (1280, -1), (1280.5, 720), (1280,), (float("nan"), 720), ("a", "b"), 5])
def test_an_image_size_that_cannot_be_is_refused(size):
    with pytest.raises(InputError, match="is not an image size"):
        Lens.unknown(size)


def lens(focal, distortions=(), centre=(639.5, 359.5), fisheye=False):
    matrix = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return Lens((1280, 720), matrix, np.array(distortions), fisheye)


def test_the_field_of_view_of_a_lens_reaches_from_border_to_border():
    """Barrel distortion shows more; a fisheye more than half the world; a lens that turns over before the border has none."""
    degrees = np.degrees(np.arctan([640 / 800, 360 / 800]))
    assert field_of_view_deg(lens(800.0)) == pytest.approx(2 * degrees)
    across, _ = field_of_view_deg(lens(800.0, centre=(-100.0, 359.5)))
    assert across == pytest.approx(np.degrees(np.arctan(1379.5 / 800) - np.arctan(99.5 / 800)))
    assert field_of_view_deg(lens(800.0, (-0.2, 0, 0, 0)))[0] > field_of_view_deg(lens(800.0))[0] + 3
    assert field_of_view_deg(lens(640 / np.radians(100), fisheye=True)) == pytest.approx((200, 112.5))
    assert [one is None for one in field_of_view_deg(lens(560.0, (-0.3, 0, 0, 0)))] == [True, False]


FOCAL = FocalFigures(
    stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True, prior_sigma_px=48.0,
    prior="stated", people_share=0.7,
)  # fmt: skip


@pytest.mark.parametrize(
    ("share", "words", "by_prior"),
    [(0.9, "people", False), (0.5, "largely people", False), (0.49, "largely stated", True), (0.09, "stated", True)],
)
def test_what_was_stated_is_not_called_assumed(share, words, by_prior):
    (one,) = lens_parameters(LensFigures(focal=replace(FOCAL, people_share=share)))
    assert (one.determined_by, one.by_prior) == (words, by_prior)


def test_a_search_is_no_prior():
    """It rests on the same people: beside these stands what the scene states, and nothing where it states nothing."""
    searched = replace(FOCAL, prior="search", people_share=1.0)
    (one,) = lens_parameters(LensFigures(focal=searched))
    assert (one.determined_by, one.prior_value, one.prior_sigma, one.people_sigma) == ("people", None, None, None)
    (one,) = lens_parameters(LensFigures(focal=replace(searched, scene_px=520.0, scene_sigma_px=78.0)))
    assert (one.prior_value, one.prior_sigma, one.people_sigma) == (520.0, 78.0, 12.0)
    # A file of an older version does not state what determined its numbers.
    old = FocalFigures(stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True)
    bent = DistortionFigures(refined=0.1, sigma=0.02)
    (one, k1) = lens_parameters(LensFigures(focal=old, distortion=bent))
    assert (one.estimate, one.determined_by, one.by_prior, k1.determined_by) == (500.0, None, False, None)


def test_the_two_of_a_principal_point_are_one_in_words():
    point = PrincipalPointFigures(
        stated_px=(320.0, 240.0), refined_px=(321.0, 238.0), sigma_px=(6.0, 5.0), people_sigma_px=(50.0, None), far=False,
        told=False, prior_sigma_px=(6.4, 6.5), prior="assumed", people_share=(0.02, 0.3),
    )  # fmt: skip
    bent = DistortionFigures(refined=-0.12, sigma=0.03)
    numbers = lens_parameters(LensFigures(focal=FOCAL, principal_point=point, distortion=bent))
    assert names_in_words(numbers) == "focal length, principal point, k1"
    assert names_in_words(numbers[1:2]) == "principal point x"
    assert names_in_words([]) == ""


GRID = np.geomspace(0.5, 2.0, 5)


@pytest.mark.parametrize("seed", range(20))
def test_the_choice_is_the_best_of_all(seed):
    """Costs as grounds have them: least where both focal lengths are right, more the farther off they are."""
    rng = np.random.default_rng(seed)
    counts = [5, 5, 1, 5]
    right = [int(rng.integers(count)) for count in counts]
    costs = {}
    for a, b in itertools.combinations(range(4), 2):
        off_a, off_b = np.arange(counts[a]) - right[a], np.arange(counts[b]) - right[b]
        costs[a, b] = rng.uniform(5, 20) * np.log1p(off_a[:, None] ** 2 + off_b**2) + rng.uniform(0, 2, (counts[a], counts[b]))

    def total(chosen):
        return sum(table[chosen[a], chosen[b]] for (a, b), table in costs.items())

    best = min(itertools.product(*map(range, counts)), key=total)
    assert total(choose_focals(counts, costs)) == pytest.approx(total(best))
    # A camera without a pair takes any, and changes nothing.
    assert choose_focals([2, 3, 2], {(0, 2): np.array([[1.0, 5.0], [5.0, 0.0]])})[0::2] == [1, 1]
    assert choose_focals([], {}) == []


def test_only_what_may_be_is_tried():
    unknown, stated = Lens.unknown((1280, 720)), Lens.unknown((1280, 720), hfov_deg=90.0, focal_sd=0.2)
    np.testing.assert_allclose(np.exp(focals_to_try(unknown, GRID)) * unknown.focal, GRID * 1280)
    near = np.exp(focals_to_try(stated, GRID)) * stated.focal / 1280
    assert set(near.round(6)) == {round(share, 6) for share in GRID if abs(np.log(share / 0.5)) <= 0.5}
    for known in (Lens.unknown((1280, 720), hfov_deg=90.0, focal_sd=0.05), Lens((1280, 720), unknown.matrix, np.zeros(5))):
        assert focals_to_try(known, GRID).tolist() == [0.0]
    fisheye = Lens.unknown((1280, 720), fisheye=True)
    np.testing.assert_allclose(np.exp(focals_to_try(fisheye, GRID)) * fisheye.focal, 0.5 * GRID * 1280)


def test_the_next_estimate_begins_with_the_focal_length_alone():
    """The rest is found anew each time; a camera without a pose begins with the lens of its model, where it has one."""
    unknown, known = Lens.unknown((640, 480)), Lens((640, 480), np.diag([500.0, 500.0, 1.0]), np.zeros(5))
    stated = Rig((Camera("A", unknown), Camera("B", known), Camera("C", unknown)))
    matrix, pose = np.array([[700.0, 0, 333], [0, 700, 222], [0, 0, 1]]), Pose(np.eye(3), np.zeros(3))
    found = Lens((640, 480), matrix, np.array([-0.2, 0, 0, 0]), focal_sd=0.02)
    begun = begin_with(stated, Rig((Camera("A", found, pose), Camera("B", known, pose), Camera("C", unknown))))
    first = begun["A"].lens
    assert (first.focal, first.matrix[:2, 2].tolist(), first.uncalibrated) == (pytest.approx(700.0), [320.0, 240.0], True)
    assert not first.distortions.any()
    assert begun["B"].lens is known
    assert begun["C"].lens is unknown, "it has no pose"
    assert [needs_focal_search(rig) for rig in (stated, Rig(begun.cameras[:2]))] == [True, False]
    domes = Rig(tuple(Camera(name, Lens.unknown((640, 480), group="dome")) for name in "ABC"))
    posed = (Camera(name, domes[name].lens.with_focal(factor, 0.02), pose) for name, factor in (("A", 1.2), ("B", 1.25)))
    begun = begin_with(domes, Rig((*posed, domes["C"])))
    assert [camera.lens.focal for camera in begun] == pytest.approx([640 * np.sqrt(1.2 * 1.25)] * 3)


def test_cameras_of_one_model_choose_together():
    """Each on its own would take another: what all pairs like best decides, with those among themselves on equal terms."""
    own, of_model = Lens.unknown((640, 480)), Lens.unknown((640, 480), group="dome")
    known = replace(of_model, uncalibrated=False, focal_sd=None)
    rig = Rig(tuple(Camera(name, lens) for name, lens in zip("ABCDE", (of_model, own, of_model, known, own), strict=True)))
    assert shared_lenses(rig) == [[0, 2], [1], [3], [4]]
    among, beside = np.array([[4.0, 0.0], [9.0, 3.0]]), np.array([[0.0, 8.0], [2.0, 2.0]])
    chosen = choose_focals([2, 2, 2], {(0, 1): among, (0, 2): beside, (1, 2): beside}, [[0, 1], [2]])
    assert chosen[0] == chosen[1]

    def total(own, other):
        return among[own, own] + 2 * beside[own, other]

    assert total(chosen[0], chosen[2]) == min(total(own, other) for own, other in itertools.product(range(2), repeat=2))
