"""Files of others run nothing, open nothing else, promise nothing that is believed, and are not shown at length."""

import ast
import os
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import passerby
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.formats import read_rig_as
from passerby.interchange.formats.tsai import read_tsai
from passerby.interchange.motchallenge import read_boxes, read_embeddings
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.perception.networks import read_own_network
from passerby.perception.video import probe
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from support.paths import TESTS
from support.untrusted import example_files as example
from support.untrusted.bombs import bombs

PACKAGE = Path(passerby.__file__).parent
SECRET = "the-secret-of-another-file"


class Trap:
    """What unpickling it does: it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.slow
def test_small_files_that_stand_for_much_are_refused_in_little_memory(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "support.untrusted.bombs", str(tmp_path)],
        capture_output=True, text=True, timeout=1800, check=False,
        cwd=TESTS, env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1"},
    )  # fmt: skip
    lines = [line.split("\t") for line in done.stdout.splitlines()]
    assert done.returncode == 0, (lines[-1:], done.stderr[-2000:])
    assert len(lines) == sum(1 for _ in bombs())
    assert not [line for line in lines if line[-1] not in ("refused", "read")]
    assert sum(line[-1] == "refused" for line in lines) > 0.9 * len(lines)


FORBIDDEN_MODULES = {"pickle", "marshal", "shelve", "dill", "joblib", "cloudpickle"}
FORBIDDEN_CALLS = ("eval", "exec", "os.system", "os.popen", "yaml.load", "yaml.unsafe_load", "yaml.full_load")
PARSERS = ("yaml.load_all", "ElementTree.fromstring", "ElementTree.parse", "tomllib.loads", "cv2.FileStorage")
PARSING = ("interchange/storage/safe_parsing.py", "perception/networks.py", "interchange/formats/opencv_yaml.py")


@pytest.mark.parametrize("module", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nothing_in_the_source_runs_what_a_file_says(module):
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            assert not FORBIDDEN_MODULES & {name.split(".")[0] for name in names}
        if isinstance(node, ast.Call):
            name, given = ast.unparse(node.func), {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            assert name not in FORBIDDEN_CALLS
            assert given.get("shell", "False") == "False", name
            assert name != "np.load" or given.get("allow_pickle") == "False"
            assert name != "torch.load" or given.get("weights_only") == "True"
            own = module.relative_to(PACKAGE).as_posix() in PARSING
            assert own or name not in PARSERS, f"{name}: use interchange.storage.safe_parsing"


def test_pickled_objects_run_nothing(tmp_path):
    trap = tmp_path / "sprung"
    np.savez(tmp_path / "a.npz", embeddings=np.array([[Trap(trap)]], dtype=object))
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Trap(trap)))
    with zipfile.ZipFile(tmp_path / "c.npz", "w") as file:
        file.writestr("embeddings.npy", pickle.dumps(Trap(trap)))
    for name in "abc":
        with pytest.raises(InputError, match=f"{name}.npz"):
            read_embeddings(tmp_path / f"{name}.npz")
    for protocol in range(6):
        path = tmp_path / "cam.pickle"
        path.write_bytes(pickle.dumps(example.OPENCAP | {"rotation": Trap(trap)}, protocol))
        with pytest.raises(InputError, match=r"cam.pickle: the file: is not a calibration of OpenCap: it asks for posix.mkdir"):
            read_rig_as("opencap", path)
    assert not trap.exists()


@pytest.mark.slow
def test_checkpoints_run_nothing(tmp_path):
    torch = pytest.importorskip("torch")
    from passerby.training.checkpoints import load_checkpoint

    trap = tmp_path / "sprung"
    torch.save({"format": "passerby", "options": Trap(trap)}, tmp_path / "checkpoint.pt")
    with pytest.raises(InputError, match=r"checkpoint\.pt: is not a checkpoint"):
        load_checkpoint(tmp_path / "checkpoint.pt")
    assert not trap.exists()


@pytest.mark.parametrize("tag", ["!!python/object/apply:os.mkdir", "!!python/object/new:os.mkdir", "!!python/name:os.mkdir"])
@pytest.mark.parametrize("name", ["kalibr", "ros", "mv3dt", "easymocap", "opencv"])
def test_yaml_runs_nothing(name, tag, tmp_path):
    (tmp_path / "intri.yml").write_text(f"K: {tag} ['{tmp_path}/sprung']\n")
    with pytest.raises(InputError, match=r"intri.yml"):
        read_rig_as(name, tmp_path / "intri.yml")
    assert not (tmp_path / "sprung").exists()


def test_xml_opens_no_other_file(tmp_path):
    (tmp_path / "secret").write_text(SECRET)
    for kind in (f'SYSTEM "file://{tmp_path}/secret"', f'SYSTEM "{tmp_path}/secret"', f'PUBLIC "a" "{tmp_path}/secret"'):
        (tmp_path / "a.xml").write_text(f"<!DOCTYPE a [<!ENTITY b {kind}>]><Camera><Geometry width='&b;'/>&b;</Camera>")
        with pytest.raises(InputError, match="it declares entities") as error:
            read_tsai(tmp_path / "a.xml")
        assert SECRET not in str(error.value)


def test_a_network_opens_no_file_outside_its_folder(tmp_path):
    import onnx
    from onnx.external_data_helper import set_external_data

    (tmp_path / "secret").write_bytes(np.eye(3, 4, dtype=np.float32).tobytes())
    (tmp_path / "inner").mkdir()
    for place in ("../secret", str(tmp_path / "secret")):
        model = onnx.load_from_string(example.bare_network())
        set_external_data(model.graph.initializer[0], place)
        model.graph.initializer[0].ClearField("raw_data")
        model.graph.initializer[0].data_location = onnx.TensorProto.EXTERNAL
        path = tmp_path / "inner" / "net.onnx"
        path.write_bytes(model.SerializeToString())
        with pytest.raises(InputError, match=r"net\.onnx"):
            read_own_network(path, "embedder", "0" * 64)


@pytest.fixture
def film(tmp_path):
    (tmp_path / "film.mp4").write_bytes(example.video(".mp4")["film.mp4"])
    return tmp_path


@pytest.mark.parametrize(("name", "text"), [
    ("list.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfilm.mp4\n#EXT-X-ENDLIST\n"),
    ("list.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:9/film.ts\n#EXT-X-ENDLIST\n"),
    ("list.mp4", "ffconcat version 1.0\nfile film.mp4\n"),
    ("list.txt", "ffconcat version 1.0\nfile '/etc/passwd'\n"),
    ("list.sdp", "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n"),
    ("list.mpd", '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011"><Period/></MPD>'),
])  # fmt: skip
def test_a_video_is_one_file_and_no_list_of_others(film, name, text):
    assert probe(film / "film.mp4").size == (64, 48)
    (film / name).write_text(text)
    with pytest.raises(InputError, match="is not a video"):
        probe(film / name)
    os.mkfifo(film / "fifo")
    for path in (film / "fifo", Path("/dev/zero")):
        with pytest.raises(InputError, match="is a pipe or a device: name a video file"):
            probe(path)


@pytest.mark.parametrize(
    "name", ["concat:film.mp4|film.mp4", "http://127.0.0.1:9/a.mp4", "rtsp://127.0.0.1:9/a", "file:film.mp4", "pipe:0", "lavfi"]
)
def test_a_videos_name_is_no_address(film, name, monkeypatch):
    monkeypatch.chdir(film)
    with pytest.raises(InputError, match="no such file"):
        probe(name)


FILES = {"tracks": "A.txt", "keypoints": "A.json", "embeddings": "A.npz"}


def scene(folder: Path, old: str = "", new: str = "") -> Path:
    for name, content in example.scene_folder().items():
        (folder / name).write_bytes(content)
    text = example.SCENE.partition("[solver]")[0]
    assert old in text
    (folder / "scene.toml").write_text(text.replace(old, new))
    return folder / "scene.toml"


@pytest.mark.parametrize("key", FILES)
@pytest.mark.parametrize("kind", ["fifo", "zero", "stdin", "folder", "loop", "passwd", "nothing", "zero byte", "long"])
def test_a_scene_names_files_and_nothing_else(tmp_path, key, kind):
    """Nothing hangs, and what is in a file that is of another kind is not shown."""
    (tmp_path / "passwd").write_text(f"root:x:0:0:{SECRET}:/root:/bin/sh\n" * 30)
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "folder").mkdir()
    named = {
        "zero": "/dev/zero", "stdin": "/dev/stdin", "zero byte": "a\\u0000b", "long": "a" * 5000, "nothing": "../../nothing",
    }.get(kind, str(tmp_path / kind))  # fmt: skip
    path = scene(tmp_path, f'{key} = "{FILES[key]}"', f'{key} = "{named}"')
    with pytest.raises(InputError) as error:
        read_inputs(Scene.load(path))
    assert SECRET not in str(error.value)
    assert len(str(error.value)) < 700 + 3 * len(str(tmp_path))


@pytest.mark.parametrize("name", [
    "../../x", "a/b", "..", ".", "con", "NUL", "com1.txt", "a" * 200, "", "a\\\\b", "/etc/x", "a\\u0000", "\\u001b[31m",
])  # fmt: skip
def test_cameras_are_not_called_like_other_places(tmp_path, name):
    path = scene(tmp_path, "[cameras.B]", f'[cameras."{name}"]')
    with pytest.raises(InputError, match=r"cannot be a (camera's|file's) name"):
        Scene.load(path)


HOSTILE = ("../../x", "</cameras><x>&y;", '"]\n[metadata]\nunits = "mm', "a: !!python/name:os.system", "$(id);`id`", "--help")


def test_names_stay_text_in_a_rig_file(tmp_path):
    rig = Rig(tuple(type(camera)(name, camera.lens, camera.pose) for name in HOSTILE for camera in [example.rig()["B"]]))
    write_rig(tmp_path / "rig.toml", rig)
    assert read_rig(tmp_path / "rig.toml").names == HOSTILE


def test_an_errors_text_is_not_another_files(tmp_path):
    (tmp_path / "a.txt").write_text("\n".join(f"{SECRET} {n} {'x' * 4000}" for n in range(100)))
    with pytest.raises(InputError) as error:
        read_boxes(tmp_path / "a.txt")
    assert str(error.value).count(SECRET) == 0
