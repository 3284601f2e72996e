"""Network files: which file a name means, where it is looked for, what a user's own file wants, and whether it opens."""

import hashlib
import io
import os
import re
from contextlib import nullcontext
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from passerby.common.errors import InputError
from passerby.perception.fetching import sha256_of
from passerby.perception.model_files import cache_folder, find_model, model_folders
from passerby.perception.networks import InputConvention, catalogue, default_of
from passerby.perception.sessions import inputs_of, open_session, outputs_of, provider_of
from support.networks.crop_networks import port, saved
from support.networks.model_server import BODY, SHA256, entry, keep_to, know_only, serving
from support.paths import MODELS
from support.refusals import refused


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    return keep_to(tmp_path, monkeypatch)


@pytest.fixture
def server(cache, monkeypatch):
    with serving(monkeypatch) as server:
        second, looks = entry("other", url=server.url, default=False), entry("looks", "embedder", url=server.url)
        know_only([entry("tiny", url=server.url), second, looks, entry("joints", "keypoints")], monkeypatch)
        yield server


def put(folder, name="tiny.onnx", body=BODY):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(body)
    return folder / name


def test_the_manifest_is_complete():
    entries = catalogue()
    for key in ("name", "file", "sha256"):
        assert len({getattr(item, key) for item in entries}) == len(entries)
    pinned = re.compile(r"https://raw\.githubusercontent\.com/[\w.-]+/[\w.-]+/[0-9a-f]{40}/[\w./-]+\.onnx")
    dated = re.compile(r"https://download\.openmmlab\.com/[\w./-]+-[0-9a-f]{8}_20[0-9]{6}\.zip")
    for item in entries:
        assert re.fullmatch(r"[a-z0-9-]+", item.name)
        assert re.fullmatch(r"[0-9a-f]{64}", item.sha256)
        assert re.fullmatch(r"[\w-]+\.onnx", item.file)
        assert item.url is None or (dated if item.archive else pinned).fullmatch(item.url)
        assert (item.url is None, item.licence) == ("has no download address" in item.note, "Apache-2.0")
        assert item.publisher
        assert not (item.default and item.url is None)
        assert item.output in {"detector": ["yolox"], "embedder": ["embedding"], "keypoints": ["movenet", "simcc"]}[item.role]
    roles = ("detector", "embedder", "keypoints")
    assert [item.role for item in entries if item.default] == list(roles)
    assert [default_of(role) for role in roles] == [item for item in entries if item.default]


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"sdk/pipeline.json": b"{}", "sdk/end2end.onnx": BODY}, None),
        ({"sdk/end2end.onnx": BODY[:-1]}, "holds another end2end.onnx: SHA-256 [0-9a-f]{64} instead of"),
        ({"sdk/readme.txt": BODY}, "holds no readable end2end.onnx"),
    ],
    ids=["right", "another", "none"],
)
def test_a_network_in_an_archive(server, cache, monkeypatch, members, said):
    content = io.BytesIO()
    with ZipFile(content, "w") as packed:
        for name, body in members.items():
            packed.writestr(name, body)
    server.body = content.getvalue()
    archive = {"member": "end2end.onnx", "sha256": hashlib.sha256(server.body).hexdigest(), "bytes": len(server.body)}
    know_only([entry("packed", "keypoints", url=server.url, archive=archive)], monkeypatch)
    with pytest.raises(InputError, match=said) if said else nullcontext():
        for _ in range(2):
            assert find_model("packed", "keypoints").network.path.read_bytes() == BODY
    assert [path.name for path in cache.iterdir() if not path.name.startswith(".")] == ([] if said else ["packed.onnx"])
    assert len(server.asked) == 1


def test_fetched_on_first_use_and_found_on_the_next(server, cache):
    heard = []
    network, reason = find_model("auto", "detector", tell=lambda stage, done=0, total=0: heard.append(stage))
    assert (network.name, network.path, network.sha256, reason) == ("tiny", cache / "tiny.onnx", SHA256, "")
    assert (network.output, network.input, network.licence) == ("yolox", InputConvention(), "Apache-2.0")
    assert (network.path.read_bytes(), set(heard)) == (BODY, {"fetching tiny.onnx (kB)"})
    assert (find_model("tiny", "detector").network, server.asked) == (network, [None])


def test_the_order_of_the_folders(server, cache, tmp_path, monkeypatch):
    folders = [tmp_path / name for name in ("own", "first", "second")]
    files = [put(folder) for folder in (*folders, cache)]
    monkeypatch.setenv("PASSERBY_MODELS", os.pathsep.join(map(str, folders[1:])))
    assert model_folders(folders[0]) == (*folders, cache_folder())
    for file in files:
        assert find_model("tiny", "detector", folders[0]).network.path == file
        file.unlink()
    assert server.asked == []


@pytest.mark.parametrize("place", ["models", "cache"])
def test_a_wrong_checksum_is_an_error_and_the_file_stays(server, cache, tmp_path, monkeypatch, place):
    wrong = put(cache if place == "cache" else tmp_path / "models", body=BODY[:-1])
    put(cache, "other.onnx")
    if place == "models":
        monkeypatch.setenv("PASSERBY_MODELS", str(wrong.parent))
        put(cache)
    with pytest.raises(InputError, match=f"{wrong}: is not tiny: SHA-256 {sha256_of(wrong)} instead of {SHA256}: delete it"):
        find_model("auto", "detector")
    assert (wrong.read_bytes(), server.asked) == (BODY[:-1], [])
    assert find_model("other", "detector").network is not None


def test_no_network_and_no_file_is_a_reason(server, monkeypatch):
    server.status = 503
    network, reason = find_model("auto", "detector")
    assert network is None
    assert re.fullmatch("tiny is not on this computer and cannot be fetched: .*503.*; see `passerby models`", reason)
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    asked = len(server.asked)
    for name, role, download, said in (
        ("tiny", "detector", True, "PASSERBY_OFFLINE is set"),
        ("tiny", "detector", False, "`passerby models fetch` downloads it"),
        ("auto", "keypoints", True, "name one by path"),
    ):
        network, reason = find_model(name, role, download=download)
        assert network is None
        assert said in reason
    assert len(server.asked) == asked


@pytest.mark.parametrize(
    ("name", "role", "message"),
    [
        ("tinny", "detector", "tinny: is not a model that Passerby knows: there are tiny, other, auto, or the path of an"),
        ("looks", "detector", "looks: is for embedder, not for detector: there are tiny, other"),
        ("nets/none.onnx", "detector", "nets/none.onnx: no such file"),
        ("joints", "keypoints", "has no download address: put joints.onnx into a folder that PASSERBY_MODELS names"),
    ],
)
def test_names_that_no_file_answers_to(server, tmp_path, monkeypatch, name, role, message):
    with pytest.raises(InputError, match=re.escape(message)):
        find_model(name, role)
    file = put(tmp_path / "models", "joints.onnx")
    assert find_model("joints", "keypoints", tmp_path / "models").network.path == file
    missing = tmp_path / "missing"
    with pytest.raises(InputError, match=f"{missing}: is not a folder"):
        find_model("auto", "detector", missing)
    monkeypatch.setenv("PASSERBY_MODELS", str(missing))
    with pytest.raises(InputError, match=f"{missing}: is not a folder"):
        find_model("auto", "detector")


def test_a_known_file_by_path_under_any_name(server, tmp_path, monkeypatch):
    file = put(tmp_path / "nets", "renamed.onnx")
    known = find_model("nets/renamed.onnx", "detector", base=tmp_path).network
    assert (known.name, known.path) == ("tiny", file)
    assert find_model(file, "detector", base=Path("elsewhere")).network == known
    know_only([entry("tiny")], monkeypatch)
    with pytest.raises(InputError, match=r"renamed\.onnx: is tiny, a network for detector, not for embedder"):
        find_model(file, "embedder")


def test_the_real_files(cache, monkeypatch):
    folder = Path(MODELS)
    if not folder.is_dir():
        pytest.skip(f"no model files: {folder} does not exist; set PASSERBY_MODELS to their folder")
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    present = [item for item in catalogue() if (folder / item.file).exists()]
    if not present:
        pytest.skip(f"no model files in {folder}")
    for item in present:
        assert (folder / item.file).stat().st_size == item.bytes
        assert find_model(item.name, item.role, folder).network.path == folder / item.file


def own(folder, shapes=((1, 4),), metadata=None, note=None):
    """A user's own network, whose outputs, copies of its inputs, have these shapes; with a note beside it."""
    path = folder / "mine.onnx"
    nodes = [helper.make_node("Identity", [f"x{n}"], [f"y{n}"]) for n in range(len(shapes))]
    ports = [[port(f"{side}{n}", list(shape)) for n, shape in enumerate(shapes)] for side in "xy"]
    model = onnx.load(saved(path, nodes, *ports))
    helper.set_model_props(model, metadata or {})
    onnx.save(model, str(path))
    if note is not None:
        (folder / "mine.toml").write_text(note)
    return path


def test_what_a_file_of_ones_own_usually_wants_by_its_role(tmp_path):
    file = own(tmp_path)
    detector = find_model("mine.onnx", "detector", base=tmp_path).network
    assert (detector.name, detector.path, detector.output, detector.licence) == ("mine.onnx", file, "yolox", "unknown")
    assert detector.sha256 == sha256_of(file)
    assert detector.input == InputConvention("bgr", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), "letterbox", 114.0)
    embedder = find_model(file, "embedder").network
    assert embedder.output == "embedding"
    assert (embedder.input.colour, embedder.input.fit, embedder.input.scale) == ("rgb", "stretch", 1 / 255)
    assert (embedder.input.mean, embedder.input.std) == ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
    file.write_bytes(b"hello")
    with pytest.raises(InputError, match=r"mine\.onnx: this is not an ONNX file"):
        find_model(file, "detector")


def test_what_keypoints_are_like_is_seen_from_the_outputs_or_stated_by_a_note(tmp_path):
    for shapes, output, scale in (
        ([(1, 1, 17, 3)], "movenet", 1.0),
        ([("n", 17, 384), ("n", 17, 512)], "simcc", 1 / 255),
        ([(1, 17, 64, 48)], "heatmaps", 1 / 255),
    ):
        network = find_model(own(tmp_path, shapes), "keypoints").network
        assert (network.output, network.input.colour, network.input.scale) == (output, "rgb", scale)
    file = own(tmp_path, [(1, 51)])
    with pytest.raises(InputError, match=r"mine\.onnx: outputs of shapes .*1, 51.* say which in mine\.toml"):
        find_model(file, "keypoints")
    (tmp_path / "mine.toml").write_text('output = "simcc"')
    assert find_model(file, "keypoints").network.output == "simcc"


def test_the_file_states_what_it_wants_or_a_note_does_which_does_not_overrule_it(tmp_path):
    note = 'role = "detector"\nlicence = "BSD"\nname = "net"\n[input]\ncolour = "rgb"\npadding = 0\nmean = [1, 2, 3]\n'
    network = find_model(own(tmp_path, note=note), "detector").network
    assert (network.name, network.licence) == ("net", "BSD")
    assert network.input == InputConvention("rgb", 1.0, (1.0, 2.0, 3.0), fit="letterbox", padding=0.0)
    stated = {"role": "embedder", "colour": "bgr", "scale": "0.5", "mean": "[1, 2.5, 3]", "std": "4 5 6", "licence": "MIT"}
    metadata = {f"passerby.{key}": value for key, value in stated.items()} | {"somebody.else": "1"}
    file = own(tmp_path, metadata=metadata, note='licence = "none"')
    network = find_model(file, "embedder").network
    assert network.input == InputConvention("bgr", 0.5, (1.0, 2.5, 3.0), (4.0, 5.0, 6.0), "stretch")
    assert network.licence == "MIT"
    with pytest.raises(InputError, match=r"mine\.onnx: is a network of role embedder, not detector"):
        find_model(file, "detector")


@pytest.mark.parametrize(
    ("metadata", "note", "message"),
    [
        ({}, "[input]\ncolor = 'rgb'", "mine.toml: unknown key input.color: there are role, output, input"),
        ({}, "[input]\ncolour = 'grey'", "mine.toml: input.colour is 'grey': input should be 'bgr' or 'rgb'"),
        ({}, "[input]\nstd = [1, 0, 1]", "mine.toml: input.std.1 is 0: input should be greater than 0"),
        ({}, "output = 'simcc'", "mine.onnx: output simcc is not one of detector: there are yolox"),
        ({}, f"sha256 = '{'0' * 64}'", f"mine.toml: sha256 {'0' * 64} is not that of mine.onnx"),
        ({}, "output = ", "mine.toml: is not TOML"),
        ({"passerby.mean": "1, 2"}, None, "mine.onnx: metadata passerby.*: input.mean"),
    ],
)
def test_notes_and_metadata_that_cannot_be(tmp_path, metadata, note, message):
    with pytest.raises(InputError, match=re.escape(message)):
        find_model(own(tmp_path, metadata=metadata, note=note), "detector")


def doubling(opset: int = 13, operator: str = "Add") -> bytes:
    """A network y = x + x."""
    ports = [[helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", 3])] for name in "xy"]
    graph = helper.make_graph([helper.make_node(operator, ["x", "x"], ["y"])], "doubling", *ports)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8).SerializeToString()


def renamed(name: bytes) -> bytes:
    """The same with a name that is not text."""
    return doubling().replace(b"\n\x01" + name, b"\n\x01\xee").replace(b"\x12\x01" + name, b"\x12\x01\xee")


def test_a_session_computes_on_one_thread_and_states_its_ports(tmp_path):
    session = open_session(put(tmp_path, body=doubling()), allow_cuda=False)
    assert provider_of(session) == "CPU"
    options = session.get_session_options()
    assert options.intra_op_num_threads == options.inter_op_num_threads == 1
    assert options.get_session_config_entry("session.intra_op.allow_spinning") == "0"
    x = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert np.array_equal(session.run(None, {"x": x})[0], 2 * x)
    (taken,), (given,) = inputs_of(session), outputs_of(session)
    assert (taken.name, taken.shape, taken.kind, given.name) == ("x", (None, 3), "tensor(float)", "y")


@pytest.mark.parametrize(
    ("content", "why"),
    [
        *(
            (content, ".*fetch it again")
            for content in (b"", b"<html>404</html>", bytes(1000), doubling()[: len(doubling()) // 2])
        ),
        *((renamed(name), "its names are not text: the file is damaged; fetch it again") for name in (b"x", b"y")),
        *((body, "needs operators .*older opset") for body in (doubling(999), doubling(operator="NoSuchOperator"))),
    ],
    ids=["empty", "page", "zeros", "half", "input", "output", "opset", "operator"],
)
def test_files_that_do_not_open(tmp_path, content, why, capfd):
    path = tmp_path / "network.onnx"
    with pytest.raises(InputError, match=r"network\.onnx: no such file: give"):
        open_session(path)
    path.write_bytes(content)
    with refused(why, path):
        open_session(path)
    assert capfd.readouterr() == ("", "")
