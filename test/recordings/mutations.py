"""Recordings damaged record by record: `python -m test.recordings.mutations --count 10000`.

Each file has one damaged record. It must be verified and recovered without an unexpected exception; a file that is
called intact, and every recovered one, must be opened by other readers.
"""

import argparse
import random
import struct
import tempfile
import traceback
import zlib
from collections import Counter
from pathlib import Path

import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from rosbags.highlevel import AnyReader

from mbd_sim.base.errors import MbdSimError
from mbd_sim.recordings.mcap.contents import MAGIC, RECORD_HEADER, chunk_content, data_stream, scan_records
from mbd_sim.recordings.run.recovery import damaged_original, recover
from mbd_sim.recordings.run.verification import verify

EXTREMES = (0, 1, 2, 255, 65_535, 1 << 31, (1 << 32) - 1, (1 << 63) - 1, (1 << 64) - 1)


def records(data, start=8):
    """Return opcode, start and end of each record, its header included."""
    return [(opcode, begin - RECORD_HEADER.size, end) for opcode, begin, end in scan_records(data, start)]


def mutate(data, chance, opcode=None):
    """Return a recording with one damaged record, and what was done to it.

    :param opcode: the kind of the record, or by default any kind; messages are in chunks.
    """
    found = records(data)
    kinds = sorted({one for one, _, _ in found} | {int(Opcode.MESSAGE)})
    opcode = chance.choice(kinds) if opcode is None else opcode
    if opcode == Opcode.MESSAGE:
        _, start, end = chance.choice([one for one in found if one[0] == Opcode.CHUNK])
        return data[:start] + _with_mutated_content(data[start:end], chance) + data[end:], "MESSAGE, valid chunk"
    _, start, end = chance.choice([one for one in found if one[0] == opcode])
    changed, what = _mutated(data[start:end], chance)
    damaged = data[:start] + changed + data[end:]
    if chance.random() < 0.5:
        damaged = _with_valid_checksum(damaged)
    return damaged, f"{Opcode(opcode).name}, {what}"


def _mutated(record, chance):
    """Return a damaged record, or none or two of them, and what was done."""
    changed = bytearray(record)
    match chance.choice(["byte", "number", "length", "opcode", "cut", "delete", "duplicate", "zeros"]):
        case "byte":
            changed[chance.randrange(len(record))] ^= 1 << chance.randrange(8)
            what = "a bit"
        case "number":
            size = chance.choice([2, 4, 8])
            place = chance.randrange(RECORD_HEADER.size, max(RECORD_HEADER.size + 1, len(record) - size))
            number = (chance.choice(EXTREMES) % (1 << 8 * size)).to_bytes(size, "little")
            changed[place : place + size] = number
            what = "a number"
        case "length":
            struct.pack_into("<Q", changed, 1, chance.choice([*EXTREMES, len(record) - 10, len(record)]))
            what = "its length"
        case "opcode":
            changed[0] = chance.randrange(256)
            what = "its opcode"
        case "cut":
            del changed[chance.randrange(len(changed)) :]
            what = "cut"
        case "delete":
            changed, what = bytearray(), "deleted"
        case "duplicate":
            changed, what = changed * 2, "duplicated"
        case _:
            begin = chance.randrange(len(record))
            changed[begin:] = bytes(len(record) - begin)
            what = "zeros"
    return bytes(changed), what


def _with_mutated_content(record, chance):
    """Return a chunk of which one inner record is damaged, with a valid checksum."""
    content = record[RECORD_HEADER.size :]
    chunk = Chunk.read(data_stream(content))
    inner = chunk_content(chunk.data, chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc)
    _, start, end = chance.choice(records(inner, 0))
    changed, _ = _mutated(inner[start:end], chance)
    inner = inner[:start] + changed + inner[end:]
    packed = zstandard.compress(inner)
    head = struct.pack("<QQQI", chunk.message_start_time, chunk.message_end_time, len(inner), zlib.crc32(inner))
    content = head + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    return RECORD_HEADER.pack(Opcode.CHUNK, len(content)) + content


def _with_valid_checksum(data):
    """Return a file whose summary has a valid checksum, if it has a footer."""
    footer = len(data) - len(MAGIC) - RECORD_HEADER.size - 20
    if footer < len(MAGIC) or data[footer] != Opcode.FOOTER:
        return data
    (start,) = struct.unpack_from("<Q", data, footer + RECORD_HEADER.size)
    end = len(data) - len(MAGIC) - 4
    return data[:end] + struct.pack("<I", zlib.crc32(data[start:end])) + data[-len(MAGIC) :]


def refusal_of_other_readers(path, *, deserialize=False):
    """Return why one of two other readers does not read all messages, or ""."""
    try:
        with path.open("rb") as stream:
            for _ in make_reader(stream, validate_crcs=True).iter_messages():
                pass
        with AnyReader([path]) as reader:
            for connection, _, payload in reader.messages():
                if deserialize:
                    reader.deserialize(payload, connection.msgtype)
    except Exception as error:
        return repr(error)
    return ""


def problems_with(path):
    """Verify and recover a damaged file; return what goes wrong, and whether it was called intact."""
    found, intact = [], False
    try:
        intact = all(result.is_intact and not result.problem for result in verify(path))
    except MbdSimError:
        pass
    except Exception:
        found.append(f"verify: {traceback.format_exc()}")
    if intact and (refusal := refusal_of_other_readers(path, deserialize=True)):
        found.append(f"called intact, but another reader refuses it: {refusal}")
    try:
        recover(path)
        if refusal := refusal_of_other_readers(path):
            found.append(f"recovered, but another reader refuses it: {refusal}")
        if recover(path) is not None:
            found.append("recovered twice")
    except (ValueError, OSError):
        pass
    except Exception:
        found.append(f"recover: {traceback.format_exc()}")
    damaged_original(path).unlink(missing_ok=True)
    return found, intact


def main():
    """Damage a small recording many times, and print what went wrong."""
    from test.recordings.rewriting import rewrite
    from test.recordings.runs import record_run
    from test.shared_builds import share_builds

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    share_builds()
    chance, wrong, kinds = random.Random(options.seed), 0, Counter()
    with tempfile.TemporaryDirectory() as folder:
        own = record_run(Path(folder), "double_rod", seconds=0.04, resets=False, commands=3)
        small_chunks = rewrite(own, Path(folder) / "small.mcap", chunk_size=500)
        for number in range(options.count):
            data, what = mutate((own, small_chunks)[number % 2].read_bytes(), chance)
            path = Path(folder) / "damaged.mcap"
            path.write_bytes(data)
            problems, intact = problems_with(path)
            kinds[what] += 1
            kinds["called intact"] += intact
            wrong += bool(problems)
            for problem in problems:
                print(f"{number}: {what}: {problem}", flush=True)
    for what, count in sorted(kinds.items()):
        print(f"{count:6d} {what}")
    print(f"{wrong} of {options.count} damaged files were treated wrongly")


if __name__ == "__main__":
    main()
