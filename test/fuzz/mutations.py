"""Ways in which files go wrong: bits that turn over, parts that are lost or come twice, numbers that are none."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Sequence
from random import Random

Mutation = Callable[[bytes, Random], bytes]

_SIZES = (0, 1, 2, 7, 8, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1)
_NUMBERS = (
    *("0", "-0", "1", "-1", "2", "0.5", "1e-6", "1.0e-06", "1.0e+308", "1e400", "1.0e+400", "-1.0e-320", "nan", ".nan"),
    *("inf", "-.inf", "9" * 30, "9" * 400, "1" * 5000, "0x10", "010", "1_000", "1:30", "1,5", "١", "true", "null", "~"),
    *("''", "a"),
)
_YAML = (
    *(
        "&a",
        "*a",
        "<<: *a",
        "!!python/name:os.system",
        "!x",
        "- ",
        ": ",
        "? ",
        "[",
        "]",
        "{",
        "}",
        "{}",
        "[]",
        "#",
        "|",
    ),
    *(">", "'", '"', "%YAML 1.3", "---", "...", "\t", "\0", "\ufeff", "\u2028", "2020-13-45", "=", "[[[[[", "{a: {a: "),
)
_NUMBER = re.compile(rb"[-+]?[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?")


def flip_bits(data: bytes, random: Random) -> bytes:
    found = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 8))):
        if found:
            found[random.randrange(len(found))] ^= 1 << random.randrange(8)
    return bytes(found)


def set_integer(data: bytes, random: Random) -> bytes:
    """A length, an offset or a count that is another."""
    form = random.choice(("<B", "<H", "<I", "<Q", ">H", ">I"))
    size = struct.calcsize(form)
    if len(data) < size:
        return data
    value = random.choice(_SIZES) % (1 << 8 * size)
    at = random.randrange(len(data) - size + 1)
    return data[:at] + struct.pack(form, value) + data[at + size :]


def set_double(data: bytes, random: Random) -> bytes:
    """A sample that is none, or a large one."""
    if len(data) < 8:
        return data
    value = random.choice((float("nan"), float("inf"), -1e300, 1e300, 1e9, -1e9, 0.0, 1e-300, 6.3, -6.3, 1e5))
    at = random.randrange((len(data) - 8) // 4 + 1) * 4
    return data[:at] + struct.pack("<d", value) + data[at + 8 :]


def truncate(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def remove(data: bytes, random: Random) -> bytes:
    at, size = _part(data, random)
    return data[:at] + data[at + size :]


def repeat(data: bytes, random: Random) -> bytes:
    at, size = _part(data, random)
    return data[: at + size] + data[at : at + size] * random.choice((1, 1, 2, 50)) + data[at + size :]


def move(data: bytes, random: Random) -> bytes:
    at, size = _part(data, random)
    rest, part = data[:at] + data[at + size :], data[at : at + size]
    to = random.randrange(len(rest) + 1)
    return rest[:to] + part + rest[to:]


def overwrite(data: bytes, random: Random) -> bytes:
    """A block of the disk that holds zeros, ones, or something else."""
    at, size = _part(data, random)
    filler = random.choice((b"\0", b"\xff", b" ", None))
    return data[:at] + (random.randbytes(size) if filler is None else filler * size) + data[at + size :]


def change_number(data: bytes, random: Random) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return data
    place = random.choice(found)
    return data[: place.start()] + random.choice(_NUMBERS).encode() + data[place.end() :]


def insert_token(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data) + 1)
    return data[:at] + random.choice((*_YAML, *_NUMBERS)).encode() + data[at:]


def change_line(data: bytes, random: Random) -> bytes:
    """A line that is lost, comes twice, comes elsewhere, is indented otherwise or is many."""
    lines = data.split(b"\n")
    at = random.randrange(len(lines))
    line = lines[at]
    kind = random.randrange(6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(random.randrange(len(lines) + 1), line)
    elif kind == 2:
        lines[at] = random.choice((b"  ", b" ", b"\t")) + line
    elif kind == 3:
        lines[at] = line.lstrip()
    elif kind == 4:
        lines[at : at + 1] = [line] * 300
    else:
        other = random.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    return b"\n".join(lines)


def change_word(data: bytes, random: Random) -> bytes:
    """A cell, a key or a value that stands in the place of another."""
    words = list(re.finditer(rb"[^\s,:{}\[\]]+", data))
    if not words:
        return data
    place, other = random.choice(words), random.choice(words)
    return data[: place.start()] + random.choice((other.group(), b"")) + data[place.end() :]


def change_record(data: bytes, random: Random) -> bytes:
    """One record of an mcap file changed inside; checksums of chunks are made good, so that the change is believed."""
    places, position = [], 8
    while position + 9 <= len(data) - 8:
        _, length = struct.unpack_from("<BQ", data, position)
        places.append((position, length))
        position += 9 + length
    if not places:
        return data
    at, length = random.choice(places)
    payload = data[at + 9 : at + 9 + length]
    if data[at] == 6 and len(payload) >= 40 and random.random() < 0.8:
        payload = _changed_chunk(payload, random)
    else:
        payload = random.choice(BINARY)(payload, random)
    size = len(payload) if random.random() < 0.8 else length
    return data[:at] + data[at : at + 1] + struct.pack("<Q", size) + payload + data[at + 9 + length :]


def _changed_chunk(payload: bytes, random: Random) -> bytes:
    start, end, _, _, name = struct.unpack_from("<QQQII", payload)
    if name:  # packed: only what is around can be changed and still be unpacked
        return random.choice(BINARY)(payload[:32], random) + payload[32:]
    content = payload[40:]
    for _ in range(random.choice((1, 1, 3))):
        content = random.choice((*BINARY, set_double))(content, random)
    checksum = random.choice((zlib.crc32(content), 0))
    return struct.pack("<QQQIIQ", start, end, len(content), checksum, 0, len(content)) + content


def _part(data: bytes, random: Random) -> tuple[int, int]:
    at = random.randrange(len(data) + 1)
    return at, min(random.choice((1, 2, 4, 8, 16, 64, 512, 4096)), len(data) - at)


def change_array(data: bytes, random: Random) -> bytes:
    """A field of a message's definition that is an array of others, of many, of none, or of what it is part of."""
    fields = list(re.finditer(rb"^([\w/]+)((?:\[[^\]]*\])?) (?=\w+$)", data, re.MULTILINE))
    if not fields:
        return data
    place, other = random.choice(fields), random.choice(fields)
    count = random.choice((b"0", b"1", b"9", b"300", b"65536", b"2000000000", b"<=7", b"", b"9" * 30))
    kind = random.choice((place[1], other[1], b"string", b"E", b"JointState", b"std_msgs/Header"))
    return data[: place.start()] + kind + b"[" + count + b"] " + data[place.end() :]


def add_part(data: bytes, random: Random) -> bytes:
    """A message more in a definition: empty, with arrays of itself or of others, or a chain of many."""
    kind = random.choice((b"uint8 X=1\n", b"E[9] e\n", b"E[0] e\n", b"JointState[9] e\n", b"float64[9] x\n" * 99))
    parts = [b"sensor_msgs/E\n" + kind]
    if random.random() < 0.3:
        parts += [b"sensor_msgs/C%d\nC%d a\nC%d[3] b\n" % (i, i + 1, i + 1) for i in range(random.choice((3, 30, 300)))]
    return data + b"".join(b"=" * 80 + b"\nMSG: " + part for part in parts)


BINARY: Sequence[Mutation] = (flip_bits, set_integer, set_double, truncate, remove, repeat, move, overwrite)
TEXT: Sequence[Mutation] = (
    *(change_number, change_number, change_number, insert_token, change_line, change_word, change_word),
    *(flip_bits, truncate, remove, repeat, move),
)
DEFINITION: Sequence[Mutation] = (change_array, change_array, change_array, add_part, add_part, *TEXT)
MCAP: Sequence[Mutation] = (*BINARY, change_record, change_record, change_record, change_record)


def mutate(data: bytes, mutations: Sequence[Mutation], random: Random) -> bytes:
    """The data with one change, or a few."""
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        data = random.choice(mutations)(data, random)
    return data
