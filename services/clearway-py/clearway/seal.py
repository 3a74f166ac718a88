"""The checksum that seals every sample: what is read is what was written, on the channel it was meant for.

CRC-32 (:func:`zlib.crc32`) of the channel's full name, the header before its last field, and the records. It
finds every flipped bit and every burst of up to 32 bits; ``docs/CHANNELS.md`` says more.
"""

from __future__ import annotations

import ctypes
import zlib
from typing import Any

CHECKSUM_BYTES = 4
"""The last field of a header."""


def seed(service: str) -> int:
    """What the checksums of a channel begin with: the CRC-32 of its full name."""
    return zlib.crc32(service.encode())


def checksum(seed: int, header: Any, records: Any) -> int:
    """The checksum of a header and the bytes of its records; the header's own does not count."""
    return zlib.crc32(records, zlib.crc32(bytes(header)[:-CHECKSUM_BYTES], seed))


def put(seed: int, header: Any, number: int, records: Any) -> None:
    """Completes a header that ``number`` records follow."""
    header.records = number
    header.checksum = checksum(seed, header, records)


def holds(seed: int, header: Any, sample: Any, record_bytes: int) -> bool:
    """Whether a sample's records are those that its header was sealed with."""
    number = sample.header.number_of_elements
    # Before the records: a wrong number of them would reach beyond the sample.
    if number != header.records:
        return False
    records = (ctypes.c_ubyte * (number * record_bytes)).from_address(sample.payload_ptr)
    return bool(checksum(seed, header, records) == header.checksum)
