"""The known formats: what each is called, how it is recognised, read and written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from rigcal.errors import FormatError
from rigcal.formats import (
    anipose,
    colmap,
    colmap_model,
    easymocap,
    foxglove,
    kalibr,
    mrcal,
    multiview_dataset,
    nerfstudio,
    opencv,
    qualisys,
    ros,
    usd,
)
from rigcal.formats._foreign import ForeignRig, Written
from rigcal.formats._source import Source
from rigcal.rig import Rig

Writer = Callable[[Rig], Written]


@dataclass(frozen=True, slots=True)
class Format:
    """A format of another tool: a file, or a folder of files."""

    name: str
    """As ``--from`` and ``--to`` have it."""
    description: str
    """The tools and files, in a few words."""
    meaning: str
    """What its numbers mean: frames, units, order of coefficients, pixel centres."""
    recognises: Callable[[Source], bool]
    """Whether a file or folder is in this format."""
    read: Callable[[Source], ForeignRig] | None
    """None where a rig can only be exported."""
    write: Writer | None
    """None where a rig can only be imported."""
    has_common_frame: bool
    """Whether the poses are from a frame of their own, which may be a world; False where they lead from camera to
    camera."""
    is_folder: bool
    """Whether the format is several files in a folder."""

    @property
    def can_import(self) -> bool:
        """Whether a rig can be read from this format."""
        return self.read is not None

    @property
    def can_export(self) -> bool:
        """Whether a rig can be written in this format."""
        return self.write is not None


class _OfText(Protocol):
    """A module whose format is one text file."""

    NAME: str

    def recognises(self, text: str, /) -> bool: ...
    def read(self, file: Path, text: str, /) -> ForeignRig: ...


class _OfFiles(Protocol):
    """A module whose format is several files, or one in several forms."""

    NAME: str

    def recognises(self, source: Source, /) -> bool: ...
    def read(self, source: Source, /) -> ForeignRig: ...


def _text_format(module: _OfText, description: str, write: Writer | None, *, has_common_frame: bool = True) -> Format:
    def recognises(source: Source) -> bool:
        return not source.is_folder and any(module.recognises(text) for text in source.texts.values())

    def read(source: Source) -> ForeignRig:
        if source.is_folder:
            raise FormatError(
                f"{module.NAME} is one file, not a folder",
                where=source.path,
                expected="a file",
                got=f"a folder with {source.shown_names}",
                do_next="give the file in it",
            )
        return module.read(source.path, *source.texts.values())

    meaning = _meaning(module)
    return Format(module.NAME, description, meaning, recognises, read, write, has_common_frame, is_folder=False)


def _files_format(
    module: _OfFiles, description: str, write: Writer, *, has_common_frame: bool = True, is_folder: bool = True
) -> Format:
    meaning = _meaning(module)
    return Format(module.NAME, description, meaning, module.recognises, module.read, write, has_common_frame, is_folder)


def _meaning(module: object) -> str:
    """The module's own docstring, which is where a format is described."""
    return (module.__doc__ or "").replace("``", "").strip()


def _export_format(name: str, description: str, meaning: str, write: Writer) -> Format:
    return Format(name, description, meaning, lambda _: False, None, write, has_common_frame=True, is_folder=False)


_ALL = (
    _text_format(anipose, "aniposelib, Pose2Sim, Caliscope and FreeMoCap TOML", anipose.write),
    _text_format(colmap, "COLMAP rig configuration, rig_config.json", colmap.write, has_common_frame=False),
    _files_format(colmap_model, "COLMAP model: cameras, images, rigs (import also binary)", colmap_model.write),
    _files_format(easymocap, "EasyMocap intri.yml and extri.yml", easymocap.write),
    _text_format(foxglove, "Foxglove CameraCalibration and FrameTransforms as JSON", foxglove.write),
    _text_format(kalibr, "Kalibr camchain.yaml", kalibr.write, has_common_frame=False),
    _files_format(mrcal, "mrcal .cameramodel, one for each camera", mrcal.write),
    _text_format(multiview_dataset, "dataset.json of a multi-view data set", None),
    _text_format(nerfstudio, "nerfstudio transforms.json", nerfstudio.write),
    _files_format(
        opencv, "OpenCV yml: one camera or a stereo pair", opencv.write, has_common_frame=False, is_folder=False
    ),
    _text_format(qualisys, "Qualisys Track Manager .qca.txt", None),
    _files_format(ros, "ROS camera_info with tf_static, launch file and URDF", ros.write),
    _export_format(usd.NAME, "OpenUSD cameras, .usda", _meaning(usd), usd.write),
)
FORMATS: Mapping[str, Format] = MappingProxyType({form.name: form for form in _ALL})
"""Every format by its name."""
