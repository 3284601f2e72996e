"""Tiny ONNX networks whose answers are known, and a server of such files."""
