"""Joining shared memory and opening a fleet's channels: the only module that names iceoryx2 services."""

from __future__ import annotations

import ctypes
import os
import pwd
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .errors import (
    AttachError,
    ChannelError,
    FleetNameError,
    LocationError,
    NoDaemonError,
    NotObservedError,
    SchemaError,
)
from .layout import (
    AdminAnswer,
    AdminRequest,
    AdminRobot,
    CommandHeader,
    ObservationHeader,
    Record,
    RobotCommand,
    RobotObservation,
    RobotState,
    RobotTelemetry,
    StateHeader,
    TelemetryHeader,
)
from .wheel import iox2

CHANNELS: dict[str, tuple[type[Record], type[Record]]] = {
    "state": (RobotState, StateHeader),
    "command": (RobotCommand, CommandHeader),
    "telemetry": (RobotTelemetry, TelemetryHeader),
    "observation": (RobotObservation, ObservationHeader),
}
"""The record and the header of each channel."""

STARTING_S = 2.0
"""How long a channel is waited for that a running daemon does not offer: it may have begun just now."""

PREFIX = "iox2_"
ROOT = "/tmp/iceoryx2/"


class Transport:
    """Where the channels of one fleet are."""

    def __init__(
        self, fleet: str, prefix: str | None = None, root: str | os.PathLike[str] | None = None
    ) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", fleet):
            raise FleetNameError(fleet)
        self.fleet = fleet
        self.prefix = prefix if prefix is not None else os.environ.get("CLEARWAY_IOX2_PREFIX", PREFIX)
        self.root = os.fspath(root if root is not None else os.environ.get("CLEARWAY_IOX2_ROOT", ROOT))

    def service(self, channel: str) -> str:
        """Full name of a channel."""
        return f"clearway/{self.fleet}/v1/{channel}"

    def configuration(self) -> Any:
        """What iceoryx2 is told; explicit, because it otherwise looks for a file in the working directory."""
        configuration = iox2.config.default()
        try:
            configuration.global_cfg.prefix = iox2.FileName.new(self.prefix)
        except iox2.SemanticStringError as error:
            raise LocationError("prefix", self.prefix, str(error)) from error
        try:
            configuration.global_cfg.root_path = iox2.Path.new(self.root)
        except iox2.SemanticStringError as error:
            raise LocationError("root", self.root, str(error)) from error
        return configuration

    def stranger(self) -> str | None:
        """Whose the directory of the channels is, if it is another user's and closed to this one."""
        for place in (Path(self.root), Path(self.root) / "nodes"):
            try:
                owner = place.stat().st_uid
            except FileNotFoundError:
                continue
            except PermissionError:
                return "another user"
            if owner != os.geteuid() and not os.access(place, os.R_OK | os.W_OK | os.X_OK):
                try:
                    return f"user {pwd.getpwuid(owner).pw_name}"
                except KeyError:
                    return f"user {owner}"
        return None


class Attachment:
    """One membership in shared memory."""

    def __init__(self, transport: Transport) -> None:
        self.transport = transport
        # iceoryx2 writes to the console what is raised here anyway; IOX2_LOG_LEVEL brings it back.
        iox2.set_log_level_from_env_or(iox2.LogLevel.Fatal)
        configuration = transport.configuration()
        stranger = transport.stranger()
        if stranger is not None:
            raise AttachError(
                f"the channels under {transport.root!r} belong to {stranger}: a fleet can be joined only "
                "by the user who runs its daemon; run as that user, or set CLEARWAY_IOX2_PREFIX and "
                "CLEARWAY_IOX2_ROOT"
            )
        try:
            self._node = (
                iox2.NodeBuilder.new()
                .name(iox2.NodeName.new(f"python-{transport.fleet}-{os.getpid()}"))
                .config(configuration)
                # Ctrl-C stays Python's.
                .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
                .create(iox2.ServiceType.Ipc)
            )
        except iox2.NodeCreationFailure as error:
            raise AttachError(
                f"cannot join shared memory under {transport.root!r} ({error}): check that it and /dev/shm "
                "exist, are writable for this user and not full, and that `ulimit -n` allows more files"
            ) from error

    def has_daemon(self) -> bool:
        """Whether somebody writes the fleet's state."""
        try:
            return int(self._open("state").dynamic_config.number_of_publishers) > 0
        except iox2.PublishSubscribeOpenError as error:
            if str(error) == "DoesNotExist":
                return False
            raise self._not_opened("state", error) from error

    def subscriber(self, channel: str) -> tuple[Any, int]:
        """A reader of a channel, and how many samples it may hold."""
        service = self._patiently(channel, lambda: self._open(channel))
        may_hold = service.static_config.subscriber_max_borrowed_samples
        try:
            return service.subscriber_builder().create(), may_hold
        except iox2.SubscriberCreateError as error:
            raise self._no_port(channel, error, "raise channel.max_readers or end a reader") from error

    def publisher(self, channel: str, robots: int) -> Any:
        """A writer of samples with at most ``robots`` records."""
        builder = self._patiently(channel, lambda: self._open(channel)).publisher_builder()
        try:
            return (
                builder.initial_max_slice_len(max(robots, 1))
                .max_loaned_samples(1)
                .backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
                .create()
            )
        except iox2.PublisherCreateError as error:
            raise self._no_port(channel, error, "raise channel.max_observers or end a writer") from error

    def admin(self) -> Any:
        """A client of ``admin``."""
        service = self.transport.service("admin")
        builder = self._node.service_builder(iox2.ServiceName.new(service)).request_response(
            iox2.Slice[AdminRobot], iox2.Slice[ctypes.c_uint8]
        )
        builder = builder.request_header(AdminRequest).response_header(AdminAnswer)
        opened = self._patiently("admin", builder.open)
        try:
            return (
                opened.client_builder()
                # Most requests are about one robot; more memory is taken when one is about many.
                .initial_max_slice_len(16)
                .allocation_strategy(iox2.AllocationStrategy.PowerOfTwo)
                .backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
                .create()
            )
        except iox2.ClientCreateError as error:
            raise self._no_port("admin", error, "raise admin.max_clients or end a client") from error

    def _open(self, channel: str) -> Any:
        record, header = CHANNELS[channel]
        name = iox2.ServiceName.new(self.transport.service(channel))
        builder = self._node.service_builder(name).publish_subscribe(iox2.Slice[record])
        return builder.user_header(header).open()

    def _patiently(self, channel: str, opening: Callable[[], Any]) -> Any:
        """Opens a channel. A daemon that begins makes one after the other: what is missing may come."""
        end = time.monotonic() + STARTING_S
        while True:
            try:
                return opening()
            except (iox2.PublishSubscribeOpenError, iox2.RequestResponseOpenError) as error:
                missing = str(error) == "DoesNotExist" and self.has_daemon()
                if not missing or time.monotonic() >= end:
                    raise self._not_opened(channel, error) from error
            time.sleep(0.01)

    def _not_opened(self, channel: str, error: Exception) -> Exception:
        service, reason = self.transport.service(channel), str(error)
        if reason == "DoesNotExist":
            unheard = channel == "observation" and self.has_daemon()
            return NotObservedError(service) if unheard else NoDaemonError(service)
        if "Incompatible" in reason and "Type" in reason:
            return SchemaError(service)
        return ChannelError(
            service, reason, "a process of another version, or with other limits, keeps it alive: end it"
        )

    def _no_port(self, channel: str, error: Exception, remedy: str) -> ChannelError:
        return ChannelError(self.transport.service(channel), str(error), remedy)
