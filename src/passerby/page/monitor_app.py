"""The addresses of the page of a monitored rig. The browser names cameras, frames, and one of two recordings."""

from __future__ import annotations

from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from passerby.common.errors import InputError, PasserbyError
from passerby.page.answers import answering, bug, camera_of, frame_of, picture_answer, static_routes
from passerby.page.monitored import MonitoredSession, Source
from passerby.page.security import Guard

SOURCES: dict[str, Source] = {"calibration": "calibration", "footage": "footage"}


def make_monitor_app(session: MonitoredSession, token: str, port: int) -> ASGIApp:
    """The page of a monitored rig, guarded."""
    routes = [
        *static_routes("monitor.html"),
        Route("/api/monitor", answering(lambda _: session.state())),
        Route("/api/views", answering(lambda request: session.views(camera_of(request)))),
        Route("/picture", lambda request: _picture(session, request)),
    ]

    def refused(_: Request, error: Exception) -> Response:
        return JSONResponse({"error": session.public(str(error))}, 422)

    handlers: dict[Any, Any] = {PasserbyError: refused, Exception: bug}
    return Guard(Starlette(routes=routes, exception_handlers=handlers), token, port)


def _picture(session: MonitoredSession, request: Request) -> Response:
    source = SOURCES.get(request.query_params.get("of", ""))
    if source is None:
        raise InputError("of is neither calibration nor footage")
    name, footage = session.checked_name(camera_of(request)), session.footage(source)
    scene, version = footage.scene(name)
    return picture_answer(footage.pictures, scene, version, name, frame_of(request))
