"""Which file a name means, where it is looked for, and what is done where it lies nowhere."""

import hashlib
import io
import os
import re
from contextlib import nullcontext
from pathlib import Path
from zipfile import ZipFile

import pytest

from passerby.common.errors import InputError
from passerby.perception.fetching import sha256_of
from passerby.perception.model_files import cache_folder, find_model, model_folders
from passerby.perception.networks import InputConvention, catalogue, default_of
from support.networks.model_server import BODY, SHA256, entry, keep_to, know_only, serving
from support.paths import MODELS


@pytest.fixture
def cache(tmp_path, monkeypatch):
    return keep_to(tmp_path, monkeypatch)


@pytest.fixture
def server(cache, monkeypatch):
    with serving(monkeypatch) as server:
        known = [
            entry("tiny", url=server.url),
            entry("other", url=server.url, default=False),
            entry("looks", "embedder", url=server.url),
            entry("joints", "keypoints"),
        ]
        know_only(known, monkeypatch)
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


def packed(members):
    """A zip archive, with what its entry in a manifest says of it."""
    content = io.BytesIO()
    with ZipFile(content, "w") as archive:
        for name, body in members.items():
            archive.writestr(name, body)
    body = content.getvalue()
    return body, {"member": "end2end.onnx", "sha256": hashlib.sha256(body).hexdigest(), "bytes": len(body)}


@pytest.mark.parametrize(
    ("members", "told"),
    [
        ({"sdk/pipeline.json": b"{}", "sdk/end2end.onnx": BODY}, None),
        ({"sdk/end2end.onnx": BODY[:-1]}, "holds another end2end.onnx: SHA-256 [0-9a-f]{64} instead of"),
        ({"sdk/readme.txt": BODY}, "holds no readable end2end.onnx"),
    ],
    ids=["right", "another", "none"],
)
def test_a_network_in_an_archive(server, cache, monkeypatch, members, told):
    server.body, archive = packed(members)
    know_only([entry("packed", "keypoints", url=server.url, archive=archive)], monkeypatch)
    with pytest.raises(InputError, match=told) if told else nullcontext():
        for _ in range(2):
            assert find_model("packed", "keypoints").network.path.read_bytes() == BODY
    assert [path.name for path in cache.iterdir() if not path.name.startswith(".")] == ([] if told else ["packed.onnx"])
    assert len(server.asked) == 1


def test_fetched_on_first_use_and_found_on_the_next(server, cache):
    told = []
    network, reason = find_model("auto", "detector", tell=lambda stage, done=0, total=0: told.append(stage))
    assert (network.name, network.path, network.sha256, reason) == ("tiny", cache / "tiny.onnx", SHA256, "")
    assert (network.output, network.input, network.licence) == ("yolox", InputConvention(), "Apache-2.0")
    assert (network.path.read_bytes(), set(told)) == (BODY, {"fetching tiny.onnx (kB)"})
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
    folder = cache if place == "cache" else tmp_path / "models"
    wrong = put(folder, body=BODY[:-1])
    put(cache, "other.onnx")
    if place == "models":
        monkeypatch.setenv("PASSERBY_MODELS", str(folder))
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
    for name, role, download, told in (
        ("tiny", "detector", True, "PASSERBY_OFFLINE is set"),
        ("tiny", "detector", False, "`passerby models fetch` downloads it"),
        ("auto", "keypoints", True, "name one by path"),
    ):
        network, reason = find_model(name, role, download=download)
        assert network is None
        assert told in reason
    assert len(server.asked) == asked


def test_a_model_that_no_address_serves(server, tmp_path):
    with pytest.raises(InputError, match=r"joints: .* has no download address: put joints\.onnx into a folder that PASS"):
        find_model("joints", "keypoints")
    file = put(tmp_path / "models", "joints.onnx")
    assert find_model("joints", "keypoints", tmp_path / "models").network.path == file


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("tinny", "tinny: is not a model that Passerby knows: there are tiny, other, auto, or the path of an .onnx file"),
        ("looks", "looks: is for embedder, not for detector: there are tiny, other"),
        ("nets/none.onnx", "nets/none.onnx: no such file"),
    ],
)
def test_names_that_nobody_knows(server, name, message):
    with pytest.raises(InputError, match=re.escape(message)):
        find_model(name, "detector")


def test_a_known_file_by_path_under_any_name(server, tmp_path, monkeypatch):
    file = put(tmp_path / "nets", "renamed.onnx")
    know_it = find_model("nets/renamed.onnx", "detector", base=tmp_path).network
    assert (know_it.name, know_it.path) == ("tiny", file)
    assert find_model(file, "detector", base=Path("elsewhere")).network == know_it
    know_only([entry("tiny")], monkeypatch)
    with pytest.raises(InputError, match=r"renamed\.onnx: is tiny, a network for detector, not for embedder"):
        find_model(file, "embedder")


def test_a_folder_that_is_none(server, tmp_path, monkeypatch):
    missing = tmp_path / "missing"
    with pytest.raises(InputError, match=f"{missing}: is not a folder"):
        find_model("auto", "detector", missing)
    monkeypatch.setenv("PASSERBY_MODELS", str(missing))
    with pytest.raises(InputError, match=f"{missing}: is not a folder"):
        find_model("auto", "detector")


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
