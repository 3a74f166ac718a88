"""Telling the daemon where robots are."""

from __future__ import annotations

import ctypes
import time

import numpy as np
from numpy.typing import ArrayLike

from . import seal
from .errors import ReleasedError, TransferError
from .layout import ObservationHeader, RobotObservation, StateHeader
from .subscriber import Subscriber
from .transport import Attachment
from .wheel import iox2


class ObservationPublisher:
    """Tells the daemon where robots are. Keeps the sequence and follows the daemon's epoch.

    One publisher speaks for a robot at a time: the daemon refuses a second one until the first is silent.
    """

    def __init__(self, node: Attachment, robots: int) -> None:
        self._port = node.publisher("observation", robots)
        self._states = Subscriber(node, "state", StateHeader)
        self._room = max(robots, 1)
        self._seed = seal.seed(node.transport.service("observation"))
        self.epoch = 0
        """The daemon's run that is followed; 0 before a state was seen."""
        self.sequence = 0
        """Number of the sample that went out last."""

    def publish(
        self,
        ids: ArrayLike,
        poses: ArrayLike,
        *,
        stamp_ns: int | None = None,
        holding: ArrayLike | None = None,
    ) -> None:
        """Publishes the poses of some robots.

        ``ids``: shape (n,). ``poses``: shape (n, 3), a row x_m, y_m, theta_rad for each id, world frame, any
        finite heading. ``stamp_ns``: when they were true, ``time.monotonic_ns()``; now, where it is left out.
        n is at most the number of robots that the publisher was made for. ``holding``: shape (n,), what each
        robot's gate held at the stamp, :meth:`Gate.holding`, so that one that missed a command is noticed;
        left out by who does not know, a localisation system: the daemon then takes the robots to get every
        command in time.

        Raises ``ValueError`` for other shapes, :class:`~clearway.TransferError` when nothing went out.
        """
        if self._port is None:
            raise ReleasedError("the publisher of observations")
        # Everything is checked before memory is borrowed.
        numbers, rows = np.asarray(ids), np.asarray(poses, dtype=np.float64)
        if numbers.ndim != 1 or rows.shape != (len(numbers), 3):
            raise ValueError(
                f"ids have shape {numbers.shape} and poses {rows.shape}: wanted are (n,), (n, 3)"
            )
        if len(numbers) > self._room:
            raise ValueError(
                f"{len(numbers)} robots and the publisher was made for {self._room}: "
                "make it with client.observations(robots) for the most that there will be"
            )
        codes = np.asarray(np.zeros(len(numbers), np.uint32) if holding is None else holding)
        if codes.shape != numbers.shape:
            raise ValueError(f"holding has shape {codes.shape} and ids {numbers.shape}: wanted are the same")
        records = np.zeros(len(numbers), RobotObservation.dtype())
        records["id"] = np.array([_robot_id(number) for number in numbers.tolist()], np.uint32)
        records["holding"] = np.array([_holding(code) for code in codes.tolist()], np.uint32)
        records["x_m"], records["y_m"], records["theta_rad"] = rows.T
        if (newest := self._states.newest()) is not None:
            self.epoch = newest.header.epoch
        header = ObservationHeader(
            epoch=self.epoch,
            sequence=self.sequence + 1,
            stamp_ns=time.monotonic_ns() if stamp_ns is None else stamp_ns,
        )
        seal.put(self._seed, header, len(numbers), records.tobytes())
        try:
            sample = self._port.loan_slice_uninit(len(numbers))
            ctypes.memmove(sample.payload_ptr, records.ctypes.data, records.nbytes)
            ctypes.memmove(sample.user_header_ptr, ctypes.addressof(header), ctypes.sizeof(header))
            # The number belongs to a sample that may have reached somebody.
            self.sequence += 1
            sample.assume_init().send()
        except (iox2.LoanError, iox2.SendError) as error:
            raise TransferError(f"the channel 'observation' failed: {error}") from error

    def close(self) -> None:
        """Leaves the channel."""
        self._port = None
        self._states.close()


def _robot_id(number: object) -> int:
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 2**32:
        raise ValueError(f"{number!r} is not the id of a robot")
    return number


def _holding(code: object) -> int:
    if isinstance(code, bool) or not isinstance(code, int) or not 0 <= code < 2**32:
        raise ValueError(f"{code!r} says of no command whether a robot follows it: wanted is what a gate holds")
    return code
