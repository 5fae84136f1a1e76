"""Many recordings judged at once, by the processes of a machine or the workers of a Dask cluster.

A batch is a row for each recording and the events of each, in a folder. Whoever computed them and in whatever order,
they are the same bytes. A recording that cannot be judged is a row that says why. The same batch again computes only
what is new: a recording, rules, options or a program that differ, or what failed the last time.
"""

from recognition.batch.finding import Found, find_recordings
from recognition.batch.judged import Orders
from recognition.batch.results import ROWS, TABLE, Results, require_apart
from recognition.batch.rows import Row
from recognition.batch.running import BatchResult, run_batch

__all__ = [
    "ROWS",
    "TABLE",
    "BatchResult",
    "Found",
    "Orders",
    "Results",
    "Row",
    "find_recordings",
    "require_apart",
    "run_batch",
]
