use super::{Vec2, unit, wrap};

/// Position and heading of a robot in the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Position of the centre, m.
    pub position_m: Vec2,
    /// Heading, rad, counter-clockwise from the world's x axis, in (−π, π].
    pub theta_rad: f64,
}

impl Pose {
    /// A pose from its three coordinates; the heading is wrapped into (−π, π].
    pub fn new(x_m: f64, y_m: f64, theta_rad: f64) -> Self {
        Self { position_m: Vec2::new(x_m, y_m), theta_rad: wrap(theta_rad) }
    }

    /// Unit vector along the heading: h = (cos θ, sin θ).
    pub fn heading(&self) -> Vec2 {
        unit(self.theta_rad)
    }

    /// True when all three coordinates are finite.
    pub fn is_finite(&self) -> bool {
        self.position_m.x.is_finite() && self.position_m.y.is_finite() && self.theta_rad.is_finite()
    }
}

/// sin(x)/x, with its limit 1 at 0.
pub fn sinc(x: f64) -> f64 {
    // Below 1e-4 the third term of the series is under the last bit.
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { libm::sin(x) / x }
}

/// s · sinc(ω s / 2): length of the chord that a unit-speed arc covers in `s` seconds.
pub fn chord_factor(omega_radps: f64, s: f64) -> f64 {
    s * sinc(0.5 * omega_radps * s)
}

/// The motion of a unicycle whose input (v, ω) is held: an arc of a circle, or a line.
///
/// Exact solution of the paper's (10) under a zero-order hold,
/// p(s) = p + v s sinc(ωs/2) · (cos(θ + ωs/2), sin(θ + ωs/2)) and θ(s) = θ + ωs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Pose at s = 0.
    pub start: Pose,
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s.
    pub omega_radps: f64,
}

impl Arc {
    /// Position at `s` seconds, m.
    pub fn position(&self, s: f64) -> Vec2 {
        let half = 0.5 * self.omega_radps * s;
        self.start.position_m + unit(self.start.theta_rad + half) * (self.v_mps * s * sinc(half))
    }

    /// Velocity at `s` seconds, m/s.
    pub fn velocity(&self, s: f64) -> Vec2 {
        unit(self.start.theta_rad + self.omega_radps * s) * self.v_mps
    }

    /// Pose at `s` seconds.
    pub fn pose(&self, s: f64) -> Pose {
        Pose { position_m: self.position(s), theta_rad: wrap(self.start.theta_rad + self.omega_radps * s) }
    }

    /// The rest of the motion, seen from `s` seconds on.
    #[must_use]
    pub fn from(&self, s: f64) -> Self {
        Self { start: self.pose(s), ..*self }
    }
}

/// How a plant carries a pose through a period whose input is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Integration {
    /// Along the arc: what a unicycle does.
    #[default]
    Exact,
    /// One forward Euler step, p + vTh(θ) and θ + Tω, as in the paper's simulation: a straight line
    /// along the first heading. It leaves the arc by up to ½|vω|T², 16 mm at 5 m/s, 1 rad/s and 80 ms.
    Euler,
}

impl Integration {
    /// The way that positions take through the period.
    pub fn path(self, arc: &Arc) -> Arc {
        match self {
            Self::Exact => *arc,
            Self::Euler => Arc { omega_radps: 0.0, ..*arc },
        }
    }

    /// Pose at `s` seconds.
    pub fn pose(self, arc: &Arc, s: f64) -> Pose {
        let theta_rad = wrap(arc.start.theta_rad + arc.omega_radps * s);
        Pose { position_m: self.path(arc).position(s), theta_rad }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quarter_turn_of_unit_radius() {
        let arc =
            Arc { start: Pose::new(1.0, 0.0, std::f64::consts::FRAC_PI_2), v_mps: 1.0, omega_radps: 1.0 };
        let end = arc.pose(std::f64::consts::FRAC_PI_2);
        assert!((end.position_m - Vec2::new(0.0, 1.0)).norm() < 1e-15);
        assert!((end.theta_rad - std::f64::consts::PI).abs() < 1e-15);
    }

    #[test]
    fn euler_hides_up_to_16_mm_of_arc_a_step() {
        let arc = Arc { start: Pose::new(0.0, 0.0, 0.4), v_mps: 5.0, omega_radps: 1.0 };
        let apart = |s| {
            let (exact, euler) = (Integration::Exact.pose(&arc, s), Integration::Euler.pose(&arc, s));
            assert_eq!(exact, arc.pose(s));
            assert_eq!(euler.theta_rad, exact.theta_rad);
            (euler.position_m - exact.position_m).norm()
        };
        // ½ v ω T² = 16 mm, less what the chord is shorter.
        assert!((apart(0.08) - 0.016).abs() < 1e-5, "{}", apart(0.08));
        assert!(apart(0.04) < 0.0041);
    }

    proptest! {
        /// The closed form against a fine Runge–Kutta integration of (10).
        #[test]
        fn closed_form_solves_the_differential_equation(
            theta in -3.1..3.1f64, v in -5.0..5.0f64, omega in -3.0..3.0f64, t in 0.0..1.0f64,
        ) {
            let arc = Arc { start: Pose::new(0.3, -0.2, theta), v_mps: v, omega_radps: omega };
            let steps = 200;
            let h = t / f64::from(steps);
            let (mut x, mut y, mut a) = (0.3, -0.2, theta);
            for _ in 0..steps {
                // RK4 of a system whose right side depends on θ alone is Simpson's rule.
                let f = |q: f64| (v * q.cos(), v * q.sin());
                let (k1, k2, k3) = (f(a), f(a + 0.5 * h * omega), f(a + h * omega));
                x += h / 6.0 * (k1.0 + 4.0 * k2.0 + k3.0);
                y += h / 6.0 * (k1.1 + 4.0 * k2.1 + k3.1);
                a += h * omega;
            }
            prop_assert!((arc.position(t) - Vec2::new(x, y)).norm() < 1e-9);
        }

        /// Stopping half-way and going on is the same as going through.
        #[test]
        fn flow_property(theta in -3.1..3.1f64, v in 0.0..5.0f64, omega in -1.0..1.0f64, s in 0.0..0.08f64) {
            let arc = Arc { start: Pose::new(0.0, 0.0, theta), v_mps: v, omega_radps: omega };
            let two = arc.from(s).pose(0.08 - s);
            prop_assert!((two.position_m - arc.position(0.08)).norm() < 1e-13);
        }
    }
}
