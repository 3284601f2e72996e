"""Who may ask the page for anything, and what all pages answer alike.

Any web site that a user visits can send requests to 127.0.0.1, and a name of its own can lead there (DNS rebinding). So `Host`
must be this server's, `Origin` this page's, and the cookie, which no other site's requests carry, must hold the token.
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
"""Of a request's body: an act is a few hundred bytes. A path may have its own limit, as that of an upload has."""
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
    """Turns away what does not come from the opened page, and limits what it may send."""

    def __init__(
        self, app: ASGIApp, token: str, port: int, limits: Mapping[str, int] | None = None, open_below: str | None = None
    ) -> None:
        """Guard an app; below `open_below` no token is needed: its addresses cannot be guessed."""
        self._app, self._token, self._limits, self._open_below = app, token, dict(limits or {}), open_below
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._cookie = f"passerby-{port}"  # browsers keep cookies by host, whatever the port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
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
        """The answer to a request that is not let in, or that brings the token; None for one that is."""
        headers = _read_headers(scope["headers"])
        if headers.get("host") not in self._hosts:
            return PlainTextResponse("Unknown host.\n", 421)
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return PlainTextResponse("Not allowed.\n", 405)
        origin, own = headers.get("origin"), f"http://{headers['host']}"
        is_open = self._open_below is not None and scope["path"].startswith(self._open_below) and scope["method"] == "GET"
        # What runs apart from the page, as the report does, has the origin "null".
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
    """Headers by name; one that comes twice is empty, and so fits nothing."""
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
    """A request's body; None for one of more than `most` bytes, whose rest is not read."""
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
    """A body that was read already."""
    messages: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Message:
        return messages.pop() if messages else {"type": "http.disconnect"}

    return receive


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
