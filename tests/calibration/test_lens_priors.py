"""The origin of priors: stated by the scene, searched for among people, or assumed."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.lens_priors import with_lens_priors
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures

FOCAL = FocalFigures(
    stated_px=700.0, refined_px=710.0, sigma_px=20.0, people_sigma_px=40.0, far=False, told=True, prior_sigma_px=70.0,
    people_share=0.25,
)  # fmt: skip
POINT = PrincipalPointFigures(
    stated_px=(320.0, 240.0),
    refined_px=(321.0, 240.0),
    sigma_px=(6.0, 6.0),
    people_sigma_px=(50.0, None),
    far=False,
    told=False,
)
FIGURES = {"A": LensFigures(focal=FOCAL, principal_point=POINT, distortion=DistortionFigures(refined=-0.1, sigma=0.05))}


def of(lens):
    return with_lens_priors(FIGURES, Rig((Camera("A", lens),)))["A"]


def test_a_focal_length_that_nobody_stated_rests_on_people_alone():
    parts = of(Lens.unknown((640, 480), group="yard"))
    assert (parts.focal.prior, parts.focal.people_share, parts.focal.scene_px) == ("search", 1.0, None)
    assert (parts.principal_point.prior, parts.distortion.prior, parts.group) == ("assumed", "assumed", "yard")


def test_a_data_sheet_is_weighed_against_people_whatever_the_search_said():
    lens = Lens.unknown((640, 480), hfov_deg=60.0)
    assert 0.1 < lens.focal_sd < LARGEST_FOCAL_SD
    focal = of(lens).focal
    sd = lens.focal_sd * lens.focal
    assert (focal.prior, focal.scene_px, focal.scene_sigma_px) == ("search", lens.focal, pytest.approx(sd))
    assert focal.people_share == pytest.approx(sd**2 / (sd**2 + 40.0**2))


def test_what_is_known_well_enough_is_its_own_prior():
    parts = of(Lens.unknown((640, 480), hfov_deg=60.0, focal_sd=0.05))
    assert (parts.focal.prior, parts.focal.people_share, parts.focal.scene_px) == ("stated", 0.25, None)
    assert parts.principal_point.prior == "assumed"


def test_refined_intrinsics_are_stated():
    known = Lens((640, 480), np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]]), np.zeros(5))
    for lens in (known, replace(known, focal_sd=0.2)):
        parts = of(lens)
        assert {parts.focal.prior, parts.principal_point.prior, parts.distortion.prior} == {"stated"}
        assert parts.focal.people_share == 0.25
