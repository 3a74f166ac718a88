//! A whole run as a table: a row for each period and robot.

use clearway::evaluation::Trace;
use std::fmt::Write;

/// Pose, input, V and the slack of the certificate of every robot, and the smallest clearance of any pair
/// over the period (empty where there is no pair).
pub(super) fn csv(run: &Trace) -> String {
    let mut out =
        "time_s,robot,x_m,y_m,theta_rad,v_mps,omega_radps,lyapunov_m2,slack_m2,min_clearance_m\n".to_owned();
    for (k, period) in run.periods.iter().enumerate() {
        let time_s = run.time_s(k);
        let clearance = Some(period.min_clearance_m).filter(|c| c.is_finite());
        let clearance = clearance.map_or(String::new(), |c| c.to_string());
        for (robot, s) in run.scenario.robots.iter().zip(&period.fleet) {
            let (p, theta, u) = (s.pose.position_m, s.pose.theta_rad, s.input);
            let (v, slack) = (s.lyapunov_m2(), s.slack_m2);
            // Writing to a string cannot fail.
            let _ = writeln!(
                out,
                "{time_s:.6},{},{},{},{theta},{},{},{v},{slack},{clearance}",
                robot.id, p.x, p.y, u.v_mps, u.omega_radps
            );
        }
    }
    out
}
