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
