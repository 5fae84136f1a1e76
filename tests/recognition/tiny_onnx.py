"""ONNX files written byte by byte in protobuf form, for networks whose answers are known; needs no onnx package."""

from __future__ import annotations

import hashlib

import numpy as np

FLOAT, UINT8, INT32 = 1, 2, 6


def field(number, value):
    """One protobuf field: a varint, or bytes with their length."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def varint(value):
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def value_info(name, element_type, shape):
    dims = b"".join(field(1, field(2, dim) if isinstance(dim, str) else field(1, dim)) for dim in shape)
    return field(1, name) + field(2, field(1, field(1, element_type) + field(2, dims)))


def node(op_type, inputs, output, **attributes):
    """A node with integer attributes, or lists of integers."""
    content = b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, op_type)
    for name, value in attributes.items():
        several = isinstance(value, list)
        numbers = b"".join(field(8, one) for one in value) if several else field(3, value)
        content += field(5, field(1, name) + numbers + field(20, 7 if several else 2))
    return content


def tensor(name, values):
    dims = b"".join(field(1, dim) for dim in values.shape)
    return dims + field(2, FLOAT) + field(8, name) + field(9, values.astype(np.float32).tobytes())


def model(nodes, constants, outputs, *, name, element_type, shape):
    """A graph of these nodes, with named constants and the outputs of given shapes."""
    graph = b"".join(field(1, one) for one in nodes) + field(2, "tiny")
    graph += b"".join(field(5, tensor(key, values)) for key, values in constants.items())
    graph += field(11, value_info(name, element_type, shape))
    graph += b"".join(field(12, value_info(key, FLOAT, dims)) for key, dims in outputs.items())
    return field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 13))


def tiny_network(constant, gain=None, *, name="images", element_type=FLOAT, shape=(1, 3, 32, 32), op_type="Add"):
    """Each output is its constant, plus its gain times the brightest input value.

    ``constant`` and ``gain`` are arrays, or dictionaries of them by the output's name.
    """
    constants = constant if isinstance(constant, dict) else {"output": constant}
    gains = gain if isinstance(gain, dict) else dict.fromkeys(constants, gain)
    nodes = [node("Cast", [name], "float", to=FLOAT), node("ReduceMax", ["float"], "brightest", keepdims=0)]
    values = {}
    for key, value in constants.items():
        values[f"{key}.constant"] = value
        values[f"{key}.gain"] = np.zeros_like(value) if gains[key] is None else gains[key]
        nodes += [
            node("Mul", [f"{key}.gain", "brightest"], f"{key}.scaled"),
            node(op_type, [f"{key}.constant", f"{key}.scaled"], key),
        ]
    shapes = {key: value.shape for key, value in constants.items()}
    return model(nodes, values, shapes, name=name, element_type=element_type, shape=shape)


def brightest_pixel_simcc(width, height, *, name="input"):
    """An RTMPose whose every joint is the brightest pixel: the bin of a pixel responds with its column's maximum."""
    nodes = [node("ReduceMax", [name], "grey", axes=[1], keepdims=0)]
    constants, shapes = {}, {}
    for key, across, order, length in (("simcc_x", 1, [0, 1, 2], width), ("simcc_y", 2, [0, 2, 1], height)):
        spread = np.zeros((length, 2 * length))
        spread[np.arange(length), 2 * np.arange(length)] = 1
        constants |= {f"{key}.spread": spread, f"{key}.joints": np.zeros((1, 17, 2 * length))}
        shapes[key] = (1, 17, 2 * length)
        nodes += [
            node("ReduceMax", ["grey"], f"{key}.line", axes=[across], keepdims=1),
            node("Transpose", [f"{key}.line"], f"{key}.row", perm=order),
            node("MatMul", [f"{key}.row", f"{key}.spread"], f"{key}.bins"),
            node("Add", [f"{key}.bins", f"{key}.joints"], key),
        ]
    return model(nodes, constants, shapes, name=name, element_type=FLOAT, shape=("batch", 3, height, width))


def write(folder, onnx, manifest, stem="model"):
    """FILE.onnx and FILE.toml; ``{sha256}`` in the manifest becomes the network's."""
    (folder / f"{stem}.onnx").write_bytes(onnx)
    manifest = manifest.replace("{sha256}", hashlib.sha256(onnx).hexdigest())
    (folder / f"{stem}.toml").write_text(manifest, encoding="utf-8")
    return folder / f"{stem}.onnx"
