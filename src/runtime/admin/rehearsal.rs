use super::plan::Plan;
use super::refusal::{Refusal, check_header};
use crate::config::Config;
use crate::scenario::Scenario;
use crate::wire::{AdminKind, AdminRequest, AdminRobot};

/// What the daemon would answer to requests, found out without one: the checks of the thread that
/// answers operators, against the fleet as it will be once everything accepted is carried out.
///
/// What only the loop knows is left out: who stands where by then, and how much waits already.
///
/// ```
/// use clearway::config::Config;
/// use clearway::runtime::Rehearsal;
/// use clearway::scenario::Scenario;
/// use clearway::wire::{AdminCode, AdminKind, AdminRequest, AdminRobot};
///
/// let mut fleet = Rehearsal::new(&Config::new(Scenario::builtin("swap8")?), 7);
/// let request = AdminRequest { expires_ns: 2_000, kind: AdminKind::SetGoals as u32, ..Default::default() };
/// let goal = AdminRobot { id: 0, goal_x_m: f64::NAN, ..Default::default() };
/// let refusal = fleet.ask(&request, &[goal], 1_000).unwrap_err();
/// assert_eq!((refusal.code, refusal.robot), (AdminCode::NotFinite, 0));
/// # Ok::<(), clearway::document::ConfigError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Rehearsal {
    plan: Plan,
    start: Scenario,
    epoch: u64,
}

impl Rehearsal {
    /// The fleet of `config` as it starts, in the run `epoch`.
    pub fn new(config: &Config, epoch: u64) -> Self {
        Self { plan: Plan::new(config), start: config.scenario.clone(), epoch }
    }

    /// Looks at a request at `now_ns`, and takes it as carried out if it is sound.
    ///
    /// # Errors
    /// What it is refused for; the fleet is as before.
    pub fn ask(
        &mut self,
        request: &AdminRequest,
        robots: &[AdminRobot],
        now_ns: u64,
    ) -> Result<AdminKind, Refusal> {
        let kind = check_header(request, self.epoch, now_ns)?;
        if kind.is_question() {
            return if robots.is_empty() { Ok(kind) } else { Err(Refusal::about_no_robot()) };
        }
        for change in self.plan.changes(kind, robots)? {
            self.plan.apply(&change);
        }
        Ok(kind)
    }

    /// The scenario as it is by now, in ascending order of id.
    pub fn scenario(&self) -> Scenario {
        self.plan.scenario(&self.start)
    }

    /// Bits of [`state_flags`](crate::wire::state_flags) that hold the fleet.
    pub fn hold(&self) -> u32 {
        self.plan.hold()
    }
}
