"""A scene of four cameras with its true rig in the output folder: nothing needs to be calibrated."""

import json
import re
import shutil
import subprocess
import sys
import tomllib

import pytest

from passerby.cli.main import run
from passerby.page.app import make_app
from passerby.page.session import Session
from support.asgi_client import request

PORT, TOKEN = 8123, "the-token"
HOST = f"127.0.0.1:{PORT}"


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page") / "scene"
    assert run(["simulate", "-o", str(folder), "--people", "3", "--seconds", "4"]) == 0
    return folder


@pytest.fixture
def session(simulated, tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(simulated, scene)
    (tmp_path / "out").mkdir()
    shutil.copyfile(scene / "truth.toml", tmp_path / "out" / "rig.toml")
    return Session(scene / "scene.toml", tmp_path / "out")


class Client:
    """A browser that was opened with the token."""

    def __init__(self, session):
        self.app = make_app(session, TOKEN, PORT)

    def get(self, path, query="", **headers):
        return self.ask("GET", path, query=query, **headers)[0]

    def post(self, path, body=b"{}", **headers):
        return self.ask("POST", path, body=body, **{"origin": f"http://{HOST}", **headers})[0]

    def ask(self, method, path, *, query="", body=b"", chunks=None, **headers):
        told = {"host": HOST, "cookie": f"passerby-{PORT}={TOKEN}", **headers}
        pairs = [(name.replace("_", "-"), value) for name, value in told.items() if value is not None]
        return request(self.app, method, path, headers=pairs, body=body, query=query, chunks=chunks)


@pytest.fixture
def client(session):
    return Client(session)


@pytest.fixture
def served():
    """Serves what is opened by the program itself; gives the address."""
    servers = []

    def serve(opened):
        command = [sys.executable, "-m", "passerby", "open", str(opened), "--no-browser"]
        servers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        found = (re.search(r"http://127.0.0.1:\d+/\S+", line) for line in servers[-1].stdout)
        return next(filter(None, found)).group()

    yield serve
    for server in servers:
        server.terminate()
        server.communicate()


def act(client, session, version=None, **content):
    """The answer to an act, on the scene file as it is or as it was seen."""
    body = {"version": session.version if version is None else version, **content}
    return client.post("/api/act", json.dumps(body).encode())


def scene_of(session):
    return tomllib.loads(session.scene_file.read_text())
