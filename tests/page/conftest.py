"""A scene of four cameras with its true rig in the output folder, calibrated boxes to click on, clients, and served pages."""

import json
import re
import shutil
import subprocess
import sys
import tomllib

import cv2
import numpy as np
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


@pytest.fixture(scope="session")
def calibrated_once(tmp_path_factory):
    """A scene of boxes and its calibration; its people are said to be of usual height, so that something is left to be marked.

    Processes of their own: this one drives a browser."""
    folder = tmp_path_factory.mktemp("clicks")
    options = ["--people", "6", "--seconds", "20", "--box-noise", "0.02", "--seed", "5", "--person-height-mean-m", "1.80"]
    scene = folder / "scene" / "scene.toml"
    passerby = [sys.executable, "-m", "passerby"]
    subprocess.run([*passerby, "simulate", "-o", str(scene.parent), *options], check=True, capture_output=True)
    scene.write_text(re.sub(r"(?m)^person_height.*\n", "", scene.read_text()))
    command = [*passerby, "calibrate", str(scene), "-o", str(folder / "out"), "--no-report"]
    subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture
def folder(calibrated_once, tmp_path):
    """A copy of the calibrated scene: the folders `scene` and `out`."""
    return shutil.copytree(calibrated_once, tmp_path / "copy")


class Client:
    """A browser that was opened with the token."""

    def __init__(self, session):
        self.app = make_app(session, TOKEN, PORT)

    def get(self, path, query="", **headers):
        return self.ask("GET", path, query=query, **headers)[0]

    def post(self, path, body=b"{}", **headers):
        """The answer to bytes, or to a value as JSON."""
        body = body if isinstance(body, bytes) else json.dumps(body).encode()
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
    """Serves what is opened by the program itself, a process of `servers`; gives the address."""
    servers = []

    def serve(*opened):
        command = [sys.executable, "-m", "passerby", "open", *map(str, opened), "--no-browser"]
        servers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        found = (re.search(r"http://127.0.0.1:\d+/\S+", line) for line in servers[-1].stdout)
        return next(filter(None, found)).group()

    serve.servers = servers
    yield serve
    for server in servers:
        server.terminate()
        server.communicate()


def act(client, session, version=None, **content):
    """The answer to an act, on the scene file as it is or as it was seen."""
    return client.post("/api/act", {"version": session.version if version is None else version, **content})


def refusal(answer):
    """What a refused request gets as its reason."""
    assert answer.status == 422
    return answer.json()["error"]


def scene_of(session):
    return tomllib.loads(session.scene_file.read_text())


def middle(rig):
    """Amid the cameras, on the ground."""
    return np.mean([camera.centre for camera in rig], axis=0) * [1, 1, 0]


def decoded(data):
    """The colours of a picture file."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def listen(page, but=None):
    """A list that gets every error of the page's console, but those with a word, and of its scripts."""
    errors = []

    def hear(said):
        if said.type == "error" and (but is None or but not in said.text):
            errors.append(said.text)

    page.on("console", hear)
    page.on("pageerror", lambda error: errors.append(str(error)))
    return errors


UNIT, MARGIN_M = 0.02, 2.0
"""Of a drawn plan: metres per pixel, and metres around the cameras."""


class DrawnPlan:
    """A plan that shows the world of a true rig, whose axes run to its right and up."""

    def __init__(self, truth):
        centres = np.array([camera.centre[:2] for camera in truth])
        self.truth = truth
        self.corner = np.array([centres[:, 0].min() - MARGIN_M, centres[:, 1].max() + MARGIN_M])
        self.size = tuple(np.ceil((np.ptp(centres, axis=0) + 2 * MARGIN_M) / UNIT).astype(int).tolist())

    @property
    def png(self):
        return cv2.imencode(".png", np.full((*self.size[::-1], 3), 235, np.uint8))[1].tobytes()

    def pixel(self, place):
        """Of a place in the world."""
        return ((np.asarray(place)[:2] - self.corner) * (1, -1) / UNIT - 0.5).round(2).tolist()

    def cameras(self, *names):
        return {name: self.pixel(self.truth[name].centre) for name in names}

    def point(self, place, *names):
        """A point of the ground, on the plan and in cameras."""
        pixels = {name: self.truth[name].project(place)[0].round(2).tolist() for name in names}
        return {"at": self.pixel(place), "pixels": pixels}
