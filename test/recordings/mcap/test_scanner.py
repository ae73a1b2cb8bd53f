"""Records of MCAP data: complete, truncated and damaged."""

import struct
import zlib

import pytest
import zstandard
from mcap.opcode import Opcode

from mbd_sim.recordings.mcap.contents import BrokenRecordError, FileBytes, chunk_content, scan_messages, scan_records


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def message(channel, sequence, time_ns, payload):
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", channel, sequence, time_ns, time_ns) + payload)


def test_records_are_found_in_bytes_and_in_files(tmp_path):
    data = record(Opcode.HEADER, b"abc") + record(0x80, b"") + record(Opcode.FOOTER, b"defg")
    expected = [(Opcode.HEADER, b"abc"), (0x80, b""), (Opcode.FOOTER, b"defg")]  # 0x80: a private record
    assert [(opcode, data[begin:end]) for opcode, begin, end in scan_records(data)] == expected
    (tmp_path / "x").write_bytes(data)
    with (tmp_path / "x").open("rb") as stream:
        file = FileBytes(stream)
        assert [(opcode, file[begin:end]) for opcode, begin, end in scan_records(file)] == expected
        assert (len(file), file[-4:], file[: 10**6]) == (len(data), b"defg", data)


@pytest.mark.parametrize("cut", [1, 2])
def test_a_record_with_truncated_content_is_an_error(cut):
    first, second = record(Opcode.HEADER, b"abc"), record(Opcode.DATA_END, b"de")
    records = scan_records((first + second)[:-cut])
    assert next(records)[0] == Opcode.HEADER
    with pytest.raises(BrokenRecordError, match=f"cut off: .* the record that begins at byte {len(first)}"):
        next(records)


@pytest.mark.parametrize("cut", [3, 10, 11])
def test_the_scan_ends_where_the_header_of_a_record_is_truncated(cut):
    data = record(Opcode.HEADER, b"abc") + record(Opcode.DATA_END, b"de")
    assert [opcode for opcode, _, _ in scan_records(data[:-cut])] == [Opcode.HEADER]


@pytest.mark.parametrize("damaged", [bytes(20), record(0x10, b"abc"), struct.pack("<BQ", Opcode.CHUNK, 1 << 40)])
def test_an_unknown_opcode_or_an_impossible_length_is_an_error(damaged):
    first = record(Opcode.HEADER, b"abc")
    with pytest.raises(BrokenRecordError, match=f"no valid record at byte {len(first)}"):
        list(scan_records(first + damaged))


def test_messages_of_a_chunk():
    content = record(Opcode.SCHEMA, b"skipped") + message(1, 7, 100, b"a") + message(2, 8, 200, b"bc")
    assert list(scan_messages(content)) == [(1, 7, 100, b"a"), (2, 8, 200, b"bc")]
    with pytest.raises(BrokenRecordError, match="too short"):
        list(scan_messages(record(Opcode.MESSAGE, b"abc")))


def test_the_content_of_a_chunk_is_checked():
    crc = zlib.crc32(b"records")
    compressed = zstandard.compress(b"records")
    assert chunk_content(compressed, "zstd", 7, crc) == chunk_content(b"records", "", 7, crc) == b"records"
    with pytest.raises(BrokenRecordError, match="fails its CRC check"):
        chunk_content(b"Records", "", 7, crc)
    for stored, compression in ((b"nonsense", "zstd"), (b"records", "other")):
        with pytest.raises(BrokenRecordError, match="cannot be decompressed"):
            chunk_content(stored, compression, 7, crc)


def test_a_file_that_shrinks_while_it_is_read_is_an_error(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(bytes(100))
    with path.open("r+b") as stream:
        data = FileBytes(stream)
        stream.truncate(50)
        with pytest.raises(OSError, match="truncated while"):
            data[40:60]
