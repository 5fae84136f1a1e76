"""From a checkpoint to ONNX: fp32, and int8 calibrated on validation pictures; checked against torch.

The int8 file is static QDQ, weights per channel. The last layers stay in fp32: one scale for boxes, joints and scores
together would leave steps of several pixels.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from recognition.detectors.bundled.geometry import SITE_WH, WORKER_WH
from tools.train.cache import site_cache, worker_cache
from tools.train.coco import DataError, read_split
from tools.train.fit import FitOptions, build_network
from tools.train.networks import ConvUnit, hat_boxes
from tools.train.samples import plain_crop
from tools.train.warp import warp_image

_OPSET = 17
_CALIBRATION = 160
"""Pictures for calibration."""
_AGREE = 1e-3
"""Largest difference between torch and ONNX Runtime in fp32, relative to 1 + the value."""
OUTPUTS = {"site": ("scores", "places"), "worker": ("heat", "states", "hats")}


class SiteGraph(nn.Module):
    """The site network as the decoder defines it."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Scores and places of (1, H, W, 3) uint8."""
        logits, places = self.network(image.permute(0, 3, 1, 2).float())
        return logits.sigmoid(), places


class WorkerGraph(nn.Module):
    """The worker network as the decoder defines it."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Heat, states, hats of (N, H, W, 3) uint8."""
        heat, hats, states = self.network(image.permute(0, 3, 1, 2).float())
        shares = heat.flatten(2).softmax(-1).unflatten(2, heat.shape[2:])
        boxes = hat_boxes(hats[:, 1:]).permute(0, 3, 1, 2)
        return shares, states.sigmoid(), torch.cat([hats[:, :1].sigmoid(), boxes], 1)


def fused(network: nn.Module) -> nn.Module:
    """The network with normalisation and the division by 255 inside its convolutions; in place."""
    network.eval()
    units = [module for module in network.modules() if isinstance(module, ConvUnit)]
    for unit in units:
        unit[0], unit[1] = fuse_conv_bn_eval(unit[0], unit[1]), nn.Identity()
    units[0][0].weight.data /= 255.0
    return network


def export(data: Path, out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Write ``OUT/NETWORK.onnx``, ``OUT/NETWORK_int8.onnx`` and ``OUT/export.json`` of ``OUT/checkpoint.pt``.

    Raises:
        DataError: where there is no checkpoint, or ONNX Runtime computes something else than torch.
    """
    path = out / "checkpoint.pt"
    if not path.is_file():
        raise DataError(
            "there is no checkpoint", where=path, expected="checkpoint.pt", got="no file", do_next="Train first."
        )
    stored = torch.load(path, weights_only=True)
    options = FitOptions(**stored["options"])
    validation = read_split(data, "validation")
    network = build_network(options, len(validation.categories))
    network.load_state_dict(stored["average"])
    graph: nn.Module = (SiteGraph if options.network == "site" else WorkerGraph)(fused(network))
    if options.network == "site":
        pictures = site_cache(validation, SITE_WH, say).images
    else:
        crops = worker_cache(validation, say).images
        pictures = np.stack([warp_image(crop, plain_crop(), WORKER_WH) for crop in _spread(crops)])
    about = {
        "network": options.network,
        "classes": json.dumps([category.name for category in validation.categories]),
        "joints": json.dumps(list(options.joint_names())),
    }
    plain, small = out / f"{options.network}.onnx", out / f"{options.network}_int8.onnx"
    sample = _spread(pictures)
    difference = _write_plain(graph, sample, plain, about, OUTPUTS[options.network])
    _write_int8(plain, small, sample)
    summary = {
        "epochs": stored["epochs_done"],
        "plans": stored["plans"],
        "options": stored["options"],
        "parameters": sum(value.numel() for value in network.parameters()),
        "largest_difference_to_torch": difference,
        "files": {file.name: {"bytes": file.stat().st_size, "sha256": _sha256(file)} for file in (plain, small)},
    }
    (out / "export.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return summary


def _spread(images: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(images[:: max(1, len(images) // _CALIBRATION)][:_CALIBRATION])


def _write_plain(
    graph: nn.Module, sample: NDArray[np.uint8], path: Path, about: dict[str, str], outputs: tuple[str, ...]
) -> float:
    count = 1 if about["network"] == "site" else 3
    batch = torch.from_numpy(sample[:count].copy())
    free = {name: {0: "n"} for name in ("image", *outputs)} if about["network"] == "worker" else None
    with torch.no_grad():
        torch.onnx.export(
            graph, (batch,), str(path), opset_version=_OPSET, dynamo=False, input_names=["image"],
            output_names=list(outputs), dynamic_axes=free,
        )  # fmt: skip
        wanted = [output.numpy() for output in graph(batch)]
    model = onnx.load(path)
    _unshare(model)
    onnx.helper.set_model_props(model, about)
    onnx.save(model, path)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    got = session.run(None, {"image": batch.numpy()})
    difference = max(float((abs(a - b) / (1 + abs(b))).max()) for a, b in zip(got, wanted, strict=True))
    if difference > _AGREE:
        raise DataError(
            "ONNX Runtime computes something else than torch", where=path, expected=f"a difference of {_AGREE} or less",
            got=f"{difference:.2g}", do_next="Compare the versions of torch and onnxruntime with the pinned ones.",
        )  # fmt: skip
    return difference


def _unshare(model: onnx.ModelProto) -> None:
    """Give every convolution weights of its own.

    ONNX Runtime packs weights for its kernels once, unless several nodes share them: the shared heads took 0.45 ms
    at stride 16 where the same convolution with weights of its own took 0.14 ms.
    """
    stored = {tensor.name: tensor for tensor in model.graph.initializer}
    alias = {node.output[0]: node.input[0] for node in model.graph.node if node.op_type == "Identity"}
    seen: set[str] = set()
    for node in model.graph.node:
        if node.op_type != "Conv":
            continue
        for place in (1, 2):
            name = node.input[place]
            while name in alias:
                name = alias[name]
            if name in seen:
                twin = model.graph.initializer.add()
                twin.CopyFrom(stored[name])
                twin.name = name = f"{name}_of_{node.name}"
            seen.add(name)
            node.input[place] = name
    used = {name for node in model.graph.node if node.op_type != "Identity" for name in node.input}
    used |= {output.name for output in model.graph.output}
    for node in [node for node in model.graph.node if node.op_type == "Identity" and node.output[0] not in used]:
        model.graph.node.remove(node)


class _Reader(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, sample: NDArray[np.uint8]) -> None:
        self._rest: Iterator[NDArray[np.uint8]] = iter(sample)

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        image = next(self._rest, None)
        return None if image is None else {"image": image[None]}


def _write_int8(plain: Path, path: Path, sample: NDArray[np.uint8]) -> None:
    ready = path.with_suffix(".part")
    quant_pre_process(str(plain), str(ready), skip_symbolic_shape=True)
    model = onnx.load(ready)
    quantize_static(
        str(ready), str(path), _Reader(sample), quant_format=QuantFormat.QDQ, per_channel=True,
        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8,
        op_types_to_quantize=["Conv", "Relu", "Add", "Resize"], nodes_to_exclude=_from_last_layers(model),
    )  # fmt: skip
    ready.unlink()
    small = onnx.load(path)
    _without_input_cast(small)
    props = {entry.key: entry.value for entry in model.metadata_props}
    onnx.helper.set_model_props(small, props)
    onnx.checker.check_model(small)
    onnx.save(small, path)


def _from_last_layers(model: onnx.ModelProto) -> list[str]:
    """Names of the last layers and of all that follows them."""
    reached: set[str] = set()
    names = []
    for node in model.graph.node:
        if "_out" in node.name.split("/")[-2:][0] or reached & set(node.input):
            reached |= set(node.output)
            names.append(node.name)
    return names


def _without_input_cast(model: onnx.ModelProto) -> None:
    """The input's bytes are the first convolution's int8 input: drop the way to float and back."""
    cast = next(node for node in model.graph.node if node.op_type == "Cast")
    quantise = next(node for node in model.graph.node if cast.output[0] in node.input)
    if quantise.op_type != "QuantizeLinear":
        raise DataError(
            "the int8 graph starts in another way", where=quantise.name, expected="QuantizeLinear",
            got=quantise.op_type, do_next="Compare the version of onnxruntime with the pinned one.",
        )  # fmt: skip
    for tensor in model.graph.initializer:
        if tensor.name in quantise.input[1:]:
            value = np.ones_like(onnx.numpy_helper.to_array(tensor)) * (tensor.name == quantise.input[1])
            tensor.CopyFrom(onnx.numpy_helper.from_array(value, tensor.name))
    for node in model.graph.node:
        for place, name in enumerate(node.input):
            if name == quantise.output[0]:
                node.input[place] = cast.input[0]
    model.graph.node.remove(cast)
    model.graph.node.remove(quantise)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
