"""Reading what the daemon publishes, in place."""

from __future__ import annotations

import time
import weakref
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import numpy as np

from . import seal
from .codes import NO_ROBOT
from .errors import ReleasedError, SampleInUseError, TooManySamplesError, TransferError
from .layout import Record, Records
from .transport import CHANNELS, Attachment
from .wheel import iox2

LOOK_EVERY_S = 500e-6
"""Between two looks at a channel, s."""

H = TypeVar("H", bound=Record)


class _Memory:
    """A sample's records as NumPy sees them. Arrays refer to it, and it keeps the sample."""

    def __init__(self, sample: Any, record: type[Record]) -> None:
        self._sample = sample
        dtype = record.dtype()
        self.__array_interface__ = {
            "version": 3,
            # The second element: for reading only. Writing would end the process.
            "data": (sample.payload_ptr, True),
            "shape": (sample.header.number_of_elements,),
            "typestr": f"|V{dtype.itemsize}",
        }


class Sample(Generic[H]):
    """A sample in shared memory: a header, and one record for each place of the fleet.

    :attr:`robots` is a view of shared memory, for reading. The sample stays where it is as long as this
    object or any view of it exists, and goes back to the daemon when the last of them is dropped. A reader
    may hold four at a time: copy what is to be kept.
    """

    def __init__(self, sample: Any, record: type[Record], header: type[H], seed: int) -> None:
        self._sample: Any = sample
        self._record = record
        self._seed = seed
        self._memory: weakref.ref[_Memory] | None = None
        self._header = header.from_buffer_copy(sample.user_header().contents)

    @property
    def header(self) -> H:
        """What stands once at the head of the sample: a copy, valid for ever."""
        return self._header

    @property
    def robots(self) -> Records:
        """One record for each place of the fleet, in the same order in every sample of a run; not copied.

        Free places are among them: see :meth:`present`. Use ``.copy()`` for what outlives the sample.
        """
        if self._sample is None:
            raise ReleasedError("the sample")
        memory = self._memory() if self._memory is not None else None
        if memory is None:
            memory = _Memory(self._sample, self._record)
            self._memory = weakref.ref(memory)
        return np.asarray(memory).view(self._record.dtype())

    def present(self) -> Records:
        """The robots of the fleet: a copy of the records without the free places."""
        robots = self.robots
        there: Records = robots[robots["id"] != NO_ROBOT]
        return there

    def is_intact(self) -> bool:
        """Whether the sample still is what its writer sealed.

        It was when a reader that verifies handed it out; the memory belongs to somebody else. Who moves a
        robot by it copies what it needs and asks again.
        """
        if self._sample is None:
            raise ReleasedError("the sample")
        return seal.holds(self._seed, self._header, self._sample, self._record.dtype().itemsize)

    def release(self) -> None:
        """Gives the sample back at once; the header stays.

        Raises :class:`~clearway.SampleInUseError` while arrays look into it.
        """
        if self._memory is not None and self._memory() is not None:
            raise SampleInUseError
        self._sample = None

    def __enter__(self) -> Sample[H]:
        return self

    def __exit__(self, *_: object) -> None:
        # An array that lives on keeps the sample, and that is no error of the block's.
        self._sample = None

    def __repr__(self) -> str:
        held = "released" if self._sample is None else f"{self._sample.header.number_of_elements} places"
        return f"<Sample of {self._record.__name__}, {held}, {self._header!r}>"


class Subscriber(Generic[H]):
    """Reads one channel. Samples of one period come once, oldest first.

    What is not as its writer sealed it is left out and counted. Verifying takes about a millisecond for each
    MB; ``verify=False`` hands everything out as it is, for who only looks on and asks
    :meth:`Sample.is_intact` where it matters.
    """

    def __init__(
        self, node: Attachment, channel: str, header: type[H], *, verify: bool = True
    ) -> None:
        self._channel = channel
        self._record = CHANNELS[channel][0]
        self._header = header
        self._verify = verify
        self._seed = seal.seed(node.transport.service(channel))
        self.corrupt = 0
        """Samples so far that were corrupted on their way and were not handed out."""
        self._port, self._may_hold = node.subscriber(channel)

    def next(self) -> Sample[H] | None:
        """The oldest sample that has not been read, if there is one. Does not wait.

        Raises :class:`~clearway.TooManySamplesError` when too many samples are held.
        """
        while (sample := self._receive()) is not None:
            if self._passes(sample):
                return sample
        return None

    def _passes(self, sample: Sample[H]) -> bool:
        intact = not self._verify or sample.is_intact()
        self.corrupt += not intact
        return intact

    def _receive(self) -> Sample[H] | None:
        if self._port is None:
            raise ReleasedError(f"the reader of {self._channel!r}")
        try:
            sample = self._port.receive()
        except iox2.ReceiveError as error:
            if str(error) == "ExceedsMaxBorrows":
                raise TooManySamplesError(self._channel, self._may_hold) from None
            raise TransferError(f"the channel {self._channel!r} failed: {error}") from error
        return None if sample is None else Sample(sample, self._record, self._header, self._seed)

    def newest(self) -> Sample[H] | None:
        """The newest sample, if any arrived and it is intact; drops those before it. Does not wait."""
        newest = None
        while (sample := self._receive()) is not None:
            newest = sample
        return newest if newest is not None and self._passes(newest) else None

    def wait(self, timeout_s: float = 2.0) -> Sample[H] | None:
        """The oldest sample that has not been read, waited for at most ``timeout_s`` seconds.

        ``None`` after that, as when the daemon has ended.
        """
        end = time.monotonic() + timeout_s
        while (sample := self.next()) is None:
            left_s = end - time.monotonic()
            if left_s <= 0.0:
                return None
            time.sleep(min(LOOK_EVERY_S, left_s))
        return sample

    def stream(self, timeout_s: float = 2.0) -> Iterator[Sample[H]]:
        """Every sample, until none has come for ``timeout_s`` seconds."""
        while True:
            sample = self.wait(timeout_s)
            if sample is None:
                return
            yield sample
            # The one that was handed out is not held while the next is waited for.
            del sample

    def __iter__(self) -> Iterator[Sample[H]]:
        """Every sample, until none has come for two seconds: see :meth:`stream`."""
        return self.stream()

    def close(self) -> None:
        """Leaves the channel. Samples that are held stay."""
        self._port = None
