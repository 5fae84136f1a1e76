"""Assets by name: each is made from its name alone, and a part of the names is sealed for the test half.

A name is a number in four digits (``"0017"``). Names from ``SEALED_FROM`` on belong to the sealed test half of the
evaluation sequences and never appear in training or validation; ``tests/tools/test_sicsg_split.py`` compares the lists.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import numpy as np

Split = Literal["train", "validation", "test"]
KINDS = ("room", "body", "clothes", "motion", "light", "texture", "variant")
SEALED_FROM = 8000
"""Names below it are open (training and validation), names from it on are sealed (test)."""
POOL = {"room": 400, "body": 200, "clothes": 300, "motion": 200, "light": 200, "texture": 24, "variant": 24}
"""How many names each kind has open; the sealed part has a quarter of it, at least 8."""


def asset_rng(kind: str, name: str) -> np.random.Generator:
    """The random numbers that make the asset; ``kind`` may be narrower than in ``KINDS`` (``"variant/ladder"``)."""
    digest = hashlib.sha256(f"{kind}/{name}".encode()).digest()
    return np.random.default_rng(np.frombuffer(digest[:16], dtype=np.uint32))


def draw(kind: str, split: Split, rng: np.random.Generator) -> str:
    """A name of one of ``KINDS`` that the split may use."""
    count = POOL[kind]
    if split == "test":
        return f"{SEALED_FROM + int(rng.integers(max(8, count // 4))):04d}"
    if kind == "room":  # validation has rooms of its own
        first, end = (0, count * 3 // 4) if split == "train" else (count * 3 // 4, count)
        return f"{int(rng.integers(first, end)):04d}"
    return f"{int(rng.integers(count)):04d}"


def is_sealed(name: str) -> bool:
    """Whether the name belongs to the test half."""
    return int(name) >= SEALED_FROM
