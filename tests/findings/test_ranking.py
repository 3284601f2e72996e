"""What is shown first: causes before what follows from them, the same of several cameras at once, three at most."""

from passerby.core.usability import doubt_missing_pose
from passerby.findings.finding import doubt, notice
from passerby.findings.ranking import MOST_SHOWN, describe_first_reasons, find_cause, reasons_of


def small(camera: str, width: int = 640) -> dict[str, object]:
    return {"camera": camera, "width": width}


MOVED = doubt("camera_moved", "C1", seconds=63.2, frame=317, metres=0.42, degrees=5.1, left_out="after", sigmas=20.0, shift=0.2)
FEW = doubt("few_observations", "C1", agreeing=12)
OTHER = doubt("few_observations", "C2", agreeing=9)
LENGTHS = doubt("rig_uncertain", what="scale", sigma=14.0, lacks=[], why=None)
ALL = doubt("lens_doubtful", why="implausible", focal={"change": 0.1})


def codes(*findings) -> list[list[tuple[str, tuple[str, ...]]]]:
    return [[(one.code, one.cameras) for one in reason.findings] for reason in reasons_of(findings)]


def test_what_follows_from_a_cause_about_the_same_camera_is_left_out() -> None:
    assert (codes(FEW, MOVED), find_cause(FEW, [FEW, MOVED])) == ([[("camera_moved", ("C1",))]], MOVED)
    assert codes(OTHER, MOVED) == [[("camera_moved", ("C1",))], [("few_observations", ("C2",))]]


def test_a_cause_about_all_explains_every_camera() -> None:
    assert codes(FEW, OTHER, ALL) == [[("lens_doubtful", ())]]


def test_notices_explain_nothing_and_are_no_reasons() -> None:
    said = notice("camera_moved", "C1", **MOVED.values)
    assert codes(FEW, said) == [[("few_observations", ("C1",))]]


def test_the_same_of_several_cameras_is_one_sentence() -> None:
    (reason,) = reasons_of([FEW, OTHER])
    assert reason.problem == "camera C1 has only 12 supporting observations (likewise camera C2)"
    unexplained = [doubt("camera_without_pose", name, why=None) for name in ("C1", "C3")]
    (reason,) = reasons_of(unexplained)
    assert reason.problem == "cameras C1 and C3 could not be registered"
    few = [doubt_missing_pose(notice("few_walkers", name)) for name in ("C4", "C5")]
    first, second = reasons_of([*unexplained, *few])
    assert (first, len(second.findings)) == (reason, 2)
    assert second.problem == "camera C4 saw too few people who walk for a second or longer (likewise camera C5)"


def test_a_first_screen_has_three_reasons_and_says_how_many_there_are() -> None:
    many = [LENGTHS, FEW, doubt("boxes_noisy", noise_percent=40.0),
            doubt("pairs_disagree"), doubt("reinitialisation_failed")]  # fmt: skip
    text = describe_first_reasons(many, "the report")
    assert text.count("; ") == MOST_SHOWN
    assert text.endswith("; and 2 more: see the report")
