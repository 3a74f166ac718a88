"""A fleet outside of the daemon, in Python: obeys the commands and says where it is.

Stands in for drivers and a localisation system. The daemon has to listen to observations::

    clearwayd --config docs/examples/clearway.toml --set source.kind=observation --scenario swap8 &
    python examples/drive.py --seconds 10
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

import clearway
from clearway.layout import CommandHeader, Records


class Unicycle:
    """One robot that moves exactly as the model says, behind the gate of every receiver of commands."""

    def __init__(self, robot: int, pose: tuple[float, float, float], period_ns: int, now_ns: int) -> None:
        self.gate = clearway.Gate(robot, max_hold_ns=period_ns)
        self.pose = pose
        self.now_ns = now_ns

    def advance(self, now_ns: int) -> None:
        """Moves it up to a time, from one change of its input to the next."""
        while self.now_ns < now_ns:
            change_ns = self.gate.next_change_ns(self.now_ns)
            until_ns = now_ns if change_ns is None else min(change_ns, now_ns)
            self.pose = arc(self.pose, self.gate.input(self.now_ns), (until_ns - self.now_ns) * 1e-9)
            self.now_ns = until_ns


def arc(
    pose: tuple[float, float, float], command: tuple[float, float], seconds: float
) -> tuple[float, float, float]:
    """Where a unicycle is after it has held (v, ω) m/s, rad/s: exact, an arc of a circle or a line."""
    (x_m, y_m, theta_rad), (v_mps, omega_radps) = pose, command
    half = 0.5 * omega_radps * seconds
    chord_m = v_mps * seconds * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    return (
        x_m + chord_m * math.cos(theta_rad + half),
        y_m + chord_m * math.sin(theta_rad + half),
        math.remainder(theta_rad + 2.0 * half, math.tau),
    )


class Plant:
    """The fleet, in the order of the places on the channels."""

    def __init__(self, states: Records, period_ns: int) -> None:
        now_ns = time.monotonic_ns()
        # Not yet observed, everybody is where the scenario starts.
        self.robots = [
            Unicycle(
                int(s["id"]), (float(s["x_m"]), float(s["y_m"]), float(s["theta_rad"])), period_ns, now_ns
            )
            for s in states
        ]
        self.ids = [robot.gate.robot for robot in self.robots]

    def obey(self, header: CommandHeader, commands: Records) -> None:
        """Hands every robot its command."""
        by_id = {int(command["id"]): command for command in commands}
        for robot in self.robots:
            command = by_id.get(robot.gate.robot)
            if command is not None:
                robot.gate.offer(header, command, time.monotonic_ns())

    def holding(self, now_ns: int) -> list[int]:
        """Which command everybody follows: the daemon then knows of a robot that missed one."""
        return [robot.gate.holding(now_ns) for robot in self.robots]

    def advance(self, now_ns: int) -> np.ndarray:
        """Moves everybody up to a time; rows x_m, y_m, theta_rad."""
        for robot in self.robots:
            robot.advance(now_ns)
        return np.array([robot.pose for robot in self.robots])


def main() -> None:
    """Drives until the daemon ends or the time is over."""
    parser = argparse.ArgumentParser(description="A fleet of exact unicycles in Python.")
    parser.add_argument("--fleet", default="default")
    parser.add_argument("--seconds", type=float, default=math.inf, help="how long (default: until the end)")
    arguments = parser.parse_args()

    with clearway.attach(arguments.fleet, wait_s=10.0) as client:
        first = client.states.wait(timeout_s=10.0)
        if first is None:
            raise SystemExit("the daemon publishes no states")
        period_ns = first.header.period_ns
        plant = Plant(first.present(), period_ns)
        del first
        end = time.monotonic() + arguments.seconds
        heard = time.monotonic()
        # A run is over when no commands come any more.
        while time.monotonic() < min(end, heard + 2.0 + 10e-9 * period_ns):
            now_ns = time.monotonic_ns()
            poses = plant.advance(now_ns)
            while (sample := client.commands.next()) is not None:
                plant.obey(sample.header, sample.robots)
                heard = time.monotonic()
            client.observe(plant.ids, poses, stamp_ns=now_ns, holding=plant.holding(now_ns))
            # Often enough for commands that come out only at the deadline: late ones are missed.
            time.sleep(min(0.1e-9 * period_ns, 1e-3))
        for robot in plant.robots:
            print(f"robot {robot.gate.robot}: ({robot.pose[0]:.3f}, {robot.pose[1]:.3f}) m")


if __name__ == "__main__":
    main()
