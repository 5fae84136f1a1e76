"""Schemas of our own: classes of protobuf messages from a description, as ``protoc`` would make them from a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

PACKAGE = "recognition"
Field: TypeAlias = tuple[str, str]
"""Name and type: a scalar such as ``double``, ``Timestamp``, or another message of the file; before it may stand
``repeated`` or ``optional``."""
_FIELD = descriptor_pb2.FieldDescriptorProto


def message_class(name: str, messages: Mapping[str, Sequence[Field]]) -> Any:
    """The class of messages that have this form.

    Args:
        name: Of the file, without folders.
        messages: The fields of each message in the order of their numbers, from 1; the last message is the one wanted,
            and may hold those before it.
    """
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{PACKAGE}/{name}", package=PACKAGE, syntax="proto3", dependency=[timestamp_pb2.DESCRIPTOR.name]
    )
    for own, fields in messages.items():
        message = file.message_type.add(name=own)
        for number, (field, text) in enumerate(fields, start=1):
            _add_field(message, field, number, text)
    pool = descriptor_pool.Default()
    pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{list(messages)[-1]}"))


def _add_field(message: descriptor_pb2.DescriptorProto, name: str, number: int, text: str) -> None:
    *before, kind = text.split()
    label = _FIELD.LABEL_REPEATED if "repeated" in before else _FIELD.LABEL_OPTIONAL
    field = message.field.add(name=name, number=number, label=label)
    if kind in _SCALARS:
        field.type = _SCALARS[kind]
    else:
        of = ".google.protobuf.Timestamp" if kind == "Timestamp" else f".{PACKAGE}.{kind}"
        field.type, field.type_name = _FIELD.TYPE_MESSAGE, of
    if "optional" in before:
        field.proto3_optional, field.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")


_SCALARS = {
    "double": _FIELD.TYPE_DOUBLE, "int64": _FIELD.TYPE_INT64, "uint32": _FIELD.TYPE_UINT32,
    "sint32": _FIELD.TYPE_SINT32, "bool": _FIELD.TYPE_BOOL, "string": _FIELD.TYPE_STRING,
}  # fmt: skip
