"""A part of a scene's inputs: some of its cameras, as if the others were not there."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.findings.finding import Finding
from passerby.scene.inputs import SceneInputs


def part_of(inputs: SceneInputs, names: Collection[str]) -> SceneInputs:
    """The inputs of some cameras, in the order of the rig.

    Doubts about the whole scene hold of the part too; notices are those about its cameras.

    Args:
        inputs: of all cameras.
        names: the cameras of the part.
    """
    inside = [camera for camera in inputs.rig if camera.name in names]
    seen = inputs.observations
    own = [camera.name for camera in inside]
    clocks = {name: seen.clocks[name] for name in own if name in seen.clocks}
    fps = clocks[own[0]].fps if own and own[0] in clocks else seen.fps
    return replace(
        inputs,
        rig=Rig(tuple(inside)),
        observations=Observations({name: seen[name] for name in own}, fps, clocks),
        findings=tuple(finding for finding in inputs.findings if _is_about(finding, own)),
        doubts=tuple(finding for finding in inputs.doubts if not finding.cameras or _is_about(finding, own)),
        pointed=tuple(one for one in inputs.pointed if one.camera in own),
        stated=inputs.stated.within(own),
        measured=tuple(one for one in inputs.measured if set(one.cameras) <= set(own)),
        gaps={name: spans for name, spans in inputs.gaps.items() if name in own},
        elsewhere=(*inputs.elsewhere, *(camera for camera in inputs.rig if camera.name not in names)),
    )


def _is_about(finding: Finding, names: Collection[str]) -> bool:
    """Whether a finding is about one of the cameras."""
    return any(name in names for name in finding.cameras)
