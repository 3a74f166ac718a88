use super::{Arc, min_distance_arcs};

/// An arc that is driven between two instants, `CLOCK_MONOTONIC` ns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedArc {
    /// When the arc is at its start, ns.
    pub from_ns: u64,
    /// When it is left, ns.
    pub to_ns: u64,
    /// The way.
    pub arc: Arc,
}

impl TimedArc {
    /// How long it takes, s.
    pub fn duration_s(&self) -> f64 {
        seconds(self.from_ns, self.to_ns)
    }

    /// What is left of it from `at_ns` on.
    #[must_use]
    pub fn from(&self, at_ns: u64) -> Self {
        let at_ns = at_ns.clamp(self.from_ns, self.to_ns);
        if at_ns == self.from_ns {
            return *self;
        }
        Self { from_ns: at_ns, arc: self.arc.from(seconds(self.from_ns, at_ns)), ..*self }
    }
}

fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

/// Smallest distance between two centres over all instants at which both are known, m; `None` when
/// there is none. Each way is in the order of time and may have gaps.
///
/// One exact minimum ([`min_distance_arcs`]) for each overlap.
pub fn min_distance_timed(a: &[TimedArc], b: &[TimedArc]) -> Option<f64> {
    let (mut i, mut j, mut smallest) = (0, 0, None::<f64>);
    while let (Some(p), Some(q)) = (a.get(i), b.get(j)) {
        let (from_ns, to_ns) = (p.from_ns.max(q.from_ns), p.to_ns.min(q.to_ns));
        if from_ns <= to_ns {
            let bound =
                min_distance_arcs(&p.from(from_ns).arc, &q.from(from_ns).arc, seconds(from_ns, to_ns));
            smallest = Some(smallest.map_or(bound.upper_m, |m| m.min(bound.upper_m)));
        }
        // Whoever ends first has met everything that it can.
        if p.to_ns <= q.to_ns {
            i += 1;
        } else {
            j += 1;
        }
    }
    smallest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;

    fn line(from_ns: u64, to_ns: u64, x_m: f64, v_mps: f64) -> TimedArc {
        TimedArc { from_ns, to_ns, arc: Arc { start: Pose::new(x_m, 0.0, 0.0), v_mps, omega_radps: 0.0 } }
    }

    const S: u64 = 1_000_000_000;

    #[test]
    fn the_distance_is_taken_at_the_same_instants() {
        // One stands at 10 m; the other comes up to 9 m and goes back. In pieces that do not match.
        let parked = [line(0, S, 10.0, 0.0), line(S, 9 * S, 10.0, 0.0)];
        let visitor = [line(0, 3 * S / 2, 0.0, 6.0), line(3 * S / 2, 4 * S, 9.0, -3.0)];
        assert!((min_distance_timed(&parked, &visitor).unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(min_distance_timed(&visitor, &parked), min_distance_timed(&parked, &visitor));
        // Both were at 5 m, but never at the same time.
        let early = [line(0, S, 0.0, 5.0)];
        let late = [line(2 * S, 3 * S, 5.0, 1.0)];
        assert_eq!(min_distance_timed(&early, &late), None);
        assert_eq!(min_distance_timed(&early, &[]), None);
    }

    #[test]
    fn a_gap_is_jumped_over_and_what_follows_counts() {
        let gap = [line(0, S, 0.0, 1.0), line(3 * S, 4 * S, 7.0, 1.0)];
        let parked = [line(0, 10 * S, 8.5, 0.0)];
        assert!((min_distance_timed(&gap, &parked).unwrap() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_part_of_an_arc_is_the_rest_of_the_way() {
        let arc = Arc { start: Pose::new(1.0, 2.0, 0.3), v_mps: 2.0, omega_radps: 0.8 };
        let whole = TimedArc { from_ns: S, to_ns: 3 * S, arc };
        let rest = whole.from(2 * S);
        assert_eq!((rest.from_ns, rest.to_ns, rest.duration_s()), (2 * S, 3 * S, 1.0));
        assert!((rest.arc.position(1.0) - arc.position(2.0)).norm() < 1e-12);
        assert_eq!((whole.from(0), whole.from(9 * S).duration_s()), (whole, 0.0));
    }
}
