/// The input u = (v, ω) of one robot, held for one period.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s, counter-clockwise positive.
    pub omega_radps: f64,
}

impl Command {
    /// Stand still. Admissible in every state: the answer to every fault.
    pub const STOP: Self = Self { v_mps: 0.0, omega_radps: 0.0 };

    /// True when both inputs are finite.
    pub fn is_finite(&self) -> bool {
        self.v_mps.is_finite() && self.omega_radps.is_finite()
    }
}
