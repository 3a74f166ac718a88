"""Membership in a fleet: what :func:`attach` returns."""

from __future__ import annotations

import os
import time

from numpy.typing import ArrayLike

from .admin import AdminClient
from .errors import NoDaemonError, ReleasedError
from .layout import CommandHeader, StateHeader, TelemetryHeader
from .observe import ObservationPublisher
from .subscriber import Subscriber
from .transport import Attachment, Transport


class Client:
    """Membership in a fleet, made by :func:`attach`.

    Use it, and what it hands out, from one thread at a time; in a child process attach anew.
    """

    def __init__(self, node: Attachment, *, verify: bool = True) -> None:
        self._attachment: Attachment | None = node
        self._verify = verify
        self._states: Subscriber[StateHeader] | None = None
        self._commands: Subscriber[CommandHeader] | None = None
        self._telemetry: Subscriber[TelemetryHeader] | None = None
        self._admin: AdminClient | None = None
        self._observations: list[ObservationPublisher] = []
        self._observing: ObservationPublisher | None = None

    @property
    def fleet(self) -> str:
        """The fleet's name."""
        return self._node.transport.fleet

    def has_daemon(self) -> bool:
        """Whether a daemon writes the fleet's state; one that was killed counts until it is cleaned up."""
        return self._node.has_daemon()

    @property
    def states(self) -> Subscriber[StateHeader]:
        """The fleet's states, one sample a period, read from the first use on."""
        if self._states is None:
            self._states = Subscriber(self._node, "state", StateHeader, verify=self._verify)
        return self._states

    @property
    def commands(self) -> Subscriber[CommandHeader]:
        """The fleet's commands, one sample a period, read from the first use on."""
        if self._commands is None:
            self._commands = Subscriber(self._node, "command", CommandHeader, verify=self._verify)
        return self._commands

    @property
    def telemetry(self) -> Subscriber[TelemetryHeader]:
        """How each period went, read from the first use on. A slow reader misses samples: ticks have gaps."""
        if self._telemetry is None:
            self._telemetry = Subscriber(self._node, "telemetry", TelemetryHeader, verify=self._verify)
        return self._telemetry

    @property
    def admin(self) -> AdminClient:
        """For an operator's requests."""
        if self._admin is None:
            self._admin = AdminClient(self._node)
        return self._admin

    def observations(self, robots: int) -> ObservationPublisher:
        """A publisher of what is seen of up to ``robots`` robots.

        Raises :class:`~clearway.NotObservedError` unless the daemon has ``source.kind = "observation"``.
        """
        publisher = ObservationPublisher(self._node, robots)
        self._observations.append(publisher)
        return publisher

    def observe(
        self,
        ids: ArrayLike,
        poses: ArrayLike,
        *,
        stamp_ns: int | None = None,
        holding: ArrayLike | None = None,
    ) -> None:
        """Publishes poses: :meth:`ObservationPublisher.publish` of a publisher made at the first call.

        That one has room for as many robots as the first call names.
        """
        if self._observing is None:
            self._observing = self.observations(len(tuple(ids)))  # type: ignore[arg-type]
        self._observing.publish(ids, poses, stamp_ns=stamp_ns, holding=holding)

    def close(self) -> None:
        """Leaves the fleet. Samples that are held stay; whatever else came from here ends."""
        ports = (self._states, self._commands, self._telemetry, self._admin, *self._observations)
        for port in ports:
            if port is not None:
                port.close()
        self._states = self._commands = self._telemetry = self._admin = self._observing = None
        self._observations.clear()
        self._attachment = None

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _node(self) -> Attachment:
        if self._attachment is None:
            raise ReleasedError("the client")
        return self._attachment


def attach(
    fleet: str = "default",
    *,
    wait_s: float = 0.0,
    verify: bool = True,
    prefix: str | None = None,
    root: str | os.PathLike[str] | None = None,
) -> Client:
    """Joins a fleet whose daemon runs, waiting up to ``wait_s`` seconds for it to start.

    ``verify``: whether samples that were corrupted on their way are left out, and counted by
    :attr:`Subscriber.corrupt`; see :class:`Subscriber` for what it costs.

    ``prefix`` and ``root`` say where its channels live: ``CLEARWAY_IOX2_PREFIX`` and ``CLEARWAY_IOX2_ROOT``
    unless they are given, and the daemon's defaults where those are not set. Use it in a ``with`` block, or
    close it.

    Raises :class:`~clearway.NoDaemonError` when no daemon runs, :class:`~clearway.SchemaError` when it speaks
    another version, :class:`~clearway.AttachError` when shared memory cannot be joined, as another user's,
    :class:`~clearway.FleetNameError` or :class:`~clearway.LocationError` for names that cannot be.
    """
    transport = Transport(fleet, prefix, root)
    node, end = Attachment(transport), time.monotonic() + wait_s
    while not node.has_daemon():
        if time.monotonic() >= end:
            raise NoDaemonError(transport.service("state"))
        time.sleep(0.01)
    return Client(node, verify=verify)
