"""The paper's own figures: Tables 1 to 3 of Xu, Li, Weng, Kitani, CVPR 2021, on its three real scenes of four cameras each."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

SCENES: Mapping[str, str] = MappingProxyType(
    {"terrace": "Terrace, 80 m²", "basketball": "Basketball, 350 m²", "construction": "ConstructSite, 600 m²"}
)
"""The preset that stands for each."""

POSES: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "sift": {"terrace": (4599, 55.0), "basketball": (6140, 65.5), "construction": (10770, 45.7)},
        "superpoint": {"terrace": (358, 54.7), "basketball": (20065, 54.0), "construction": (2530, 50.1)},
        "wxbs": {"terrace": (1302, 54.1), "basketball": (82000, 57.0), "construction": (7800, 48.9)},
        "superpoint-lightglue": {"terrace": (9934, 37.0), "basketball": (12000, 29.1), "construction": (1722, 24.1)},
        "oracle": {"terrace": (390, 1.18), "basketball": (358, 0.66), "construction": (591, 2.08)},
        "boxes-by-hand": {"terrace": (308, 0.52), "basketball": (490, 0.85), "construction": (485, 1.80)},
        "boxes-re-id": {"terrace": (308, 0.52), "basketball": (410, 0.88), "construction": (493, 1.85)},
    }
)
"""Table 1: metric errors, mm and degrees. `superpoint-lightglue` is its row of SuperGlue."""

REPROJECTIONS: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "sift": {"terrace": (254, 44), "basketball": (533, 93), "construction": (178, 23)},
        "superpoint-lightglue": {"terrace": (36.57, 6.35), "basketball": (11.03, 1.91), "construction": (96.38, 12.68)},
        "oracle": {"terrace": (0.45, 0.08), "basketball": (0.51, 0.09), "construction": (13.45, 1.78)},
        "boxes-re-id": {"terrace": (2.30, 0.40), "basketball": (1.01, 0.18), "construction": (45.10, 5.93)},
    }
)
"""Table 2: RPE in pixels, ERR in percent."""

POSES_MEAN: tuple[float, float] = (404, 1.08)  # mean of Table 1's row `boxes-re-id` over the scenes

NOISE: Mapping[str, Mapping[float, tuple[float, float]]] = MappingProxyType(
    {
        "terrace": {1: (339, 0.65), 5: (407, 1.50), 10: (433, 1.91), 20: (1692, 28.5)},
        "basketball": {1: (454, 1.03), 5: (532, 1.76), 10: (1653, 26.2), 20: (3093, 49.2)},
        "construction": {1: (489, 1.86), 5: (537, 1.86), 10: (601, 1.85), 20: (867, 2.31)},
    }
)
"""Table 3: metric errors, mm and degrees, by uniform noise of the boxes' corners of plus or minus so many pixels."""
NOISE_FAILS_PX = 50.0  # with this much it fails on all scenes
