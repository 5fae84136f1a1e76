"""The two networks: plain 3x3 convolutions, which ONNX Runtime runs fastest in int8 on a CPU.

Decision: plain convolutions and no inverted residuals. At equal size in int8 the latter were slower and trained
several times slower on a CPU (see the reference of measured costs); depthwise convolutions are bound by memory there.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from recognition.detectors.bundled.decode import LOG_DISTANCE
from recognition.detectors.bundled.geometry import SITE_STRIDES, WORKER_STRIDE, WORKER_WH


@dataclass(frozen=True, slots=True)
class SiteWidths:
    """Channels of the site network."""

    stem: int = 32
    """At stride 4."""
    stages: tuple[int, int, int] = (64, 128, 192)
    """At strides 8, 16 and 32."""
    depths: tuple[int, int, int] = (1, 2, 1)
    """Further convolutions of each stage after the one with stride 2."""
    neck: int = 48
    """Of the top-down path and the heads."""


class ConvUnit(nn.Sequential):
    """Convolution, batch normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int, *, size: int = 3, stride: int = 1, dilation: int = 1) -> None:
        padding = dilation * ((size - stride + 1) // 2)
        super().__init__(
            nn.Conv2d(inputs, outputs, size, stride, padding, dilation, bias=False),
            nn.BatchNorm2d(outputs, momentum=0.03),
            nn.ReLU(inplace=True),
        )


def _stage(inputs: int, outputs: int, further: int) -> nn.Sequential:
    return nn.Sequential(ConvUnit(inputs, outputs, stride=2), *(ConvUnit(outputs, outputs) for _ in range(further)))


def _up(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


class SiteNetwork(nn.Module):
    """People with joints and objects with keypoints in the whole image.

    Features at strides 4 (in one step) to 32, a top-down path that adds, and heads with shared weights at strides 8,
    16 and 32.
    """

    def __init__(self, classes: int, widths: SiteWidths | None = None) -> None:
        super().__init__()
        w = widths or SiteWidths()
        self.stem = ConvUnit(3, w.stem, size=6, stride=4)
        inputs = (w.stem, *w.stages)
        self.stages = nn.ModuleList(_stage(inputs[idx], inputs[idx + 1], depth) for idx, depth in enumerate(w.depths))
        self.laterals = nn.ModuleList(ConvUnit(channels, w.neck, size=1) for channels in w.stages)
        self.smooth = nn.ModuleList(ConvUnit(w.neck, w.neck) for _ in SITE_STRIDES[:-1])
        self.class_unit = ConvUnit(w.neck, w.neck)
        self.place_unit = ConvUnit(w.neck, w.neck)
        self.class_out = nn.Conv2d(w.neck, classes, 1)
        self.place_out = nn.Conv2d(w.neck, 4 + 34 + 17 + 8, 1)
        nn.init.constant_(self.class_out.bias, -4.6)  # everything starts at a score of 0.01: rare is the rule
        nn.init.normal_(self.place_out.weight, std=0.01)
        nn.init.zeros_(self.place_out.bias)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (N, A, C) and places (N, A, 63), both raw, cells of the finest stride first, row by row."""
        features = []
        x = self.stem(x)
        for stage in self.stages:
            x = stage(x)
            features.append(x)
        lateral = [unit(feature) for unit, feature in zip(self.laterals, features, strict=True)]
        level = lateral[-1]
        levels = [level]
        for idx in (1, 0):
            level = self.smooth[idx](lateral[idx] + _up(level))
            levels.insert(0, level)
        logits = [self.class_out(self.class_unit(level)).flatten(2) for level in levels]
        places = [self.place_out(self.place_unit(level)).flatten(2) for level in levels]
        return torch.cat(logits, 2).transpose(1, 2), torch.cat(places, 2).transpose(1, 2)


def boxes_from(raw: Tensor, centres: Tensor, strides: Tensor) -> Tensor:
    """Boxes (..., A, 4) xyxy in input pixels of raw distances (..., A, 4): stride * exp(raw) to each side."""
    distances = strides * raw.clamp(*LOG_DISTANCE).exp()
    return torch.cat([centres - distances[..., :2], centres + distances[..., 2:]], -1)


def points_from(raw: Tensor, centres: Tensor, strides: Tensor) -> Tensor:
    """Points (..., A, K, 2) in input pixels of raw offsets (..., A, 2K)."""
    return raw.unflatten(-1, (-1, 2)) * strides[..., None] + centres[:, None, :]


class WorkerNetwork(nn.Module):
    """Joints of the worker in the middle of a crop and every hard hat in it."""

    def __init__(self, joints: int, width: int = 32) -> None:
        super().__init__()
        w = width
        self.stage4 = nn.Sequential(ConvUnit(3, w, size=6, stride=4), ConvUnit(w, w))
        self.stage8 = _stage(w, 2 * w, 2)
        # Dilated, so that every cell knows the whole crop: left and right follow from which way the worker faces.
        self.stage16 = nn.Sequential(ConvUnit(2 * w, 3 * w, stride=2), ConvUnit(3 * w, 3 * w, dilation=2))
        self.lateral8 = ConvUnit(3 * w, 2 * w, size=1)
        self.smooth8 = ConvUnit(2 * w, 2 * w)
        self.lateral4 = ConvUnit(2 * w, w, size=1)
        self.smooth4 = nn.Sequential(ConvUnit(w, 3 * w // 2), ConvUnit(3 * w // 2, 3 * w // 2))
        self.heat_out = nn.Conv2d(3 * w // 2, joints, 1)
        self.hat_out = nn.Conv2d(3 * w // 2, 5, 1)
        self.squeeze = ConvUnit(3 * w, w // 2, size=1)
        cells16 = (WORKER_WH[0] // 16) * (WORKER_WH[1] // 16)
        self.state_out = nn.Linear(w // 2 * cells16, 2 * joints)
        nn.init.constant_(self.hat_out.bias[:1], -4.6)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Raw: heat (N, J, H/4, W/4), hats (N, 5, H/4, W/4) and states (N, J, 2): in the crop, visible."""
        x4 = self.stage4(x)
        x8 = self.stage8(x4)
        x16 = self.stage16(x8)
        y8 = self.smooth8(x8 + _up(self.lateral8(x16)))
        y4 = self.smooth4(x4 + _up(self.lateral4(y8)))
        states = self.state_out(self.squeeze(x16).flatten(1)).unflatten(1, (-1, 2))
        return self.heat_out(y4), self.hat_out(y4), states


def hat_boxes(raw: Tensor) -> Tensor:
    """Boxes (N, H, W, 4) xyxy in crop pixels of the hat head's raw distances (N, 4, H, W)."""
    height, width = raw.shape[2:]
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    centres = (torch.stack([x, y], -1) + 0.5) * WORKER_STRIDE
    distances = WORKER_STRIDE * raw.clamp(*LOG_DISTANCE).exp().permute(0, 2, 3, 1)
    return torch.cat([centres - distances[..., :2], centres + distances[..., 2:]], -1)
