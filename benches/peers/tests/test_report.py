import unittest

from closed_loop.report import markdown


def row(law, scenario, **changes):
    times = {"count": 10, "p50": 1000, "p99": 2000, "p999": 3000, "max": 4000}
    return {
        "group": "pair",
        "scenario": scenario,
        "law": law,
        "title": law.upper(),
        "robots": 2,
        "arrived": 2,
        "violations": 0,
        "min_clearance_m": 0.25,
        "makespan_s": 2.0,
        "arrival_ratio": 1.1,
        "path_ratio": 1.0,
        "omega_variation_rad": None,
        "solve_ns": None,
        "step_ns_per_robot": 500,
        "fleet_step_ns": times,
        **changes,
    }


class ReportTest(unittest.TestCase):
    def cells(self, rows):
        """For every table its lines as lists of cells, without the ruler."""
        document = {"rows": rows, "reference": "ours", "period_s": 0.08}
        tables = [part for part in markdown(document).split("\n\n") if part.startswith("|")]
        return [
            [
                [cell.strip() for cell in line.strip("|").split(" | ")]
                for line in t.splitlines()
                if "---" not in line
            ]
            for t in tables
        ]

    def test_laws_are_compared_where_both_passed(self):
        slow = {"step_ns_per_robot": 2000, "makespan_s": 3.0}
        rows = [
            row("ours", "a"),
            row("peer", "a", **slow),
            row("ours", "b"),
            row("peer", "b", **slow, violations=3, min_clearance_m=-0.1),
        ]
        overall, makespans, group = self.cells(rows)
        peer = dict(zip(overall[0], overall[2], strict=True))
        self.assertEqual((peer["runs passed"], peer["pairs too close"]), ("1 of 2", "3"))
        self.assertEqual(peer["clearance m"], "-0.1000")
        self.assertEqual((peer["makespan × ours"], peer["× ours"]), ("1.50 (1)", "4.0"))
        self.assertEqual((peer["periods"], peer["keeps 80 ms"]), ("20", "yes"))
        self.assertEqual(makespans[2], ["PEER", "3.00 (3)"])
        self.assertEqual([line[0] for line in group], ["law", "OURS", "PEER"])

    def test_who_does_not_arrive_has_no_makespan_and_a_long_period_is_not_kept(self):
        late = {"count": 10, "p50": 1000, "p99": 2000, "p999": 3000, "max": 81_000_000}
        failed = {"arrived": 1, "makespan_s": None, "fleet_step_ns": late}
        overall, makespans, group = self.cells([row("ours", "a"), row("peer", "a", **failed)])
        peer = dict(zip(overall[0], overall[2], strict=True))
        self.assertEqual((peer["makespan × ours"], peer["keeps 80 ms"]), ("–", "**no**"))
        self.assertEqual(makespans[2], ["PEER", "1 of 2"])
        self.assertEqual(dict(zip(group[0], group[2], strict=True))["makespan s"], "–")


if __name__ == "__main__":
    unittest.main()
