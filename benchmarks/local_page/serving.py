"""`passerby open` as a user begins it, and a plain client of its addresses."""

from __future__ import annotations

import http.client
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)")
TIMEOUT_S = 600.0  # a busy machine is slow; this only ends a run that hangs


@dataclass(frozen=True)
class Served:
    """A server, and how to reach it."""

    process: subprocess.Popen[str]
    began: float  # `time.perf_counter` before the program was begun
    port: int
    token: str

    @property
    def address(self) -> str:
        """What the user opens."""
        return f"{self.origin}/?token={self.token}"

    @property
    def origin(self) -> str:
        """Of the page's own requests."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def cpu_s(self) -> float:
        """Processor time of the server so far, with that of the calibrations that have ended; Linux only."""
        times = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[11:15]
        return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")

    def ask(self, path: str, content: Any = None) -> tuple[int, Any]:
        """Status and answer of a GET, or of a POST where there is content. Raises `OSError` where the server is gone."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT_S)
        headers = {"cookie": f"passerby-{self.port}={self.token}", "origin": self.origin, "content-type": "application/json"}
        try:
            if content is None:
                client.request("GET", path, headers=headers)
            else:
                client.request("POST", path, json.dumps(content).encode(), headers)
            answer = client.getresponse()
            body = answer.read()
        except http.client.HTTPException as error:
            raise ConnectionError(str(error)) from error
        finally:
            client.close()
        return answer.status, json.loads(body) if answer.headers["content-type"] == "application/json" else body


@contextmanager
def served(opened: Path, out: Path) -> Iterator[Served]:
    """The server of a scene while the block runs."""
    command = [sys.executable, "-m", "passerby", "open", str(opened), "-o", str(out), "--no-browser"]
    began = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = next(filter(None, map(_ADDRESS.search, process.stdout)))
            yield Served(process, began, int(found[1]), found[2])
        finally:
            process.kill()
