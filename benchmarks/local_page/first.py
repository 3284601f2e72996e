"""From the command to the first picture in the browser, sixteen cameras with an hour of video each."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from local_page.hand import SIZE, chromium
from local_page.hour import CAMERAS, hour_scene
from local_page.serving import TIMEOUT_S, served
from pages.tables import load

REPEATS = 5
SHOWN = "() => [...document.querySelectorAll('.stage img')].filter((one) => one.complete && one.naturalWidth > 0).length"


@dataclass(frozen=True)
class FirstCase:
    """Where the films are, and which repetition it is."""

    films: Path
    repeat: int


def cases(films: Path, repeats: int) -> dict[str, FirstCase]:
    """By key."""
    return {f"first {repeat}": FirstCase(films, repeat) for repeat in range(repeats)}


def work(case: FirstCase) -> dict[str, Any]:
    """Seconds until the address is printed, the first picture is shown, and all are. The browser runs already."""
    scene = hour_scene(case.films)
    with tempfile.TemporaryDirectory() as scratch, chromium() as browser:
        page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
        page.goto("about:blank")
        with served(scene, Path(scratch) / "out") as server:
            address_s = time.perf_counter() - server.began
            page.goto(server.address, wait_until="commit")
            first_s, cpu_s = _until(server.began, page, 1), server.cpu_s
            all_s = _until(server.began, page, CAMERAS)
    return {"address_s": address_s, "first_s": first_s, "all_s": all_s, "first_cpu_s": cpu_s, "load": load()}


def _until(began: float, page: Any, count: int) -> float:
    while page.evaluate(SHOWN) < count:
        if time.perf_counter() - began > TIMEOUT_S:
            raise TimeoutError(f"{count} pictures")
        time.sleep(0.01)
    return time.perf_counter() - began
