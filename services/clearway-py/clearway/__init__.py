"""A running Clearway fleet from Python: read along, publish observations, give orders.

    import clearway

    with clearway.attach() as client:
        for sample in client.states:
            for robot in sample.robots:
                print(sample.header.tick, robot["id"], robot["x_m"], robot["y_m"])

Lengths are in m, angles in rad in the world frame, times in ``CLOCK_MONOTONIC`` ns, which is the clock of
:func:`time.monotonic_ns`.
"""

from .actuation import Gate, Refusal
from .admin import AdminClient, Done, Status
from .client import Client, attach
from .codes import (
    NO_ROBOT,
    AdminCode,
    AdminFlags,
    AdminKind,
    Holding,
    SolveStatus,
    StateFlags,
    StopReason,
    TelemetryFlags,
)
from .errors import (
    AdminTimeoutError,
    AttachError,
    ChannelError,
    ClearwayError,
    FleetNameError,
    InterruptedReadError,
    LocationError,
    NoDaemonError,
    NotObservedError,
    ReleasedError,
    SampleInUseError,
    SchemaError,
    TooManySamplesError,
    TransferError,
)
from .observe import ObservationPublisher
from .refusals import RefusedError
from .subscriber import Sample, Subscriber

__version__ = "0.1.0"

__all__ = [
    "NO_ROBOT",
    "AdminClient",
    "AdminCode",
    "AdminFlags",
    "AdminKind",
    "AdminTimeoutError",
    "AttachError",
    "ChannelError",
    "ClearwayError",
    "Client",
    "Done",
    "FleetNameError",
    "Gate",
    "Holding",
    "InterruptedReadError",
    "LocationError",
    "NoDaemonError",
    "NotObservedError",
    "ObservationPublisher",
    "Refusal",
    "RefusedError",
    "ReleasedError",
    "Sample",
    "SampleInUseError",
    "SchemaError",
    "SolveStatus",
    "StateFlags",
    "Status",
    "StopReason",
    "Subscriber",
    "TelemetryFlags",
    "TooManySamplesError",
    "TransferError",
    "attach",
]
