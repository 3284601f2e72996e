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
    pictures = PlanPictures()
    views = list["PlanViews"]()

    def view() -> PlanView:
        from passerby.page.plan_view import PlanViews

        if not views:
            views.append(PlanViews(session, pictures))
        return views[0].view()

    def drawn(_: Request) -> Response:
        from passerby.page.plan_shapes import drawing

        return JSONResponse(drawing(view()))

    def svg(_: Request) -> Response:
        from passerby.page.plan_shapes import svg_text

        return _file(svg_text(view()), "image/svg+xml", "svg", SVG_POLICY)

    def geojson(_: Request) -> Response:
        from passerby.page.plan_geojson import geojson_text

        return _file(geojson_text(view()), "application/geo+json", "geojson")

    async def upload(request: Request) -> Response:
        content = await request.body()
        name = await run_in_threadpool(keep_plan, session.scene_file.parent, content)
        return JSONResponse(await run_in_threadpool(_told, session, pictures, name))

    async def fit(request: Request) -> Response:
        from passerby.page.plan_fit import try_plan

        try:
            content = json.loads(await request.body() or b"{}")
        except (ValueError, RecursionError):
            raise InputError("the request is not JSON") from None
        return JSONResponse(await run_in_threadpool(try_plan, session, pictures, content))

    def picture(request: Request) -> Response:
        shown = pictures.shown(plan_path(session, _image(request)))
        return Response(shown.data, media_type=shown.media_type, headers={"cache-control": "private, max-age=3600"})

    def backdrop(_: Request) -> Response:
        found = view().backdrop
        if found is None:
            raise InputError("no plan set the frame of the rig")
        return Response(found.shown.data, media_type=found.shown.media_type)

    return [
        Route(UPLOAD, upload, methods=["POST"]),
        Route("/api/plan/fit", fit, methods=["POST"]),
        Route("/api/plan/picture", lambda request: JSONResponse(_told(session, pictures, _image(request)))),
        Route("/api/plan/view", drawn),
        Route("/plan", picture),
        Route("/plan/backdrop", backdrop),
        Route("/plan/view.svg", svg),
        Route("/plan/view.geojson", geojson),
    ]


def _file(text: str, media_type: str, end: str, policy: str = "") -> Response:
    """A file to be saved."""
    headers = {"content-disposition": f'attachment; filename="rig-from-above.{end}"'}
    return Response(text, media_type=media_type, headers=headers | ({"content-security-policy": policy} if policy else {}))


def _image(request: Request) -> str | None:
    """The uploaded plan that is asked for; None for the scene file's."""
    return request.query_params.get("image")


def _told(session: Session, pictures: PlanPictures, image: str | None) -> dict[str, Any]:
    """What a browser needs to know of a plan before it shows it."""
    return {"image": image, "size": list(pictures.shown(plan_path(session, image)).size)}
