"""Keys of a scene file for lenses without intrinsics: one complete focal length, the same for all cameras of one model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Protocol

from passerby.core.data_sheet import WIDEST_FISHEYE_DEG, WIDEST_PINHOLE_DEG

SAME_AS = re.compile(r"\s*same\s+as\s+(\S.*?)\s*", re.IGNORECASE)
FOCAL_KEYS = ("hfov_deg", "focal_mm", "sensor_width_mm", "focal_35mm", "focal_sd_percent")
"""All keys that state a focal length; the first key of a statement names it."""
StatedKey = Literal["hfov_deg", "focal_mm", "focal_35mm"]
STATEMENTS: tuple[StatedKey, ...] = ("hfov_deg", "focal_mm", "focal_35mm")
_KEYS_WITHOUT_INTRINSICS = ("image_size", "hfov_deg", "focal_mm", "sensor_width_mm", "focal_35mm", "lens_model", "lens")


class LensTable(Protocol):
    """The keys of a camera's table in the scene file that describe its lens."""

    intrinsics: Path | None
    image_size: tuple[int, int] | None
    video: Path | tuple[Path, ...] | None
    hfov_deg: float | None
    focal_mm: float | None
    sensor_width_mm: float | None
    focal_35mm: float | None
    focal_sd_percent: float | None
    lens_model: Literal["pinhole", "fisheye"] | None
    lens: str | None


def parse_named_camera(lens: str) -> str:
    """Return the camera that `same as CAMERA` names. Raises `ValueError` for any other text."""
    match = SAME_AS.fullmatch(lens)
    if match is None:
        raise ValueError('write lens = "same as CAMERA", with the name of a camera of the same model')
    return match[1]


def check_lens_keys(table: LensTable) -> None:
    """Raise `ValueError` if the lens of a camera is stated incompletely, more than once or in contradiction."""
    if table.intrinsics is not None:
        for key in _KEYS_WITHOUT_INTRINSICS:
            if getattr(table, key) is not None:
                raise ValueError(f"states both intrinsics and {key}: delete one of them")
        return
    stated = [key for key in STATEMENTS if getattr(table, key) is not None]
    if table.sensor_width_mm is not None and table.focal_mm is None:
        raise ValueError(
            f"states sensor_width_mm = {table.sensor_width_mm:g}, but no focal_mm: add the focal length in mm, or delete it"
        )
    if len(stated) > 1:
        both = " and ".join(f"{key} = {getattr(table, key):g}" for key in stated)
        raise ValueError(f"states its focal length more than once, by {both}: keep one of them")
    if table.focal_mm is not None and table.sensor_width_mm is None:
        raise ValueError(
            f"states focal_mm = {table.focal_mm:g}, but no sensor_width_mm: add the width of the sensor in mm, as in its data "
            "sheet, or state hfov_deg, or focal_35mm, instead"
        )
    if table.focal_sd_percent is not None and not stated and table.lens is None:
        raise ValueError(
            "states focal_sd_percent, but no focal length: add hfov_deg, focal_mm with sensor_width_mm, focal_35mm, or "
            "intrinsics"
        )
    if table.video is None and table.image_size is None and table.lens is None:
        raise ValueError(
            "has neither intrinsics nor a video, so its image size is unknown: add image_size = [width, height], or intrinsics"
        )


def model_camera(cameras: Mapping[str, LensTable], name: str) -> str:
    """Follow the references `same as CAMERA` from `name` to the last camera, which is `name` itself if it refers to none.

    Raises `ValueError` if the references form a circle, or name a camera that is not declared.
    """
    chain = [name]
    while (lens := cameras[chain[-1]].lens) is not None:
        other = parse_named_camera(lens)
        if other in chain:
            if other == chain[-1]:
                raise ValueError(f"[cameras.{other}] lens: names the camera itself: name another camera of its model")
            links = " -> ".join([*chain[chain.index(other) :], other])
            raise ValueError(
                f"[cameras.{other}] lens: leads in a circle ({links}): delete lens of one, and state there what is known"
            )
        if other not in cameras:
            raise ValueError(f"[cameras.{chain[-1]}] lens: camera {other} is not declared")
        chain.append(other)
    return chain[-1]


def models_of(cameras: Mapping[str, LensTable]) -> dict[str, tuple[str, ...]]:
    """Return, by camera, all cameras with its lens: first the one that the others name, then the others in scene order.

    Raises `ValueError` as `model_camera` does.
    """
    members: dict[str, list[str]] = {}
    for name in cameras:
        members.setdefault(model_camera(cameras, name), []).append(name)
    ordered = {model: (model, *(name for name in names if name != model)) for model, names in members.items()}
    return {name: names for names in ordered.values() for name in names}


def check_models(cameras: Mapping[str, LensTable]) -> None:
    """Raise `ValueError` if cameras of one model have contradicting statements."""
    models = models_of(cameras)
    for name, table in cameras.items():
        model = models[name][0]
        if model == name:
            continue
        if cameras[model].intrinsics is not None:
            for key in (*STATEMENTS, "lens_model"):
                if getattr(table, key) is not None:
                    raise ValueError(
                        f"[cameras.{name}]: states {key}, but its lens is the same as that of {model}, which has intrinsics: "
                        f"delete {key} or lens"
                    )
        elif table.focal_sd_percent is not None and not any(getattr(table, key) is not None for key in STATEMENTS):
            raise ValueError(
                f"[cameras.{name}]: states focal_sd_percent, but no focal length: state it beside the focal length of {model}"
            )
    for names in dict.fromkeys(models.values()):
        _check_agreement(cameras, names)


def _check_agreement(cameras: Mapping[str, LensTable], names: tuple[str, ...]) -> None:
    """Raise `ValueError` if cameras of one model state different focal lengths or lens models."""
    if cameras[names[0]].intrinsics is not None:
        return
    _check_widths(cameras, names)
    for keys in (FOCAL_KEYS, ("lens_model",)):
        holders = [name for name in names if any(getattr(cameras[name], key) is not None for key in keys)]
        for name in holders[1:]:
            first, other = (_describe_keys(cameras[camera], keys) for camera in (holders[0], name))
            if first != other:
                raise ValueError(
                    f"[cameras.{name}]: states {other}, but {holders[0]}, which has the same lens, {first}: state it once, at "
                    "one of them"
                )


def _check_widths(cameras: Mapping[str, LensTable], names: tuple[str, ...]) -> None:
    """Raise `ValueError` for a field of view that only a fisheye lens can have, if no camera states a fisheye lens."""
    if any(cameras[name].lens_model == "fisheye" for name in names):
        return
    for name in names:
        field_deg = cameras[name].hfov_deg
        if field_deg is not None and field_deg > WIDEST_PINHOLE_DEG:
            raise ValueError(
                f"[cameras.{name}] hfov_deg is {field_deg:g}: a pinhole lens has up to {WIDEST_PINHOLE_DEG:g} degrees; add "
                f'lens_model = "fisheye" for a fisheye lens, which has up to {WIDEST_FISHEYE_DEG:g}'
            )


def _describe_keys(table: LensTable, keys: tuple[str, ...]) -> str:
    """Return the given keys that a camera states, with their values, as text."""
    stated = ((key, getattr(table, key)) for key in keys)
    return ", ".join(
        f"{key} = {value:g}" if isinstance(value, float) else f'{key} = "{value}"' for key, value in stated if value is not None
    )


def stating_camera(cameras: Mapping[str, LensTable], names: tuple[str, ...], keys: tuple[str, ...]) -> str | None:
    """Return the first of the named cameras that states any of the keys; None if none does."""
    return next((name for name in names if any(getattr(cameras[name], key) is not None for key in keys)), None)
