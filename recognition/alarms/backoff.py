"""How long to wait before the next attempt: longer each time, and never in step with others.

Every wait doubles the one before up to the longest, and is shortened by a random part of up to a half: many runs that
lost the same server do not come back to it at once. The same seed gives the same waits.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from rigcal.errors import OptionError


@dataclass(frozen=True, slots=True)
class RetryOptions:
    """How soon what failed is tried again.

    Raises:
        OptionError: where the waits are not positive and in order.
    """

    first_s: float = 0.5
    """The first wait, at most."""
    longest_s: float = 60.0
    """Every later one, at most."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.first_s <= self.longest_s:
            raise OptionError("first_s", expected="a time above 0, up to longest_s", got=self.first_s)


class Backoff:
    """The waits of one target."""

    def __init__(self, options: RetryOptions, name: str) -> None:
        self._options = options
        self._random = random.Random(f"{options.seed} {name}")
        self._failures = 0

    def next_s(self) -> float:
        """How long to wait after one more failure, in seconds."""
        longest = min(self._options.longest_s, self._options.first_s * 2.0 ** min(self._failures, 60))
        self._failures += 1
        return longest * self._random.uniform(0.5, 1.0)

    def reset(self) -> None:
        """After a success."""
        self._failures = 0
