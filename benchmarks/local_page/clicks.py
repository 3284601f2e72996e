"""One length, the origin and the x axis by six clicks on the demonstration, and solving again."""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from command import ONE_THREAD, passerby
from local_page.hand import SIZE, Hand, access_faults, against, best_views, chromium, ends_of
from local_page.serving import served
from pages.tables import load
from passerby.interchange.rig_toml import read_rig

NOISE_PX = 2.0
SEEDS = 10


@dataclass(frozen=True)
class ClickCase:
    """A demonstration that was calibrated, and the seed of a hand."""

    demo: Path
    seed: int


def demo_folder(folder: Path) -> Path:
    """The output of `passerby demo`, made once."""
    if not (folder / "out" / "rig.toml").is_file():
        passerby("demo", "-o", str(folder), environment=ONE_THREAD)
    return folder


def cases(demo: Path, seeds: int) -> dict[str, ClickCase]:
    """By key."""
    return {f"hand {seed}": ClickCase(demo, seed) for seed in range(seeds)}


def work(case: ClickCase) -> dict[str, Any]:
    """Mark, set the frame, solve again; plain values."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "demo"
        shutil.copytree(demo_folder(case.demo), folder)
        out, truth = folder / "out", read_rig(folder / "scene" / "truth.toml")
        before, ends = read_rig(out / "rig.toml"), ends_of(truth)
        pair, axis_camera = best_views(before, truth, ends)
        with served(folder / "scene" / "scene.toml", out) as server, chromium() as browser:
            hand = Hand(browser.new_page(viewport=SIZE), np.random.default_rng(case.seed), NOISE_PX)  # type: ignore[arg-type]
            hand.page.goto(server.address)
            hand.until(f"() => document.querySelectorAll('.layer[viewBox]').length === {len(truth)}")
            hand.page.click("[data-tool=length]")
            for name in pair:
                for end in ends:
                    hand.click(truth[name], end)
            hand.until("() => document.getElementById('measured').textContent.includes('residual')")
            hand.page.get_by_label("Length in metres").fill(f"{np.linalg.norm(ends[1] - ends[0]):.3f}")
            hand.save("Save the length")
            hand.page.click("[data-tool=world]")
            for end in ends:
                hand.click(truth[axis_camera], end)
            hand.until("() => document.getElementById('tool').textContent.includes('runs through')")
            hand.save("Save the world frame")
            began, cpu_s = time.perf_counter(), server.cpu_s
            hand.page.get_by_role("button", name="Solve again").click()
            hand.until("() => document.getElementById('run-state').textContent === 'finished'")
            hand.until("() => document.querySelector('#result table thead').textContent.includes('moved m')")
            solving_s, cpu_s = time.perf_counter() - began, server.cpu_s - cpu_s
            faults = access_faults(hand.page)
            foreign = [url for url in hand.asked if not url.startswith(server.origin)]
        scale, heading = against(truth, ends, read_rig(out / "rig.toml"))
        scale_before, _ = against(truth, ends, before)
    return {
        "scale": scale, "scale_before": scale_before, "heading_deg": heading, "clicks": hand.clicks, "solving_s": solving_s,
        "solving_cpu_s": cpu_s, "load": load(),
        "errors": hand.errors, "foreign": foreign, "faults": faults,
    }  # fmt: skip
