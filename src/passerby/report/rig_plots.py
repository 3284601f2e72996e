"""The rig in space and from above, as plotly figures in plain values: {"data": [...], "layout": {...}}.

They name no colours of text, grid and background: the page sets these for light and dark.
"""

from passerby.report.rig_plan import rig_from_above
from passerby.report.rig_space import rig_in_space

__all__ = ["rig_from_above", "rig_in_space"]
