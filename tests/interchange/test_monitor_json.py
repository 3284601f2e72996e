"""`monitor.json`: what is read of it, and what is no such file is told in one line with its key."""

import json

import pytest

from passerby.common.errors import InputError
from passerby.interchange.monitor_json import MONITOR_FILE, MonitoredCamera, read_monitor
from support.refusals import refused

LEAST = {
    "schema_version": 1, "from_s": 0.0, "until_s": 60.0, "window_s": 10.0, "threshold": 5.0,
    "cameras": [{"name": "A", "state": "steady"}, {"name": "B", "state": "moved", "fps": 25.0, "new_pose": True}],
}  # fmt: skip
MOVE = {"camera": "B", "or": ["C"], "noticed_s": 12.5, "shift_m": [0.1, None, 0.0], "metres": 0.1}


def read(folder, content):
    (folder / MONITOR_FILE).write_text(content if isinstance(content, str) else json.dumps(content))
    return read_monitor(folder)


def test_what_is_read(tmp_path):
    windows = [{"from_s": 0.0, "until_s": 10.0, "cameras": {"A": {"score": None, "told": True}}}]
    found = read(tmp_path, LEAST | {"moves": [MOVE], "windows": windows, "of a later Passerby": {"any": [1]}})
    assert found.entries["A"] == MonitoredCamera(name="A", state="steady")
    assert (found.entries["B"].fps, found.entries["B"].new_pose) == (25.0, True)
    (move,) = found.moves
    assert (move.camera, move.or_, move.noticed_s, move.shift_m) == ("B", ("C",), 12.5, (0.1, None, 0.0))
    assert found.windows[0].cameras["A"].told


def test_an_older_file_is_read(tmp_path):
    found = read(tmp_path, LEAST)
    assert (found.moves, found.windows, found.scene_file, found.judged_by) == ((), (), None, None)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", r"is not JSON \(.*\): monitor again"),
        ("[1, 2]", "it is not a table"),
        (LEAST | {"schema_version": 2}, "schema_version is 2, of a later Passerby"),
        ({key: value for key, value in LEAST.items() if key != "threshold"}, "it has no threshold"),
        (LEAST | {"cameras": [{"name": "A"}]}, r"it has no cameras\.0\.state"),
        (LEAST | {"cameras": [{"name": "A", "state": "gone"}]}, r"cameras\.0\.state is 'gone', which should be 'steady', "),
        (json.dumps(LEAST).replace("60.0", "NaN"), "until_s is nan"),
    ],
)
def test_what_is_wrong_is_told_with_key_and_remedy(tmp_path, content, told):
    with refused(told, tmp_path / MONITOR_FILE):
        read(tmp_path, content)


def test_a_folder_without_the_file_is_told(tmp_path):
    with pytest.raises(InputError, match=r"monitor\.json: no such file: name the folder that `passerby monitor RIG SCENE"):
        read_monitor(tmp_path)
