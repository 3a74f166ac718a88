"""Exceptions for requests that the daemon refused: one for each code of its answers."""

from __future__ import annotations

from .codes import AdminCode
from .errors import ClearwayError


class RefusedError(ClearwayError):
    """The daemon refused. Base of the others; itself raised for codes of later versions."""

    def __init__(self, code: int, robot: int | None, text: str) -> None:
        known = code in AdminCode._value2member_map_
        super().__init__(f"refused ({AdminCode(code).name.lower() if known else f'code {code}'}): {text}")
        self.code: AdminCode | int = AdminCode(code) if known else code
        """Why."""
        self.robot = robot
        """Id of the robot that it is about, if it is about one."""
        self.text = text
        """The daemon's reason, in words."""


class BusyError(RefusedError):
    """Too much is asked for at a time: try again a period later."""


class ExpiredError(RefusedError):
    """The request came, or would have been carried out, after its expiry."""


class MalformedError(RefusedError):
    """The daemon does not know the kind of request, or its records do not fit it."""


class OtherEpochError(RefusedError):
    """The request is meant for another run of the daemon."""


class UnknownRobotError(RefusedError):
    """There is no robot with this id."""


class ForeignRobotError(RefusedError):
    """The robot is a foreign one: it takes no goals and cannot be removed."""


class RepeatedRobotError(RefusedError):
    """A robot stands in the request twice."""


class TakenIdError(RefusedError):
    """There is a robot with this id already, or the id is reserved."""


class NotFiniteError(RefusedError):
    """A number is not finite."""


class OutsideArenaError(RefusedError):
    """A point is outside the arena."""


class InsideObstacleError(RefusedError):
    """A point is closer to an obstacle than the robot may come."""


class GoalTakenError(RefusedError):
    """A goal is closer to another robot's goal than the two may come."""


class TooCloseError(RefusedError):
    """The robot would stand closer to another than the two may come."""


class BadRadiusError(RefusedError):
    """The radius is out of range."""


class FullError(RefusedError):
    """The fleet has no room for another robot."""


class StoppedError(RefusedError):
    """The fleet is stopped: clear that first."""


class EndingError(RefusedError):
    """The run is ending."""


class NotKeptError(RefusedError):
    """It was carried out and is in force, and is not kept, or not yet: it may not survive a restart of the daemon."""


BY_CODE: dict[AdminCode, type[RefusedError]] = {
    AdminCode.BUSY: BusyError,
    AdminCode.EXPIRED: ExpiredError,
    AdminCode.MALFORMED: MalformedError,
    AdminCode.OTHER_EPOCH: OtherEpochError,
    AdminCode.UNKNOWN_ROBOT: UnknownRobotError,
    AdminCode.FOREIGN_ROBOT: ForeignRobotError,
    AdminCode.REPEATED_ROBOT: RepeatedRobotError,
    AdminCode.TAKEN_ID: TakenIdError,
    AdminCode.NOT_FINITE: NotFiniteError,
    AdminCode.OUTSIDE_ARENA: OutsideArenaError,
    AdminCode.INSIDE_OBSTACLE: InsideObstacleError,
    AdminCode.GOAL_TAKEN: GoalTakenError,
    AdminCode.TOO_CLOSE: TooCloseError,
    AdminCode.BAD_RADIUS: BadRadiusError,
    AdminCode.FULL: FullError,
    AdminCode.STOPPED: StoppedError,
    AdminCode.ENDING: EndingError,
    AdminCode.NOT_KEPT: NotKeptError,
}


def refusal(code: int, robot: int | None, text: str) -> RefusedError:
    """The exception for a code."""
    known = AdminCode._value2member_map_.get(code)
    kind = BY_CODE.get(known, RefusedError) if isinstance(known, AdminCode) else RefusedError
    return kind(code, robot, text)
