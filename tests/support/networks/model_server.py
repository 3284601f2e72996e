"""A server on this computer that serves one small file, well or badly, and a catalogue of models that it serves."""

import hashlib
import re
import threading
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np

from passerby.perception import fetching, model_files
from passerby.perception import networks as catalogue_module
from passerby.perception.networks import ModelEntry, catalogue

BODY = np.random.default_rng(5).bytes(300_000)
SHA256 = hashlib.sha256(BODY).hexdigest()


class Server:
    """What is asked of it (the Range headers, None without one), and how it misbehaves."""

    def __init__(self):
        self.body = BODY
        self.asked = []
        self.ranges = True
        self.breaks_after = []
        """One number of bytes for each answer that breaks off; later answers are whole."""
        self.hold = None
        """An event: after the first half of an answer the server waits for it."""
        self.status = None
        self.location = None
        self.content_range = None
        self.port = 0

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/models/tiny.onnx"

    def answer(self, handler):
        wanted = handler.headers.get("Range")
        self.asked.append(wanted)
        if self.location and handler.path != "/moved":
            handler.send_response(302)
            handler.send_header("Location", self.location)
            handler.end_headers()
            return
        if self.status:
            handler.send_error(self.status)
            return
        start = int(re.fullmatch(r"bytes=(\d+)-", wanted)[1]) if wanted and self.ranges else 0
        if start >= len(self.body):
            handler.send_error(416)
            return
        part = self.body[start:]
        handler.send_response(206 if start else 200)
        handler.send_header("Content-Length", str(len(part)))
        if start:
            whole = f"bytes {start}-{len(self.body) - 1}/{len(self.body)}"
            handler.send_header("Content-Range", self.content_range or whole)
        handler.end_headers()
        if self.breaks_after:
            part = part[: self.breaks_after.pop(0)]
        half = len(part) // 2
        handler.wfile.write(part[:half])
        handler.wfile.flush()
        if self.hold is not None:
            self.hold.wait(600)
        handler.wfile.write(part[half:])


@contextmanager
def serving(monkeypatch):
    """A `Server` that answers until the block ends, and is waited for however long its thread waits for its turn."""
    monkeypatch.setattr(fetching, "ANSWER_S", 600)
    monkeypatch.setattr(fetching, "STALL_S", 600)
    server = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            with suppress(OSError):  # The other side may have gone away.
                server.answer(self)
            self.close_connection = True

        def log_message(self, *arguments):
            pass

    class Quiet(ThreadingHTTPServer):
        daemon_threads = True

    with Quiet(("127.0.0.1", 0), Handler) as listening:
        server.port = listening.server_address[1]
        thread = threading.Thread(target=listening.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            if server.hold is not None:
                server.hold.set()
            listening.shutdown()
            thread.join()


def keep_to(folder, monkeypatch):
    """No user's cache, no proxy, no models of this computer: only `folder`. Returns the cache folder."""
    for name in ("PASSERBY_MODELS", "PASSERBY_OFFLINE", "http_proxy", "https_proxy", "all_proxy", "HTTPS_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("no_proxy", "127.0.0.1,localhost")
    monkeypatch.setattr(model_files.platformdirs, "user_cache_path", lambda *_, **__: folder / "cache")
    return folder / "cache" / "models"


def entry(name, role="detector", url=None, **changes):
    """An entry whose file is the server's."""
    facts = {
        "name": name,
        "role": role,
        "file": f"{name}.onnx",
        "url": url,
        "sha256": SHA256,
        "bytes": len(BODY),
        "licence": "Apache-2.0",
        "publisher": "nobody",
        "output": {"detector": "yolox", "embedder": "embedding", "keypoints": "movenet"}[role],
        "note": "noise",
        "default": role == "detector",
    }
    return ModelEntry.model_validate({**facts, **changes})


def know_only(entries, monkeypatch):
    """Replace the manifest."""
    assert catalogue()
    for module in (catalogue_module, model_files):
        monkeypatch.setattr(module, "catalogue", lambda: tuple(entries))
