"""The root of the tree, and what any command may meet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class RigcalError(Exception):
    """A problem that the user can mend; its message is complete and is shown without a traceback."""

    def __init__(
        self, what: str, *, where: object = None, expected: object = None, got: object = None, do_next: str
    ) -> None:
        self.what, self.do_next = what, do_next
        self.where, self.expected, self.got = (None if v is None else str(v) for v in (where, expected, got))
        super().__init__(self._message())

    def _message(self) -> str:
        lines = [self.what]
        rows = (
            ("where", self.where),
            ("expected", self.expected),
            ("got", self.got),
            ("do next", self.do_next),
        )
        lines += [f"  {name + ':':<10}{value}" for name, value in rows if value is not None]
        return "\n".join(lines)


class OptionError(RigcalError):
    """An option of a stage is outside its range."""

    def __init__(self, name: str, *, expected: str, got: object) -> None:
        super().__init__(
            f"option {name} is out of range",
            expected=expected,
            got=repr(got),
            do_next=f"give {name} as {expected}",
        )


class OptionsError(OptionError):
    """Options that do not go together, or one that needs another."""

    def __init__(self, name: str, *, expected: str, got: str, do_next: str) -> None:
        RigcalError.__init__(
            self, f"option {name} cannot be used like this", expected=expected, got=got, do_next=do_next
        )


class OutputError(RigcalError):
    """A result cannot be written."""

    def __init__(self, path: Path, *, got: str) -> None:
        super().__init__(
            "cannot write this file",
            where=path,
            expected="a folder that can be written to, with space on its disk",
            got=got,
            do_next="choose another place with -o, or free some space",
        )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make the folder of an output, and turn a refusal of the file system into an :class:`OutputError`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise OutputError(path, got=error.strerror or str(error)) from error
