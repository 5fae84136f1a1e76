"""Schemas and channels, repeated as metadata records.

MCAP keeps them in the chunk of their first message, and again in the index. A recording whose recorder was killed has
no index, so one damaged chunk would make every later message of its channels unreadable. Hence a metadata record per
schema and per channel stands before that chunk, with a checksum, for MCAP gives metadata none.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Iterator, Mapping

from mcap import records as r
from mcap.writer import Writer

SCHEMA_METADATA, CHANNEL_METADATA = "schema", "channel"
CHECKSUM = "crc32"


def define_schema(writer: Writer, name: str, encoding: str, data: bytes) -> int:
    """Register a schema and repeat it as metadata; returns its id."""
    schema_id: int = writer.register_schema(name, encoding, data)
    fields = {"id": str(schema_id), "name": name, "encoding": encoding, "base64": base64.b64encode(data).decode()}
    writer.add_metadata(SCHEMA_METADATA, {**fields, CHECKSUM: _checksum(fields)})
    return schema_id


def define_channel(writer: Writer, topic: str, encoding: str, schema_id: int) -> int:
    """Register a channel and repeat it as metadata; returns its id."""
    channel_id = writer.register_channel(topic, encoding, schema_id)
    fields = {"id": str(channel_id), "topic": topic, "encoding": encoding, "schema": str(schema_id)}
    writer.add_metadata(CHANNEL_METADATA, {**fields, CHECKSUM: _checksum(fields)})
    return channel_id


def is_definition(metadata: r.Metadata) -> bool:
    """Whether a metadata record repeats a schema or a channel."""
    return metadata.name in (SCHEMA_METADATA, CHANNEL_METADATA)


def repeated_definitions(metadata: Iterable[r.Metadata]) -> Iterator[r.Schema | r.Channel]:
    """The schemas and channels that metadata records repeat; damaged records are passed over."""
    for record in metadata:
        fields = record.metadata
        if not is_definition(record) or fields.get(CHECKSUM) != _checksum(fields):
            continue
        try:
            if record.name == SCHEMA_METADATA:
                data = base64.b64decode(fields["base64"], validate=True)
                yield r.Schema(int(fields["id"]), data, fields["encoding"], fields["name"])
            else:
                yield r.Channel(int(fields["id"]), fields["topic"], fields["encoding"], {}, int(fields["schema"]))
        except (KeyError, ValueError):
            continue


def _checksum(fields: Mapping[str, str]) -> str:
    text = "\0".join(f"{key}={value}" for key, value in sorted(fields.items()) if key != CHECKSUM)
    return str(zlib.crc32(text.encode()))
