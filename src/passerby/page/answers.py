"""What all pages answer alike: their own files, JSON, pictures, and what a request may name."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from passerby.common.errors import InputError
from passerby.page.pictures import PictureStore
from passerby.scene.scene import Scene

TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
Answer = Callable[[Request], Any]


def static_routes(index: str) -> list[Route]:
    """The files of the pages, each read once; `index` names the one that the address itself leads to."""
    folder = resources.files("passerby.page") / "static"
    names = sorted(one.name for one in folder.iterdir() if one.name[one.name.rfind(".") :] in TYPES)
    return [_static(name, "/" if name == index else f"/static/{name}") for name in names]


def _static(name: str, path: str) -> Route:
    content = (resources.files("passerby.page") / "static" / name).read_bytes()
    kind = TYPES[name[name.rfind(".") :]]

    async def answer(_: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(path, answer)


def answering(work: Answer) -> Callable[[Request], Any]:
    """A route's answer as JSON, worked out beside the server's loop."""

    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(work, request))

    return answer


def picture_answer(store: PictureStore, scene: Scene, version: str, name: str, frame: int) -> Response:
    """The picture of a camera that is nearest to a frame. Raises `InputError` where there is none."""
    still = store.known(version, name, frame)
    if still is None:
        with store.turn:
            still = store.still(scene, version, name, frame)
    headers = {"cache-control": "private, max-age=3600", "x-frame": str(still.frame)}
    return Response(still.jpeg, media_type="image/jpeg", headers=headers)


async def bug(_: Request, error: Exception) -> Response:
    """The answer to an unexpected error."""
    return PlainTextResponse("A bug in Passerby; the terminal shows it.\n", 500)


def frame_of(request: Request) -> int:
    """The frame that a request names; 1 where it names none. Raises `InputError` for what is no number."""
    text = request.query_params.get("frame", "1")
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError("frame is no frame number")
    return max(1, int(text))


def asked_frame(request: Request) -> int | None:
    """The same; None where it names none."""
    return frame_of(request) if "frame" in request.query_params else None


def camera_of(request: Request) -> str:
    """The camera that a request names."""
    return request.query_params.get("camera", "")
