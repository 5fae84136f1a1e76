"""Who does the work where there is much of it, processes of this machine or a Dask cluster, and how it outlives them.

Decision: both are a :class:`concurrent.futures.Executor`, so that one function hands out the work. A pool of processes
breaks as a whole when one is killed, and does not say at whose work; Dask suspects whatever the worker had before it.
So all that was lost is tried again, each piece alone, and only what kills its worker then too is given up. A scheduler
that somebody else runs tries again by itself before it says that a piece is lost.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from typing import TYPE_CHECKING, Any, TypeVar

from recognition.errors import BatchError

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
R = TypeVar("R")

_POLL_S = 0.2
"""How soon a wish to stop is seen."""
_CONNECT_S = 10


class WorkerLostError(Exception):
    """Stands for the result of a piece of work whose worker ended twice, the second time with nothing else to do."""


@dataclass(frozen=True, slots=True)
class Crew:
    """Who does the work."""

    hire: Callable[[], Executor]
    """Called again when the last one is broken."""
    at_once: int | None
    """How much is handed out at a time; None: everything, they queue by themselves."""
    lost: tuple[type[BaseException], ...]
    """What a future raises whose worker ended."""


@contextmanager
def process_pool(jobs: int) -> Iterator[Crew]:
    """New processes of this machine, which end with this one and are ended with the block."""
    others = set(active_children())
    hired: list[Executor] = []

    def hire() -> Executor:
        hired.append(ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin))
        return hired[-1]

    try:
        yield Crew(hire, jobs, (BrokenExecutor,))
    finally:
        for executor in hired:
            executor.shutdown(wait=False, cancel_futures=True)
        for process in set(active_children()) - others:
            process.terminate()
        for executor in hired:
            executor.shutdown()


def leave_signals_to_parent() -> None:
    """In a worker: Ctrl-C and a closed terminal, which every process of a terminal is told of, are its parent's."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def _begin() -> None:
    leave_signals_to_parent()
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


@contextmanager
def dask_workers(count: int) -> Iterator[Crew]:
    """A Dask cluster of this machine with so many workers, for as long as the block lasts.

    Raises:
        BatchError: where Dask is not installed.
    """
    require_dask()
    from distributed import LocalCluster

    local = LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        memory_limit=None,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
        preload=[f"from {__name__} import leave_signals_to_parent as leave; leave()"],
        scheduler_kwargs={"allowed_failures": 0},  # what is lost is tried again here
    )
    with local as cluster, dask_scheduler(cluster.scheduler_address) as crew:
        yield crew


@contextmanager
def dask_scheduler(address: str) -> Iterator[Crew]:
    """The workers of a Dask cluster that runs; they must see the recordings under the same paths.

    Args:
        address: Of its scheduler, ``tcp://HOST:8786``.

    Raises:
        BatchError: where Dask is not installed, nothing answers, or the cluster has no workers.
    """
    require_dask()
    from distributed import KilledWorker

    with _quiet("distributed"), _client(address) as client:
        if not client.nthreads():
            raise BatchError(
                "the Dask scheduler has no workers",
                where=address,
                expected="at least one",
                got="none",
                do_next=f"start some where this program is installed: dask worker {address}",
            )
        yield Crew(lambda: client.get_executor(pure=False), None, (KilledWorker,))


def _client(address: str) -> Client:
    from distributed import Client

    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BatchError(
            "no Dask scheduler answers",
            where=address,
            expected="the address of a scheduler, tcp://HOST:8786",
            got=" ".join(str(error).split()),
            do_next="start one with `dask scheduler`, or leave the work to this machine: --jobs",
        ) from error


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Without what a library prints of workers that end: it is said once, in words, by what comes of it."""
    handlers = logging.getLogger(name).handlers
    levels = [handler.level for handler in handlers]
    for handler in handlers:
        handler.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for handler, level in zip(handlers, levels, strict=True):
            handler.setLevel(level)


def require_dask() -> None:
    """BatchError where Dask is not installed."""
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise BatchError(
            "Dask is not installed",
            expected="the extra `dask`",
            got=str(error),
            do_next="run `pip install rigcal[dask]`, or leave the work to processes of this machine: --jobs",
        ) from error


def carried_out(
    work: Callable[[T], R], tasks: Sequence[T], crew: Crew, *, stop: Callable[[], bool]
) -> Iterator[tuple[T, R | BaseException]]:
    """Do something with each of many, by many.

    Args:
        work: What to do; it and what it is given travel to other processes.
        tasks: With what.
        crew: By whom.
        stop: Whether somebody wants it to end.

    Yields:
        Each task with its result or what it raised, in the order in which they are done. A task whose worker ended
        is tried again at the end, alone; :class:`WorkerLostError` where that one ended too.

    Raises:
        BatchError: where the crew itself is gone.
    """
    lost: list[T] = []
    for task, result in _handed_out(work, tasks, crew, crew.at_once or len(tasks), stop):
        if isinstance(result, crew.lost):
            lost.append(task)
        else:
            yield task, result
    for task, result in _handed_out(work, lost, crew, 1, stop):
        yield task, WorkerLostError() if isinstance(result, crew.lost) else result


def _handed_out(
    work: Callable[[T], R], tasks: Sequence[T], crew: Crew, at_once: int, stop: Callable[[], bool]
) -> Iterator[tuple[T, R | BaseException]]:
    waiting = deque(tasks)
    running: dict[Future[R], T] = {}
    executor = crew.hire() if tasks else None
    while executor is not None and (waiting or running):
        broken = False
        try:
            while waiting and len(running) < at_once:
                running[executor.submit(work, waiting[0])] = waiting[0]
                waiting.popleft()
        except BrokenExecutor:  # a worker ended between two tasks
            broken = True
        for future in wait(running, timeout=_POLL_S, return_when=FIRST_COMPLETED).done:
            if stop():
                return
            result = _result(future)
            broken |= isinstance(result, BrokenExecutor)
            yield running.pop(future), result
        if stop():
            return
        if broken:
            for future in wait(running).done:
                yield running.pop(future), _result(future)
            executor = crew.hire()


def _result(future: Future[Any]) -> Any:
    """What came of it, or what it raised."""
    if future.cancelled():
        raise BatchError(
            "the workers are gone",
            expected="workers until the end of the batch",
            got="cancelled work: the scheduler ended or was restarted",
            do_next="start them again, and give the same command: what is done is kept",
        )
    failure = future.exception()
    return future.result() if failure is None else failure
