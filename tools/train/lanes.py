"""One step of training on several batches at once, one thread each.

Decision: a copy of the network per thread, gradients added at the end, and not one network whose operators use several
threads. Those wait for each other at every operator, actively; where other processes want the cores too, a thread that
has to wait stops all. Measured on two cores with six other busy processes: 61 crops a second with one thread in the
operators, 3 with two.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import torch
from torch import nn

from tools.train.losses import Parts
from tools.train.samples import Batch, network_input

Loss = Callable[[Any, Batch], Parts]


class Lanes:
    """Copies of a network, one per thread."""

    def __init__(self, network: nn.Module, loss: Loss, count: int) -> None:
        self._loss = loss
        self._networks = [network, *(copy.deepcopy(network) for _ in range(count - 1))]
        self._pool = ThreadPoolExecutor(count, initializer=torch.set_num_threads, initargs=(1,))

    def gradients(self, batches: Sequence[Batch]) -> dict[str, float]:
        """Leave the mean gradient of a batch per lane at the network; returns the mean parts of the loss.

        Statistics of batch normalisation are those of the first lane's batches.
        """
        first, *others = self._networks
        used = self._networks[: len(batches)]
        with torch.no_grad():
            for other in others:
                torch._foreach_copy_(list(other.parameters()), list(first.parameters()))
        parts = list(self._pool.map(self._one, used, batches))
        with torch.no_grad():
            grads = [[value.grad for value in network.parameters()] for network in used]
            for more in grads[1:]:
                torch._foreach_add_(grads[0], more)
            torch._foreach_mul_(grads[0], 1.0 / len(used))
        return {name: sum(part[name] for part in parts) / len(parts) for name in parts[0]}

    def _one(self, network: nn.Module, batch: Batch) -> dict[str, float]:
        network.train()
        network.zero_grad(set_to_none=False)
        with torch.autocast("cpu", torch.bfloat16):
            outputs = network(network_input(batch.images))
        parts = self._loss(outputs, batch)
        torch.stack(list(parts.values())).sum().backward()
        return {name: float(value.detach()) for name, value in parts.items()}
