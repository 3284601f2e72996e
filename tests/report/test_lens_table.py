"""The section on lenses: there where lenses were estimated, with what each number rests on."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Lens, Rig
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures, field_of_view_deg
from passerby.interchange.storage.text_formats import plain
from passerby.report.page import report_page
from support.report.drawings import contents, simulated
from support.report.pages import Page, with_figures

FOUND = Lens((720, 576), np.array([[500.0, 0, 361], [0, 500, 287], [0, 0, 1]]), np.array([-0.12, 0, 0, 0]))
PARTS = LensFigures(
    focal=FocalFigures(
        stated_px=480.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True, prior_sigma_px=48.0,
        prior="search", people_share=1.0,
    ),
    principal_point=PrincipalPointFigures(
        stated_px=(359.5, 287.5), refined_px=(361.0, 287.0), sigma_px=(6.0, 5.0), people_sigma_px=(50.0, None), far=False,
        told=False, prior_sigma_px=(7.2, 7.2), prior="assumed", people_share=(0.02, 0.0),
    ),
    distortion=DistortionFigures(
        refined=-0.12, sigma=0.03, stated=0.0, prior_sigma=0.15, people_sigma=0.031, prior="assumed", people_share=0.95
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def told():
    """Four cameras, the lenses of two of them estimated."""
    made = simulated(seconds=4.0)
    rig = Rig(tuple(replace(one, lens=FOUND) if one.name in ("C2", "C3") else one for one in made.rig))
    poor = replace(PARTS, focal=replace(PARTS.focal, sigma_px=40.0), group="yard")
    lenses = {"C2": plain(replace(PARTS, group="yard")), "C3": plain(poor)}
    return with_figures(contents(made, rig=rig), lenses=lenses)


@pytest.fixture(scope="module")
def page(told):
    return Page(report_page(told))


def test_there_is_a_row_for_each_lens_that_was_estimated(page):
    rows = page.rows("lenses-table")
    assert [row["Camera"] for row in rows] == ["C2", "C3"]
    across, down = field_of_view_deg(FOUND)
    row, keys = rows[0], ("Focal length px", "Principal point x, px", "Principal point y, px", "Distortion k1")
    assert [float(row[key]) for key in keys] == [500.0, 361.0, 287.0, -0.12]
    assert (float(row["Field of view ° across"]), float(row["Field of view ° down"])) == pytest.approx((across, down))
    assert (row["From people"], row["From the prior"]) == ("focal length, k1", "principal point")


def test_every_number_has_its_prior_and_the_share_of_people(page):
    rows = page.rows("lens-priors-table")
    assert len(rows) == 8
    names = "focal length, px", "principal point x, px", "principal point y, px", "distortion k1"
    assert tuple(row["Parameter"] for row in rows[:4]) == names
    keys = ("Estimate", "Std", "Prior", "Prior std", "Std by people alone", "From people %", "Determined by")
    assert [rows[0][key] for key in keys] == ["500.0", "10.0", "", "", "", "100.0", "people"]
    assert [rows[1][key] for key in keys] == ["361.0", "6.0", "359.5", "7.2", "50.0", "2.0", "assumed"]
    assert [rows[3][key] for key in keys] == ["-0.12", "0.03", "0.0", "0.15", "0.031", "95.0", "people"]


def test_what_rests_on_little_is_named_and_words_that_not_everybody_knows_are_explained(page):
    for said in ("the focal length of C3 is uncertain by more than 4 %", "± 8.0 %", "Grey: people barely determine",
                 "C2 and C3 have one lens", "Focal length", "Field of view", "Principal point", "Distortion k1", "Prior",
                 "bends straight lines"):  # fmt: skip
        assert said in page.sections["lenses"]


def test_it_is_not_there_where_no_lens_was_estimated(told):
    page = Page(report_page(with_figures(told, lenses={})))
    assert "lenses" not in page.sections
    assert not any(attributes.get("href") == "#lenses" for _, attributes in page.elements)


def test_what_was_not_refined_is_as_it_was_stated(told):
    page = Page(report_page(with_figures(told, lenses={"C2": plain(LensFigures(focal=replace(PARTS.focal, prior="stated")))})))
    (row,) = page.rows("lenses-table")
    assert (float(row["Principal point x, px"]), float(row["Distortion k1"])) == (361.0, -0.12)
    assert len(page.rows("lens-priors-table")) == 1
    assert "± 6" not in page.sections["lenses"]
