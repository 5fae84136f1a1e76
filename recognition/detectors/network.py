"""One ONNX network on the CPU; the only module that imports onnxruntime, and only when a network is loaded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import Outputs
from recognition.detectors.manifest import InputSpec
from recognition.errors import ModelError

_ELEMENT_TYPES = {"float32": "tensor(float)", "uint8": "tensor(uint8)", "int32": "tensor(int32)"}


class Network:
    """A network with one input, checked against its manifest by looking and by one run."""

    def __init__(self, onnx: bytes, path: Path, spec: InputSpec, *, outputs: int, threads: int, batch: int = 1) -> None:
        """Load it.

        Args:
            onnx: content of the file.
            path: where it came from, for messages.
            spec: the manifest's input; its size is that of an input of open size.
            outputs: how many of the first outputs are read.
            threads: threads within one operator.
            batch: images in the one run; more than one needs a network whose input is open there.

        Raises:
            ModelError: where onnxruntime refuses the file, or the input is not as stated.
        """
        self._name = spec.name
        with _refusals_explained(path):
            self._session = _open(onnx, threads)
            _check_input(self._session, path, spec, batch)
            names = [output.name for output in self._session.get_outputs()]
            tried = self._session.run(names, {spec.name: np.zeros(_shape(spec, batch), spec.dtype)})
        self._read = names[:outputs]
        self.shapes = {name: np.asarray(output).shape for name, output in zip(names, tried, strict=True)}
        """Shape of each output, by name, in the order of the graph; those too that are not read."""

    def run(self, tensor: NDArray[Any]) -> Outputs:
        """The outputs that are read, for one input."""
        return tuple(np.asarray(output) for output in self._session.run(self._read, {self._name: tensor}))


def _open(onnx: bytes, threads: int) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # what matters is raised; the rest would go to stderr past every logger
    return onnxruntime.InferenceSession(onnx, options, providers=["CPUExecutionProvider"])


@contextmanager
def _refusals_explained(path: Path) -> Iterator[None]:
    from onnxruntime.capi import onnxruntime_pybind11_state as ort

    refusals = (ort.Fail, ort.InvalidArgument, ort.InvalidGraph, ort.InvalidProtobuf, ort.NotImplemented)
    try:
        yield
    except (*refusals, ort.RuntimeException) as error:
        raise ModelError(
            "onnxruntime cannot run this network",
            where=path,
            expected="an ONNX file whose operators onnxruntime has",
            got=str(error).strip(),
            do_next="copy the file again; if it stays so, export the network again with an older opset",
        ) from error


def _check_input(session: Any, path: Path, spec: InputSpec, batch: int) -> None:
    inputs = session.get_inputs()
    shape = _shape(spec, batch)
    fits = len(inputs) == 1 and (
        inputs[0].name == spec.name
        and inputs[0].type == _ELEMENT_TYPES[spec.dtype]
        and len(inputs[0].shape) == len(shape)
        and all(got == want for got, want in zip(inputs[0].shape, shape, strict=True) if isinstance(got, int))
    )
    if not fits:
        raise ModelError(
            "the network's input is not what its manifest states",
            where=path,
            expected=f"{spec.name!r} {_text(shape)} {_ELEMENT_TYPES[spec.dtype]}",
            got=", ".join(f"{got.name!r} {_text(got.shape)} {got.type}" for got in inputs),
            do_next="mend input.name, input.size_wh, input.layout and input.dtype of the manifest",
        )


def _shape(spec: InputSpec, batch: int) -> tuple[int, ...]:
    width, height = spec.size_wh
    return (batch, 3, height, width) if spec.layout == "nchw" else (batch, height, width, 3)


def _text(shape: Any) -> str:
    return "x".join(map(str, shape))
