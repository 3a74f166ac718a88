//! Requests that may take long, worked off a part at a time.

use super::goals::Goals;
use super::plan::Plan;
use super::refusal::Refusal;
use crate::channel::Asked;
use crate::controller::{PreparedRoute, RouteWork};
use crate::model::Obstacle;
use crate::runtime::desk::Change;
use crate::scenario::{Scenario, ScenarioText};
use crate::wire::AdminKind;

/// What writing a robot down costs, in looks at an obstacle.
const WRITING_LOOKS: usize = 100;

/// Routes by place, as the desk takes them.
pub(super) type Routes = Vec<(usize, Option<Box<PreparedRoute>>)>;

/// A request in work, or waiting for it.
pub(super) enum Job {
    Order(Order),
    Text(Text),
}

impl Job {
    pub(super) fn asked(&self) -> &Asked {
        match self {
            Self::Order(order) => &order.asked,
            Self::Text(text) => &text.asked,
        }
    }

    pub(super) fn into_asked(self) -> Asked {
        match self {
            Self::Order(order) => order.asked,
            Self::Text(text) => text.asked,
        }
    }

    pub(super) fn is_order(&self) -> bool {
        matches!(self, Self::Order(_))
    }
}

/// A request that changes the fleet.
pub(super) struct Order {
    asked: Asked,
    kind: AdminKind,
    step: Step,
    /// Refusals of the loop that were known when it was begun.
    refusals_known: u64,
}

enum Step {
    Waiting,
    Goals(Goals),
    /// The routes to the new goals, one after the other.
    Routes {
        changes: Vec<Change>,
        next: usize,
        routes: Routes,
        route: Option<RouteWork>,
    },
}

impl Order {
    pub(super) fn new(asked: Asked, kind: AdminKind) -> Self {
        Self { asked, kind, step: Step::Waiting, refusals_known: 0 }
    }

    /// Whether the loop has refused something since this was begun: what it was checked against is not so.
    pub(super) fn is_outdated(&self, refusals_known: u64) -> bool {
        !matches!(self.step, Step::Waiting) && self.refusals_known != refusals_known
    }

    /// Goes on for about `looks` looks at an obstacle or a robot, and takes off what it needed; whether the
    /// loop can have it. `plan` changes its robots meanwhile only with `refusals_known`.
    ///
    /// # Errors
    /// Why it cannot be carried out.
    pub(super) fn advance(
        &mut self,
        (plan, refusals_known): (&Plan, u64),
        obstacles: &[Obstacle],
        margin_m: f64,
        looks: &mut usize,
    ) -> Result<bool, Refusal> {
        while *looks > 0 {
            match &mut self.step {
                Step::Waiting => {
                    self.refusals_known = refusals_known;
                    self.step = self.begin(plan)?;
                    *looks = looks.saturating_sub(1 + plan.capacity() / 8);
                }
                Step::Goals(goals) => {
                    if goals.advance(plan, looks)? {
                        let done = std::mem::replace(&mut self.step, Step::Waiting);
                        let Step::Goals(goals) = done else { continue };
                        self.step = Step::routes(goals.changes());
                    }
                }
                Step::Routes { changes, next, routes, route } => {
                    if let Some(mut work) = route.take() {
                        if !work.advance(looks) {
                            *route = Some(work);
                        } else if let Some((place, _)) = wanted(plan, &changes[*next]) {
                            routes.push((place, Some(Box::new(work.finish()))));
                            *next += 1;
                        }
                    } else if let Some(change) = changes.get(*next) {
                        *looks = looks.saturating_sub(1 + obstacles.len());
                        match wanted(plan, change) {
                            Some((_, (radius_m, goal_m))) => {
                                *route = Some(RouteWork::new(obstacles, margin_m + radius_m, goal_m));
                            }
                            None => *next += 1,
                        }
                    } else {
                        return Ok(true);
                    }
                }
            }
        }
        Ok(false)
    }

    fn begin(&self, plan: &Plan) -> Result<Step, Refusal> {
        let records = self.asked.robots();
        match self.kind {
            AdminKind::SetGoals => Ok(Step::Goals(Goals::new(plan, records))),
            kind => plan.changes(kind, &records).map(Step::routes),
        }
    }

    /// What was asked, what it comes to, and what was known when it was begun.
    pub(super) fn finish(self) -> (Asked, Vec<Change>, Routes, u64) {
        match self.step {
            Step::Routes { changes, routes, .. } => (self.asked, changes, routes, self.refusals_known),
            Step::Waiting | Step::Goals(_) => (self.asked, Vec::new(), Vec::new(), self.refusals_known),
        }
    }
}

impl Step {
    fn routes(changes: Vec<Change>) -> Self {
        Self::Routes { changes, next: 0, routes: Vec::new(), route: None }
    }
}

/// Whose route a change needs: the place, and the robot's radius and goal.
fn wanted(plan: &Plan, change: &Change) -> Option<(usize, (f64, crate::geometry::Vec2))> {
    match *change {
        Change::Goal { place, goal_m } => Some((place, (plan.robot(place)?.radius_m, goal_m))),
        Change::Add { place, robot, .. } => Some((place, (robot.radius_m, robot.goal_m))),
        Change::Hold { .. } | Change::Remove { .. } => None,
    }
}

/// A question for the scenario as it is.
pub(super) struct Text {
    asked: Asked,
    /// The fleet when it was begun, and what is written of it.
    work: Option<(Scenario, ScenarioText)>,
    /// Which fleet that is.
    pub(super) version: u64,
}

impl Text {
    pub(super) fn new(asked: Asked) -> Self {
        Self { asked, work: None, version: 0 }
    }

    pub(super) fn is_begun(&self) -> bool {
        self.work.is_some()
    }

    /// Begins to write `fleet` down.
    pub(super) fn begin(&mut self, fleet: Scenario, version: u64) {
        self.work = Some((fleet, ScenarioText::default()));
        self.version = version;
    }

    /// Goes on for about `looks` looks at an obstacle and takes off what it needed; whether all is written.
    pub(super) fn advance(&mut self, looks: &mut usize) -> bool {
        let Some((fleet, text)) = &mut self.work else { return false };
        let parts = *looks / WRITING_LOOKS + 1;
        let whole = text.advance(fleet, parts);
        *looks =
            looks.saturating_sub(if whole { fleet.robots.len().min(parts) } else { parts } * WRITING_LOOKS);
        whole
    }

    /// Who asked, and the text.
    pub(super) fn finish(self) -> (Asked, String) {
        (self.asked, self.work.map(|(_, text)| text.finish()).unwrap_or_default())
    }
}
