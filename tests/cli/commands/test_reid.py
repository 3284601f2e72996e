"""`passerby reid` from pictures to a network for the perception stage, and what it says where it cannot."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys

import pytest

from passerby.cli.main import run
from support.datasets.coloured_people import coloured_people

OPTIONS = "height = 32\nwidth = 16\nepochs = 3\nvalidate_every = 3\npeople_per_batch = 4\npictures_per_person = 2\n"
TORCH = ("torch", "transformers", "pytorch_metric_learning", "accelerate")


@pytest.fixture(scope="module")
def court(tmp_path_factory):
    return coloured_people(tmp_path_factory.mktemp("data") / "court")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "options.toml"
    path.write_text(OPTIONS)
    return path


@pytest.fixture
def one_thread():
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def answer(capsys, *arguments, status=0):
    assert run([str(one) for one in arguments]) == status
    return capsys.readouterr()


def assert_same_figures(found, wanted):
    """ONNX Runtime adds up in another order than PyTorch; ranks of these few pictures do not turn by that."""
    assert found.keys() == wanted.keys()
    for name, figure in wanted.items():
        if isinstance(figure, dict):
            assert_same_figures(found[name], figure)
        else:
            assert found[name] == pytest.approx(figure, abs=1e-9), name


@pytest.mark.system
@pytest.mark.usefixtures("one_thread")
def test_from_pictures_to_a_network(court, config, tmp_path, capsys):
    """The figures of the last epoch are those of `evaluate`, and those of the exported network."""
    folder, net = tmp_path / "run", tmp_path / "net.onnx"

    def evaluated(what):
        return json.loads(answer(capsys, "reid", "evaluate", what, court, "--json").out)["sets"]["court"]

    assert evaluated("stripes")["plain"]["queries"] == 12
    train = ("reid", "train", court, "-o", folder, "--recipe", "small", "--config", config, "--seed", 2, "--device", "cpu")
    printed = answer(capsys, *train, "--json", "-v")
    epochs = [line.split(":")[0] for line in printed.err.splitlines() if line.startswith("epoch")]
    assert epochs == ["epoch 1", "epoch 2", "epoch 3"]
    told = json.loads(printed.out)
    assert (told["people"], told["pictures"], told["resumed_after"]) == (6, 24, 0)
    assert (told["options"]["seed"], told["options"]["backbone"], told["last"]["epoch"]) == (2, "small", 3)
    assert {path.name for path in folder.iterdir()} >= {"run.toml", "checkpoint.pt", "log.csv", "curves.html"}
    by_run = evaluated(folder)
    assert by_run["plain"]["queries"] == 12
    assert {key: by_run["plain"][key] for key in ("rank_1", "map")} == {key: told["last"][key] for key in ("rank_1", "map")}
    figures = answer(capsys, "reid", "evaluate", folder / "checkpoint.pt", court).out
    assert "court, plain" in figures
    assert "court, centred" in figures

    report = json.loads(answer(capsys, "reid", "export", folder, "-o", net, "--data", court, "--json").out)
    assert report["real"]["pictures"] > 0
    assert report["real"]["same_ranking"]
    assert_same_figures(evaluated(net), by_run)

    again = answer(capsys, *train)
    assert "continues after epoch 3 of 3" in again.out
    assert f"written to {folder}" in again.out


@pytest.mark.system
@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["train", "{court}", "-o", "{out}", "--recipe", "best"], "recipe 'best' does not exist"),
        (["train", "{court}", "-o", "{out}", "--precision", "fp8"], "precision is 'fp8'"),
        (["train", "{court}", "-o", "{out}", "--device", "tpu"], "device 'tpu' does not exist: give auto or cpu"),
        (["train", "{out}/nowhere", "-o", "{out}"], "nowhere"),
        (["train", "{court}", "-o", "{out}", "--backbone", "small", "--weights", "published"], "backbone small: no published"),
        (["train", "{court}", "-o", "{out}", "--weights", "{out}/nowhere"], "nowhere: no such file"),
        (["evaluate", "{out}", "{court}"], "checkpoint.pt: no such file"),
        (["evaluate", "nobody", "{court}"], "nobody"),
        (["export", "{out}", "-o", "{out}/net.onnx"], "checkpoint.pt: no such file"),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_a_wrong_option_or_file_is_one_line_of_error(court, tmp_path, capsys, arguments, told):
    filled = [one.format(court=court, out=tmp_path) for one in arguments]
    printed = answer(capsys, "reid", *filled, status=2)
    *notes, last = printed.err.splitlines()
    assert last.startswith("error: ")
    assert told in last
    assert all(line.startswith("note: court: ") for line in notes)
    assert printed.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.system
@pytest.mark.parametrize("command", ["train", "evaluate", "finetune", "export"])
def test_a_command_that_lacks_its_extra_says_so_before_anything_is_done(court, tmp_path, capsys, monkeypatch, command):
    plain, absent = importlib.util.find_spec, TORCH
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name in absent else plain(name, *more))
    rest = {"train": [court, "-o", tmp_path / "run"], "evaluate": [tmp_path, court], "finetune": [tmp_path],
            "export": [tmp_path, "-o", tmp_path / "net.onnx"]}[command]  # fmt: skip
    (line,) = answer(capsys, "reid", command, *rest, status=2).err.splitlines()
    assert f"passerby reid {command}" in line
    assert "needs torch, transformers, pytorch_metric_learning, accelerate: pip install 'passerby[reid]'" in line
    assert list(tmp_path.iterdir()) == []
    if command == "export":
        absent = ("onnxscript",)
        said = answer(capsys, "reid", command, *rest, status=2).err
        assert "passerby reid export needs onnxscript: pip install 'passerby[reid]'" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["reid", "--help"], ["reid", "train", "--help"], ["reid", "evaluate", "stripes", "{court}", "--json"]],
    ids=" ".join,
)
def test_torch_is_not_loaded_where_it_is_not_needed(court, arguments):
    filled = [one.format(court=court) for one in arguments]
    program = (
        "import sys\nfrom passerby.cli.main import run\n"
        f"status = run({filled!r})\n"
        f"loaded = [name for name in {(*TORCH, 'onnx', 'plotly')!r} if name in sys.modules]\n"
        "sys.exit(status or (f'loads {loaded}' if loaded else 0))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout
