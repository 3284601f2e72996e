"""Ways over the ground from an output folder: what is needed besides, and what is refused."""

from dataclasses import replace

import pytest

from passerby.calibration.following import folder_clocks, track_options
from passerby.common.errors import InputError
from passerby.core.observations import Clock
from passerby.interchange.output_folder import OutputFolder, read_output
from support.scenes.output_folders import written_output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> OutputFolder:
    """Of a calibration that needed no frame rate."""
    return read_output(written_output(tmp_path_factory.mktemp("scene")))


def test_a_stated_rate_is_that_of_all_cameras_where_the_calibration_knows_none(folder: OutputFolder) -> None:
    for fps in (0.5, 1000.0):
        assert folder_clocks(folder, fps) == {"A": Clock(fps), "B": Clock(fps)}
    found = {"A": Clock(25.0), "B": Clock(12.5, 0.25)}
    assert folder_clocks(replace(folder, clocks=found), 30.0) == folder_clocks(replace(folder, clocks=found)) == found


def test_a_rate_that_no_camera_has_and_none_at_all_are_told(folder: OutputFolder) -> None:
    for fps in (0.0, -25.0, 1001.0, float("nan")):
        with pytest.raises(InputError, match="give frames per second, above 0 and at most 1000"):
            folder_clocks(folder, fps)
    with pytest.raises(InputError, match="the calibration has no frame rate"):
        folder_clocks(folder)


def test_how_people_are_followed_has_limits(folder: OutputFolder) -> None:
    for gap in (0.0, 2.5, 60.0):
        assert track_options(folder, max_gap=gap).max_gap_s == gap
    for gap in (-0.1, 60.5, float("nan")):
        with pytest.raises(InputError, match="give seconds from 0 to 60"):
            track_options(folder, max_gap=gap)
    with pytest.raises(InputError, match="choose one of"):
        track_options(folder, "by magic")
