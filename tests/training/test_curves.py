"""The record of a training survives what befalls a training."""

import re
from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.training.curves import COLUMNS, EpochRecord, TrainingLog, write_curves


def row(epoch, scored=False):
    losses = 5.0 / epoch, 4.7 / epoch, 0.3 / epoch
    scores = (1 - 1 / (epoch + 0.1), 1 / 3) if scored else (None, None)
    return EpochRecord(epoch, 10 * epoch, 3.5e-4 / epoch, *losses, *scores)


def filled(log, rows):
    for one in rows:
        log.append(one)
    return log


@pytest.fixture
def log(tmp_path):
    return filled(TrainingLog(tmp_path), ROWS)


ROWS = [row(epoch, epoch % 2 == 0) for epoch in range(1, 6)]


def test_rows_come_back_to_the_last_bit(log, tmp_path):
    assert log.rows() == tuple(ROWS)
    lines = log.path.read_text().splitlines()
    assert lines[:2] == ["epoch,step,learning_rate,loss,identity_loss,triplet_loss,rank_1,map", "1,10,0.00035,5.0,4.7,0.3,,"]
    assert lines[2].endswith(",0.3333333333333333")
    assert (len(lines), [entry.name for entry in log.path.parent.iterdir()]) == (6, ["log.csv"])
    ours = replace(ROWS[1], epoch=np.int64(2), loss=np.float64(0.1), rank_1=np.float32(0.5), map=np.float64(1))
    numpys = filled(TrainingLog(tmp_path / "numpy"), [ours])
    assert numpys.path.read_text().splitlines()[1] == "2,20,0.000175,0.1,2.35,0.15,0.5,1.0"


def test_a_training_that_goes_on_leaves_the_same_bytes(log, tmp_path):
    again = filled(TrainingLog(tmp_path / "again"), ROWS[:4])
    again.truncate_after(3)  # killed after epoch 4 was written and before it was kept
    assert (again.rows(), filled(again, ROWS[3:]).path.read_bytes()) == (tuple(ROWS[:3]), log.path.read_bytes())
    with pytest.raises(InputError, match="has epoch 5 already, epoch 5 cannot follow"):
        log.append(row(5))
    log.truncate_after(0)
    assert log.path.read_text() == ",".join(COLUMNS) + "\n", "one that begins anew drops the old one"
    absent = TrainingLog(tmp_path / "none")
    absent.truncate_after(0)
    assert (absent.rows(), absent.path.exists()) == ((), False)


def test_a_write_that_fails_leaves_the_log_as_it_was(log, monkeypatch):
    before = log.path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match=r"log\.csv: cannot be written \(No space left"):
        log.append(row(6))
    assert (log.path.read_bytes(), [entry.name for entry in log.path.parent.iterdir()]) == (before, ["log.csv"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,loss\n1,2\n", r"log\.csv: line 1 is not epoch,step"),
        ("", r"log\.csv: line 1 is not"),
        ("{header}\n1,10,0.1,5\n", r"log\.csv: line 2: 4 values instead of 8"),
        ("{header}\n1,10,0.1,high,4,1,,\n", r"log\.csv: line 2: loss is 'high', not a number"),
        ("{header}\n1,10,0.1,,4,1,,\n", r"log\.csv: line 2: loss is '', not a number"),
        ("{header}\n2,10,0.1,5,4,1,,\n2,20,0.1,5,4,1,,\n", r"log\.csv: line 3: epoch 2 comes after epoch 2"),
    ],
)
def test_a_file_that_is_no_log(tmp_path, text, said):
    log = TrainingLog(tmp_path)
    log.path.write_text(text.format(header=",".join(COLUMNS)))
    for act in (log.rows, lambda: log.append(row(9)), lambda: log.truncate_after(1)):
        with pytest.raises(InputError, match=said):
            act()


def drawn(page):
    """The numbers of the curves as the page has them: name -> epochs, values."""
    found = re.findall(r'"name":"([^"]+)","x":\[([^]]*)\],"y":\[([^]]*)\],"type":"scatter"', page)
    return {name: tuple([float(text) for text in axis.split(",")] for axis in axes) for name, *axes in found}


def test_the_page_shows_all_curves_needs_no_network_and_is_the_same_each_time(log, tmp_path):
    def page_of(log, name):
        write_curves(log, tmp_path / name)
        return (tmp_path / name).read_text()

    page = page_of(log, "curves.html")
    curves = drawn(page)
    assert set(curves) == {"total, weighted", "identity", "triplet", "rank-1", "mAP", "learning rate"}
    assert curves["total, weighted"] == ([1, 2, 3, 4, 5], [one.loss for one in ROWS])
    assert curves["rank-1"] == ([2, 4], [ROWS[1].rank_1, ROWS[3].rank_1])
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page)
    for told in ("prefers-color-scheme: dark", "Best rank-1 0.756 after epoch 4"):
        assert told in page
    assert page.count("Plotly.newPlot(") >= 3
    assert str(tmp_path) not in page
    assert page_of(log, "again.html") == page
    assert "No epoch is finished yet." in page_of(TrainingLog(tmp_path / "none"), "none.html")
