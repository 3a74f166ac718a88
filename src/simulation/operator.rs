//! The operator: asks for what a fault says, and looks at what is answered.

use super::active::Active;
use super::kind::Kind;
use super::plan::Plan;
use crate::channel::{AdminPort, Waiting};
use crate::geometry::Vec2;
use crate::wire::{AdminCode, AdminKind, AdminRequest, AdminRobot};

/// What is expected of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    Done,
    /// Refused with this code.
    Code(AdminCode),
}

struct Request {
    waiting: Waiting,
    kind: AdminKind,
    expected: Expected,
    /// Index of the robot and its new goal, in force once it is done.
    goal: Option<(usize, Vec2)>,
    asked: u64,
}

/// One operator.
pub(crate) struct Operator {
    port: Option<AdminPort>,
    requests: Vec<Request>,
    tickets: u64,
    /// The robot that was added stands in the fleet.
    pub(crate) added: bool,
}

/// Periods after which an answer is not waited for any more: the daemon was killed.
const PATIENCE: u64 = 40;

impl Operator {
    pub(crate) fn new() -> Self {
        Self { port: None, requests: Vec::new(), tickets: 0, added: false }
    }

    /// Speaks to another run of the daemon.
    pub(crate) fn attach(&mut self, port: AdminPort) {
        self.port = Some(port);
        self.requests.clear();
        self.added = false;
    }

    fn ask(
        &mut self,
        (now_ns, period): (u64, u64),
        kind: AdminKind,
        robots: &[AdminRobot],
        expected: Expected,
        goal: Option<(usize, Vec2)>,
    ) {
        self.tickets += 1;
        let header = AdminRequest {
            ticket: self.tickets,
            expires_ns: now_ns + 10_000_000_000,
            kind: kind as u32,
            ..AdminRequest::default()
        };
        let Some(port) = &self.port else { return };
        if let Ok(waiting) = port.ask(&header, robots) {
            self.requests.push(Request { waiting, kind, expected, goal, asked: period });
        }
    }

    /// Asks for what is due in `period`.
    pub(crate) fn act(&mut self, at: (u64, u64), plan: &Plan, goals_m: &[Vec2], active: &mut [Active]) {
        let (done, refused) = (Expected::Done, Expected::Code);
        let period = at.1;
        for one in active.iter_mut() {
            let (fault, kind) = (one.fault, one.kind());
            // One step after the other, each when the one before has had its period.
            let step = one.applied;
            if period < fault.from || one.stepped.is_some_and(|last| period < last + 2) {
                continue;
            }
            let last = period >= fault.last();
            let robot = |index: usize, goal_m: Vec2| AdminRobot {
                id: plan.config.scenario.robots.get(index).map_or(0, |robot| robot.id.0),
                goal_x_m: goal_m.x,
                goal_y_m: goal_m.y,
                ..AdminRobot::default()
            };
            let spare = |which: usize| AdminRobot {
                id: plan.spares[which].id.0,
                reserved: 0,
                goal_x_m: plan.spares[which].goal_m.x,
                goal_y_m: plan.spares[which].goal_m.y,
                start_x_m: plan.spares[which].start.position_m.x,
                start_y_m: plan.spares[which].start.position_m.y,
                start_theta_rad: plan.spares[which].start.theta_rad,
                radius_m: plan.spares[which].radius_m,
            };
            match kind {
                Kind::OpGoal if step == 0 => {
                    let index = fault.target;
                    let Some(goal_m) = free_goal(index, goals_m, fault.chance) else { continue };
                    self.ask(at, AdminKind::SetGoals, &[robot(index, goal_m)], done, Some((index, goal_m)));
                }
                Kind::OpBadGoal if step == 0 => {
                    let index = fault.target;
                    let other = (index + 1) % goals_m.len().max(1);
                    let nobody = AdminRobot { id: 9_999_999, ..robot(index, Vec2::zeros()) };
                    let (request, code) = match (fault.chance * 4.0) as usize {
                        0 => (robot(index, Vec2::new(f64::NAN, 0.0)), AdminCode::NotFinite),
                        1 => (robot(index, Vec2::new(0.0, 1e7)), AdminCode::OutsideArena),
                        2 => (nobody, AdminCode::UnknownRobot),
                        _ if plan.config.scenario.robots[other].foreign_speed_mps.is_some() => {
                            (robot(other, Vec2::zeros()), AdminCode::ForeignRobot)
                        }
                        _ => (robot(index, goals_m[other]), AdminCode::GoalTaken),
                    };
                    self.ask(at, AdminKind::SetGoals, &[request], refused(code), None);
                }
                Kind::OpPause if step == 0 => self.ask(at, AdminKind::Pause, &[], done, None),
                Kind::OpPause if step == 1 && last => self.ask(at, AdminKind::Resume, &[], done, None),
                Kind::OpStop if step == 0 => self.ask(at, AdminKind::Stop, &[], done, None),
                Kind::OpStop if step == 1 => {
                    self.ask(at, AdminKind::Resume, &[], refused(AdminCode::Stopped), None);
                }
                Kind::OpStop if step == 2 && last => self.ask(at, AdminKind::Clear, &[], done, None),
                Kind::OpStop if step == 3 => self.ask(at, AdminKind::Resume, &[], done, None),
                Kind::OpAdd if step == 0 => self.ask(at, AdminKind::AddRobot, &[spare(0)], done, None),
                Kind::OpAdd if step == 1 => {
                    self.ask(at, AdminKind::AddRobot, &[spare(1)], refused(AdminCode::Full), None);
                }
                Kind::OpAdd if step == 2 && last => {
                    // Nobody speaks for it any more.
                    self.added = false;
                    self.ask(at, AdminKind::RemoveRobot, &[spare(0)], done, None);
                }
                _ => continue,
            }
            one.applied += 1;
            one.stepped = Some(period);
            one.outlast(period + 2);
        }
    }

    /// Takes the answers; `tell` hears which were not as expected, `goal` which goals are in force.
    /// Returns how many were refused.
    pub(crate) fn hear(
        &mut self,
        period: u64,
        mut tell: impl FnMut(String),
        mut goal: impl FnMut(usize, Vec2),
    ) -> u64 {
        let (mut refused, mut added) = (0, self.added);
        self.requests.retain(|request| {
            let Ok(Some((answer, text))) = request.waiting.answer() else {
                let waits = period < request.asked + PATIENCE;
                if !waits {
                    tell(format!("{} of period {} was never answered", request.kind.name(), request.asked));
                }
                return waits;
            };
            refused += u64::from(answer.code != AdminCode::Done as u32);
            let expected = match request.expected {
                Expected::Done => AdminCode::Done,
                Expected::Code(code) => code,
            };
            if answer.code != expected as u32 {
                let code = AdminCode::from_code(answer.code).map_or("unknown", AdminCode::name);
                let text = String::from_utf8_lossy(&text);
                tell(format!(
                    "{} was answered {code} ({text}), not {}",
                    request.kind.name(),
                    expected.name()
                ));
            } else if expected != AdminCode::Done && text.is_empty() {
                tell(format!("{} was refused without a reason", request.kind.name()));
            }
            if answer.code == AdminCode::Done as u32 {
                added |= request.kind == AdminKind::AddRobot;
                if let Some((index, goal_m)) = request.goal {
                    goal(index, goal_m);
                }
            }
            false
        });
        self.added = added;
        refused
    }
}

/// A goal where nobody else has one.
fn free_goal(index: usize, goals_m: &[Vec2], chance: f64) -> Option<Vec2> {
    (0..16).map(f64::from).find_map(|step| {
        let way = crate::geometry::unit(std::f64::consts::TAU * (chance + step / 16.0));
        let goal_m = way * (4.0 + 6.0 * chance);
        let free = goals_m.iter().enumerate().all(|(other, at)| other == index || (at - goal_m).norm() > 1.0);
        free.then_some(goal_m)
    })
}
