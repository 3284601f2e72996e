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


def same_figures(found, wanted):
    """ONNX Runtime adds up in another order than PyTorch; ranks of these few pictures do not turn by that."""
    assert found.keys() == wanted.keys()
    for name, figure in wanted.items():
        if isinstance(figure, dict):
            same_figures(found[name], figure)
        else:
            assert found[name] == pytest.approx(figure, abs=1e-9), name


@pytest.mark.system
@pytest.mark.usefixtures("one_thread")
def test_from_pictures_to_a_network(court, config, tmp_path, capsys):
    folder, net = tmp_path / "run", tmp_path / "net.onnx"
    train = ("reid", "train", court, "-o", folder, "--recipe", "small", "--config", config, "--seed", 2, "--device", "cpu")
    told = json.loads(answer(capsys, *train, "--json").out)
    assert (told["people"], told["pictures"], told["resumed_after"]) == (6, 24, 0)
    assert told["options"]["seed"] == 2
    assert told["options"]["backbone"] == "small"
    assert told["last"]["epoch"] == 3
    assert {path.name for path in folder.iterdir()} >= {"run.toml", "checkpoint.pt", "log.csv", "curves.html"}
    by_run = json.loads(answer(capsys, "reid", "evaluate", folder, court, "--json").out)["sets"]["court"]
    assert by_run["plain"]["queries"] == 12
    figures = answer(capsys, "reid", "evaluate", folder / "checkpoint.pt", court).out
    assert "court, plain" in figures
    assert "court, centred" in figures

    report = json.loads(answer(capsys, "reid", "export", folder, "-o", net, "--data", court, "--json").out)
    assert report["real"]["pictures"] > 0
    assert report["real"]["same_ranking"]
    by_onnx = json.loads(answer(capsys, "reid", "evaluate", net, court, "--json").out)["sets"]["court"]
    same_figures(by_onnx, by_run)

    again = answer(capsys, *train)
    assert "continues after epoch 3 of 3" in again.out
    assert f"written to {folder}" in again.out


@pytest.mark.system
@pytest.mark.usefixtures("one_thread")
def test_the_figures_of_the_last_epoch_are_those_of_evaluate(court, config, tmp_path, capsys):
    folder = tmp_path / "run"
    train = ("reid", "train", court, "-o", folder, "--recipe", "small", "--config", config, "--device", "cpu", "--json", "-v")
    printed = answer(capsys, *train)
    assert [line.split(":")[0] for line in printed.err.splitlines() if line.startswith("epoch")] == [
        "epoch 1",
        "epoch 2",
        "epoch 3",
    ]
    last = json.loads(printed.out)["last"]
    score = json.loads(answer(capsys, "reid", "evaluate", folder, court, "--json").out)["sets"]["court"]["plain"]
    assert score["rank_1"] == last["rank_1"]
    assert score["map"] == last["map"]


def test_stripes_are_evaluated_without_a_run(court, capsys):
    score = json.loads(answer(capsys, "reid", "evaluate", "stripes", court, "--json").out)["sets"]["court"]["plain"]
    assert score["queries"] == 12


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
def test_one_line_says_what_is_wrong(court, tmp_path, capsys, arguments, told):
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
def test_without_the_extra(court, tmp_path, capsys, monkeypatch, command):
    """What needs it says so, in one line, before anything else is done."""
    plain = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name in TORCH else plain(name, *more))
    rest = {"train": [court, "-o", tmp_path / "run"], "evaluate": [tmp_path, court], "finetune": [tmp_path],
            "export": [tmp_path, "-o", tmp_path / "net.onnx"]}[command]  # fmt: skip
    printed = answer(capsys, "reid", command, *rest, status=2)
    assert f"passerby reid {command}" in printed.err
    assert "needs torch, transformers, pytorch_metric_learning, accelerate: pip install 'passerby[reid]'" in printed.err
    assert len(printed.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.system
def test_an_export_without_what_writes_onnx(tmp_path, capsys, monkeypatch):
    plain = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "onnxscript" else plain(name, *more))
    printed = answer(capsys, "reid", "export", tmp_path, "-o", tmp_path / "net.onnx", status=2)
    assert "passerby reid export needs onnxscript: pip install 'passerby[reid]'" in printed.err


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
