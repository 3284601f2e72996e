"""From videos to observations: decoding, the detector that needs no weights, networks, and the cache of what was measured.

Imports `interchange` and below; knows neither scenes nor solvers.
"""
