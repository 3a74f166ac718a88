"""Ten lines: follow a running fleet and print where everybody is.

Run ``clearwayd --config docs/examples/clearway.toml``, then this.
"""

import clearway

with clearway.attach() as client:
    for sample in client.states:
        print(f"period {sample.header.tick}")
        for robot in sample.present():
            print(f"  robot {robot['id']}: ({robot['x_m']:.2f}, {robot['y_m']:.2f}) m")
