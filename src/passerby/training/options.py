"""The options of the training of a network."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from passerby.common.errors import InputError
from passerby.interchange.storage.safe_parsing import read_toml

Precision = Literal["no", "fp16", "bf16"]


@dataclass(frozen=True)
class TrainOptions:
    """Options of the training. Raises `InputError` for a value out of range.

    The defaults are the strong baseline of Luo et al., *Bag of Tricks and a Strong Baseline for Deep Person Re-identification*,
    CVPR workshops 2019, on the network and the losses of Xu et al., CVPR 2021; `paper()` is the latter without the former.
    """

    backbone: str = "resnet-50"
    """small, resnet-18 to resnet-152; a model of `transformers`: its type (convnextv2), its name on the hub, its folder."""
    weights: str = "auto"
    """auto (published weights if available), published (or stop), random, or a run or checkpoint with the first weights."""
    height: int = 256
    width: int = 128
    """Height and width of the network's input, pixels."""
    pooling: Literal["average", "gem"] = "average"
    """Pooling of the last feature map: global average, or generalised mean (Radenovic et al., PAMI 2019)."""
    last_stride: Literal[1, 2] = 1
    """Stride of a ResNet's last stage; 1 doubles the resolution of the last feature map."""
    neck: bool = True
    """A batch normalisation between the feature of the triplet loss and that of the identity loss and of retrieval."""

    people_per_batch: int = 16
    """Number of people in a batch (P)."""
    pictures_per_person: int = 4
    """Number of pictures of each person in a batch (K)."""
    epochs: int = 120
    learning_rate: float = 3.5e-4
    """Largest learning rate of AdamW."""
    weight_decay: float = 5e-4
    warm_up_epochs: float = 10.0
    """Number of epochs over which the learning rate rises linearly."""
    schedule: Literal["cosine", "constant"] = "cosine"
    """Learning rate after the warm-up."""

    margin: float = 0.3
    """Margin of the triplet loss."""
    triplet_weight: float = 1.0
    identity_weight: float = 1.0
    label_smoothing: float = 0.1

    flip: float = 0.5
    """Probability of a mirrored picture."""
    shift: float = 0.08
    """Largest shift and crop, as a share of the picture's height."""
    erasing: float = 0.5
    """Probability that a rectangle is erased (Zhong et al., AAAI 2020)."""
    colour: float = 0.2
    """Largest relative change of brightness, contrast and each channel's gain: cameras differ in them."""

    hold_out: float = 0.1
    """Share of the people that are used for validation, if the data have no query and gallery."""
    validate_every: int = 10
    """Number of epochs between two validations."""
    precision: Precision = "no"
    """Mixed precision of `accelerate`."""
    workers: int = 0
    """Number of processes that read pictures; 0: the process of the training reads them."""
    seed: int = 0

    def __post_init__(self) -> None:
        within: tuple[tuple[str, float, float], ...] = (
            ("height", 16, 2048), ("width", 16, 2048), ("people_per_batch", 2, 4096), ("pictures_per_person", 2, 1024),
            ("epochs", 1, 100_000), ("learning_rate", 1e-9, 10), ("weight_decay", 0, 10), ("warm_up_epochs", 0, 100_000),
            ("margin", 0, 100), ("triplet_weight", 0, 1000), ("identity_weight", 0, 1000), ("label_smoothing", 0, 0.99),
            ("flip", 0, 1), ("shift", 0, 0.5), ("erasing", 0, 1), ("colour", 0, 1), ("hold_out", 0, 0.9),
            ("validate_every", 1, 100_000), ("workers", 0, 256), ("seed", 0, 2**32 - 1),
        )  # fmt: skip
        for name, low, high in within:
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} = {value} is out of range: give a value from {low:g} to {high:g}")
        if self.triplet_weight == 0 and self.identity_weight == 0:
            raise InputError("triplet_weight and identity_weight are both 0: one of the losses is needed")

    @classmethod
    def paper(cls) -> TrainOptions:
        """Return only the paper's choices: ResNet-50, global pooled feature, identity and triplet loss."""
        return cls(last_stride=2, neck=False, label_smoothing=0, erasing=0, shift=0, colour=0, warm_up_epochs=0,
                   schedule="constant")  # fmt: skip

    @classmethod
    def small(cls) -> TrainOptions:
        """Return options for a processor without a graphics card: a network of 1.2 million weights."""
        return cls(backbone="small", height=128, width=64)

    def to_dict(self) -> dict[str, Any]:
        """Return the options as plain values."""
        return asdict(self)


RECIPES = {"strong": TrainOptions, "paper": TrainOptions.paper, "small": TrainOptions.small}


def train_options(
    recipe: str = "strong", config: Path | None = None, *, start: TrainOptions | None = None, **chosen: Any
) -> TrainOptions:
    """Return the options of a recipe, overwritten by those of a TOML file, and then by `chosen` ones (None: not chosen).

    `start` replaces the recipe's options. Raises `InputError` for a recipe, key or value that does not exist.
    """
    if recipe not in RECIPES:
        raise InputError(f"recipe {recipe!r} does not exist: choose one of {', '.join(RECIPES)}")
    options: TrainOptions = start or RECIPES[recipe]()
    tables: list[tuple[str, dict[str, Any]]] = [] if config is None else [(str(config), read_toml(config))]
    tables.append(("options", {key: value for key, value in chosen.items() if value is not None}))
    for place, table in tables:
        known = options.to_dict()
        for key in table:
            if key not in known:
                raise InputError(f"{place}: unknown key {key}: there are {', '.join(known)}")
        try:
            options = TypeAdapter(TrainOptions).validate_python({**known, **table})
        except ValidationError as error:
            fault = error.errors()[0]
            raise InputError(f"{place}: {'.'.join(map(str, fault['loc']))} is {fault['input']!r}: {fault['msg']}") from None
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
    return options
