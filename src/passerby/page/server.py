"""Selection of the page that `passerby open` shows, and its server on the address of the local machine.

The address is printed and the browser is started before the modules of the page are imported: in the meantime the browser's
requests wait in the listening socket.
"""

from __future__ import annotations

import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from starlette.types import ASGIApp

HOST = "127.0.0.1"
DEFAULT_OUT = "out"


@dataclass(frozen=True)
class Opened:
    """A scene and its output folder, which a page shows."""

    scene_file: Path
    out: Path
    """The output folder."""

    def __str__(self) -> str:
        return f"scene {self.scene_file}, results in {self.out}"


@dataclass(frozen=True)
class OpenedMonitoring:
    """A folder of `passerby monitor`, which a page shows."""

    folder: Path

    def __str__(self) -> str:
        return f"monitored rig in {self.folder}"


def find_opened(opened: Path, out: Path | None = None) -> Opened | OpenedMonitoring:
    """Find the scene and the output folder, or the monitored rig, for a path.

    Args:
        opened: an output folder of a calibration or of `passerby monitor`, a scene file, or a folder of videos. If a folder of
            videos has no scene file, one is written.
        out: the output folder; default: the opened one, or `out` beside the scene file.

    Raises:
        InputError: nothing at the path can be opened.
    """
    if opened.is_file():
        return Opened(opened, out or opened.absolute().parent / DEFAULT_OUT)
    if not opened.is_dir():
        raise InputError(f"{opened}: no such file or folder: give an output folder, a scene file or a folder of videos")
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.output_folder import read_report, scene_of

    if (opened / CALIBRATION_FILE).is_file():
        remedy = f"open the scene file instead: passerby open SCENE -o {opened}"
        return Opened(scene_of(opened, read_report(opened), remedy), out or opened)
    from passerby.interchange.monitor_json import MONITOR_FILE, read_monitor

    if (opened / MONITOR_FILE).is_file():
        if out is not None:
            raise InputError(f"{opened}: holds what `passerby monitor` found, which is shown as it is: leave out --out")
        read_monitor(opened)
        return OpenedMonitoring(opened)
    from passerby.scene.start.start import SCENE_FILE, start

    scene = opened / SCENE_FILE
    if not scene.exists():
        start(opened)
    return Opened(scene, out or opened / DEFAULT_OUT)


def serve(opened: Opened | OpenedMonitoring, port: int, tell: Callable[[str], None], *, browser: bool) -> None:
    """Serve a page until the process is interrupted.

    Args:
        opened: the scene or the monitored rig to show.
        port: 0 for any free port.
        tell: called with the page's address as soon as a browser can open it.
        browser: whether to open the page in the user's browser.

    Raises:
        InputError: the port is not free.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise InputError(f"port {port} cannot be used ({error.strerror or error}): give another --port, or none") from None
    number = listener.getsockname()[1]
    token = secrets.token_urlsafe(32)
    address = f"http://{HOST}:{number}/?token={token}"
    tell(address)
    if browser:
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    _listen(opened, listener, token)


def _listen(opened: Opened | OpenedMonitoring, listener: socket.socket, token: str) -> None:
    """Answer requests until the process is interrupted."""
    import uvicorn

    port = listener.getsockname()[1]
    app = _monitor_app(opened, token, port) if isinstance(opened, OpenedMonitoring) else _app(opened, token, port)
    config = uvicorn.Config(
        app, log_level="error", access_log=False, server_header=False, lifespan="off",
        limit_concurrency=200, timeout_keep_alive=5,
    )  # fmt: skip
    uvicorn.Server(config).run(sockets=[listener])


def _app(opened: Opened, token: str, port: int) -> ASGIApp:
    from passerby.page.app import make_app, prepare_pictures
    from passerby.page.session import Session

    session = Session(opened.scene_file, opened.out, serves=True)
    threading.Thread(target=prepare_pictures, args=(session,), daemon=True).start()
    return make_app(session, token, port)


def _monitor_app(opened: OpenedMonitoring, token: str, port: int) -> ASGIApp:
    from passerby.page.app import make_monitor_app
    from passerby.page.monitored import MonitoredSession

    return make_monitor_app(MonitoredSession(opened.folder), token, port)
