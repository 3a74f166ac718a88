use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Bits of [`RobotTelemetry::flags`].
pub mod telemetry_flags {
    /// The robot has not made progress for more than a second and has not arrived.
    pub const STALLED: u32 = 1;
    /// The robot has left its goal, or its way, to let another one pass.
    pub const GIVING_WAY: u32 = 1 << 1;
    /// The robot holds its place inside the tolerance of its goal.
    pub const HOLDING: u32 = 1 << 2;
}

/// Header of a sample on `telemetry`: one period of the loop.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.TelemetryHeader")]
pub struct TelemetryHeader {
    /// Which run of the daemon.
    pub epoch: u64,
    /// Number of the period whose state was answered.
    pub tick: u64,
    /// Scheduled start of the period, `CLOCK_MONOTONIC` ns.
    pub release_ns: u64,
    /// How late the loop thread woke after it, ns.
    pub release_lateness_ns: u64,
    /// From waking to the state sample being published, ns.
    pub state_publish_ns: u64,
    /// From the stamp of the state to the last command being staged, ns; 0 when one was missing.
    pub state_to_staged_ns: u64,
    /// From the stamp of the state to the command sample being published, ns.
    pub state_to_command_ns: u64,
    /// How late the command sample was published after the deadline, ns.
    pub deadline_lateness_ns: u64,
    /// Periods skipped just before this one because the loop overran.
    pub skipped_periods: u64,
    /// Robots told to stop in this period for a reason other than the start or an operator.
    pub fallback_commands: u64,
    /// Records lost before this one because the queue to the housekeeping thread was full.
    pub lost_records: u64,
    /// Solutions that the shadow audit has compared so far.
    pub audited: u64,
    /// Of these, the ones that disagreed.
    pub audit_disagreed: u64,
    /// Largest difference of the inputs that the audit has seen, m/s or rad/s.
    pub audit_max_input_gap: f64,
    /// Records of the sample.
    pub records: u32,
    /// CRC-32 of the channel's name, the header before this field, and the records.
    pub checksum: u32,
}

/// One robot in a sample on `telemetry`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotTelemetry")]
pub struct RobotTelemetry {
    /// Id of the robot.
    pub id: u32,
    /// 0, or the code of the stop reason that went out.
    pub stop_reason: u32,
    /// Code of the [`SolveStatus`].
    pub status: u32,
    /// Neighbours and obstacles that had a safety row.
    pub safety_rows: u32,
    /// Rows (safety, comfort, speed bound) that hold with equality at the solution.
    pub active_rows: u32,
    /// Steps that the scalar recursion z ← z − Q(z) needs until the robot is inside its tolerance:
    /// the predicted settling step. `u32::MAX`: more than 250.
    pub settling_steps: u32,
    /// Bits of [`telemetry_flags`].
    pub flags: u32,
    /// Zero; reserved.
    pub reserved: u32,
    /// Time for the solver alone, ns.
    pub solve_ns: u64,
    /// Time for the robot's whole step: neighbours, guidance, programme, solver, verification, ns.
    pub step_ns: u64,
    /// Forward speed that went out, m/s.
    pub v_mps: f64,
    /// Turn rate that went out, rad/s.
    pub omega_radps: f64,
    /// V_p = ½‖p − p_d‖², m².
    pub lyapunov_position_m2: f64,
    /// Q_p asked of it, m².
    pub decrease_position_m2: f64,
    /// δ_p: what the position certificate fell short of Q_p, m².
    pub slack_position_m2: f64,
    /// V_θ = 1 − cos e.
    pub lyapunov_heading: f64,
    /// Q_θ asked of it.
    pub decrease_heading: f64,
    /// δ_θ: what the heading certificate fell short of Q_θ.
    pub slack_heading: f64,
    /// Σ_j δ_rj: how far the comfort rows were given up, m.
    pub slack_comfort_m: f64,
    /// Rotation β of the reference about the robot, rad.
    pub reference_rotation_rad: f64,
    /// Speed cap from the guidance, m/s.
    pub speed_cap_mps: f64,
    /// min_j d_ij − ρ_ij at the instant the command acts, m; +∞ without neighbours.
    pub clearance_m: f64,
    /// Scaled KKT residual of the solution.
    pub kkt_residual: f64,
}

/// How a robot's programme ended.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolveStatus {
    /// No programme was solved.
    #[default]
    NotSolved = 0,
    /// Solved and verified.
    Verified = 1,
    /// A solution came back and verification refused it.
    Refused = 2,
    /// The solver gave up.
    Failed = 3,
}
