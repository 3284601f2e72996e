"""Origins of the priors of estimated lenses: the scene, a search by people, or usual values of lenses.

The solver begins an unknown lens with the focal length of a search. That value depends on the people that the adjustment also
uses, so it counts as evidence of the people. The figures also give the value that the scene stated before.
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
    """Add the origin of each prior to the figures of lenses.

    Args:
        lenses: figures of the solver, by camera.
        inputs: names and lenses of the scene, before any estimate.
    """
    return {name: _of_lens(parts, inputs[name].lens) for name, parts in lenses.items()}


def _of_lens(parts: LensFigures, lens: Lens) -> LensFigures:
    """Add the origins of the priors to the figures of one camera's lens."""
    usual: LensPrior = "assumed" if lens.uncalibrated else "stated"
    return replace(
        parts,
        focal=None if parts.focal is None else _of_focal(parts.focal, lens),
        principal_point=None if parts.principal_point is None else replace(parts.principal_point, prior=usual),
        distortion=None if parts.distortion is None else replace(parts.distortion, prior=usual),
        group=lens.group,
    )


def _of_focal(focal: FocalFigures, lens: Lens) -> FocalFigures:
    """Add the origin of the prior to the figures of a focal length: stated by the scene, or searched for."""
    sd = lens.focal_sd
    if not lens.uncalibrated or sd is None or sd <= SEARCHED_SD:
        return replace(focal, prior="stated")
    if sd >= LARGEST_FOCAL_SD:  # a guess for any lens, without information on this one
        return replace(focal, prior="search", people_share=1.0)
    # The people's share of the total information (inverse variances); the rest is of the scene's value.
    scene_px, people_px = sd * lens.focal, np.inf if focal.people_sigma_px is None else focal.people_sigma_px
    share = float(1 / (1 + (people_px / scene_px) ** 2))
    return replace(focal, prior="search", people_share=share, scene_px=lens.focal, scene_sigma_px=scene_px)
