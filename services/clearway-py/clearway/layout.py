"""The records in shared memory, version 1: each declared once, for ctypes and for NumPy.

Lengths are in m, angles in rad counter-clockwise from the x axis, both in the world frame; times are
``CLOCK_MONOTONIC`` ns, the clock of :func:`time.monotonic_ns`. The unit ends each field's name;
``docs/CHANNELS.md`` explains every field. ``tests/layout.json`` holds names, sizes, offsets and types as the
daemon's compiler laid them out; tests in both languages compare their side with it.
"""

from __future__ import annotations

import ctypes
from typing import Annotated, Any, TypeAlias, TypeVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

U32: TypeAlias = Annotated[int, ctypes.c_uint32]
U64: TypeAlias = Annotated[int, ctypes.c_uint64]
F64: TypeAlias = Annotated[float, ctypes.c_double]

Records: TypeAlias = NDArray[np.void]
"""A structured array: one element for each robot, one field for each of the record's."""


class Record(ctypes.Structure):
    """A record of the wire: an instance is one record, :meth:`dtype` describes arrays of them."""

    @classmethod
    def type_name(cls) -> str:
        """The name under which iceoryx2 compares types across languages."""
        return f"clearway.v1.{cls.__name__}"

    @classmethod
    def dtype(cls) -> np.dtype[np.void]:
        """The record as a NumPy type."""
        dtype: np.dtype[np.void] = np.dtype(cls)  # type: ignore[assignment]
        return dtype

    def __repr__(self) -> str:
        fields = ", ".join(f"{field[0]}={getattr(self, field[0])!r}" for field in self._fields_)
        return f"{type(self).__name__}({fields})"


R = TypeVar("R", bound=Record)


def _laid_out(cls: type[R]) -> type[R]:
    """Lays the annotated fields out as C does; none is in place before its class is complete."""
    fields: list[tuple[str, Any]] = []
    for name, hint in get_type_hints(cls, include_extras=True).items():
        if name in cls.__annotations__:
            fields.append((name, get_args(hint)[1] if get_args(hint) else hint))
    cls._fields_ = fields
    return cls


@_laid_out
class StateHeader(Record):
    """Head of a sample on ``state``."""

    epoch: U64
    tick: U64
    stamp_ns: U64
    release_ns: U64
    period_ns: U64
    records: U32
    checksum: U32


@_laid_out
class RobotIntent(Record):
    """What a robot tells the others besides its state."""

    heading_rad: F64
    speed_mps: F64
    blocked_s: F64
    target_x_m: F64
    target_y_m: F64
    waypoint_x_m: F64
    waypoint_y_m: F64
    rank: U32
    valid: U32


@_laid_out
class RobotState(Record):
    """One robot on ``state``: its pose at the start of the period and the command it holds until the next."""

    id: U32
    flags: U32
    x_m: F64
    y_m: F64
    theta_rad: F64
    v_mps: F64
    omega_radps: F64
    goal_x_m: F64
    goal_y_m: F64
    radius_m: F64
    uncertainty_m: F64
    seen_x_m: F64
    seen_y_m: F64
    way_m: F64
    intent: RobotIntent


@_laid_out
class CommandHeader(Record):
    """Head of a sample on ``command``: the commands act in [valid_from_ns, valid_until_ns), after those of
    tick ``follows``."""

    epoch: U64
    tick: U64
    stamp_ns: U64
    state_stamp_ns: U64
    valid_from_ns: U64
    valid_until_ns: U64
    follows: U64
    records: U32
    checksum: U32


@_laid_out
class RobotCommand(Record):
    """One robot on ``command``; ``stop_reason`` 0 is a verified command."""

    id: U32
    stop_reason: U32
    v_mps: F64
    omega_radps: F64


@_laid_out
class TelemetryHeader(Record):
    """Head of a sample on ``telemetry``: one period of the loop."""

    epoch: U64
    tick: U64
    release_ns: U64
    release_lateness_ns: U64
    state_publish_ns: U64
    state_to_staged_ns: U64
    state_to_command_ns: U64
    deadline_lateness_ns: U64
    skipped_periods: U64
    fallback_commands: U64
    lost_records: U64
    audited: U64
    audit_disagreed: U64
    audit_max_input_gap: F64
    records: U32
    checksum: U32


@_laid_out
class RobotTelemetry(Record):
    """One robot on ``telemetry``."""

    id: U32
    stop_reason: U32
    status: U32
    safety_rows: U32
    active_rows: U32
    settling_steps: U32
    flags: U32
    reserved: U32
    solve_ns: U64
    step_ns: U64
    v_mps: F64
    omega_radps: F64
    lyapunov_position_m2: F64
    decrease_position_m2: F64
    slack_position_m2: F64
    lyapunov_heading: F64
    decrease_heading: F64
    slack_heading: F64
    slack_comfort_m: F64
    reference_rotation_rad: F64
    speed_cap_mps: F64
    clearance_m: F64
    kkt_residual: F64


@_laid_out
class ObservationHeader(Record):
    """Head of a sample on ``observation``."""

    epoch: U64
    sequence: U64
    stamp_ns: U64
    records: U32
    checksum: U32


@_laid_out
class RobotObservation(Record):
    """One robot on ``observation``; ``holding`` is a code of :class:`~clearway.Holding`."""

    id: U32
    holding: U32
    x_m: F64
    y_m: F64
    theta_rad: F64


@_laid_out
class AdminRequest(Record):
    """Head of a request on ``admin``."""

    ticket: U64
    expires_ns: U64
    epoch: U64
    offset: U64
    kind: U32
    reserved: U32


@_laid_out
class AdminRobot(Record):
    """One robot in a request on ``admin``."""

    id: U32
    reserved: U32
    goal_x_m: F64
    goal_y_m: F64
    start_x_m: F64
    start_y_m: F64
    start_theta_rad: F64
    radius_m: F64


@_laid_out
class AdminAnswer(Record):
    """Head of an answer on ``admin``: what became of the request, and how the daemon is doing."""

    ticket: U64
    epoch: U64
    stamp_ns: U64
    acts_from_tick: U64
    code: U32
    kind: U32
    robot: U32
    flags: U32
    text_bytes: U64
    tick: U64
    period_ns: U64
    uptime_ns: U64
    periods: U64
    deadline_misses: U64
    skipped_periods: U64
    fallback_commands: U64
    rejected_inputs: U64
    lost_records: U64
    worker_panics: U64
    release_lateness_max_ns: U64
    solve_p99_ns: U64
    min_clearance_m: F64
    requests_done: U64
    requests_refused: U64
    requests_busy: U64
    capacity: U32
    robots: U32
    arrived: U32
    stalled: U32
    unseen: U32
    workers: U32
    workers_silent: U32
    degraded: U32
    state_readers: U32
    command_readers: U32
    telemetry_readers: U32
    observation_writers: U32
    admin_clients: U32
    restarts: U32
