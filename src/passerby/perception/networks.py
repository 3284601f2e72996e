"""An ONNX file, and its input and output conventions."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

Role = Literal["detector", "embedder", "keypoints"]
Colour = Literal["bgr", "rgb"]
Fit = Literal["letterbox", "stretch"]
Output = Literal["yolox", "embedding", "movenet", "simcc", "heatmaps"]


@dataclass(frozen=True)
class InputConvention:
    """What a network takes; its size, layout and type are read from the file itself.

    A pixel of value p, 0 to 255, enters as (p * scale - mean) / std, channel by channel in the network's order of colours.
    """

    colour: Colour = "bgr"
    scale: float = 1.0
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    fit: Fit = "letterbox"
    """letterbox: the aspect ratio is kept, the rest is padding; stretch: width and height are scaled each on its own."""
    padding: float = 114.0
    """Value of the padding, 0 to 255."""


@dataclass(frozen=True)
class Network:
    """A network that lies on this disk."""

    name: str
    """As the manifest calls it, or the file's name."""
    role: Role
    path: Path
    sha256: str
    """Of the file, in hex: it was checked where the manifest knows it."""
    output: Output
    input: InputConvention = field(default_factory=InputConvention)
    licence: str = "unknown"

    @property
    def identity(self) -> dict[str, object]:
        """What decides its results, as plain values for JSON; where the file lies does not."""
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
