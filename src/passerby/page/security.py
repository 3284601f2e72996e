"""Access control of the pages, and the answers that all pages share.

Any web site that a user visits can send requests to 127.0.0.1, and can make a host name of its own resolve to it (DNS
rebinding). So `Host` must be this server's, `Origin` must be this page's, and the cookie must contain the token; requests of
other sites do not carry the cookie.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Mapping
from http.cookies import CookieError, SimpleCookie
from importlib import resources
from typing import Any
from urllib.parse import parse_qs

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from passerby.common.errors import InputError
from passerby.page.pictures import PictureStore
from passerby.scene.scene import Scene

MOST_BYTES = 64 * 1024
"""Largest size of a request's body: an act has a few hundred bytes. A path may have its own limit, for example for uploads."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; frame-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
CLOSED = "This page is opened by the address that `passerby open` prints.\n"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
Answer = Callable[[Request], Any]


class Guard:
    """Refuses requests that do not come from the opened page, and limits their size."""

    def __init__(
        self, app: ASGIApp, token: str, port: int, limits: Mapping[str, int] | None = None, open_below: str | None = None
    ) -> None:
        """Guard an app. Paths that begin with `open_below` need no token, because their addresses cannot be guessed."""
        self._app, self._token, self._limits, self._open_below = app, token, dict(limits or {}), open_below
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._cookie = f"passerby-{port}"  # browsers store cookies by host, not by port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request: refuse it, or pass it to the app."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = list(message.get("headers", []))
                present = {name.lower() for name, _ in own}
                own += [(name.encode(), value.encode()) for name, value in HEADERS.items() if name.encode() not in present]
                message = {**message, "headers": own}
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None and scope["method"] == "POST":
            most = self._limits.get(scope["path"], MOST_BYTES)
            body = await _body(scope, receive, most)
            if body is None:
                told = f"The request is too large: it may have {most / 1e6:.3g} MB.\n"
                refusal = PlainTextResponse(told, 413, {"connection": "close"})
            else:
                receive = _replay_body(body)
        await (refusal or self._app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> PlainTextResponse | RedirectResponse | None:
        """Return the answer to a refused request or to one that brings the token; None for an admitted request."""
        headers = _read_headers(scope["headers"])
        if headers.get("host") not in self._hosts:
            return PlainTextResponse("Unknown host.\n", 421)
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return PlainTextResponse("Not allowed.\n", 405)
        origin, own = headers.get("origin"), f"http://{headers['host']}"
        is_open = self._open_below is not None and scope["path"].startswith(self._open_below) and scope["method"] == "GET"
        # A sandboxed document, such as the report, has the origin "null".
        if origin != own and (origin is not None or scope["method"] == "POST") and not (is_open and origin == "null"):
            return PlainTextResponse("Another site may not ask for this.\n", 403)
        if scope["path"] == "/" and scope["method"] == "GET":
            given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
            if given and self._is_token(given):
                answer = RedirectResponse("/", 303)
                answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
                return answer
        if is_open:
            return None
        if not self._is_token(_cookie(headers.get("cookie", ""), self._cookie)):
            return PlainTextResponse(CLOSED, 403)
        return None

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode("utf-8", "replace"), self._token.encode())


def _read_headers(headers: Iterable[tuple[bytes, bytes]]) -> dict[str, str]:
    """Return the headers by name. A header that occurs twice is empty, so no check accepts it."""
    found: dict[str, str] = {}
    for name, value in headers:
        key = name.decode("latin-1").lower()
        found[key] = "" if key in found else value.decode("latin-1")
    return found


def _cookie(header: str, name: str) -> str:
    try:
        morsel = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


async def _body(scope: Scope, receive: Receive, most: int) -> bytes | None:
    """Read a request's body; None for a body of more than `most` bytes, whose rest is not read."""
    stated = _read_headers(scope["headers"]).get("content-length")
    if stated is not None and not (stated.isdigit() and len(stated) < 10 and int(stated) <= most):
        return None
    body, more = bytearray(), True
    while more:
        message = await receive()
        if message["type"] != "http.request":
            return None
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > most:
            return None
    return bytes(body)


def _replay_body(body: bytes) -> Receive:
    """Return a `receive` function that delivers a body that was already read."""
    messages: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Message:
        return messages.pop() if messages else {"type": "http.disconnect"}

    return receive


def static_routes(index: str) -> list[Route]:
    """Return the routes of the pages' files, each read once; `index` is the file at the address `/`."""
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
    """Return a route's function that computes its answer in a thread, outside the server's event loop, and sends it as JSON."""

    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(work, request))

    return answer


def picture_answer(store: PictureStore, scene: Scene, version: str, name: str, frame: int) -> Response:
    """Return the picture of a camera at a frame or the nearest before. Raises `InputError` if there is none."""
    still = store.known(version, name, frame)
    if still is None:
        with store.turn:
            still = store.still(scene, version, name, frame)
    headers = {"cache-control": "private, max-age=3600", "x-frame": str(still.frame)}
    return Response(still.jpeg, media_type="image/jpeg", headers=headers)


async def bug(_: Request, error: Exception) -> Response:
    """Answer an unexpected error."""
    return PlainTextResponse("A bug in Passerby; the terminal shows it.\n", 500)


def frame_of(request: Request) -> int:
    """Return the frame that a request names; 1 if it names none. Raises `InputError` if it is not a number."""
    text = request.query_params.get("frame", "1")
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError("frame is no frame number")
    return max(1, int(text))


def asked_frame(request: Request) -> int | None:
    """Return the frame that a request names; None if it names none. Raises as `frame_of` does."""
    return frame_of(request) if "frame" in request.query_params else None


def camera_of(request: Request) -> str:
    """Return the camera that a request names; empty if it names none."""
    return request.query_params.get("camera", "")
