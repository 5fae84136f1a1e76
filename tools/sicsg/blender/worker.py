"""The process inside Blender's Python: reads jobs from its input, writes results to its output, in order.

Jobs are messages (``wire.py``) with an entry ``do``: ``texture``, ``mesh``, ``vertices`` and ``drop`` have no answer,
``render`` and ``passes`` have one. Whatever goes wrong ends the process; its standard error says why. Its one argument
is a folder for renders on their way.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from tools.sicsg.blender.wire import receive, send


def main() -> None:
    """Serve jobs until the input ends."""
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # Blender's own messages stay out of the replies
    try:
        import bpy
    except ImportError as error:
        send(replies, {"unusable": str(error)})
        return
    from tools.sicsg.blender.studio import Studio

    studio = Studio(Path(sys.argv[1]))
    send(replies, {"blender": bpy.app.version_string, "device": studio.device})
    while (message := receive(sys.stdin.buffer)) is not None:
        answer = studio.do(*message)
        if answer is not None:
            send(replies, {}, answer)


if __name__ == "__main__":
    main()
