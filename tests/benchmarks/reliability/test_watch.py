"""The monitor's part of `make reliability`, a few cases of it."""

import pytest


@pytest.fixture(scope="module")
def part(bench):
    """The module."""
    return bench("reliability.watch")


def test_a_few_cases_and_their_page(part, monkeypatch):
    monkeypatch.setattr(part, "HOUR_S", 300.0)
    quiet = part.work(("quiet", 1, 13))
    assert quiet["alarms"] == 0
    assert quiet["minutes"] == 5
    # A degree and 10 cm, of cameras of a rig of four.
    knocks = [part.work(("knock", number, 13)) for number in (6, 7)]
    assert [one["turn"] for one in knocks] == [False, True]
    assert all(one["seen"] and one["among"] and not one["early"] for one in knocks)
    lines = part._lines([quiet], knocks)
    assert [line.seen[:7] for line in lines[:2]] == ["0 of 1 ", "2 of 2 "]
    text = f"{part._table(knocks, [])} {part._note([quiet])}"
    assert "| cheap, 1 degree" in text
    assert "nan" not in text
