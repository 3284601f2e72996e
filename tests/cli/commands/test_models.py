"""`passerby models`: what it prints and how it ends."""

import json

import pytest
import typer

from passerby.cli import main as cli
from passerby.cli.commands.models import models_app
from passerby.common.errors import InputError
from support.networks.model_server import BODY, SHA256, entry, keep_to, know_only, serving


@pytest.fixture
def cache(tmp_path, monkeypatch):
    return keep_to(tmp_path, monkeypatch)


@pytest.fixture
def server(cache, monkeypatch):
    with serving(monkeypatch) as server:
        tiny, second = entry("tiny", url=server.url), entry("second", url=server.url, default=False)
        know_only([tiny, second, entry("joints", "keypoints", bytes=25_051_237)], monkeypatch)
        yield server


@pytest.fixture
def run(capsys):
    def run(*arguments):
        typer.main.get_command(models_app).main(list(arguments), prog_name="models", standalone_mode=False)
        return capsys.readouterr().out

    return run


def lines(text):
    return [" ".join(line.split()) for line in text.splitlines()]


def test_the_list_says_where_each_model_is(server, run, cache, tmp_path):
    assert set(lines(run("list"))) >= {
        "joints keypoints 25.1 MB Apache-2.0 not here", "tiny detector 0.3 MB Apache-2.0 auto not here", f"searched in {cache}",
    }  # fmt: skip
    run("fetch")
    assert f"tiny detector 0.3 MB Apache-2.0 auto {cache / 'tiny.onnx'}" in lines(run("list"))
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "tiny.onnx").write_bytes(BODY)
    told = json.loads(run("list", "--json", "--models", str(folder)))
    assert told["folders"] == [str(folder), str(cache)]
    tiny, _, joints = told["models"]
    assert tiny["path"] == str(folder / "tiny.onnx")
    assert (tiny["sha256"], tiny["bytes"], tiny["url"], tiny["default"]) == (SHA256, len(BODY), server.url, True)
    assert (joints["path"], joints["url"], joints["role"]) == (None, None, "keypoints")


def test_a_group_without_a_verb_lists_the_models_or_shows_its_help(server, run, capsys):
    assert run() == run("list")
    for group, said in (("models", "tiny"), ("reid", "finetune")):
        assert cli.run([group]) == 0
        told = capsys.readouterr()
        assert said in told.out
        assert not told.err


def test_fetch_what_auto_means_or_all_that_can_be_had(server, run, cache):
    assert run("fetch") == f"tiny: fetched to {cache / 'tiny.onnx'}\n"
    assert [path.name for path in cache.glob("*.onnx")] == ["tiny.onnx"]
    assert run("fetch", "tiny") == f"tiny: already in {cache / 'tiny.onnx'}\n"
    assert server.asked == [None]
    told = json.loads(run("fetch", "--all", "--json"))
    assert [(item["name"], item["fetched"]) for item in told["models"]] == [("tiny", False), ("second", True)]
    assert {path.read_bytes() for path in cache.glob("*.onnx")} == {BODY}


@pytest.mark.parametrize(
    ("arguments", "offline", "message"),
    [
        (["joints"], "", "joints: has no download address: put joints.onnx into"),
        (["nothing"], "", "nothing: is not a model that Passerby knows: there are tiny, second, joints$"),
        (["tiny", "--all"], "", "names and --all contradict each other"),
        ([], "1", "tiny: cannot be fetched: PASSERBY_OFFLINE is set"),
    ],
)
def test_fetch_what_cannot_be_had(server, run, monkeypatch, arguments, offline, message):
    monkeypatch.setenv("PASSERBY_OFFLINE", offline)
    with pytest.raises(InputError, match=message):
        run("fetch", *arguments)


def test_verify_sees_every_copy(server, run, cache, tmp_path, capsys):
    assert json.loads(run("verify", "--json")) == {"checked": [], "absent": ["tiny", "second", "joints"]}
    run("fetch", "--all")
    right = f"tiny right {cache / 'tiny.onnx'}"
    assert {right, "joints not here"} <= set(lines(run("verify")))
    (cache / "second.onnx").write_bytes(BODY[:-1])
    with pytest.raises(InputError, match=r"second\.onnx: is not second: SHA-256 [0-9a-f]{64} instead") as caught:
        run("verify")
    assert caught.value.exit_status == 2
    assert {right, f"second WRONG {cache / 'second.onnx'}"} <= set(lines(capsys.readouterr().out))
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "tiny.onnx").write_bytes(BODY)
    (cache / "tiny.onnx").write_bytes(b"")
    (cache / "second.onnx").unlink()
    with pytest.raises(InputError, match=str(cache / "tiny.onnx")):
        run("verify", "--json", "--models", str(folder))
    assert [item["right"] for item in json.loads(capsys.readouterr().out)["checked"]] == [True, False]
