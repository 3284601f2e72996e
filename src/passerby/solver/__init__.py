"""Estimation of a rig from people with identities: the start, the adjustment of upright people, uncertainty and findings.

`optimizer/` is the least-squares solver; `geopose/` is the published method. Imports `people` and lower packages, not
`association`.
"""
