"""`python benchmarks/run_paper.py`: which parts are run, what is written, and what is left of a run that was stopped."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from pages.commit import commit
from pages.records import Found
from pages.tables import table
from paper import parts
from passerby.cli import main
from support.paths import BENCHMARKS

run_paper = pytest.importorskip("run_paper")
pytest.importorskip("matplotlib")


def run(arguments):
    return main.run(arguments, run_paper.app, "run_paper.py")


@pytest.fixture
def calls(monkeypatch):
    """Parts that need no time; the second stops the run as long as `interrupts` is not empty."""
    seen = SimpleNamespace(wanted=[], interrupts=[])

    def part(name):
        def work(wanted, executor, tell):
            seen.wanted.append((name, wanted))
            tell(name, 0, 1)
            if name == "second" and seen.interrupts:
                raise seen.interrupts.pop()
            wanted.kept.mkdir(parents=True, exist_ok=True)
            return Found({"T": table(["x"], [[name]])}, files={f"{name}.svg": "<svg/>", f"{name}.png": b"\x89PNG"})

        return SimpleNamespace(says=f"says {name}", load=lambda: work)

    monkeypatch.setattr(parts, "PARTS", {name: part(name) for name in ("first", "second", "third")})
    return seen


def test_every_part_is_a_module_with_a_run():
    for part in parts.PARTS.values():
        assert callable(part.load())


def test_a_part_that_does_not_exist_is_one_line(capsys, tmp_path):
    assert run(["noize", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error == "error: part 'noize' of the benchmark does not exist: did you mean 'noise'?\n"
    assert run(["zzz"]) == 2
    assert "noise, correspondences" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_parts_are_listed(calls, capsys):
    assert run(["--list"]) == 0
    assert capsys.readouterr().out.splitlines() == ["first   says first", "second  says second", "third   says third"]


def test_pages_say_what_wrote_them(calls, capsys, tmp_path):
    out = tmp_path / "out"
    assert run(["third", "first", "--quick", "--seeds", "3", "--data", str(tmp_path), "-o", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ["records", *(f"{name}.{end}" for name in ("first", "third") for end in ("md", "svg", "png"))]
    )
    text = (out / "third.md").read_text()
    command = "python benchmarks/run_paper.py third --quick --seeds 3 --data DATA"
    assert text.startswith("# third\n\n")
    assert f"Written by `{command}`, code of commit {commit()}, on: " in text
    assert "numpy" in text
    assert str(tmp_path) not in text
    assert str(table(["x"], [["third"]])) in capsys.readouterr().out
    assert [name for name, _ in calls.wanted] == ["third", "first"]
    wanted = calls.wanted[0][1]
    assert (wanted.quick, wanted.seeds, wanted.data, wanted.scenes) == (True, 3, tmp_path, None)


def test_a_stopped_run_keeps_its_pages_and_what_is_done(calls, capsys, tmp_path):
    calls.interrupts.append(KeyboardInterrupt())
    assert run(["-o", str(tmp_path)]) == 130
    assert capsys.readouterr().err.endswith("error: interrupted\n")
    assert (tmp_path / "first.md").is_file()
    assert not (tmp_path / "second.md").exists()
    assert (tmp_path / ".kept").is_dir()
    assert run(["-o", str(tmp_path)]) == 0
    assert (tmp_path / "third.md").is_file()
    assert not (tmp_path / ".kept").exists()


def test_the_folder_cannot_be_a_file(calls, capsys, tmp_path):
    (tmp_path / "out").write_text("")
    assert run(["first", "-o", str(tmp_path / "out")]) == 2
    assert "out: cannot be written" in capsys.readouterr().err
    assert not calls.wanted


def test_listing_needs_neither_numbers_nor_plots():
    code = f"import sys; sys.path.insert(0, {str(BENCHMARKS)!r}); import run_paper; from passerby.cli import main\n"
    code += "print(main.run(['--list'], run_paper.app, 'run_paper.py'), *sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "0" in loaded
    assert not {"matplotlib", "torch", "poselib", "kornia"} & set(loaded)
