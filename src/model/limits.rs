use super::Command;

/// Input limits (33e) and the required gap between bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Smallest forward speed, m/s; at most 0, so that a stop is admissible.
    pub v_min_mps: f64,
    /// Largest forward speed, m/s; above 0.
    pub v_max_mps: f64,
    /// Smallest turn rate, rad/s; below 0.
    pub omega_min_radps: f64,
    /// Largest turn rate, rad/s; above 0.
    pub omega_max_radps: f64,
    /// Gap `d_s` that bodies keep between them, m.
    pub safety_margin_m: f64,
}

impl Default for Limits {
    /// The values of the paper's Section IV.A.
    fn default() -> Self {
        Self {
            v_min_mps: 0.0,
            v_max_mps: 5.0,
            omega_min_radps: -1.0,
            omega_max_radps: 1.0,
            safety_margin_m: 0.15,
        }
    }
}

impl Limits {
    /// True when `command` is finite and inside (33e), bounds included.
    pub fn admits(&self, command: Command) -> bool {
        command.is_finite()
            && (self.v_min_mps..=self.v_max_mps).contains(&command.v_mps)
            && (self.omega_min_radps..=self.omega_max_radps).contains(&command.omega_radps)
    }

    /// Largest admissible |v|, m/s.
    pub fn speed_mps(&self) -> f64 {
        self.v_max_mps.max(-self.v_min_mps)
    }

    /// Largest admissible |ω|, rad/s.
    pub fn turn_rate_radps(&self) -> f64 {
        self.omega_max_radps.max(-self.omega_min_radps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_inclusive_and_not_finite_is_refused() {
        let l = Limits::default();
        assert!(l.admits(Command::STOP));
        assert!(l.admits(Command { v_mps: 5.0, omega_radps: -1.0 }));
        assert!(!l.admits(Command { v_mps: 5.0 + 1e-12, omega_radps: 0.0 }));
        assert!(!l.admits(Command { v_mps: f64::NAN, omega_radps: 0.0 }));
        assert!(!l.admits(Command { v_mps: 0.0, omega_radps: f64::INFINITY }));
    }
}
