"""Trainings need PyTorch, which comes with the extra "reid"; without it their tests are left out."""

from importlib.util import find_spec

NEEDING_TORCH = ("augmentation", "checkpoints", "export", "losses", "sampling", "training")
collect_ignore = [] if find_spec("torch") else [f"test_{name}.py" for name in NEEDING_TORCH]
