"""Trains one network: AdamW, cosine with warm-up, bfloat16, an average of the weights; goes on where it stopped.

``OUT/checkpoint.pt`` is written after each epoch, ``OUT/log.jsonl`` has one line per epoch.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import nn

from recognition.observations import JOINTS
from tools.train.cache import CACHED_WH, site_cache, worker_cache
from tools.train.coco import DataError, read_split
from tools.train.geometry import WORKER_JOINTS
from tools.train.lanes import Lanes, Loss
from tools.train.losses import SiteLoss, WorkerLoss
from tools.train.networks import SiteNetwork, WorkerNetwork
from tools.train.samples import Shuffled, SiteSamples, WorkerSamples, batches
from tools.train.warp import Mirror


@dataclass(frozen=True, slots=True)
class FitOptions:
    """How one network is trained."""

    network: Literal["site", "worker"]
    joints: Literal["all", "rules"] = "all"
    """Joints of the worker network: COCO-17, or those that rules look at."""
    epochs: int = 24
    batch: int = 8
    """Samples per lane."""
    rate: float = 2e-3
    """Highest learning rate."""
    decay: float = 0.05
    """Of the weights of convolutions."""
    seed: int = 0
    processes: int = 2
    """That augment."""
    lanes: int = 2
    """Threads, each with a batch of its own."""

    def joint_names(self) -> tuple[str, ...]:
        """Joints that the worker network gives, in their order."""
        return WORKER_JOINTS[self.joints]


class Average:
    """Exponential moving average of a network's weights, quicker at the start."""

    def __init__(self, network: nn.Module) -> None:
        self.state = {name: value.detach().clone() for name, value in network.state_dict().items()}

    def update(self, network: nn.Module, step: int) -> None:
        """Take the weights after a step, counted from 1."""
        keep = min(0.9985, (1 + step) / (10 + step))
        for name, value in network.state_dict().items():
            if value.is_floating_point():
                self.state[name].lerp_(value, 1.0 - keep)
            else:
                self.state[name].copy_(value)


def build_network(options: FitOptions, classes: int) -> nn.Module:
    """The network that the options ask for, untrained."""
    torch.manual_seed(options.seed)
    if options.network == "site":
        return SiteNetwork(classes)
    return WorkerNetwork(len(options.joint_names()))


def fit(options: FitOptions, data: Path, out: Path, say: Callable[[str], None]) -> Path:
    """Train, or go on training; returns the checkpoint.

    Args:
        options: of the run; a checkpoint of other options is refused. Only the number of epochs may change: the
            learning rate falls to its end by then.
        data: folder with ``coco_train.json``.
        out: folder for checkpoint and log.
        say: takes a line for the user.

    Raises:
        DataError: where data or checkpoint do not fit.
    """
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    train = read_split(data, "train")
    mirror = Mirror.of(train.categories)
    if options.network == "site":
        samples: Any = SiteSamples(site_cache(train, CACHED_WH, say), mirror, options.seed)
        loss: Loss = SiteLoss()
    else:
        samples = WorkerSamples(worker_cache(train, say), mirror, options.seed)
        loss = WorkerLoss(tuple(JOINTS.index(name) for name in options.joint_names()))
    least = options.batch * options.lanes
    if len(samples) < least:
        raise DataError(
            "too little to train with", where=train.source, expected=f"{least} samples or more",
            got=len(samples), do_next="Render more, or take a smaller batch.",
        )  # fmt: skip
    network = build_network(options, len(train.categories)).to(memory_format=torch.channels_last)
    return _Run(options, network, loss, samples, out, say).train()


class _Run:
    def __init__(
        self, options: FitOptions, network: nn.Module, loss: Loss, samples: Any, out: Path, say: Callable[[str], None]
    ) -> None:
        self._options, self._network, self._out, self._say = options, network, out, say
        self._lanes = Lanes(network, loss, options.lanes)
        self._sampler = Shuffled(len(samples), options.seed)
        self._batches = batches(samples, self._sampler, options.batch, options.processes)
        self._average = Average(network)
        self._optimiser = torch.optim.AdamW(_groups(network, options.decay), lr=options.rate)
        self._path = out / "checkpoint.pt"
        self._plans = [[0, options.epochs]]
        """From which epoch on the learning rate fell to its end by which."""

    def train(self) -> Path:
        first = self._restored()
        for epoch in range(first, self._options.epochs):
            self._sampler.epoch = epoch
            start = time.monotonic()
            means = self._epoch(epoch)
            took = time.monotonic() - start
            self._store(epoch + 1)
            line = {"epoch": epoch, "seconds": round(took, 1), "images_per_s": round(len(self._sampler) / took, 1)}
            with (self._out / "log.jsonl").open("a", encoding="utf-8") as log:
                log.write(json.dumps(line | means) + "\n")
            self._say(f"epoch {epoch + 1}/{self._options.epochs} {line['images_per_s']}/s {means}")
        return self._path

    def _epoch(self, epoch: int) -> dict[str, float]:
        sums: dict[str, float] = {}
        count = len(self._batches) // self._options.lanes
        batches = iter(self._batches)
        for idx in range(count):
            step = epoch * count + idx
            for group in self._optimiser.param_groups:
                group["lr"] = learning_rate(step, self._options.epochs * count, self._options.rate)
            parts = self._lanes.gradients([next(batches) for _ in range(self._options.lanes)])
            nn.utils.clip_grad_norm_(self._network.parameters(), 5.0)
            self._optimiser.step()
            self._average.update(self._network, step + 1)
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + value
        return {name: round(value / count, 4) for name, value in sums.items()}

    def _store(self, epochs_done: int) -> None:
        part = self._path.with_suffix(".part")
        torch.save(
            {
                "options": asdict(self._options),
                "epochs_done": epochs_done,
                "plans": self._plans,
                "network": self._network.state_dict(),
                "average": self._average.state,
                "optimiser": self._optimiser.state_dict(),
            },
            part,
        )
        part.replace(self._path)

    def _restored(self) -> int:
        if not self._path.exists():
            return 0
        stored = torch.load(self._path, weights_only=True)
        if stored["options"] | {"epochs": self._options.epochs} != asdict(self._options):
            raise DataError(
                "the checkpoint is of a run with other options", where=self._path, expected=asdict(self._options),
                got=stored["options"], do_next="Give these to go on (--epochs may differ), or another --out.",
            )  # fmt: skip
        self._network.load_state_dict(stored["network"])
        self._average.state = stored["average"]
        self._optimiser.load_state_dict(stored["optimiser"])
        done = int(stored["epochs_done"])
        self._plans = stored["plans"]
        if self._plans[-1][1] != self._options.epochs:
            self._plans.append([done, self._options.epochs])
        self._say(f"going on after epoch {done}")
        return done


def _groups(network: nn.Module, decay: float) -> list[dict[str, Any]]:
    weights = [value for value in network.parameters() if value.ndim > 1]
    others = [value for value in network.parameters() if value.ndim <= 1]
    return [{"params": weights, "weight_decay": decay}, {"params": others, "weight_decay": 0.0}]


def learning_rate(step: int, steps: int, highest: float) -> float:
    """Rises over 3 % of the steps and falls along a cosine to 1 %."""
    warm = max(1, round(0.03 * steps))
    if step < warm:
        return highest * (step + 1) / warm
    return highest * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * (step - warm) / max(1, steps - warm))))
