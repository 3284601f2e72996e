"""Small hand-made scenes for tests of reading and checking; their people are not meant to be solved."""

from pathlib import Path

LENS = """[{name}]
size = [{width}, {height}]
matrix = [[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]
distortions = {distortions}
"""


def lens(name, width=1280, height=720, distortions="[0.0, 0.0, 0.0, 0.0, 0.0]"):
    return LENS.format(name=name, width=width, height=height, distortions=distortions)


def rows(frames=10, identities=(1, 2), left=100):
    return "".join(
        f"{frame},{identity},{left + 200 * place + 3 * frame},300,40,110,1,-1,-1,-1\n"
        for frame in range(1, frames + 1)
        for place, identity in enumerate(identities)
    )


def write_scene(folder: Path, cameras=("A", "B"), extra="", files=None, association='mode = "given"'):
    """A folder with a scene of three sound files a camera; `files` replaces some of them (None: is left out).

    Boxes that another camera has too get other scores: a copied file is a fault.
    """
    content = {
        "scene.toml": f"[association]\n{association}\n"
        + "".join(f'[cameras.{name}]\nintrinsics = "rig.toml"\ntracks = "{name}.txt"\n' for name in cameras)
        + extra,
        "rig.toml": "".join(lens(name) for name in cameras),
        **{f"{name}.txt": rows() for name in cameras},
        **(files or {}),
    }
    for number, name in enumerate(cameras):
        before = [content[f"{other}.txt"] for other in cameras[:number]]
        if content[f"{name}.txt"] in before and content[f"{name}.txt"]:
            content[f"{name}.txt"] = content[f"{name}.txt"].replace(",1,-1,-1,-1\n", f",{1 - number / 100},-1,-1,-1\n")
    for name, text in content.items():
        if text is not None:
            (folder / name).write_text(text)
    return folder / "scene.toml"
