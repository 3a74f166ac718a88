# %% [markdown]
# # Live trajectories of a running fleet
#
# Run `clearwayd --config docs/examples/clearway.toml`, then these cells one by one, or the file as a script:
# with a display it draws while robots drive, in any case it writes a picture. Needs matplotlib.

# %% Settings
import os
import time

import matplotlib.pyplot as plt
import numpy as np

import clearway

SECONDS = float(os.environ.get("CLEARWAY_SECONDS", "10"))  # how long to watch
PICTURE = os.environ.get("CLEARWAY_PICTURE", "trajectories.png")
REDRAW_S = 0.2

# %% Attach, and see who is there
client = clearway.attach(wait_s=10.0)
sample = client.states.wait()
if sample is None:
    raise SystemExit("the daemon publishes no states")
fleet = sample.present()  # a copy: it outlives the sample
period_s = 1e-9 * sample.header.period_ns
del sample
fleet[["id", "x_m", "y_m", "goal_x_m", "goal_y_m"]]

# %% The figure: the plane above, the smallest clearance below
figure, (plane, below) = plt.subplots(
    2, 1, figsize=(7.0, 8.5), height_ratios=[4.0, 1.0], layout="constrained"
)
plane.set(aspect="equal", xlabel="x in m", ylabel="y in m")
below.set(xlabel="time in s", ylabel="clearance in m")
plane.grid(alpha=0.3)
below.grid(alpha=0.3)
below.axhline(0.0, color="black", linewidth=0.8)
colours = plt.colormaps["turbo"](np.linspace(0.05, 0.95, len(fleet)))
trails, bodies, noses = [], [], []
for robot, colour in zip(fleet, colours, strict=True):
    plane.plot(robot["goal_x_m"], robot["goal_y_m"], "x", color=colour, markersize=7)
    trails.append(plane.plot([], [], color=colour, linewidth=1.2, label=f"robot {robot['id']}")[0])
    bodies.append(plane.add_patch(plt.Circle((0.0, 0.0), robot["radius_m"], color=colour)))
    noses.append(plane.plot([], [], color="white", linewidth=1.5)[0])
(curve,) = below.plot([], [], color="tab:red", linewidth=1.2)
xs, ys = (np.concatenate([fleet[axis], fleet[f"goal_{axis}"]]) for axis in ("x_m", "y_m"))
plane.set(xlim=(xs.min() - 1.0, xs.max() + 1.0), ylim=(ys.min() - 1.0, ys.max() + 1.0))
plane.legend(loc="upper right", fontsize="x-small", ncols=2)

# %% Watch: every state and every record of telemetry, drawn a few times a second
path = {int(robot["id"]): [] for robot in fleet}
heading = {}
times_s, clearances_m = [], []
release_ns = None


def draw() -> None:
    """Brings the figure up to date."""
    for robot, trail, body, nose in zip(fleet, trails, bodies, noses, strict=True):
        way = np.array(path[int(robot["id"])])
        if len(way):
            trail.set_data(way[:, 0], way[:, 1])
            body.center = way[-1]
            tip = way[-1] + robot["radius_m"] * np.array(heading[int(robot["id"])])
            nose.set_data([way[-1][0], tip[0]], [way[-1][1], tip[1]])
    curve.set_data(times_s, clearances_m)
    below.relim()
    below.autoscale_view()
    seconds = 0.0 if not times_s else times_s[-1]
    plane.set_title(f'fleet "{client.fleet}" after {seconds:.1f} s, T = {1e3 * period_s:g} ms')
    plt.pause(0.001)


end, drawn = time.monotonic() + SECONDS, 0.0
while time.monotonic() < end:
    sample = client.states.wait(timeout_s=2.0)
    if sample is None:
        break  # the daemon has ended
    for robot in sample.robots:  # looked at where it lies, in shared memory
        if int(robot["id"]) in path:
            path[int(robot["id"])].append((float(robot["x_m"]), float(robot["y_m"])))
            heading[int(robot["id"])] = (np.cos(robot["theta_rad"]), np.sin(robot["theta_rad"]))
    while (record := client.telemetry.next()) is not None:
        release_ns = release_ns or record.header.release_ns
        smallest_m = record.robots["clearance_m"].min(initial=np.inf)
        if np.isfinite(smallest_m):
            times_s.append(1e-9 * (record.header.release_ns - release_ns))
            clearances_m.append(smallest_m)
    # Neither is held while the figure is drawn.
    del sample, robot, record
    if time.monotonic() > drawn + REDRAW_S:
        draw()
        drawn = time.monotonic()
draw()

# %% Keep the picture
figure.savefig(PICTURE, dpi=120)
client.close()
print(f"{PICTURE}: {len(times_s)} periods, clearance at least {min(clearances_m, default=np.nan):.3f} m")
