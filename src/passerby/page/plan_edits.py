"""`[world.plan]` as lines of the scene file: what stays the same keeps its lines and comments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import NotParsed, parse_toml
from passerby.page.scene_edits import keep_lines

STATED = ("image", "metres_per_pixel", "distance", "cameras", "points")
"""The keys that the page sets; others stay as an editor wrote them."""
IN_EDITOR = "correct [world.plan] in an editor"


def with_plan(text: str, wanted: Mapping[str, Any]) -> str:
    """With `[world.plan]` as wanted, whatever set the world before; lines stay, but for those that set the heading.

    Args:
        text: of the scene file.
        wanted: values of `STATED`, plain; what is missing there is taken out. Points that are there already keep their place.

    Raises `InputError` where the file is not TOML, or has the plan in a form that cannot be changed here.
    """
    document = _parsed(text)
    world: Any = document.get("world")
    plan: Any = world.get("plan") if isinstance(world, Mapping) else None
    if isinstance(plan, Table):
        _update(plan, wanted)
    else:
        fresh = tomlkit.table(is_super_table=True)
        fresh["plan"] = _fresh_plan(wanted, plan)
        keep_lines(world, fresh)
        if world is None and text.strip():
            document.add(tomlkit.nl())
        document["world"] = fresh
    return _checked(document, wanted)


def without_plan(text: str) -> str:
    """Without `[world.plan]`, and so without a stated world frame; lines stay. Raises `InputError` where there is none."""
    document = _parsed(text)
    world: Any = document.get("world")
    if not isinstance(world, Mapping) or "plan" not in world:
        raise InputError("[world.plan] is not there")
    fresh = tomlkit.table(is_super_table=True)
    keep_lines(world, fresh)
    if len(fresh):
        document["world"] = fresh
    else:
        del document["world"]
    return _checked(document, None)


def _parsed(text: str) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text)
    except TOMLKitError as error:
        raise InputError(f"the scene file is not TOML: {error}: correct it in an editor first") from None


def _fresh_plan(wanted: Mapping[str, Any], before: Any) -> Table:
    """A new table, with the further keys of a plan that was written on one line."""
    kept = {} if not isinstance(before, Mapping) else {key: before[key] for key in before if key not in STATED}
    if kept and plain(before.get("image")) != wanted["image"]:
        kept.pop("origin", None)
    table = tomlkit.table()
    for key in STATED[:-1]:
        if key in wanted:
            table[key] = _item(wanted[key])
    for key, value in kept.items():
        table[key] = value
    if wanted.get("points"):
        table["points"] = _tables(wanted["points"])
    return table


def _update(plan: Table, wanted: Mapping[str, Any]) -> None:
    """Change what differs. An origin is a pixel of one picture, and goes with it."""
    if plain(plan.get("image")) != wanted["image"]:
        plan.pop("origin", None)
    for key in STATED[:-1]:
        if key not in wanted:
            plan.pop(key, None)
        elif key == "cameras" and isinstance(plan.get(key), Mapping):
            _update_cameras(plan[key], wanted[key])
        elif plain(plan.get(key)) != wanted[key]:
            plan[key] = _item(wanted[key])
    points = plan.get("points")
    if not isinstance(points, AoT):
        plan.pop("points", None)
        if wanted.get("points"):
            plan["points"] = _tables(wanted["points"])
        return
    left = [dict(one) for one in wanted.get("points", [])]
    for number in reversed(range(len(points))):
        one = plain(points[number])
        if one in left:
            left.remove(one)
        else:
            del points[number]
    for one in left:
        points.append(_point(one))
    if not len(points):
        plan.pop("points")


def _update_cameras(cameras: Any, wanted: Mapping[str, Any]) -> None:
    for name in [name for name in cameras if name not in wanted]:
        del cameras[name]
    for name, at in wanted.items():
        if plain(cameras.get(name)) != at:
            cameras[name] = at


def _item(value: Any) -> Any:
    """A value; tables on one line."""
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.inline_table()
    for key, one in value.items():
        table[key] = one
    return table


def _tables(points: Any) -> AoT:
    tables = tomlkit.aot()
    for one in points:
        tables.append(_point(one))
    return tables


def _point(point: Mapping[str, Any]) -> Table:
    table = tomlkit.table()
    table.trivia.indent = "\n"  # an empty line before its header
    for key, value in point.items():
        table[key] = _item(value)
    return table


def plain(item: Any) -> Any:
    """A value without its lines."""
    return item.unwrap() if hasattr(item, "unwrap") else item


def _checked(document: tomlkit.TOMLDocument, wanted: Mapping[str, Any] | None) -> str:
    """The new text, once it says what was wanted: tables may stand anywhere in a file, in any form."""
    text = tomlkit.dumps(document)
    try:
        found = parse_toml(text.replace("\r\n", "\n")).get("world", {})
    except NotParsed:
        raise InputError(f"the plan cannot be changed here: {IN_EDITOR}") from None
    plan = found.get("plan") if isinstance(found, dict) else None
    if wanted is None and plan is None:
        return text
    if wanted is None or not isinstance(plan, dict) or _stated(plan) != _stated(wanted):
        raise InputError(f"the plan cannot be changed here: {IN_EDITOR}")
    return text


def _stated(plan: Mapping[str, Any]) -> dict[str, Any]:
    """What the page sets, points in any order."""
    points = sorted(plan.get("points", []), key=repr)
    return {**{key: plan[key] for key in STATED[:-1] if key in plan}, "points": points}
