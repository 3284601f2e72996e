"""The addresses of the plan: its picture in and out, drafts tried on the rig, and the view from above with its files.

What draws the rig and lays it upon a plan is imported when it is asked for: the first page does not wait for it.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from passerby.common.errors import InputError
from passerby.page.plan_pictures import PlanPictures, plan_path
from passerby.page.plan_upload import MOST_BYTES, keep_plan
from passerby.page.session import Session

if TYPE_CHECKING:
    from passerby.page.plan_view import PlanView, PlanViews

UPLOAD = "/api/plan/upload"
LIMITS = {UPLOAD: MOST_BYTES}
"""Of the bodies that a path takes, bytes."""
SVG_POLICY = "default-src 'none'; img-src data:; sandbox"
"""The saved drawing holds its plan, and nothing in it runs."""


def plan_routes(session: Session) -> list[Route]:
    """All of them."""
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
    """The answers; those that are no coroutines are made in threads."""

    def __init__(self, session: Session) -> None:
        self._session, self._pictures = session, PlanPictures()
        self._views: list[PlanViews] = []

    async def upload(self, request: Request) -> Response:
        """A picture that becomes a file beside the scene file."""
        content = await request.body()
        name = await run_in_threadpool(keep_plan, self._session.scene_file.parent, content)
        return JSONResponse(await run_in_threadpool(self._described, name))

    async def fit(self, request: Request) -> Response:
        """A draft tried on the rig."""
        from passerby.page.plan_fit import try_plan

        try:
            content = json.loads(await request.body() or b"{}")
        except (ValueError, RecursionError):
            raise InputError("the request is not JSON") from None
        return JSONResponse(await run_in_threadpool(try_plan, self._session, self._pictures, content))

    def told(self, request: Request) -> Response:
        """What a browser needs to know of a plan before it shows it."""
        return JSONResponse(self._described(_image(request)))

    def picture(self, request: Request) -> Response:
        """The plan that is placed."""
        shown = self._pictures.shown(plan_path(self._session, _image(request)))
        return Response(shown.data, media_type=shown.media_type)

    def backdrop(self, _: Request) -> Response:
        """The plan that set the frame of the rig."""
        found = self._view().backdrop
        if found is None:
            raise InputError("no plan set the frame of the rig")
        return Response(found.shown.data, media_type=found.shown.media_type)

    def drawn(self, _: Request) -> Response:
        """The view from above, as shapes."""
        from passerby.page.plan_shapes import drawing

        return JSONResponse(drawing(self._view()))

    def svg(self, _: Request) -> Response:
        """The same as a file."""
        from passerby.page.plan_shapes import svg_text

        return _file(svg_text(self._view()), "image/svg+xml", "svg", SVG_POLICY)

    def geojson(self, _: Request) -> Response:
        """What is drawn, in coordinates."""
        from passerby.page.plan_geojson import geojson_text

        return _file(geojson_text(self._view()), "application/geo+json", "geojson")

    def _described(self, image: str | None) -> dict[str, Any]:
        shown = self._pictures.shown(plan_path(self._session, image))
        return {"image": image, "size": list(shown.size)}

    def _view(self) -> PlanView:
        from passerby.page.plan_view import PlanViews

        if not self._views:
            self._views.append(PlanViews(self._session, self._pictures))
        return self._views[0].view()


def _file(text: str, media_type: str, end: str, policy: str = "") -> Response:
    """A file to be saved."""
    headers = {"content-disposition": f'attachment; filename="rig-from-above.{end}"'}
    return Response(text, media_type=media_type, headers=headers | ({"content-security-policy": policy} if policy else {}))


def _image(request: Request) -> str | None:
    """The uploaded plan that is asked for; None for the scene file's."""
    return request.query_params.get("image")
