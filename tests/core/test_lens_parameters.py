"""The numbers of an estimated lens in words: what determined each, and what was known before."""

from dataclasses import replace

import pytest

from passerby.core.lens_figures import (
    DistortionFigures,
    FocalFigures,
    LensFigures,
    PrincipalPointFigures,
    lens_parameters,
    names_in_words,
)

FOCAL = FocalFigures(
    stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True, prior_sigma_px=48.0,
    prior="stated", people_share=0.7,
)  # fmt: skip
POINT = PrincipalPointFigures(
    stated_px=(320.0, 240.0), refined_px=(321.0, 238.0), sigma_px=(6.0, 5.0), people_sigma_px=(50.0, None), far=False,
    told=False, prior_sigma_px=(6.4, 6.5), prior="assumed", people_share=(0.02, 0.3),
)  # fmt: skip
BENT = DistortionFigures(
    refined=-0.12, sigma=0.03, stated=0.0, prior_sigma=0.15, people_sigma=0.031, prior="assumed", people_share=0.95
)


def test_each_number_with_its_prior():
    numbers = lens_parameters(LensFigures(focal=FOCAL, principal_point=POINT, distortion=BENT))
    assert [(one.name, one.determined_by, one.by_prior) for one in numbers] == [
        ("focal length", "largely people", False), ("principal point x", "assumed", True),
        ("principal point y", "largely assumed", True), ("distortion k1", "people", False),
    ]  # fmt: skip
    assert [(one.prior_value, one.prior_sigma, one.people_sigma) for one in numbers] == [
        (480.0, 48.0, 12.0), (320.0, 6.4, 50.0), (240.0, 6.5, None), (0.0, 0.15, 0.031),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("share", "words"), [(0.9, "people"), (0.5, "largely people"), (0.49, "largely stated"), (0.09, "stated")]
)
def test_what_was_stated_is_not_called_assumed(share, words):
    (one,) = lens_parameters(LensFigures(focal=replace(FOCAL, people_share=share)))
    assert one.determined_by == words


def test_a_search_is_no_prior():
    """It rests on the same people: beside these stands what the scene states, and nothing where it states nothing."""
    searched = replace(FOCAL, prior="search", people_share=1.0)
    (one,) = lens_parameters(LensFigures(focal=searched))
    assert (one.determined_by, one.prior_value, one.prior_sigma, one.people_sigma) == ("people", None, None, None)
    (one,) = lens_parameters(LensFigures(focal=replace(searched, scene_px=520.0, scene_sigma_px=78.0)))
    assert (one.prior_value, one.prior_sigma, one.people_sigma) == (520.0, 78.0, 12.0)


def test_files_of_an_older_passerby_say_nothing_of_it():
    old = FocalFigures(stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True)
    (one,) = lens_parameters(LensFigures(focal=old))
    assert (one.estimate, one.determined_by, one.by_prior) == (500.0, None, False)
    assert lens_parameters(LensFigures(distortion=DistortionFigures(refined=0.1, sigma=0.02)))[0].determined_by is None


def test_the_two_of_a_principal_point_are_one_in_words():
    numbers = lens_parameters(LensFigures(focal=FOCAL, principal_point=POINT, distortion=BENT))
    assert names_in_words(numbers) == "focal length, principal point, k1"
    assert names_in_words(numbers[1:2]) == "principal point x"
    assert names_in_words([]) == ""
