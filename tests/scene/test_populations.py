"""A stated population states heights; a stated height is stronger."""

import pytest
from pydantic import ValidationError

from passerby.core.stature import PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M
from passerby.scene.scale_tables import ScaleTable


def heights(**stated):
    table = ScaleTable.model_validate(stated)
    return table.person_height_m, table.person_height_sd_m, table.person_height_mean_sd_m


def test_children_are_smaller_and_mixed_people_differ_more():
    children, mixed, adults = (heights(population=name) for name in ("children", "mixed", "adults"))
    assert adults == heights() == (PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M, None)
    assert children[0] < mixed[0] < adults[0]
    assert mixed[1] > children[1] > adults[1]
    assert mixed[0] == pytest.approx((children[0] + adults[0]) / 2, abs=0.005)
    # Half of each: the spread between the two beside that within each of them.
    within, between = (children[1] ** 2 + adults[1] ** 2) / 2, ((adults[0] - children[0]) / 2) ** 2
    assert mixed[1] == pytest.approx((within + between) ** 0.5, abs=0.005)
    # Among children of one age the sd is 6 cm, between ages 9 cm.
    assert children[1] == pytest.approx((0.06**2 + 0.09**2) ** 0.5, abs=0.005)


def test_a_stated_height_overrides_the_population():
    assert heights(population="children", person_height_m=1.8) == (1.8, PERSON_HEIGHT_SD_M, None)
    assert heights(population="children", person_height_sd_m=0.05) == (1.32, 0.05, 0.10)


def test_another_population_is_an_error():
    with pytest.raises(ValidationError, match="'adults', 'children' or 'mixed'"):
        ScaleTable.model_validate({"population": "cats"})
