"""Asks an ASGI application without a network and without another package."""

import asyncio
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass


@dataclass
class Answer:
    """What came back."""

    status: int
    headers: dict
    body: bytes

    def json(self):
        """The body's value."""
        return json.loads(self.body)


def request(app, method, path, *, headers=(), body=b"", query="", chunks=None):
    """One request; `headers` are pairs of text. `chunks` are the parts of a body of unstated length."""
    parts = list(chunks) if chunks is not None else [body]
    taken, sent = [], []

    async def receive():
        if not parts:
            return {"type": "http.disconnect"}
        taken.append(parts.pop(0))
        return {"type": "http.request", "body": taken[-1], "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "path": path, "scheme": "http",
        "raw_path": path.encode(), "query_string": query.encode(), "root_path": "", "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 1), "headers": [(name.lower().encode(), value.encode()) for name, value in headers],
    }  # fmt: skip
    # In a thread of its own: a browser that is driven beside has a loop in this one.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, app(scope, receive, send)).result()
    start = next(one for one in sent if one["type"] == "http.response.start")
    content = b"".join(one.get("body", b"") for one in sent if one["type"] == "http.response.body")
    return Answer(start["status"], {name.decode().lower(): value.decode() for name, value in start["headers"]}, content), taken
