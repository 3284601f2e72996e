"""The page of people's ways: one case from end to end, failures that count, data that are missing."""

from dataclasses import replace

from paper import tracking
from paper.tracking import CAMERAS, FAILED, Case, Outcome, RealOutcome, RealSet, outcome_of, run_set
from passerby.people.trajectories.trajectories import METHODS
from passerby.simulation import PRESETS

MEANS = {f"{method} {cameras}": 0.1 for method in METHODS for cameras in CAMERAS}
GOOD = Outcome("accepted", 0.02, MEANS, 0.99, 0.7, 0.2)
BAD = replace(GOOD, verdict="refused", scale_error=FAILED, mean_m=dict.fromkeys(MEANS, FAILED), covered=0.0)


def test_a_case_from_end_to_end():
    outcome = outcome_of(Case("terrace", 0, "given", tape=True))
    assert outcome.verdict == "accepted"
    assert outcome.mean_m["smoothed similarity"] < 0.1
    # With one length known the goal holds in metres too.
    assert outcome.mean_m["smoothed metric"] < 0.15
    assert outcome.mean_m["smoothed true"] < outcome.mean_m["pairwise true"]
    assert outcome.covered > 0.98
    assert 0.5 < outcome.sigma_share < 0.95


def test_a_failure_is_never_averaged_away():
    outcomes = {Case("terrace", seed, "given"): one for seed, one in enumerate((GOOD, BAD, GOOD))}
    row = next(line for line in str(tracking._table(outcomes, "given")).splitlines() if "smoothed" in line)
    assert "0.100 m (fails)" in row
    assert "1 of 3" in row
    goals = str(tracking._goals(outcomes))
    assert "**no**" in goals
    assert "fails" in goals
    assert "*not run*" in str(tracking._table(outcomes, "found"))


def test_sigmas_of_all_presets():
    outcomes = {Case(preset, 0, "given"): GOOD for preset in PRESETS}
    text = str(tracking._sigma_table(outcomes))
    assert text.count("70 to 70 %") == len(PRESETS)


def test_sets_that_are_not_at_hand_are_not_run():
    assert run_set(RealSet("pets2009", 7.0, None)) == RealOutcome("pets2009", "no data at hand")
    assert "*not run*: no data at hand" in str(tracking._real_table([RealOutcome("pets2009", "no data at hand")]))
