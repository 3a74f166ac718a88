/// What disturbs a robot: how far it may be from the exact unicycle that is fully observed.
///
/// As bounds they are what the safety rows allow for (docs/MATH.md §2); as amplitudes they are what
/// the plant does.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbance {
    /// Distance of a position in the state from the true one, m.
    pub position_m: f64,
    /// Error of a heading in the state, rad.
    pub heading_rad: f64,
    /// Slip: error of the velocity, in any direction, as a share of the wheels' speed. A robot whose
    /// wheels stand does not slip.
    pub slip: f64,
    /// Error of the turn rate, rad/s, at any speed.
    pub turn_rate_radps: f64,
    /// Time constant of the first-order lag between a command and the wheels, s.
    pub lag_s: f64,
    /// Time after which a command begins to act, s; at most one period.
    pub delay_s: f64,
}

impl Disturbance {
    /// The exact model.
    pub const NONE: Self =
        Self { position_m: 0.0, heading_rad: 0.0, slip: 0.0, turn_rate_radps: 0.0, lag_s: 0.0, delay_s: 0.0 };

    /// Whether nothing is disturbed.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Every amplitude multiplied by `share`.
    #[must_use]
    pub fn scaled(&self, share: f64) -> Self {
        Self {
            position_m: self.position_m * share,
            heading_rad: self.heading_rad * share,
            slip: self.slip * share,
            turn_rate_radps: self.turn_rate_radps * share,
            lag_s: self.lag_s * share,
            delay_s: self.delay_s * share,
        }
    }

    /// Time by which the travel of a command is behind it in the mean, s.
    pub fn late_s(&self) -> f64 {
        self.lag_s + self.delay_s
    }
}
