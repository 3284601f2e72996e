"""From videos to observations: decoding, a detector without weights, networks, and the cache of their results.

Imports `interchange` and lower packages; does not import scenes or solvers.
"""
