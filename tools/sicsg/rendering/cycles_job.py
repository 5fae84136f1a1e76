"""The child process in which Blender runs, and what can go wrong with it."""

from __future__ import annotations

import os
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tools.sicsg.blender import wire

ROOT = Path(__file__).resolve().parents[3]
PYTHON_VARIABLE = "SICSG_BPY_PYTHON"
_SHARED_MEMORY = Path("/dev/shm")
_LAST_LINES = 12
_PATIENCE_S = 5.0
"""How long a process may take to end by itself."""


class CyclesError(RuntimeError):
    """Cycles cannot render; comes whole through a pool of processes."""

    def __init__(self, what: str, got: str, todo: str) -> None:
        super().__init__(what, got, todo)

    def __str__(self) -> str:
        what, got, todo = self.args
        return f"{what}: {got}; {todo}"


def blender_python() -> Path:
    """The Python that has bpy: of the environment variable ``SICSG_BPY_PYTHON``, else of ``.venv-sicsg``."""
    return Path(os.environ.get(PYTHON_VARIABLE) or ROOT / ".venv-sicsg" / "bin" / "python")


class CyclesJob:
    """Blender in a process of its own, that does jobs in order. :meth:`close` it when done.

    Raises:
        CyclesError: from every method, if the process cannot be started, cannot import bpy, ends, takes longer than
            ``timeout_s`` over an answer, or answers with something else.
    """

    def __init__(self, python: Path, timeout_s: float) -> None:
        self._python, self._timeout_s, self._late = python, timeout_s, threading.Event()
        in_memory = _SHARED_MEMORY if _SHARED_MEMORY.is_dir() else None
        self._folder = tempfile.TemporaryDirectory(prefix="sicsg-", dir=in_memory)
        self._log = Path(self._folder.name, "log.txt")
        command = [str(python), "-m", "tools.sicsg.blender.worker", self._folder.name]
        try:
            with self._log.open("wb") as log:
                pipe = subprocess.PIPE
                self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=log, cwd=ROOT)
        except OSError as error:
            self._folder.cleanup()
            hint = f"make it with `make sicsg-env`, or name another in {PYTHON_VARIABLE}"
            raise CyclesError(f"no Python for bpy at {python}", error.strerror or str(error), hint) from error
        self._jobs, self._results = self._process.stdin, self._process.stdout
        self.device = self._greeting()

    def _greeting(self) -> str:
        header, _ = self.answer()
        if "unusable" in header:
            self.close()
            raise CyclesError(f"{self._python} cannot import bpy", header["unusable"], "renew it with `make sicsg-env`")
        return str(header["device"])

    def tell(self, header: dict[str, Any], arrays: wire.Arrays | None = None) -> None:
        """Hand over a job."""
        try:
            with self._deadline():
                wire.send(self._jobs, header, arrays)
        except OSError as error:
            raise self._failure("ended") from error

    def answer(self) -> tuple[dict[str, Any], wire.Arrays]:
        """Wait for the next result."""
        try:
            with self._deadline():
                message = wire.receive(self._results)
        except wire.WireError as error:
            raise self._failure(f"answered with something else ({error})") from error
        if message is None:
            raise self._failure("ended")
        return message

    def close(self) -> None:
        """End the process."""
        for stream in (self._jobs, self._results):
            with suppress(BrokenPipeError):  # what it has not read does not matter any more
                stream.close()
        try:
            self._process.wait(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    @contextmanager
    def _deadline(self) -> Iterator[None]:
        """End the process, and with it whatever waits for it, when the time is over."""
        timer = threading.Timer(self._timeout_s, self._expire)
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _expire(self) -> None:
        self._late.set()
        self._process.kill()

    def _failure(self, what: str) -> CyclesError:
        """The error, with the last lines that the process wrote; the process is ended."""
        if self._late.is_set():
            what = f"gave no answer within {self._timeout_s:g} s"
        self._process.kill()
        code = self._process.wait()
        lines = self._log.read_text(errors="replace").strip().splitlines()[-_LAST_LINES:]
        got = " | ".join(lines) or f"exit status {code}, no message"
        self.close()
        hint = "if that does not say why, memory may have run out: free some or render smaller views"
        return CyclesError(f"Blender's process ({self._python}) {what}", got, hint)
