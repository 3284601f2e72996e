"""Measures that only the benchmarks need: of detections, tracklets, identities and correspondences."""
