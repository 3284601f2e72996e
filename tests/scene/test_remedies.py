"""Every remedy that names a setting works as it stands, in a scene file that has the table and in one that has not.

The remedies are collected from the code and the examples of findings: `under [table] set key = value`, and `set key to ...`
where only the user knows the value. Each is followed literally, in the scene file that `passerby init` writes and in one of the
cameras alone.
"""

import ast
import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from passerby.calibration.calibrate import calibrate
from passerby.calibration.scene_solver import solver_options
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, Keypoints
from passerby.perception.plan import keypoints_to_be_had
from passerby.report.distances import Distance, _advice
from passerby.scene.camera_input import CameraInput
from passerby.scene.check import check_scene, find_too_short
from passerby.scene.scene import TABLES, Scene
from support.documentation import ROOT
from support.networks.model_server import BODY, entry, keep_to, know_only
from support.scenes.puppet_videos import film, puppets, scene_file, write_video
from support.scenes.puppet_videos import pictures as pictures_of

SOURCE = ROOT / "src" / "passerby"
VALUE = r'(?:\[[^\]]*\]|"[^"]*"|true|false|\d+(?:\.\d+)?|\{\})'
REMEDY = re.compile(rf"under \[([\w.{{}}]+)\] set ((?:[a-z_]+ = {VALUE}(?:,? (?:and|or) |[^.;:]*?, or )?)+)")
SETTING = re.compile(rf"([a-z_]+) = ({VALUE})")
LEFT_OPEN = re.compile(r"under \[([\w.{}]+)\] set ([a-z_]+) to")
EXAMPLES = {"boxes": "corners", "rotate": "90"}
"""Keys with a choice of values: one of them, where the text has the one that fits."""
BARE = '[cameras.C1]\nintrinsics = "rig.toml"\nvideo = "C1.mp4"\n\n[cameras.C2]\nintrinsics = "rig.toml"\nvideo = "C2.mp4"\n'


@cache
def texts() -> tuple[tuple[str, str], ...]:
    """(place, text) of all strings of the code, `{}` in place of values, and of the examples of findings; no docstrings."""
    return tuple(_texts())


def _texts() -> Iterator[tuple[str, str]]:
    examples = Path(__file__).parents[1] / "findings" / "finding_texts.json"
    yield from ((row["code"], row["text"]) for row in json.loads(examples.read_text(encoding="utf-8")))
    for path in sorted(SOURCE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "under" not in source or "set " not in source:  # it has no remedy: to parse all the code would take seconds
            continue
        nodes = list(ast.walk(ast.parse(source)))
        docstrings = {node.value for node in nodes if isinstance(node, ast.Expr)}
        skipped = docstrings | {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in nodes:
            if not isinstance(node, ast.JoinedStr | ast.Constant):
                continue
            place = f"{path.relative_to(SOURCE)}:{node.lineno}"
            if isinstance(node, ast.JoinedStr):
                yield place, "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
            elif isinstance(node.value, str) and node not in skipped:
                yield place, re.sub(r"\{\w+[^{}]*\}", "{}", node.value)


def remedies() -> list[tuple[str, tuple[str, ...]]]:
    """(table, lines to write there), each once; lines that stand for a choice are remedies of their own."""
    found = {}
    for _, text in texts():
        for table, told in REMEDY.findall(text):
            lines = [
                f"{key} = {value if value != '{}' else EXAMPLES.get(key, '7')}".replace("{}", EXAMPLES.get(key, "C1"))
                for key, value in SETTING.findall(told)
            ]
            choices = [(line,) for line in lines] if " or " in told else [tuple(lines)]
            found |= dict.fromkeys((table.replace("{}", "C1"), choice) for choice in choices)
    return sorted(found)


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene file as `passerby init` writes it."""
    folder = tmp_path_factory.mktemp("started")
    made = puppets(1.0, 5.0, 2, 2)
    for name in ("C1", "C2"):
        write_video(folder / f"{name}.mp4", pictures_of(made, name), made.fps)
    assert run(["init", str(folder)]) == 0
    return folder / "scene.toml"


def followed(text: str, table: str, lines: tuple[str, ...]) -> str:
    """The file after somebody did what the remedy says: the lines stand in the table, in place of those of the same keys."""
    rows, header = text.splitlines(), f"[{table}]"
    if f"#{header}" in rows:
        rows[rows.index(f"#{header}")] = header
    if header not in rows:
        rows += ["", header]
    begin = rows.index(header) + 1
    end = next((k for k in range(begin, len(rows)) if re.match(r"#?\[", rows[k])), len(rows))
    keys = "|".join(line.split(" = ")[0] for line in lines)
    kept = [row for row in rows[begin:end] if not re.match(rf"#?(?:{keys}) =", row)]
    return "\n".join([*rows[:begin], *lines, *kept, *rows[end:]]) + "\n"


def test_remedies_are_found_and_keys_whose_value_only_the_user_knows_are_keys() -> None:
    found = remedies()
    expected = [("association", "max_offset_s = 7"), ("solver", 'refine = ["clock_rate"]'), ("cameras.C1", "until_s = 7"),
                ("cameras.C1", "from_s = 7")]  # fmt: skip
    assert {*((table, (line,)) for table, line in expected), ("world", ('points = "points.csv"', "tilt = true"))} <= {*found}
    assert len(found) >= 10
    left_open = {pair for _, text in texts() for pair in LEFT_OPEN.findall(text)}
    assert ("association", "max_offset_s") in left_open
    for table, key in left_open:
        assert key in TABLES[tuple(table.replace("{}", "*").split("."))].model_fields, (table, key)


@pytest.mark.parametrize("bare", [False, True])
@pytest.mark.parametrize(("table", "lines"), remedies())
def test_a_remedy_works_as_it_stands(started: Path, tmp_path: Path, table: str, lines: tuple[str, ...], bare: bool) -> None:
    path = tmp_path / "scene.toml"
    text = BARE if bare else started.read_text(encoding="utf-8")
    if lines == ('mode = "given"',):  # goes with identities in files
        text = text.replace("video = ", "tracks = " if bare else "image_size = [640, 480]\ntracks = ")
    path.write_text(followed(text, table, lines), encoding="utf-8")
    scene = Scene.load(path)
    solver_options(scene)
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    for part in table.split("."):
        content = content[part]
    for line in lines:
        ((key, value),) = tomllib.loads(line).items()
        assert content[key] == value


def test_the_generated_scene_has_every_table_and_every_key(started: Path, tmp_path: Path) -> None:
    """Once each: what a remedy names is there to be edited. Tables that need values of the user's own are examples."""
    text = started.read_text(encoding="utf-8")
    for table in ("scene", "perception", "association", "solver", "scale", "solver.options", "world"):
        assert len(re.findall(rf"(?m)^#?\[{re.escape(table)}\]", text)) == 1, table
    for table in ("association", "solver", "perception", "scale"):
        own = text.split(f"\n[{table}]\n")[1].split("\n[")[0]
        for key, field in TABLES[(table,)].model_fields.items():
            if "Table" not in str(field.annotation) and key != "options":
                assert len(re.findall(rf"(?m)^#?{key} = ", own)) == 1, (table, key)
    lines = _advice([Distance("C1", "C2", 8.0, 0.1)])  # a measured distance can be appended
    for own in (BARE, text):
        (tmp_path / "scene.toml").write_text(f"{own}\n{lines}\n", encoding="utf-8")
        assert Scene.load(tmp_path / "scene.toml").scale.distances[0].metres == 8.0


@pytest.mark.parametrize(
    ("added", "told"),
    [
        ("[association]\nmax_offset_s = 1\n[scale]\n[ association ]  # again\nmode = 'given'\n",
         "[association] occurs twice, in lines 8 and 11: merge the two into one"),
        ("[cameras.C1]\nfps = 3\n", "[cameras.C1] occurs twice, in lines 1 and 8: merge the two into one"),
        ("[association]\nmax_offset_s = 1\n# max_offset_s = 2\nmax_offset_s = 3\n",
         "[association] max_offset_s occurs twice, in lines 9 and 11: keep one of them"),
        ("[scale]\n[[scale.distances]]\nmetres = 1\n[[scale.distances]]\nmetres = 2\n[scale]\n",
         "[scale] occurs twice, in lines 8 and 13"),
        *((wrong, "is not TOML: ") for wrong in ("[association\n", "refine = [\n", "[scale]\nlengths = [\n[1, 2],\n[1, 2],\n")),
    ],
)  # fmt: skip
def test_a_table_that_stands_twice(tmp_path: Path, added: str, told: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f"{BARE}{added}", encoding="utf-8")
    with pytest.raises(InputError) as error:
        Scene.load(path)
    assert str(error.value).startswith(f"{path}: {told}")


@pytest.fixture
def brief(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene of two videos of 1.7 s; a network for joints is known, and is not on this computer."""
    keep_to(tmp_path, monkeypatch)
    know_only([entry("joints", "keypoints"), entry("small-joints", "keypoints", bytes=len(BODY) - 1)], monkeypatch)
    monkeypatch.setattr("passerby.perception.plan.catalogue", lambda: (entry("joints", "keypoints"),))
    made = puppets(1.7, 10.0, 2, 5)
    film(made, tmp_path)
    return scene_file(tmp_path, {"C1": "C1.mp4", "C2": "C2.mp4"}, extra="[scene]")


def put_model(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "networks").mkdir()
    (folder / "networks" / "joints.onnx").write_bytes(BODY)
    monkeypatch.setenv("PASSERBY_MODELS", str(folder / "networks"))


def test_check_reports_videos_that_are_too_short(brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report = check_scene(brief)
    assert report.exit_status == 3
    assert report.lacks == (
        f"{brief}: the recordings of cameras C1 (1.7 s), C2 (1.7 s) are too short to register cameras by how people walk, "
        "which takes more than 2 s: record longer",
    )
    put_model(tmp_path, monkeypatch)
    (lack,) = check_scene(brief).lacks
    assert lack.endswith(': record longer, or use keypoints: under [perception] set keypoints = "joints"')
    text = brief.read_text(encoding="utf-8")
    for added in ("\n[association]\nmode = 'appearance'\n", "fps = 5\n"):  # the same pictures, 3.4 s
        brief.write_text(f"{text}{added}", encoding="utf-8")
        assert check_scene(brief).lacks == ()


def test_joints_of_one_camera_make_no_recording_long_enough(brief: Path) -> None:
    scene = Scene.load(brief)
    boxes = Boxes(np.arange(1, 13), np.zeros(12), np.full((12, 4), 30.0), np.ones(12))
    joints = Keypoints(np.ones(1), np.zeros(1), np.full((1, 1, 2), 40.0), np.ones((1, 1)), ("nose",))
    alone = [CameraInput(name, False, boxes=boxes, fps=10.0) for name in scene.cameras]
    both = [replace(reading, keypoints=joints) for reading in alone]
    assert [bool(find_too_short(scene, some)) for some in (alone, [both[0], alone[1]], both)] == [True, True, False]


def test_joints_that_an_address_serves_can_be_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep_to(tmp_path, monkeypatch)
    known = entry("absent", "keypoints"), entry("served", "keypoints", url="http://127.0.0.1:9/served.onnx", default=True)
    know_only([*known], monkeypatch)
    monkeypatch.setattr("passerby.perception.plan.catalogue", lambda: known)
    assert keypoints_to_be_had(None) == "served"
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    assert keypoints_to_be_had(None) is None


@pytest.mark.system
def test_a_refusal_names_the_joints_that_can_be_had(brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = calibrate(brief)
    assert refused.verdict == "refused"
    assert not [reason for reason in refused.reasons if "keypoints" in reason or "larger clock offsets" in reason]
    put_model(tmp_path, monkeypatch)
    reasons = calibrate(brief).reasons
    assert reasons[:-1] == refused.reasons
    assert reasons[-1].endswith(': under [perception] set keypoints = "joints"')
