"""Whether a network's outputs are those of the family that its manifest names, and if not, whose they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from recognition.detectors.families import BOX_FAMILIES, FAMILIES
from recognition.detectors.family import AnyFamily, Layout
from recognition.detectors.manifest import AnyManifest, BoxManifest
from recognition.errors import ModelError

_BESIDE_CLASSES = (4, 5)
"""How many channels a family of boxes has beside those of the classes."""
_SUPPRESSED_COLUMNS = (6, 7, 57)
"""Of the rows that are left after non-maximum suppression: Ultralytics' boxes and people, YOLOv7's boxes."""


def require_layout(shapes: Mapping[str, tuple[int, ...]], manifest: AnyManifest, path: Path) -> None:
    """Check the shapes of a network's outputs, by their names, against the family; further outputs are passed over.

    Raises:
        ModelError: where they differ; it says which family's they are, where there is one.
    """
    family, classes = FAMILIES[manifest.family], _classes(manifest)
    got = tuple(shapes.values())
    if _is_of(family, got, manifest.input.size_wh, classes):
        return
    expected = " or ".join(map(_text, family.layouts(manifest.input.size_wh, classes)))
    stated = f"family {manifest.family}" + (f" with {classes} classes" if classes else "")
    raise ModelError(
        "the network's output is not what the manifest's family gives",
        where=path,
        expected=f"{expected}, of {stated} at {'x'.join(map(str, manifest.input.size_wh))} px",
        got=", ".join(f"{name!r} {_text((shape,))}" for name, shape in shapes.items()),
        do_next=_advice(got, manifest),
    )


def outputs_read(manifest: AnyManifest) -> int:
    """How many of a network's first outputs its family reads."""
    return len(FAMILIES[manifest.family].layouts(manifest.input.size_wh, _classes(manifest))[0])


def _advice(got: Layout, manifest: AnyManifest) -> str:
    alike = tuple(_alike(got, manifest))
    if alike:
        return f"this looks like {', or '.join(alike)}: mend the manifest"
    if len(got[0]) in (2, 3) and got[0][-1] in _SUPPRESSED_COLUMNS:
        return (
            "this looks like an export that ends in non-maximum suppression: export it again without (Ultralytics: no "
            "nms, and end2end=False for YOLO26; YOLOv7: no --end2end)"
        )
    if all(len(shape) == 5 for shape in got):
        return "these look like the raw heads of YOLOv7 or YOLOv5: export it again with the decoding (--grid)"
    return (
        "check family, classes and input.size_wh of the manifest, and that the network was exported without "
        "post-processing"
    )


def _alike(got: Layout, manifest: AnyManifest) -> Iterator[str]:
    """Families, and numbers of classes, that the outputs would suit."""
    size_wh = manifest.input.size_wh
    possible = sorted({length - beside for shape in got for length in shape for beside in _BESIDE_CLASSES})
    for name, family in FAMILIES.items():
        if name not in BOX_FAMILIES:
            if _is_of(family, got, size_wh, 0):
                yield f'family = "{name}"'
        else:
            suits = (n for n in possible if n > 0 and _is_of(family, got, size_wh, n))
            yield from (f'family = "{name}" with {n} classes' for n in suits)


def _is_of(family: AnyFamily, got: Layout, size_wh: tuple[int, int], classes: int) -> bool:
    return any(got[: len(layout)] == layout for layout in family.layouts(size_wh, classes))


def _classes(manifest: AnyManifest) -> int:
    return len(manifest.classes) if isinstance(manifest, BoxManifest) else 0


def _text(layout: Layout) -> str:
    return " and ".join("x".join(map(str, shape)) for shape in layout)
