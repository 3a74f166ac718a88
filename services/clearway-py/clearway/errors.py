"""What can go wrong, each with what to do about it in its message."""


class ClearwayError(Exception):
    """The base of all errors of this package."""


class FleetNameError(ClearwayError, ValueError):
    """The fleet's name cannot be part of a channel's name."""

    def __init__(self, name: str) -> None:
        super().__init__(
            f"the fleet name {name!r} cannot be part of a channel's name: "
            "use 1 to 64 letters, digits, '-' or '_'"
        )


class LocationError(ClearwayError, ValueError):
    """The prefix or the root directory of shared memory is unusable."""

    def __init__(self, what: str, value: str, reason: str) -> None:
        super().__init__(
            f"the channel {what} {value!r} is not usable ({reason}): set CLEARWAY_IOX2_PREFIX and "
            "CLEARWAY_IOX2_ROOT to those of the daemon, or pass prefix= and root="
        )


class AttachError(ClearwayError, OSError):
    """The process could not join shared memory."""


class NoDaemonError(ClearwayError):
    """No daemon runs for this fleet, or it does not offer the channel."""

    def __init__(self, service: str, remedy: str | None = None) -> None:
        remedy = remedy or (
            "start it with `clearwayd --fleet NAME`, or check the fleet's name and that CLEARWAY_IOX2_PREFIX "
            "and CLEARWAY_IOX2_ROOT are the daemon's"
        )
        super().__init__(f"the channel {service!r} does not exist: no daemon runs for this fleet; {remedy}")


class NotObservedError(ClearwayError):
    """The daemon does not listen to observations."""

    def __init__(self, service: str) -> None:
        super().__init__(
            f"the channel {service!r} does not exist: the daemon does not listen to observations; start it "
            'with source.kind = "observation"'
        )


class SchemaError(ClearwayError):
    """The channel carries records of another version."""

    def __init__(self, service: str) -> None:
        super().__init__(
            f"the channel {service!r} carries records of another schema than v1: use the same version of "
            "clearway on both sides"
        )


class ChannelError(ClearwayError):
    """A channel exists and cannot be opened, or has no place for another reader or writer."""

    def __init__(self, service: str, reason: str, remedy: str) -> None:
        super().__init__(f"cannot attach to the channel {service!r} ({reason}): {remedy}")


class TransferError(ClearwayError):
    """A sample could not be sent or received."""


class TooManySamplesError(TransferError):
    """More samples are held than a reader may hold."""

    def __init__(self, channel: str, held: int) -> None:
        super().__init__(
            f"{held} samples of {channel!r} are held and a reader may hold no more: keep copies "
            "(sample.robots.copy()), not samples or views of them"
        )


class SampleInUseError(ClearwayError, BufferError):
    """A sample was to be released while arrays still look into it."""

    def __init__(self) -> None:
        super().__init__("arrays still look into this sample: drop them or copy them before it is released")


class ReleasedError(ClearwayError, ValueError):
    """A sample, a channel or a client was used after it had been given back."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} has been given back and cannot be used any more")


class AdminTimeoutError(ClearwayError, TimeoutError):
    """No answer came in time. The request has expired and is not carried out later; it may have been before."""

    def __init__(self, timeout_s: float) -> None:
        super().__init__(
            f"the daemon did not answer within {timeout_s:g} s: "
            "it may have ended, be stopped, or have periods longer than that"
        )


class InterruptedReadError(ClearwayError):
    """A text could not be read as a whole, again and again."""

    def __init__(self, times: int) -> None:
        super().__init__(
            f"a text could not be read to its end, {times} times: the daemon was started again meanwhile, or "
            "too many others read as well; ask again"
        )
