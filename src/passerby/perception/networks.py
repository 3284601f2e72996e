"""ONNX networks, with their input and output conventions.

The known networks are in manifest.toml: names, addresses, checksums, licences and input conventions.

The conventions of other networks are stated in the file itself or in a note beside it, else they follow from the role.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.interchange.storage.safe_parsing import NotParsed, parse_toml, read_text

Role = Literal["detector", "embedder", "keypoints"]
Colour = Literal["bgr", "rgb"]
Fit = Literal["letterbox", "stretch"]
Output = Literal["yolox", "embedding", "movenet", "simcc", "heatmaps"]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
PREFIX = "passerby."
INPUT_KEYS = ("colour", "scale", "mean", "std", "fit", "padding")
# Mean and standard deviation of ImageNet's pictures, with pixels from 0 to 1; nearly every PyTorch network expects them.
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class InputConvention:
    """Input convention of a network; its size, layout and type are read from the file itself.

    A pixel of value p, 0 to 255, enters as (p * scale - mean) / std, channel by channel in the network's order of colours.
    """

    colour: Colour = "bgr"
    scale: float = 1.0
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    fit: Fit = "letterbox"
    """letterbox: the aspect ratio is kept, the rest is padding; stretch: width and height are scaled independently."""
    padding: float = 114.0
    """Value of the padding, 0 to 255."""


YOLOX = InputConvention()
IMAGENET = InputConvention("rgb", 1.0 / 255.0, IMAGENET_MEAN, IMAGENET_STD, "stretch")
TOP_DOWN = replace(IMAGENET, fit="letterbox", padding=0.0)
"""For RTMPose and similar networks: the crop has the input's aspect ratio, nothing is stretched."""
MOVENET = InputConvention("rgb", fit="letterbox", padding=0.0)
COCO_JOINTS = 17


@dataclass(frozen=True)
class Network:
    """A network in a file on this computer."""

    name: str
    """Name in the manifest, or the file's name."""
    role: Role
    path: Path
    sha256: str
    """Checksum of the file, in hex: it was verified for networks of the manifest."""
    output: Output
    input: InputConvention = field(default_factory=InputConvention)
    licence: str = "unknown"

    @property
    def identity(self) -> dict[str, object]:
        """Settings that determine its results, as plain values for JSON; the file's path is not one of them."""
        convention = self.input
        return {
            "network": self.name,
            "sha256": self.sha256,
            "output": self.output,
            "colour": convention.colour,
            "scale": convention.scale,
            "mean": list(convention.mean),
            "std": list(convention.std),
            "fit": convention.fit,
            "padding": convention.padding,
        }


class Table(BaseModel):
    """A table of a manifest: frozen, unknown keys rejected."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class InputTable(Table):
    """Conversion of pixels for a network; keys that are not set are taken from a base convention."""

    colour: Colour | None = None
    scale: Positive | None = None
    mean: tuple[Finite, Finite, Finite] | None = None
    std: tuple[Positive, Positive, Positive] | None = None
    fit: Fit | None = None
    padding: Annotated[float, Field(ge=0.0, le=255.0)] | None = None

    def over(self, base: InputConvention) -> InputConvention:
        """Return `base` with the values that are set here."""
        return InputConvention(
            base.colour if self.colour is None else self.colour,
            base.scale if self.scale is None else self.scale,
            base.mean if self.mean is None else self.mean,
            base.std if self.std is None else self.std,
            base.fit if self.fit is None else self.fit,
            base.padding if self.padding is None else self.padding,
        )


class ArchiveTable(Table):
    """A zip archive in which a network is published."""

    member: str
    """End of the name of the network's file in the archive."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(gt=0)]


class ModelEntry(Table):
    """The manifest's entry of one network."""

    name: str
    role: Role
    file: str
    """Its name on a user's disk, by which it is found in the folders that are searched for models."""
    url: str | None = None
    """Address where its publisher keeps exactly these bytes; None if there is none."""
    archive: ArchiveTable | None = None
    """The archive that the address serves; None where it is the network's file itself."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(gt=0)]
    licence: str
    publisher: str
    output: Output
    note: str
    input: InputTable = InputTable()
    default: bool = False
    """Whether "auto" selects this one for its role."""


class Manifest(Table):
    """The whole file."""

    models: tuple[ModelEntry, ...]


@cache
def catalogue() -> tuple[ModelEntry, ...]:
    """Return all networks of the manifest, in its order."""
    text = files("passerby.perception").joinpath("manifest.toml").read_text(encoding="utf-8")
    return Manifest.model_validate(tomllib.loads(text)).models


def default_of(role: Role) -> ModelEntry | None:
    """Return the network that "auto" selects for a role if none is on this computer; None where the manifest names none."""
    return next((entry for entry in catalogue() if entry.role == role and entry.default), None)


class Description(Table):
    """A user's description of a network, in the keys of the manifest; all of them are optional."""

    role: Role | None = None
    output: Output | None = None
    input: InputTable = InputTable()
    licence: str | None = None
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    name: str | None = None
    file: str | None = None
    url: str | None = None
    bytes: int | None = None
    publisher: str | None = None
    note: str | None = None


def read_own_network(path: Path, role: Role, sha256: str) -> Network:
    """Read the network in a file that the manifest does not have.

    Its convention is stated by the ONNX file's own `passerby.*` metadata, else by a file NAME.toml beside it. Other values are
    the usual ones for the role: a detector is a YOLOX (BGR 0 to 255, letterbox, padding 114); an embedder takes RGB crops
    stretched to its input and normalised as ImageNet's pictures; the kind of keypoint network is determined from the outputs.

    Args:
        path: the ONNX file.
        role: its use.
        sha256: checksum of the file, in hex.

    Raises `InputError` where it is no ONNX file, or states an impossible value, or another role.
    """
    from passerby.perception.sessions import open_session, outputs_of

    session = open_session(path, allow_cuda=False)
    metadata = _metadata(path, session)
    told = {key.removeprefix(PREFIX): value for key, value in metadata.items() if key.startswith(PREFIX)}
    beside = path.with_suffix(".toml")
    if told:
        description = _check_description(f"{path}: metadata {PREFIX}*", _nested(told))
    elif beside.is_file():
        description = _read_toml(beside)
    else:
        description = Description()
    if description.sha256 not in (None, sha256):
        raise InputError(f"{beside}: sha256 {description.sha256} is not that of {path.name} ({sha256}): is it another version?")
    if description.role not in (None, role):
        raise InputError(f"{path}: is a network of role {description.role}, not {role}: name one of that role")
    output = description.output or _guess_output(path, role, [port.shape for port in outputs_of(session)])
    _check_output(path, role, output)
    convention = description.input.over(_guess_input(output))
    return Network(description.name or path.name, role, path, sha256, output, convention, description.licence or "unknown")


def _metadata(path: Path, session: Any) -> dict[str, str]:
    """Return the metadata of an ONNX file. Raises `InputError` where they are not text."""
    try:
        found: dict[str, str] = session.get_modelmeta().custom_metadata_map
    except UnicodeDecodeError:
        raise InputError(f"{path}: its metadata are not text: the file is damaged; fetch it again or give another") from None
    return found


def _nested(told: dict[str, str]) -> dict[str, Any]:
    """Convert metadata, which are all texts, to the tables of a manifest: lists are numbers separated by commas or spaces."""
    pixels: dict[str, Any] = {key: told[key] for key in INPUT_KEYS if key in told}
    for key in ("mean", "std"):
        if key in pixels:
            pixels[key] = pixels[key].strip("[]() ").replace(",", " ").split()
    return {**{key: value for key, value in told.items() if key not in INPUT_KEYS}, "input": pixels}


def _read_toml(path: Path) -> Description:
    """Read the description from a file of its own."""
    try:
        return _check_description(str(path), parse_toml(read_text(path, "the description of a network")))
    except NotParsed as error:
        raise InputError(f"{path}: is not TOML: {error}: fix it there") from None


def _check_description(place: str, tables: dict[str, Any]) -> Description:
    """Check a description key by key; the first error is raised."""
    try:
        return Description.model_validate(tables)
    except ValidationError as error:
        fault = error.errors()[0]
        key = ".".join(map(str, fault["loc"]))
        if fault["type"] == "extra_forbidden":
            known = ", ".join((*Description.model_fields, *(f"input.{key}" for key in INPUT_KEYS)))
            raise InputError(f"{place}: unknown key {key}: there are {known}") from None
        raise InputError(
            f"{place}: {key} is {shortened(fault['input'])}: {fault['msg'][0].lower()}{fault['msg'][1:]}"
        ) from None


def _guess_output(path: Path, role: Role, shapes: list[tuple[int | None, ...]]) -> Output:
    """Return the output convention of a network if it is not stated; for keypoints from the shapes of its outputs.

    MoveNet: one output [1, 1, 17, 3]. SimCC (RTMPose): two, [N, joints, x bins] and [N, joints, y bins]. Heat maps: one,
    [N, joints, height, width].
    """
    if role == "detector":
        return "yolox"
    if role == "embedder":
        return "embedding"
    ranks = [len(shape) for shape in shapes]
    if ranks == [4]:
        return "movenet" if shapes[0][2:] == (COCO_JOINTS, 3) else "heatmaps"
    if ranks == [3, 3]:
        return "simcc"
    raise InputError(
        f"{path}: outputs of shapes {shapes} are none of movenet, simcc or heatmaps: say which in "
        f"{path.with_suffix('.toml').name} (output = ...), or name another network"
    )


def _check_output(path: Path, role: Role, output: Output) -> None:
    """Raise `InputError` where an output convention is not one of the role's."""
    known: dict[Role, tuple[Output, ...]] = {
        "detector": ("yolox",),
        "embedder": ("embedding",),
        "keypoints": ("movenet", "simcc", "heatmaps"),
    }
    if output not in known[role]:
        raise InputError(f"{path}: output {output} is not one of {role}: there are {', '.join(known[role])}")


def _guess_input(output: Output) -> InputConvention:
    """Return the input convention with which networks of a kind were published."""
    return {"yolox": YOLOX, "movenet": MOVENET, "simcc": TOP_DOWN, "heatmaps": TOP_DOWN}.get(output, IMAGENET)
