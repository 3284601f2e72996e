"""The published solver: pairs from box centres, a star of pairs around the reference, metric scale from stature.

Xu et al., "Wide-Baseline Multi-Camera Calibration using Person Re-Identification", CVPR 2021.
"""
