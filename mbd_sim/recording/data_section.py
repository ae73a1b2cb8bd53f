"""What was found in the data section of an MCAP file: its undamaged records, and the problems with the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from mcap.records import AttachmentIndex, ChunkIndex, MessageIndex, MetadataIndex

from mbd_sim.recording.mcap_scanner import MAGIC, Definitions
from mbd_sim.recording.mcap_summary import Summary, encoded


@dataclass
class IndexedChunk:
    """A chunk as its index should describe it, and the number of its messages by channel."""

    index: ChunkIndex
    counts: dict[int, int]


@dataclass
class DataSection:
    """The undamaged records of a file; they end at byte `end`.

    If the file is cut off or damaged after the content of a chunk, `missing_indexes` are the indexes of the messages of
    that chunk, which belong at `end`.

    `index_problem` is damage that new indexes repair, `content_problem` damage that is confined to one record and
    cannot be repaired, and `problem` says why the records end before the end of the data section. All are "" if absent.
    """

    end: int = len(MAGIC)
    missing_indexes: bytes = b""
    definitions: Definitions = field(default_factory=Definitions)
    chunks: list[IndexedChunk] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    unchunked: Counter[int] = field(default_factory=Counter)  # number of messages outside of chunks, by channel
    times: list[int] = field(default_factory=list)  # of the first and the last message outside of chunks
    index_problem: str = ""
    content_problem: str = ""
    problem: str = ""
    has_header: bool = False
    crc_agrees: bool = True

    @property
    def counts(self) -> dict[int, int]:
        """The number of messages by channel."""
        total = Counter(self.unchunked)
        for chunk in self.chunks:
            total.update(chunk.counts)
        return dict(total)

    def counts_by_topic(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        counts, found = self.counts, Counter[str]()
        for number, channel in self.definitions.channels.items():
            found[channel.topic] += counts.get(number, 0)
        return dict(found)

    def drop_last_chunk(self) -> None:
        """End before the last chunk."""
        self.end, self.missing_indexes = self.chunks.pop().index.chunk_start_offset, b""

    def replace_last_indexes(self, entries: Mapping[int, list[tuple[int, int]]]) -> None:
        """End after the content of the last chunk; `entries` are times and offsets of its messages, by channel."""
        chunk = self.chunks[-1].index
        self.end = chunk.chunk_start_offset + chunk.chunk_length
        self.missing_indexes, chunk.message_index_offsets = b"", {}
        for channel, each in sorted(entries.items()):
            chunk.message_index_offsets[channel] = self.end + len(self.missing_indexes)
            self.missing_indexes += encoded(MessageIndex(channel, each))
        chunk.message_index_length = len(self.missing_indexes)

    def summary(self) -> Summary:
        """Return the summary of a file that ends here."""
        indexes = [chunk.index for chunk in self.chunks]
        filled = [chunk.index for chunk in self.chunks if chunk.counts]
        starts = [*self.times[:1], *(index.message_start_time for index in filled)]
        ends = [*self.times[1:], *(index.message_end_time for index in filled)]
        return Summary(
            schemas=list(self.definitions.schemas.values()),
            channels=list(self.definitions.channels.values()),
            attachments=self.attachments,
            metadata=self.metadata,
            chunks=b"".join(encoded(index) for index in indexes),
            chunk_count=len(indexes),
            counts=self.counts,
            first_ns=min(starts, default=0),
            last_ns=max(ends, default=0),
        )
