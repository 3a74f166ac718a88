"""Codes and flags of the wire, version 1. They are only appended: expect numbers that are not here."""

from enum import IntEnum, IntFlag

NO_ROBOT = 0xFFFF_FFFF
"""In place of an id: no robot."""


class StateFlags(IntFlag):
    """Bits of ``RobotState.flags``."""

    VALID = 1 << 0
    """The pose comes from an accepted observation. Without it the pose is the middle of the way that it was told
    to drive since the last good one, and the robot is told to stop."""
    ARRIVED = 1 << 1
    """The robot is inside the tolerance of its goal."""
    FOREIGN = 1 << 2
    """The robot is observed, takes no commands and has no goal."""
    VACANT = 1 << 3
    """Nobody: a free place of the fleet. The rest of the record says nothing."""
    PAUSED = 1 << 4
    """The fleet is paused until it is resumed."""
    STOPPED = 1 << 5
    """The fleet is stopped, by an operator or by the daemon itself, until that is cleared."""
    MAY_STAND = 1 << 6
    """The robot follows its commands, or it has come to a stand somewhere on its way since it was last seen."""
    OUT_OF_STEP = 1 << 7
    """The robot missed a command, or was stopped by something else: it is told to stop until it is known to hold
    that."""


class Holding(IntEnum):
    """Which command a robot follows: the codes of ``RobotObservation.holding``. :meth:`command` makes those of
    commands."""

    UNTOLD = 0
    """Who looks does not know: the daemon takes the robot to get every command in time."""
    NOTHING = 1
    """None: the robot stands, because it missed one, was stopped by something else, or never had one."""

    @classmethod
    def command(cls, tick: int) -> int:
        """The code of having followed every command up to the one of ``tick``."""
        return (1 << 31) | (tick & ((1 << 31) - 1))


class TelemetryFlags(IntFlag):
    """Bits of ``RobotTelemetry.flags``."""

    STALLED = 1 << 0
    """No progress for more than a second, and not arrived."""
    GIVING_WAY = 1 << 1
    """The robot has left its goal, or its way, to let another one pass."""
    HOLDING = 1 << 2
    """The robot holds its place inside the tolerance of its goal."""


class AdminFlags(IntFlag):
    """Bits of ``AdminAnswer.flags``."""

    PAUSED = 1 << 0
    """The fleet is paused until it is resumed."""
    STOPPED = 1 << 1
    """The fleet is stopped, by an operator or by the daemon itself, until that is cleared."""
    DEGRADED = 1 << 2
    """The kernel refused a real-time call."""
    MEMORY_LOCKED = 1 << 3
    """All memory is locked."""
    OBSERVED = 1 << 4
    """States come from the ``observation`` channel."""
    ENDS_ON_ARRIVAL = 1 << 5
    """The run ends when every robot has arrived."""
    JOURNAL = 1 << 6
    """What operators change is kept in a journal, over a restart of the daemon."""
    JOURNAL_FAILING = 1 << 7
    """The journal cannot be written."""
    STOPPED_BY_RESTARTS = 1 << 8
    """With STOPPED: the daemon itself stopped the fleet, because it had to be started again too often."""
    STOPPED_BY_JOURNAL = 1 << 9
    """With STOPPED: the daemon itself stopped the fleet, because its journal could not be read."""
    WORKER_RESTING = 1 << 10
    """A worker panicked again and again and rests before it tries once more; its robots stand."""


class StopReason(IntEnum):
    """Why a robot was told to stop; 0 on the wire is a verified command."""

    START = 1
    """The first period of an epoch."""
    DEADLINE = 2
    """Its command was not complete at the deadline."""
    UNVERIFIED = 3
    """Its solution did not pass verification."""
    SOLVER = 4
    """The solver returned no solution."""
    CROWDED = 5
    """More neighbours can bind than there are rows."""
    NO_STATE = 6
    """There is no trusted state of this robot."""
    OPERATOR = 7
    """An operator or a signal asked for it."""
    FINISHED = 8
    """The run is over."""
    FOREIGN = 9
    """The robot is observed and takes no commands."""
    PAUSED = 10
    """The fleet is paused."""
    STOPPED = 11
    """The fleet is stopped, by an operator or by the daemon itself, until that is cleared."""
    VACANT = 12
    """There is no robot: a free place of the fleet."""
    CORRUPT = 13
    """The state that its command would have answered had changed in memory on its way."""
    OUT_OF_STEP = 14
    """The robot has told that it follows no commands: it missed one, or was stopped by something else. Once it
    holds this stop it may follow the next."""


class SolveStatus(IntEnum):
    """How a robot's programme ended."""

    NOT_SOLVED = 0
    VERIFIED = 1
    REFUSED = 2
    """A solution came back and verification refused it."""
    FAILED = 3
    """The solver gave up."""


class AdminKind(IntEnum):
    """What a request asks for."""

    STATUS = 1
    CONFIGURATION = 2
    SET_GOALS = 3
    PAUSE = 4
    RESUME = 5
    STOP = 6
    CLEAR = 7
    ADD_ROBOT = 8
    REMOVE_ROBOT = 9
    SCENARIO = 10


class AdminCode(IntEnum):
    """What became of a request. Every code but ``DONE`` has an exception in :mod:`clearway.refusals`."""

    DONE = 0
    BUSY = 1
    EXPIRED = 2
    MALFORMED = 3
    OTHER_EPOCH = 4
    UNKNOWN_ROBOT = 5
    FOREIGN_ROBOT = 6
    REPEATED_ROBOT = 7
    TAKEN_ID = 8
    NOT_FINITE = 9
    OUTSIDE_ARENA = 10
    INSIDE_OBSTACLE = 11
    GOAL_TAKEN = 12
    TOO_CLOSE = 13
    BAD_RADIUS = 14
    FULL = 15
    STOPPED = 16
    ENDING = 17
    NOT_KEPT = 18
