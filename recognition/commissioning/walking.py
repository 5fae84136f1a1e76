"""The walk as it is done: each step is said, waited for, and held for its time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from recognition.commissioning.walk import Performed, Walk


def walked(
    walk: Walk,
    *,
    now_ns: Callable[[], int],
    say: Callable[[str], None],
    wait: Callable[[float], bool],
    confirmed: Callable[[], bool] | None = None,
) -> Iterator[Performed]:
    """Go through a walk; the steps that were done to their end.

    Args:
        walk: The steps.
        now_ns: The present rig time.
        say: Tells those who walk what to do.
        wait: Lets so many seconds pass; False where the walk is to end.
        confirmed: Waits until somebody says that all are in place, False where the walk is to end; None: the step's
            own time to get there is waited for.
    """
    count = len(walk.steps)
    for number, step in enumerate(walk.steps, start=1):
        say(f"step {number} of {count}: {step.say}")
        if confirmed is None:
            say(f"  in place within {step.prepare_s:g} s")
        if not (wait(step.prepare_s) if confirmed is None else confirmed()):
            return
        start_ns = now_ns()
        say(f"  go on like this for {step.seconds:g} s")
        if not wait(step.seconds):
            return
        yield Performed(step, start_ns, now_ns())
