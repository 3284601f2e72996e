"""`passerby reid`: re-identification networks: train, evaluate, adapt to a scene, export."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from passerby.common.errors import InputError

if TYPE_CHECKING:
    from passerby.common.progress import Progress
    from passerby.training.crops import DataSet

reid_app = typer.Typer(
    name="reid",
    help="Re-identification networks: train them, adapt one to a scene without labels, evaluate, export.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Data = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA...",
        help="Market-1501, DukeMTMC-reID, MSMT17, a folder per identity, or tracks with a video: see docs/training.md.",
    ),
]
MoreData = Annotated[list[Path] | None, typer.Option("--data", metavar="DATA", help="Real crops to compare on; repeatable.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
Config = Annotated[Path | None, typer.Option(help="TOML file of training options; `run.toml` of a run shows them all.")]
Device = Annotated[str, typer.Option(help="auto (a GPU if there is one) or cpu.")]
Epochs = Annotated[int | None, typer.Option(min=1, help="Passes over the images.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of all random numbers; the same seed gives the same network.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="A line for every epoch, also where there is no terminal.")]
TOLD_NOTES = 12
EXTRA = ("torch", "transformers", "pytorch_metric_learning", "accelerate", "onnx", "onnxscript", "plotly")
"""Packages that the extra passerby[reid] installs."""


@reid_app.command("train")
def train(
    data: Data,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="RUN", help="Folder of the run; an interrupted run continues.")],
    recipe: Annotated[
        str,
        typer.Option(help="strong (ResNet-50 with the usual refinements), paper (plain ResNet-50), small (for a CPU)."),
    ] = "strong",
    config: Config = None,
    backbone: Annotated[str | None, typer.Option(help="small, resnet-18 ... resnet-152, or a model of transformers.")] = None,
    weights: Annotated[
        str | None, typer.Option(help="Initial weights: auto, published, random, or the folder of another run.")
    ] = None,
    epochs: Epochs = None,
    seed: Seed = None,
    precision: Annotated[str | None, typer.Option(help="Mixed precision: no, fp16 or bf16.")] = None,
    device: Device = "auto",
    json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Train a network on sets of images.

    RUN gets run.toml (the options), checkpoint.pt (the state after the last whole epoch), log.csv and curves.html.
    """
    _require_torch("train")
    from passerby.cli.terminal import show_table, stages
    from passerby.training.options import train_options
    from passerby.training.runs import train_run

    options = train_options(recipe, config, backbone=backbone, weights=weights, epochs=epochs, seed=seed, precision=precision)
    _check_device(device)
    with stages(verbose) as tell:
        sets = _read(data, out / "crops", tell)
        trained = train_run(sets, options, out, device=device, tell=tell, record=_teller(verbose))
    last = trained.last
    if json:
        _print_json({"run": out, "note": trained.note, "resumed_after": trained.resumed_after, "options": options.to_dict(),
                     "people": int(trained.origin["people"]), "pictures": int(trained.origin["pictures"]),
                     "validated_on": trained.validated_on, "last": vars(last) if last else None})  # fmt: skip
        return
    print(trained.note)
    print(f"{trained.origin['pictures']} images of {trained.origin['people']} people; validated on {trained.validated_on}")
    if last is not None:
        show_table("training", *_read_last_row(last))
    print(f"written to {out}: `passerby reid export {out} -o net.onnx` makes a network for embedder under [perception]")


@reid_app.command("evaluate")
def evaluate(
    network: Annotated[
        str, typer.Argument(metavar="NETWORK", help="A run's folder, an ONNX file, a known model's name, or stripes.")
    ],
    data: Data,
    cache: Annotated[Path | None, typer.Option(help="Folder for crops cut out of videos; default: a temporary one.")] = None,
    json: AsJson = False,
) -> None:
    """CMC rank-1, 5, 10 and mAP by the protocol of Market-1501 (same person and same camera left out).

    In sets without query and gallery every image is a query. Camera-centred: the mean of each camera is subtracted first, as
    the association does. A run needs the extra passerby[reid], the others do not.
    """
    import tempfile

    from passerby.cli.terminal import number, show_table, stages
    from passerby.training.embedding import score_data

    with tempfile.TemporaryDirectory(prefix="passerby-reid-") as temporary, stages() as tell:
        embed = _embed_by(network, tell)  # first, so that a missing network is reported before crops are made
        sets = _read(data, cache or Path(temporary), tell)
        found = {
            one.name: {kind: score_data(one, embed, centred=kind == "centred") for kind in ("plain", "centred")} for one in sets
        }
    if json:
        _print_json({"network": network, "sets": {
            name: {kind: score.to_dict() for kind, score in scores.items()} for name, scores in found.items()}})  # fmt: skip
        return
    rows = [
        [f"{name}, {kind}", *(number(100 * score.cmc[k], 1) for k in (1, 5, 10)),
         number(100 * score.mean_average_precision, 1), str(score.queries), str(score.gallery)]
        for name, scores in found.items() for kind, score in scores.items()
    ]  # fmt: skip
    show_table(f"retrieval by {network}, %", ["set", "rank-1", "rank-5", "rank-10", "mAP", "queries", "gallery"], rows)
    left_out = {name: scores["plain"].left_out for name, scores in found.items() if scores["plain"].left_out}
    for name, count in left_out.items():
        print(f"{name}: {count} queries have no correct match from another camera and are ignored")


@reid_app.command("finetune")
def finetune(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Output folder of `passerby calibrate` on videos.")],
    weights: Annotated[
        Path | None, typer.Option(help="Run to start from; default: a small network with random weights.")
    ] = None,
    target: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the network and the new calibration; default: OUT/finetuned.")
    ] = None,
    scene: Annotated[Path | None, typer.Option(help="The scene file, if it has moved since.")] = None,
    config: Config = None,
    epochs: Epochs = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the training and of the calibration.")] = 0,
    device: Device = "auto",
    json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Adapt a network to the people of a calibrated scene, without labels, then associate and solve again.

    The labels are the people that the calibration identifies reliably by geometry. OUT/finetuned gets the run, net.onnx, and
    a calibration of its own. Exit status 3: too few people are identified reliably, or the new calibration is doubtful.
    """
    _require_torch("finetune")
    from passerby.cli.tables import show_calibration, tell_reasons
    from passerby.cli.terminal import stages
    from passerby.training.runs import finetune_scene

    _check_device(device)
    with stages(verbose) as tell:
        tuned = finetune_scene(out, target or out / "finetuned", weights=weights, scene=scene, config=config, epochs=epochs,
                               seed=seed, device=device, tell=tell, record=_teller(verbose))  # fmt: skip
    if json:
        _print_json(tuned.to_dict())
    else:
        for line in tuned.lines():
            print(line)
        show_calibration(tuned.calibration, verbose)
        print(f"written to {tuned.folder}: net.onnx, run/, rig.toml, calibration.json, tracks/")
    tell_reasons(tuned.calibration)
    raise typer.Exit(tuned.calibration.exit_status)


@reid_app.command("export")
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a training, or its checkpoint.pt.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The ONNX file to write.")],
    data: MoreData = None,
    json: AsJson = False,
) -> None:
    """Write the network of a run to an ONNX file for the perception stage, and compare its output with PyTorch's."""
    _require_torch("export")
    import tempfile

    from passerby.cli.terminal import show_table, stages
    from passerby.training.runs import export_run

    with tempfile.TemporaryDirectory(prefix="passerby-reid-") as temporary, stages() as tell:
        sets = _read(data, Path(temporary), tell) if data else []
        tell("exporting")
        report = export_run(run, out, sets)
    if json:
        _print_json(report.to_dict())
        return
    compared = [("noise", report.random), *([("given images", report.real)] if report.real else [])]
    rows = [
        [what, str(one.pictures), f"{one.largest_difference:.1e}", f"{1 - one.worst_cosine:.1e}",
         "same" if one.same_ranking else "differs"]
        for what, one in compared
    ]  # fmt: skip
    show_table("compared with PyTorch", ["on", "images", "difference", "1 - cosine", "ranking"], rows)
    print(f"written to {out}: {report.bytes / 1e6:.1f} MB, {report.dimensions} dimensions; in a scene file: "
          f'under [perception] set embedder = "{out.name}"')  # fmt: skip


def _read(paths: list[Path], cache: Path, tell: Progress) -> list[DataSet]:
    """Read the data sets, and print a line for each note about omitted data."""
    from passerby.training.data.reading import read_all

    sets = read_all(paths, cache, tell)
    for one in sets:
        for note in one.notes[:TOLD_NOTES]:
            print(f"note: {one.name}: {note}", file=sys.stderr)
        if len(one.notes) > TOLD_NOTES:
            print(f"note: {one.name}: ... and {len(one.notes) - TOLD_NOTES} more", file=sys.stderr)
    return sets


def _embed_by(network: str, tell: Progress) -> Any:
    """Return the function that computes embeddings of a set of pictures, by the network's name from the user."""
    from functools import partial

    from passerby.training.embedding import embed_crops

    path = Path(network)
    if path.is_dir() or path.suffix == ".pt":
        _require_torch("evaluate RUN")
        from passerby.training.runs import run_embedder

        return run_embedder(path)[0]
    from passerby.perception.opening import open_embedder

    if network == "stripes":
        return partial(embed_crops, embedder=open_embedder("stripes"), tell=tell)
    from passerby.perception.model_files import find_model

    found = find_model(network, "embedder")
    if found.network is None:
        raise InputError(f"{network}: {found.reason}: give a run's folder, an ONNX file, or stripes")
    return partial(embed_crops, embedder=open_embedder(found.network), tell=tell)


def _teller(verbose: bool) -> Any:
    """Return a function that prints a line for each validated epoch, and with `verbose` for every epoch."""

    def told(row: Any) -> None:
        if verbose or row.rank_1 is not None:
            print(_line(row), file=sys.stderr)

    return told


def _line(row: Any) -> str:
    """Write the line of an epoch, for example: epoch 10: loss 3.210 (...), rank-1 45.0 %, mAP 38.1 %."""
    score = "" if row.rank_1 is None else f", rank-1 {100 * row.rank_1:.1f} %, mAP {100 * row.map:.1f} %"
    return f"epoch {row.epoch}: loss {row.loss:.3f} (identity {row.identity_loss:.3f}, triplet {row.triplet_loss:.3f}){score}"


def _read_last_row(row: Any) -> tuple[list[str], list[list[str]]]:
    """Return the header and the table row of the last epoch."""
    shares = ["-" if value is None else f"{100 * value:.1f} %" for value in (row.rank_1, row.map)]
    losses = [f"{value:.3f}" for value in (row.loss, row.identity_loss, row.triplet_loss)]
    return ["after epoch", "loss", "identity", "triplet", "rank-1", "mAP"], [[str(row.epoch), *losses, *shares]]


def _check_device(device: str) -> None:
    if device not in ("auto", "cpu"):
        raise InputError(f"device {device!r} does not exist: give auto or cpu (CUDA_VISIBLE_DEVICES chooses among several)")


def _require_torch(command: str) -> None:
    """Check that the extra is installed. Raises `InputError` if not."""
    from importlib.util import find_spec

    missing = [name for name in EXTRA if find_spec(name) is None]
    if missing:
        raise InputError(f"passerby reid {command} needs {', '.join(missing)}: pip install 'passerby[reid]'")


def _print_json(value: object) -> None:
    """Print one JSON object on standard output."""
    from passerby.interchange.storage.text_formats import to_json

    print(to_json(value), end="")
