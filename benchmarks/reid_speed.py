"""Time of a network on one core: `python reid_speed.py NETWORK DATA`.

Prints one JSON object: milliseconds a crop, of the network alone and with the crops' cutting and normalising; the best of a few
rounds, since whatever else runs can only add.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from passerby.perception.model_files import find_model
from passerby.perception.reid import BATCH, ReidEmbedder
from passerby.perception.sessions import inputs_of, open_session
from passerby.training.data.reading import read_data

BATCHES, ROUNDS = 16, 5


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("network", type=Path)
    parser.add_argument("data", type=Path)
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    found = find_model(arguments.network, "embedder").network
    assert found is not None, arguments.network
    embedder, session = ReidEmbedder(found), open_session(arguments.network)
    (port,) = inputs_of(session)
    noise = np.random.default_rng(0).standard_normal((BATCH, *(size or 1 for size in port.shape[1:]))).astype(np.float32)
    with tempfile.TemporaryDirectory() as cache, threadpool_limits(limits=1):
        paths = read_data(arguments.data, Path(cache)).train.paths[:BATCH]
        pictures = [np.asarray(cv2.imread(str(path)), dtype=np.uint8) for path in paths]
        height, width = min(picture.shape[:2] for picture in pictures)
        sheet = np.hstack([cv2.resize(picture, (width, height)) for picture in pictures]).astype(np.uint8)
        boxes = np.array([[k * width, 0.0, width, height] for k in range(len(pictures))])
        told = {
            "network_ms": _best(lambda: session.run(None, {port.name: noise})) / BATCH,
            "embedder_ms": _best(lambda: embedder(sheet, boxes)) / len(boxes),
        }
    print(json.dumps(told))


def _best(work: Callable[[], object]) -> float:
    """Milliseconds of one call, the mean over a round, in the best round."""
    work()
    rounds = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for _ in range(BATCHES):
            work()
        rounds.append((time.perf_counter() - began) / BATCHES)
    return 1000.0 * min(rounds)


if __name__ == "__main__":
    main()
