"""Where the priors of estimated lenses came from: the scene, a search among people, or what lenses usually are.

The solver begins an unknown lens with the focal length of a search. That value depends on the very people that the
adjustment uses, so it counts as theirs: beside it is what the scene stated before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.core.cameras import Lens, Rig
from passerby.core.lens import LARGEST_FOCAL_SD
from passerby.core.lens_figures import FocalFigures, LensFigures, LensPrior
from passerby.core.unknown_focals import SEARCHED_SD


def with_lens_priors(lenses: Mapping[str, LensFigures], inputs: Rig) -> dict[str, LensFigures]:
    """The figures of lenses with the origin of each prior.

    Args:
        lenses: by camera, as the solver has them.
        inputs: names and lenses of the scene, before any estimate.
    """
    return {name: _of_lens(parts, inputs[name].lens) for name, parts in lenses.items()}


def _of_lens(parts: LensFigures, lens: Lens) -> LensFigures:
    """One camera's lens."""
    usual: LensPrior = "assumed" if lens.uncalibrated else "stated"
    return replace(
        parts,
        focal=None if parts.focal is None else _of_focal(parts.focal, lens),
        principal_point=None if parts.principal_point is None else replace(parts.principal_point, prior=usual),
        distortion=None if parts.distortion is None else replace(parts.distortion, prior=usual),
        group=lens.group,
    )


def _of_focal(focal: FocalFigures, lens: Lens) -> FocalFigures:
    """A focal length: as the scene states it, or searched for."""
    sd = lens.focal_sd
    if not lens.uncalibrated or sd is None or sd <= SEARCHED_SD:
        return replace(focal, prior="stated")
    if sd >= LARGEST_FOCAL_SD:  # a guess for any lens, which is no knowledge of this one
        return replace(focal, prior="search", people_share=1.0)
    # The share beside what the scene states, as information adds up: that of the search is people's.
    scene_px, people_px = sd * lens.focal, np.inf if focal.people_sigma_px is None else focal.people_sigma_px
    share = float(1 / (1 + (people_px / scene_px) ** 2))
    return replace(focal, prior="search", people_share=share, scene_px=lens.focal, scene_sigma_px=scene_px)
