"""From identities to a rig: the adjustment of upright people, its start, its uncertainty and what it finds wrong.

`optimizer/` minimises; `geopose/` is the published method. Imports `people` and below, and no association.
"""
