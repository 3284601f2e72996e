"""A quick look at one camera's recording."""

import numpy as np

from passerby.perception.overview import look_over
from passerby.perception.plan import Plan
from passerby.perception.stretches import CELLS
from passerby.perception.video import probe
from passerby.perception.watching import CameraJob
from support.scenes.puppet_videos import film, puppets


def test_people_are_seen_where_they_stand(tmp_path):
    made = puppets(40.0, 3.0, 1, 4)
    film(made, tmp_path, key_every=3)
    info = probe(tmp_path / "C1.mp4")
    job = CameraJob("C1", info, 3.0, Plan(None, None, None), tmp_path / "shelf")
    told = []
    found = look_over(job, lambda done, total: told.append(done))
    assert told == sorted(told)
    seconds, count = found.seconds, found.count
    assert 36 <= len(seconds) <= 41, "a key frame every second"
    assert (np.diff(seconds) > 0).all()
    # Those whom it sees stand where somebody is; of all people it sees most.
    true = made.boxes["C1"]
    feet = (true.ltwh[:, :2] + true.ltwh[:, 2:] * (0.5, 1.0)) / info.size
    frame = np.repeat(np.rint(seconds * 3.0).astype(int) + 1, count)
    off = np.array([
        np.linalg.norm(feet[true.frame == number] - place, axis=1).min(initial=1.0)
        for number, place in zip(frame.tolist(), found.feet, strict=True)
    ])  # fmt: skip
    assert (off < 1 / CELLS[0]).mean() > 0.9
    assert count.sum() > 0.6 * np.isin(true.frame, np.rint(seconds * 3.0).astype(int) + 1).sum()
    again = look_over(job, lambda done, total: None)
    np.testing.assert_array_equal(again.feet, found.feet)
