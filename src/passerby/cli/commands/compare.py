"""`passerby compare`: two rigs of the same cameras on people that neither was made from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def compare(
    context: typer.Context,
    first: Annotated[Path, typer.Argument(metavar="A", help="Rig file (TOML), or output folder of `passerby calibrate`.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="The other rig, of the same cameras by name.")],
    people: Annotated[
        Path,
        typer.Argument(
            metavar="PEOPLE",
            help="Scene file of a recording that neither rig was made from, or the output folder of its calibration.",
        ),
    ],
    shape: Annotated[
        bool, typer.Option("--shape", help="Move B onto A by the best similarity first: its frame and scale do not count.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print the stages.")] = False,
) -> None:
    """Compare two rigs on people: which of them places the people of a recording more consistently, and by how much.

    Each camera's people are compared with where the other cameras put them. A scene file is calibrated first to associate its
    people; the poses from that are not used. Both rigs need z up and the ground at z = 0, in metres, unless --shape is given.
    """
    from passerby.calibration.rig_comparison import compare_rigs
    from passerby.cli.tables import show_people_comparison
    from passerby.cli.terminal import stages
    from passerby.common.parallel import local_processes
    from passerby.interchange.calibration_json import CALIBRATION_FILE
    from passerby.interchange.output_folder import read_rig_at
    from passerby.interchange.storage.json_text import to_json
    from passerby.scene.scene import Scene

    rigs = read_rig_at(first), read_rig_at(second)
    source = people if (people / CALIBRATION_FILE).is_file() else Scene.load(people)
    size = (source.size_bytes, len(source.cameras), source.n_videos) if isinstance(source, Scene) else (0, 0, 0)
    with stages(verbose or bool(context.obj)) as tell, local_processes(*size) as executor:
        found = compare_rigs(*rigs, source, shape=shape, seed=seed, progress=tell, executor=executor)
    if json:
        print(to_json(found.to_dict()), end="")
    else:
        show_people_comparison(found)
