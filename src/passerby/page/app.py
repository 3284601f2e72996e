"""The routes of the page of a scene, of its plan, and of the page of a monitored rig.

The modules that draw the rig and align it to a plan are imported at the first request for them, so the page opens sooner.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from passerby.calibration.alignment.lengths import measure_length
from passerby.calibration.alignment.lines import MarkedLine, measure_line
from passerby.common.errors import InputError, PasserbyError
from passerby.core.observations import Boxes
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.output_folder import REPORT_FILE, REPORT_STAMP, TRACKS_FOLDER, report_folder
from passerby.page.acts import perform
from passerby.page.geometry import IdentifiedPeople, epipolar_lines, ground_point, measure_axis
from passerby.page.monitored import MonitoredSession, Source
from passerby.page.plan_pictures import MOST_BYTES, PlanPictures, keep_plan, plan_path
from passerby.page.requests import Frame, Name, Pixel, read_as
from passerby.page.security import Guard, answering, asked_frame, bug, camera_of, frame_of, picture_answer, static_routes
from passerby.page.session import Session, StaleError

if TYPE_CHECKING:
    from passerby.page.plan_view import PlanView, PlanViews

REPORT_POLICY = "sandbox allow-scripts; frame-ancestors 'self'"
"""The report contains a policy of its own; this header isolates it from the page and from the page's cookie."""
PARTS_PATH = "/report_files/"
"""Path of the files beside the report, relative to the report at /report."""
PART_NAME = re.compile(r"[a-z0-9-]+\.js")
PREPARED = 24
"""Number of cameras whose first picture is decoded before a browser requests it."""
UPLOAD = "/api/plan/upload"
LIMITS = {UPLOAD: MOST_BYTES}
"""Largest size of a request's body, by path, bytes."""
SVG_POLICY = "default-src 'none'; img-src data:; sandbox"
"""Policy of the saved drawing: its plan is embedded, and no script runs."""
SOURCES: dict[str, Source] = {"calibration": "calibration", "footage": "footage"}


def make_app(session: Session, token: str, port: int) -> ASGIApp:
    """Return the app of a session's page with its access control."""
    people = IdentifiedPeople(session.out)
    routes = [
        *static_routes("index.html"),
        Route("/api/state", answering(lambda _: session.state())),
        Route("/api/check", answering(lambda _: session.check())),
        Route("/api/people", answering(lambda request: _people(session, camera_of(request), asked_frame(request)))),
        Route("/picture", lambda request: _picture(session, request)),
        Route("/report", lambda request: _report(session, request)),
        Route(f"{PARTS_PATH}{{stamp}}/{{name}}", lambda request: _report_part(session, request)),
        *plan_routes(session),
        _route_post("/api/act", session, lambda content: perform(session, content)),
        _route_post("/api/epipolar", session, lambda content: _epipolar(session, content)),
        _route_post("/api/length", session, lambda content: _length(session, content)),
        _route_post("/api/ground", session, lambda content: _ground(session, content)),
        _route_post("/api/axis", session, lambda content: _axis(session, content)),
        _route_post("/api/line", session, lambda content: _line(session, content)),
        _route_post("/api/person", session, lambda content: _person(people, content)),
        _route_post("/api/start", session, lambda content: session.work.start(session.scene_file, session.version)),
        _route_post("/api/stop", session, lambda content: session.work.stop()),
    ]
    handlers: dict[Any, Any] = {PasserbyError: lambda _, error: _answer_error(session, error), Exception: bug}
    return Guard(Starlette(routes=routes, exception_handlers=handlers), token, port, LIMITS, open_below=PARTS_PATH)


def _route_post(path: str, session: Session, work: Callable[[Any], Any]) -> Route:
    """Return a route that passes JSON of a browser to `work`. If `work` returns None, the answer is the new state."""

    async def answer(request: Request) -> Response:
        try:
            content = json.loads(await request.body() or b"{}")
        except (ValueError, RecursionError):
            raise InputError("the request is not JSON") from None
        found = await run_in_threadpool(work, content)
        return JSONResponse(await run_in_threadpool(session.state) if found is None else found)

    return Route(path, answer, methods=["POST"])


def _answer_error(session: Session, error: Exception) -> Response:
    """Answer with an error that a user can correct, without the folders of this machine."""
    return JSONResponse({"error": session.public(str(error))}, 409 if isinstance(error, StaleError) else 422)


def _picture(session: Session, request: Request) -> Response:
    name = camera_of(request)
    scene, version = session.camera(name)
    return picture_answer(session.pictures, scene, version, name, frame_of(request))


def prepare_pictures(session: Session) -> None:
    """Decode the first pictures of the page while the browser starts, so that they are in memory when it requests them."""
    names: list[str] = []
    with suppress(PasserbyError):
        names += session.scene()[0].cameras
    for name in names[:PREPARED]:
        with suppress(PasserbyError):  # the browser's own request reports the error
            _people(session, name, None)


def _people(session: Session, name: str, asked: int | None) -> dict[str, Any]:
    """Return the picture nearest to a frame and its boxes; without a frame, those of the frame with most people."""
    scene, version = session.camera(name)
    path = session.out / TRACKS_FOLDER / f"{name}.txt"
    boxes = read_boxes(path) if path.is_file() else Boxes.empty()
    frames, counts = np.unique(boxes.frame, return_counts=True)
    first, last = (int(frames[0]), int(frames[-1])) if len(frames) else (1, 1)
    told: dict[str, Any] = {"size": None, "why": None, "fps": scene.fps_of(name)}
    info = None
    if asked is None and len(frames):
        asked = int(frames[np.argmax(counts)])
    with session.pictures.turn:
        try:
            info = session.pictures.video(scene, version, name)
            first = 1 + round(info.begin_s * info.clock_fps)
            last = max(last, first, round((info.end_s or 0.0) * info.clock_fps))
            told |= {"size": list(info.size), "fps": told["fps"] or info.clock_fps}
        except InputError as error:
            told["why"] = session.public(str(error))
        frame = first if asked is None else asked
        try:
            frame = frame if info is None else session.pictures.still(scene, version, name, frame).frame
        except InputError as error:
            told["why"] = session.public(str(error))
    if info is None and len(frames):
        frame = int(frames[np.argmin(np.abs(frames - frame))])
    return {**told, "frame": frame, "first": first, "last": last, "boxes": boxes.ltwh[boxes.frame == frame].round(1).tolist()}


def _report(session: Session, request: Request) -> Response:
    path = session.out / REPORT_FILE
    try:
        return Response(path.read_bytes(), media_type="text/html", headers={"content-security-policy": REPORT_POLICY})
    except OSError:
        return PlainTextResponse("There is no report yet.\n", 404)


def _report_part(session: Session, request: Request) -> Response:
    """Return a file beside the report of many cameras. The sandboxed report sends no cookie: the stamp in the address, which
    cannot be guessed, shows that the client has read the report.
    """
    stamp, name = request.path_params["stamp"], request.path_params["name"]
    path = report_folder(session.out / REPORT_FILE) / stamp / name
    if REPORT_STAMP.fullmatch(stamp) and PART_NAME.fullmatch(name):
        with suppress(OSError):
            headers = {"cross-origin-resource-policy": "cross-origin", "cache-control": "private, max-age=3600"}
            return Response(path.read_bytes(), media_type="text/javascript", headers=headers)
    return PlainTextResponse("There is no such file.\n", 404)


def _epipolar(session: Session, content: Any) -> dict[str, Any]:
    asked = read_as(tuple[Name, Pixel], [content.get("camera"), content.get("at")] if isinstance(content, dict) else content)
    session.work.prepare()
    return {"lines": [asdict(one) for one in epipolar_lines(session.rig(), *asked)]}


def _length(session: Session, content: Any) -> dict[str, Any]:
    marks = Annotated[dict[Name, tuple[Pixel, Pixel]], Field(min_length=2, max_length=1000)]
    return asdict(measure_length(session.rig(), read_as(marks, content)))


def _ground(session: Session, content: Any) -> dict[str, Any]:
    camera, at = read_as(
        tuple[Name, Pixel], [content.get("camera"), content.get("at")] if isinstance(content, dict) else content
    )
    session.work.prepare()
    return {"ground": ground_point(session.rig(), camera, at).round(4).tolist()}


def _line(session: Session, content: Any) -> dict[str, Any]:
    direction, points = read_as(
        tuple[Literal["vertical", "horizontal", "x"], Annotated[dict[Name, tuple[Pixel, Pixel]], Field(min_length=1)]],
        [content.get("direction"), content.get("points")] if isinstance(content, dict) else content,
    )
    found = measure_line(session.rig(), MarkedLine(direction, points))
    return {"off_deg": None} if found is None else asdict(found)


def _person(people: IdentifiedPeople, content: Any) -> dict[str, Any]:
    asked = [content.get(key) for key in ("camera", "frame", "at")] if isinstance(content, dict) else content
    return people.find(*read_as(tuple[Name, Frame, Pixel], asked)).to_dict()


def _axis(session: Session, content: Any) -> dict[str, Any]:
    return asdict(measure_axis(session.rig(), read_as(tuple[tuple[Name, Pixel], tuple[Name, Pixel]], content)))


def plan_routes(session: Session) -> list[Route]:
    """Return all routes of the plan and of the view from above."""
    plan = _Plan(session)
    return [
        Route(UPLOAD, plan.upload, methods=["POST"]),
        Route("/api/plan/fit", plan.fit, methods=["POST"]),
        Route("/api/plan/picture", plan.told),
        Route("/api/plan/view", plan.drawn),
        Route("/plan", plan.picture),
        Route("/plan/backdrop", plan.backdrop),
        Route("/plan/view.svg", plan.svg),
        Route("/plan/view.geojson", plan.geojson),
    ]


class _Plan:
    """The answers of the plan's routes. The server runs the methods that are not coroutines in threads."""

    def __init__(self, session: Session) -> None:
        self._session, self._pictures = session, PlanPictures()
        self._views: list[PlanViews] = []

    async def upload(self, request: Request) -> Response:
        """Write an uploaded picture to a file beside the scene file."""
        content = await request.body()
        name = await run_in_threadpool(keep_plan, self._session.scene_file.parent, content)
        return JSONResponse(await run_in_threadpool(self._describe_state, name))

    async def fit(self, request: Request) -> Response:
        """Try a draft on the rig."""
        from passerby.page.plan_acts import try_plan

        try:
            content = json.loads(await request.body() or b"{}")
        except (ValueError, RecursionError):
            raise InputError("the request is not JSON") from None
        return JSONResponse(await run_in_threadpool(try_plan, self._session, self._pictures, content))

    def told(self, request: Request) -> Response:
        """Return the name and size of a plan, which a browser needs before it shows the plan."""
        return JSONResponse(self._describe_state(_image(request)))

    def picture(self, request: Request) -> Response:
        """Return the picture of the uploaded plan, or of the scene file's."""
        shown = self._pictures.shown(plan_path(self._session, _image(request)))
        return Response(shown.data, media_type=shown.media_type)

    def backdrop(self, _: Request) -> Response:
        """Return the picture of the plan that defines the world frame of the rig."""
        found = self._view().backdrop
        if found is None:
            raise InputError("no plan set the frame of the rig")
        return Response(found.shown.data, media_type=found.shown.media_type)

    def drawn(self, _: Request) -> Response:
        """Return the view from above as shapes."""
        from passerby.page.plan_shapes import drawing

        return JSONResponse(drawing(self._view()))

    def svg(self, _: Request) -> Response:
        """Return the view from above as an SVG file."""
        from passerby.page.plan_shapes import svg_text

        return _file(svg_text(self._view()), "image/svg+xml", "svg", SVG_POLICY)

    def geojson(self, _: Request) -> Response:
        """Return the view from above as a GeoJSON file."""
        from passerby.page.plan_shapes import geojson_text

        return _file(geojson_text(self._view()), "application/geo+json", "geojson")

    def _describe_state(self, image: str | None) -> dict[str, Any]:
        shown = self._pictures.shown(plan_path(self._session, image))
        return {"image": image, "size": list(shown.size)}

    def _view(self) -> PlanView:
        from passerby.page.plan_view import PlanViews

        if not self._views:
            self._views.append(PlanViews(self._session, self._pictures))
        return self._views[0].view()


def _file(text: str, media_type: str, end: str, policy: str = "") -> Response:
    """Return a response that a browser saves as a file."""
    headers = {"content-disposition": f'attachment; filename="rig-from-above.{end}"'}
    return Response(text, media_type=media_type, headers=headers | ({"content-security-policy": policy} if policy else {}))


def _image(request: Request) -> str | None:
    """Return the name of the uploaded plan that a request names; None for the scene file's plan."""
    return request.query_params.get("image")


def make_monitor_app(session: MonitoredSession, token: str, port: int) -> ASGIApp:
    """Return the app of a monitored rig's page with its access control."""
    routes = [
        *static_routes("monitor.html"),
        Route("/api/monitor", answering(lambda _: session.state())),
        Route("/api/views", answering(lambda request: session.views(camera_of(request)))),
        Route("/picture", lambda request: _answer_monitor_picture(session, request)),
    ]

    def refused(_: Request, error: Exception) -> Response:
        return JSONResponse({"error": session.public(str(error))}, 422)

    handlers: dict[Any, Any] = {PasserbyError: refused, Exception: bug}
    return Guard(Starlette(routes=routes, exception_handlers=handlers), token, port)


def _answer_monitor_picture(session: MonitoredSession, request: Request) -> Response:
    source = SOURCES.get(request.query_params.get("of", ""))
    if source is None:
        raise InputError("of is neither calibration nor footage")
    name, footage = session.checked_name(camera_of(request)), session.footage(source)
    scene, version = footage.scene(name)
    return picture_answer(footage.pictures, scene, version, name, frame_of(request))
