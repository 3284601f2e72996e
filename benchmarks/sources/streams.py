"""Films served by network cameras on loopback, recorded and calibrated, against files of what the cameras filmed."""

from __future__ import annotations

import json
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

from command import ONE_THREAD, passerby
from sources.recorded_films import BEGIN, METHOD, SECONDS, calibrated, coded_films, cut, names_of, scene_of
from sources.stream_servers import Film, rtsp_camera

LATEST_S = 60.0  # the last camera is switched on so much after the first, the others between them
BREAKS = (0.35, 0.6, 0.85)  # of the film: when the second camera closes its connections
CLOCK_OFF_S = 2.0  # of the third camera
ENDS_EARLY_S = 4.0  # the recording ends before the film does, however long the program takes to start
LOGIN = "keeper:t0psecret"
FILES, STREAMS = "files", "streams"


@dataclass(frozen=True)
class StreamsCase:
    """The films in `film` as files from when each camera is switched on, or as streams."""

    kind: str
    film: Path
    seconds: float = SECONDS
    latest_s: float = LATEST_S

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras."""
        return names_of(self.film)

    @property
    def on_s(self) -> dict[str, float]:
        """Second of the film at which each camera is switched on."""
        last = len(self.names) - 1
        return {name: self.latest_s * number / last for number, name in enumerate(self.names)}

    @property
    def breaks_s(self) -> dict[str, tuple[float, ...]]:
        """Seconds of the film at which each camera's connection breaks."""
        return {self.names[1]: tuple(self.seconds * share for share in BREAKS)}

    @property
    def clocks_off_s(self) -> dict[str, float]:
        """How much more each camera's clock shows."""
        return {self.names[2]: CLOCK_OFF_S}


def cases(scenes: Path) -> dict[str, StreamsCase]:
    """By key, the files first."""
    film = coded_films(scenes)
    return {kind: StreamsCase(kind, film) for kind in (FILES, STREAMS)}


def work(case: StreamsCase) -> dict[str, Any]:
    """The rig and the clock offsets against the truth: plain values."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if case.kind == FILES:
            for name in case.names:
                _file(case, name, folder)
            scene = scene_of(case.film, {name: name for name in case.names}, folder)
            return {"about": {"text": "files"}, **calibrated(scene, case.film, {})}
        recording = _recorded(case, folder)
        scene = folder / "site" / "scene.toml"
        scene.write_text(f"{scene.read_text(encoding='utf-8')}\n{METHOD}", encoding="utf-8")
        found = calibrated(scene, case.film, case.clocks_off_s)
        return {"about": {"text": "streams"}, "recording": recording, **found, "cpu_s": found["cpu_s"] + recording["cpu_s"]}


def _file(case: StreamsCase, name: str, folder: Path) -> None:
    """One file of all that a camera films, its wall time in its name."""

    def path_of(second: float) -> Path:
        begin = BEGIN + timedelta(seconds=second)
        return folder / name / f"{begin:%Y%m%dT%H%M%S}.{begin.microsecond // 1000:03}Z.mkv"

    video = case.film / "coded" / f"{name}.mp4"
    cut(video, 2 * case.seconds, path_of, case.on_s[name])


def _recorded(case: StreamsCase, folder: Path) -> dict[str, Any]:
    """What `passerby record` says of the streams, which it records into `folder/site`."""
    text, intrinsics = "", f'intrinsics = "{(case.film / "intrinsics.toml").as_posix()}"\n'
    with ExitStack() as servers:
        films = {name: Film.read(case.film / "coded" / f"{name}.mp4") for name in case.names}
        began = time.time()
        for name, film in films.items():
            port, _ = servers.enter_context(
                rtsp_camera(
                    film, password=LOGIN, began=began, on_s=case.on_s[name], breaks_s=case.breaks_s.get(name, ()),
                    clock_off_s=case.clocks_off_s.get(name, 0.0),
                )
            )  # fmt: skip
            text += f'[cameras.{name}]\nstream = "rtsp://{LOGIN}@127.0.0.1:{port}/live"\n{intrinsics}'
        (folder / "cameras.toml").write_text(text, encoding="utf-8")
        run = passerby(
            "record", str(folder / "cameras.toml"), "-o", str(folder / "site"), "--json", "--without-missing",
            "--seconds", f"{case.seconds - ENDS_EARLY_S:g}", environment=ONE_THREAD,
        )  # fmt: skip
    return _about(run.output, began) | {"cpu_s": run.cpu_seconds}


def _about(output: str, began: float) -> dict[str, Any]:
    """Of each camera: seconds after the film's beginning at which its recording begins, its length, its gaps and its clock."""
    found = json.loads(output)
    return {
        "cameras": {
            camera["name"]: {
                "begin_s": camera["pieces"][0]["begin"] - began if camera["pieces"] else None,
                "seconds": camera["seconds"],
                "gaps_s": [gap["until"] - gap["from"] for gap in camera["gaps"]],
                "clock": camera["clock"],
            }
            for camera in found["cameras"]
        }
    }
