//! One seed: the daemon's turns, the world's, and what is looked at after each period.

mod looking;
mod working;

use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use super::active::Active;
use super::hands::{Hand, Switch, Wrong};
use super::judge::Judge;
use super::kind::{Kind, Scope};
use super::listener::Listener;
use super::operator::Operator;
use super::plan::{Fault, Options, Plan};
use super::random::Random;
use super::world::World;
use crate::channel::memory::{Memory, Message, Queue};
use crate::clock::{Clock, VirtualTime};
use crate::geometry::Vec2;
use crate::runtime::Crew;
use crate::wire::{RobotCheckpoint, RobotCommand, RobotState};

/// Periods of a daemon before it is expected to drive.
pub(crate) const BEGIN: u64 = 8;

/// Readers that get everything that is published, and that no fault concerns.
pub(crate) struct Monitors {
    pub(crate) states: Arc<Queue<RobotState>>,
    pub(crate) commands: Arc<Queue<RobotCommand>>,
    pub(crate) checkpoints: Arc<Queue<RobotCheckpoint>>,
}

/// A running seed.
pub(crate) struct Run {
    pub(crate) plan: Plan,
    pub(crate) memory: Arc<Memory>,
    pub(crate) world: World,
    pub(crate) crew: Option<Crew<VirtualTime, Hand>>,
    pub(crate) switches: Vec<Rc<Switch>>,
    pub(crate) operator: Operator,
    pub(crate) judge: Judge,
    monitors: Monitors,
    listener: Listener,
    pending: VecDeque<Fault>,
    pub(crate) active: Vec<Active>,
    /// Where the robots of the scenario are to go now.
    pub(crate) goals_m: Vec<Vec2>,
    faults_until: u64,
    order: Random,
    /// The tick that workers have turns for, and those that still wait for theirs.
    turns: (Option<u64>, Vec<usize>),
    /// Workers that answer later, and when.
    late: Vec<(u64, usize)>,
    /// The state that was published before the last one.
    older: Option<Message<RobotState>>,
    newest: Option<Message<RobotState>>,
    pub(crate) ending: bool,
    #[cfg(test)]
    pub(crate) expected_off_m: f64,
    pub(crate) periods: u64,
}

impl Run {
    pub(crate) fn new(plan: Plan, options: &Options, listener: Listener) -> Self {
        let memory = Arc::new(Memory::default());
        let monitors = Monitors {
            states: memory.state.subscribe(),
            commands: memory.command.subscribe(),
            checkpoints: memory.checkpoint.subscribe(),
        };
        let mut order = plan.random.clone();
        Self {
            world: World::new(&plan, &memory),
            judge: Judge::new(&plan, options),
            crew: None,
            switches: (0..plan.workers).map(|_| Rc::default()).collect(),
            operator: Operator::new(),
            monitors,
            listener,
            pending: plan.faults.iter().copied().collect(),
            active: Vec::new(),
            goals_m: plan.config.scenario.robots.iter().map(|robot| robot.goal_m).collect(),
            faults_until: options.periods,
            order: order.branch(),
            turns: (None, Vec::new()),
            late: Vec::new(),
            older: None,
            newest: None,
            ending: false,
            #[cfg(test)]
            expected_off_m: 0.0,
            periods: 0,
            memory,
            plan,
        }
    }

    fn period_ns(&self) -> u64 {
        self.plan.config.timing.period_ns
    }

    /// A fault, or the beginning of a daemon, is in force from now on.
    pub(crate) fn begin(&mut self, fault: Fault) {
        let robots = match fault.kind.promise().scope {
            Scope::Robot => Some(vec![fault.target]),
            Scope::Driver => self.world.drivers.get(fault.target).map(|driver| driver.robots.clone()),
            Scope::Worker | Scope::Fleet => None,
        };
        self.judge.note(|| format!("period {}: {fault} begins", fault.from));
        let mut new = Active::new(fault, robots);
        for other in &mut self.active {
            if other.meets(&new) {
                (other.shadowed, new.shadowed) = (true, true);
                let until = other.until;
                other.outlast(new.until);
                if new.kind() != Kind::Begin && other.kind() != Kind::Begin {
                    new.outlast(until);
                }
            }
        }
        self.active.push(new);
    }

    fn begin_due(&mut self, period: u64) {
        while self.pending.front().is_some_and(|fault| fault.from <= period) {
            let Some(fault) = self.pending.pop_front() else { return };
            self.begin(fault);
        }
    }

    /// A fault of `kind` that acts in `period` and has not been done yet.
    fn due(&mut self, kind: Kind, period: u64) -> Option<&mut Active> {
        let due = |one: &&mut Active| one.kind() == kind && one.applied == 0 && one.acts_at(period);
        self.active.iter_mut().find(due)
    }

    /// The loop sleeps until `wake_ns`; whether the daemon is killed meanwhile.
    pub(crate) fn asleep(&mut self, now: &VirtualTime, wake_ns: u64) -> bool {
        self.periods += 1;
        self.look(now.now_ns());
        self.world.receive(now.now_ns(), &mut self.active);
        self.operate(now.now_ns());
        let next = self.world.period(wake_ns);
        self.begin_due(next);
        let (mut wake_ns, period_ns) = (wake_ns, self.period_ns());
        let world = &self.world;
        if let Some(one) = self
            .active
            .iter_mut()
            .find(|one| one.kind() == Kind::Overrun && one.applied == 0 && one.acts_at(next))
        {
            one.applied = 1;
            let tenths = [15, 32, 200][(one.fault.chance * 3.0) as usize % 3];
            wake_ns += period_ns / 10 * tenths;
            one.last = world.period(wake_ns);
            one.until = one.last + 2;
            let (number, until) = (one.fault.number, one.until);
            for other in self.active.iter_mut().filter(|other| other.fault.number != number) {
                other.shadowed = true;
                other.outlast(until);
            }
        }
        if self.due(Kind::Kill, next).is_some_and(|one| one.fault.chance < 0.5) {
            return true;
        }
        self.prepare(next);
        self.advance(now, wake_ns);
        false
    }

    /// Faults of the period that begins.
    fn prepare(&mut self, period: u64) {
        let mut exhausted = false;
        self.switches.iter().for_each(|switch| switch.wrong.set(Wrong::Nothing));
        for one in &mut self.active {
            if !one.acts_at(period) {
                continue;
            }
            let (kind, target) = (one.kind(), one.fault.target);
            let wrong = match kind {
                Kind::Exhausted => {
                    (exhausted, one.applied) = (true, one.applied + 1);
                    continue;
                }
                Kind::Kidnapped => {
                    one.applied += u64::from(self.world.carry_away(target, one.fault.chance));
                    continue;
                }
                Kind::WorkerPanic => Wrong::Panic((one.fault.chance * 3.0) as usize),
                Kind::WorkerRests => Wrong::Panic(0),
                Kind::SolverNan => Wrong::Nan,
                Kind::SolverBeyond => Wrong::Beyond,
                Kind::SolverAlmost => Wrong::Almost,
                Kind::SolverGivesUp => Wrong::GivesUp,
                Kind::AnswerWild => Wrong::Wild,
                _ => continue,
            };
            if let Some(switch) = self.switches.get(target) {
                switch.wrong.set(wrong);
            }
        }
        self.memory.command.exhaust(exhausted);
        self.judge.sabotage.spoil(&self.switches, period);
    }

    /// Lets time pass outside, until `until_ns`.
    pub(crate) fn advance(&mut self, now: &VirtualTime, until_ns: u64) {
        loop {
            let mut at_ns = self.world.next_ns().min(until_ns);
            if let Some(due_ns) = self.late.iter().map(|(due_ns, _)| *due_ns).min() {
                at_ns = at_ns.min(due_ns);
            }
            now.sleep_until(at_ns);
            let at_ns = now.now_ns();
            self.begin_due(self.world.period(at_ns));
            if let Some(place) = self.late.iter().position(|(due_ns, _)| *due_ns <= at_ns) {
                let (_, worker) = self.late.swap_remove(place);
                if let Some(crew) = &mut self.crew {
                    crew.work(worker);
                }
            }
            self.world.advance(at_ns);
            self.world.receive(at_ns, &mut self.active);
            let (fleet, added) = (self.goals_m.len(), self.operator.added);
            self.world.observe(at_ns, &mut self.active, |index| index < fleet || index == fleet && added);
            if at_ns >= until_ns {
                break;
            }
        }
        self.judge_motion(now.now_ns());
    }

    fn judge_motion(&mut self, now_ns: u64) {
        let period = self.world.period(now_ns);
        let (fleet, added) = (self.goals_m.len(), self.operator.added);
        let (judge, active) = (&mut self.judge, &self.active);
        self.world.judge(
            |index| index < fleet || index == fleet && added,
            |index| {
                let lies = |one: &Active| !one.fault.keeps_clear() && one.touches(index);
                active.iter().any(|one| lies(one) && one.acts_within(period))
            },
            |index| {
                let misleads = |one: &Active| one.kind().promise().misleads && one.touches(index);
                active.iter().any(|one| misleads(one) && one.acts_within(period))
            },
            |broken| judge.fail(period, Some(broken.robot), broken.invariant, broken.values),
        );
    }

    fn operate(&mut self, now_ns: u64) {
        let period = self.world.period(now_ns);
        self.operator.act((now_ns, period), &self.plan, &self.goals_m, &mut self.active);
        if let Some(crew) = &mut self.crew {
            crew.answer();
        }
        let (judge, goals_m) = (&mut self.judge, &mut self.goals_m);
        let mut wrong = Vec::new();
        let refused = self.operator.hear(
            period,
            |text| wrong.push(text),
            |index, goal_m| {
                if let Some(goal) = goals_m.get_mut(index) {
                    *goal = goal_m;
                }
            },
        );
        self.world.outside.refused += refused;
        for text in wrong {
            judge.fail(period, None, 'c', text);
        }
    }
}
