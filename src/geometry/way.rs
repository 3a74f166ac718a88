use super::{Vec2, closest_point_on_segment};

/// A path of which only the ends and a bound on the length are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// Where it begins, m.
    pub from_m: Vec2,
    /// Where it ends, m.
    pub to_m: Vec2,
    /// It is no longer than this, m.
    pub length_m: f64,
}

impl Way {
    /// How far any point of it may be from the straight line between its ends, m.
    ///
    /// Every point has distances to both ends that add up to the length at most: it is in the ellipse
    /// around them. That reaches furthest from the line across its middle, by the smaller half axis.
    pub fn bow_m(&self) -> f64 {
        let straight_m2 = (self.to_m - self.from_m).norm_squared();
        0.5 * (self.length_m * self.length_m - straight_m2).max(0.0).sqrt()
    }

    /// The point of the straight line between its ends that is nearest to `point`, m.
    pub fn closest_point(&self, point: Vec2) -> Vec2 {
        closest_point_on_segment(point, self.from_m, self.to_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Arc, Pose};
    use proptest::prelude::*;

    proptest! {
        /// However many arcs, forwards and backwards: no point of the path is further from the line.
        #[test]
        fn no_point_of_a_path_is_further_from_the_line_than_the_bow(
            arcs in prop::collection::vec((-5.0..5.0f64, -3.0..3.0f64, 0.001..0.5f64), 1..6),
        ) {
            let (mut pose, mut length_m, mut points) = (Pose::new(1.0, -2.0, 0.3), 0.0, Vec::new());
            for (v_mps, omega_radps, s) in arcs {
                let arc = Arc { start: pose, v_mps, omega_radps };
                points.extend((0..50).map(|k| arc.position(s * f64::from(k) / 50.0)));
                (pose, length_m) = (arc.pose(s), length_m + v_mps.abs() * s);
            }
            let way = Way { from_m: points[0], to_m: pose.position_m, length_m };
            for point in points {
                let off_m = (point - way.closest_point(point)).norm();
                prop_assert!(off_m <= way.bow_m() + 1e-7, "{off_m} {}", way.bow_m());
            }
        }
    }

    #[test]
    fn a_straight_path_has_no_bow_and_one_of_a_period_little() {
        let straight = Way { from_m: Vec2::zeros(), to_m: Vec2::new(3.0, 4.0), length_m: 5.0 };
        assert_eq!(straight.bow_m(), 0.0);
        // 5 m/s and 1 rad/s for 80 ms: 4 mm are the arc's, 4.6 mm are allowed for.
        let arc = Arc { start: Pose::default(), v_mps: 5.0, omega_radps: 1.0 };
        let way = Way { from_m: Vec2::zeros(), to_m: arc.position(0.08), length_m: 0.4 };
        assert!((way.bow_m() - 4.6e-3).abs() < 1e-4, "{}", way.bow_m());
        // There and back again.
        let back = Way { from_m: Vec2::zeros(), to_m: Vec2::zeros(), length_m: 1.0 };
        assert_eq!(back.bow_m(), 0.5);
    }
}
