"""The examples do what their first lines say."""

import unittest

import numpy as np

from .world import PACKAGE, WorldTestCase

try:
    import matplotlib.image
except ModuleNotFoundError:
    matplotlib = None

EXAMPLES = PACKAGE / "examples"


class Examples(WorldTestCase):
    def test_ten_lines_follow_a_fleet(self):
        lines = (EXAMPLES / "follow.py").read_text().split('"""\n')[1].strip().splitlines()
        self.assertLessEqual(len(lines), 10)
        for readme in (PACKAGE / "README.md", PACKAGE.parent.parent / "README.md"):
            printed = readme.read_text().split("```python\n")[1].split("```")[0]
            self.assertEqual(printed.strip().splitlines(), lines, readme)
        self.daemon("--ticks", "80")
        self.attach()
        said = self.ended(self.python(str(EXAMPLES / "follow.py")))
        self.assertIn("\nperiod ", said)
        self.assertRegex(said, r"robot 7: \(-?\d+\.\d\d, -?\d+\.\d\d\) m")

    @unittest.skipIf(matplotlib is None, "matplotlib is not installed")
    def test_the_notebook_draws_live_trajectories(self):
        self.environment |= {
            "CLEARWAY_SECONDS": "3",
            "CLEARWAY_PICTURE": "live.png",
            "MPLBACKEND": "Agg",
            "MPLCONFIGDIR": str(self.root),
        }
        # Long enough to be still there when the drawing begins.
        self.daemon(period_us=40_000)
        self.attach()
        said = self.ended(self.python(str(EXAMPLES / "live_trajectories.py")))
        self.assertRegex(said, r"live.png: \d+ periods, clearance at least \d+\.\d+ m")
        picture = matplotlib.image.imread(self.root / "live.png")
        height, width, _ = picture.shape
        self.assertGreater(min(height, width), 500)
        # Axes alone are shades of grey; eight robots are not.
        colours = np.unique((picture[..., :3] * 15).astype(int).reshape(-1, 3), axis=0)
        self.assertGreater(int((np.ptp(colours, axis=1) > 5).sum()), 20)
