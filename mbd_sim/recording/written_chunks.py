"""The index of the chunks of a file that is being written, in the encoded form in which the file will contain it.

It holds no Python object for each chunk: in runs of many hours the garbage collector would traverse them all.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Sequence

from mcap.records import ChunkIndex

from mbd_sim.recording.mcap_summary import encoded

_PLACE = struct.Struct("<QQQQQ")  # start and end in the file, end in the encoded index, first and last log time


class WrittenChunks:
    """The chunks that are completely in the file, with the number of messages of each topic."""

    def __init__(self, topic_count: int) -> None:
        self._topic_count = topic_count
        self._encoded = bytearray()
        self._places = bytearray()
        self._counts = array("I")  # by chunk, then by topic
        self.totals = [0] * topic_count
        self.first_ns = self.last_ns = 0  # log times of the earliest and the latest message

    def __len__(self) -> int:
        """Return the number of chunks."""
        return len(self._places) // _PLACE.size

    @property
    def index(self) -> bytes:
        """The encoded chunk index records."""
        return bytes(self._encoded)

    def add(self, index: ChunkIndex, counts: Sequence[int]) -> None:
        """Add a chunk, with its messages by topic number."""
        self._encoded += encoded(index)
        start, first_ns, last_ns = index.chunk_start_offset, index.message_start_time, index.message_end_time
        end = start + index.chunk_length + index.message_index_length
        self.first_ns = min(self.first_ns, first_ns) if len(self) else first_ns
        self.last_ns = max(self.last_ns, last_ns)
        self._places += _PLACE.pack(start, end, len(self._encoded), first_ns, last_ns)
        self._counts.extend(counts)
        self.totals = [total + count for total, count in zip(self.totals, counts, strict=True)]

    def drop_last(self) -> tuple[int, int]:
        """Forget the last chunk; return its start and end in the file."""
        start, end, _, _, _ = _PLACE.unpack_from(self._places, len(self._places) - _PLACE.size)
        del self._places[-_PLACE.size :]
        counts = self._counts[-self._topic_count :]
        del self._counts[-self._topic_count :]
        self.totals = [total - count for total, count in zip(self.totals, counts, strict=True)]
        places = list(_PLACE.iter_unpack(self._places))
        del self._encoded[places[-1][2] if places else 0 :]
        self.first_ns = min((first_ns for _, _, _, first_ns, _ in places), default=0)
        self.last_ns = max((last_ns for _, _, _, _, last_ns in places), default=0)
        return start, end
