"""Sessions of ONNX files, the same for all stages: one thread, no messages, and the same results bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import onnxruntime

from passerby.common.errors import InputError

CPU = "CPUExecutionProvider"
CUDA = "CUDAExecutionProvider"

# An algorithm chosen by timing would differ from run to run, and with it the last bits; TF32 has 10 bits of mantissa.
CUDA_OPTIONS = {"cudnn_conv_algo_search": "HEURISTIC", "use_tf32": "0"}

ERRORS_ONLY = 3


@dataclass(frozen=True)
class Port:
    """An input or output of a network."""

    name: str
    shape: tuple[int | None, ...]
    """Size of each dimension; None where the file leaves it open."""
    kind: str
    """Type as ONNX Runtime writes it, such as tensor(float)."""

    def __str__(self) -> str:
        sizes = ", ".join("?" if size is None else str(size) for size in self.shape)
        return f"{self.name} [{sizes}] of {self.kind.removeprefix('tensor(').removesuffix(')')}"


def open_session(path: Path, *, allow_cuda: bool = True) -> onnxruntime.InferenceSession:
    """Open an ONNX file: on CUDA where this ONNX Runtime has it and it works, else on the processor.

    The session has one thread that does not spin: cameras are processed in processes of their own, and threads that wait for
    each other by spinning take time from the other cameras.

    Args:
        path: the file.
        allow_cuda: False for the processor in any case.

    Returns:
        The session; `provider_of` returns where it runs. Raises `InputError` for a file that is not there, is no ONNX file, is
        damaged, or needs what this ONNX Runtime does not have.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file: give the path of an ONNX file")
    onnxruntime.disable_telemetry_events()
    onnxruntime.set_default_logger_severity(ERRORS_ONLY)
    if allow_cuda and CUDA in onnxruntime.get_available_providers():
        try:
            return _open_session(path, [(CUDA, CUDA_OPTIONS), CPU])
        except runtime_errors():
            pass  # A card that is absent, too old or full; an error of the file itself is found again below.
    try:
        return _open_session(path, [CPU])
    except runtime_errors() as error:
        raise InputError(f"{path}: {_complaint(path, error)}") from error


def provider_of(session: onnxruntime.InferenceSession) -> str:
    """Return where a session runs, for the report: CUDA or CPU."""
    return str(session.get_providers()[0]).removesuffix("ExecutionProvider")


def inputs_of(session: onnxruntime.InferenceSession) -> tuple[Port, ...]:
    """Return the inputs of a network, in the file's order."""
    return tuple(_port(value) for value in session.get_inputs())


def outputs_of(session: onnxruntime.InferenceSession) -> tuple[Port, ...]:
    """Return the outputs of a network, in the file's order."""
    return tuple(_port(value) for value in session.get_outputs())


def _port(value: Any) -> Port:
    """Convert ONNX Runtime's description, in which an open dimension is a name, None or not above 0."""
    shape = tuple(size if isinstance(size, int) and size > 0 else None for size in value.shape or ())
    return Port(value.name, shape, value.type)


def _open_session(path: Path, providers: list[Any]) -> onnxruntime.InferenceSession:
    """Open a session with the options of all of Passerby's networks."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = ERRORS_ONLY
    options.use_deterministic_compute = True
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    # ONNX Runtime's own fallback would print to standard output.
    session = onnxruntime.InferenceSession(str(path), sess_options=options, providers=providers, enable_fallback=0)
    for value in (*session.get_inputs(), *session.get_outputs()):
        _port(value)  # raises `UnicodeDecodeError` where a name in the file is no text
    return session


def runtime_errors() -> tuple[type[Exception], ...]:
    """Return the errors of ONNX Runtime: each is an `Exception` of its own, without a common base."""
    state = onnxruntime.capi.onnxruntime_pybind11_state
    names = (
        "EPFail",
        "EngineError",
        "Fail",
        "InvalidArgument",
        "InvalidGraph",
        "InvalidProtobuf",
        "NoModel",
        "NoSuchFile",
        "NotFound",
        "NotImplemented",
        "RuntimeException",
    )
    return (*(getattr(state, name) for name in names if hasattr(state, name)), RuntimeError, ValueError)


def _complaint(path: Path, error: Exception) -> str:
    """Describe in one line the error of the file and its remedy."""
    if isinstance(error, UnicodeDecodeError):
        return "its names are not text: the file is damaged; fetch it again or give another"
    kind = type(error).__name__
    text = " ".join(str(error).split())
    said = text if len(text) < 160 else f"... {text[-150:]}"
    if kind == "InvalidProtobuf" or "No graph was found" in text:
        return (
            f"this is not an ONNX file, or its download broke off ({path.stat().st_size} bytes): fetch it again or give another"
        )
    if (
        "opset" in text
        or "IR version" in text
        or kind == "NotImplemented"
        or "No Op registered" in text
        or "not a registered" in text
    ):
        return (
            f"needs operators that ONNX Runtime {onnxruntime.__version__} does not have: upgrade onnxruntime, or export the "
            f"network with an older opset ({said})"
        )
    return (
        f"ONNX Runtime {onnxruntime.__version__} does not open it: the file is damaged; fetch it again or give another ({said})"
    )
