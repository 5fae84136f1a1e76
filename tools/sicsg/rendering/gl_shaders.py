"""The shaders of the fast path, read from the GLSL files beside this module and compiled once per renderer.

llvmpipe reads a constant at an index that it knows quickly and any other one lane by lane, and runs both sides of
every branch. So the loop over lamps is written out, and what matte surfaces do not need is left out of their program.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import moderngl

MAX_RECTANGLES = 64
MAX_SHADOWED = 3
"""How many lights cast shadows: the sun and the strongest lamps and windows."""
WIDE = 2.75
"""Half of a shadow map's width one metre before its rectangle: 140 degrees in all."""
ROUNDED = 4
"""Programs are made for multiples of this number of rectangles, as making one takes seconds."""
_FOLDER = Path(__file__).parent
_INCLUDE = re.compile(r'^#include "(\w+\.glsl)"$', re.MULTILINE)


def compiled(
    context: moderngl.Context, vertex: str, fragment: str, defined: Mapping[str, str | int] | None = None
) -> moderngl.Program:
    """The program of two shader files, by their names without the ending, with these macros defined."""
    head = "\n".join(f"#define {key} {value}" for key, value in (defined or {}).items())
    texts = [_source(name).split("\n", 1) for name in (f"{vertex}.vert", f"{fragment}.frag")]
    return context.program(*(f"{version}\n{head}\n{rest}" for version, rest in texts))


def light_macros(rectangles: int, shadowed: int, sun: bool) -> dict[str, str | int]:
    """Macros that write out the loop over the lights.

    Args:
        rectangles: number of lamps and windows.
        shadowed: number of shadow maps, the sun's aside.
        sun: whether the sun shines; its map is the third.
    """
    macros: dict[str, str | int] = {"MAX_RECTANGLES": MAX_RECTANGLES, "WIDE": WIDE, "SHADOWED": shadowed}
    macros["EACH_RECTANGLE(f)"] = " ".join(f"f({i})" for i in range(rectangles))
    return macros | ({"SUN": 1} if sun else {})


def assign(program: moderngl.Program, **values: object) -> None:
    """Set uniforms; those that the compiler has left out because nothing reads them are passed over."""
    for name, value in values.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            if isinstance(value, bytes):
                member.write(value)
            else:
                member.value = value


@cache
def _source(name: str) -> str:
    text = (_FOLDER / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: _source(match[1]), text)
