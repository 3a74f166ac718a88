//! The whole controller under a virtual clock and in-memory channels, with faults that a seed decides.
//!
//! What runs is the daemon's own code: the loop, the workers with their controllers, housekeeping, the
//! thread that answers operators, admission, the plant and its gates. They take turns in one thread, their
//! samples travel through queues, and time passes only when somebody lets it. Between writers and readers
//! stand the faults of [`Kind`], several at a time, drawn from the seed. After every period is checked:
//!
//! * (a) no command acts outside of its validity: every piece of every motion is held against what was
//!   published;
//! * (b) every command is finite, within the limits, and keeps its share of every gap, or is a stop: computed
//!   anew, apart from the controller; and over continuous time no two robots come closer than they may;
//! * (c) the counter that a fault is named after moves, the log tells of it, and no counter moves that no
//!   fault explains;
//! * (d) a robot is told to stop only while a fault acts or for as many periods after as its kind may take;
//! * (e) what the published states and memories give, computed again, is what went out, to the bit; and robots
//!   far from every fault do what they do without it;
//! * in the end faults cease, and everybody who can arrives.
//!
//! The same seed gives the same bits on every run ([`Outcome::digest`]). `docs/SIMULATION.md` has the table of
//! faults and what is not simulated.
//!
//! ```
//! use clearway::simulation::{Options, simulate};
//! let options = Options { periods: 40, ..Options::default() };
//! let outcome = simulate(1, &options)?;
//! assert!(outcome.failures.is_empty());
//! assert_eq!(simulate(1, &options)?.digest, outcome.digest);
//! # Ok::<(), clearway::simulation::SimulationError>(())
//! ```

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a chance lies in [0, 1)")]

mod active;
mod hands;
mod judge;
mod kind;
mod listener;
mod operator;
mod oracle;
mod plan;
mod random;
mod run;
mod sabotage;
mod shrink;
mod stage;
mod tally;
mod world;

pub use judge::{Failure, Shown};
pub use kind::{Kind, Promise, Scope};
pub use plan::{Class, Fault, Options};
pub use shrink::shrink;

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::sync::Arc;

use crate::channel::Transport;
use crate::clock::{Clock, VirtualTime};
use crate::controller::{RobotGroup, Robots, RouteShelf};
use crate::document::ConfigError;
use crate::runtime::{DaemonError, Outline, build};
use hands::{FaultySolver, Hand};
use listener::Listener;
use plan::Plan;
use run::{BEGIN, Run};
use stage::{Killed, OnStage, Stage};

/// Why a seed could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// There is no fleet of that size.
    #[error(transparent)]
    Scenario(#[from] ConfigError),
    /// The daemon could not be put together.
    #[error(transparent)]
    Daemon(#[from] DaemonError),
    /// The channels could not be made.
    #[error(transparent)]
    Channel(#[from] crate::channel::ChannelError),
}

/// What became of a seed.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Which.
    pub seed: u64,
    /// The class of its fleet.
    pub class: Class,
    /// Robots of the fleet.
    pub robots: usize,
    /// Workers.
    pub workers: usize,
    /// Its faults.
    pub faults: Vec<Fault>,
    /// How each of them showed.
    pub shown: Vec<Shown>,
    /// What did not hold; empty for a good seed.
    pub failures: Vec<Failure>,
    /// Periods of the loop.
    pub periods: u64,
    /// Of every command that went out.
    pub digest: u64,
    /// What happened, when the options ask for it.
    pub story: Vec<String>,
}

/// Simulates one seed.
///
/// # Errors
/// [`SimulationError`]: no such fleet. What does not hold is no error, but in the outcome.
pub fn simulate(seed: u64, options: &Options) -> Result<Outcome, SimulationError> {
    let plan = Plan::new(seed, options)?;
    let (mut outcome, apart) = run_one(seed, plan, options, |_| {})?;
    // The group that no fault concerns, in a world without any.
    if outcome.class == Class::TwoGroups && outcome.failures.is_empty() {
        let mut calm = Plan::new(seed, options)?;
        calm.faults.clear();
        let (twin, undisturbed) = run_one(seed, calm, options, |_| {})?;
        if let Some(at) = (0..apart.len().min(undisturbed.len())).find(|at| apart[*at] != undisturbed[*at]) {
            outcome.failures.push(Failure {
                period: at as u64,
                robot: None,
                invariant: 'e',
                values: "robots far from every fault do not do what they do without it".to_owned(),
            });
        }
        outcome.periods += twin.periods;
    }
    Ok(outcome)
}

/// Runs a plan; `set` may change the run before it starts. Also returns the digests of the robots that no
/// fault concerns, after each period.
fn run_one(
    seed: u64,
    plan: Plan,
    options: &Options,
    set: impl FnOnce(&mut Run),
) -> Result<(Outcome, Vec<u64>), SimulationError> {
    let listener = Listener::default();
    let mut run = Run::new(plan.clone(), options, listener.clone());
    set(&mut run);
    let now = VirtualTime::new(plan.start_ns);
    let stage = Rc::new(Stage { now, run: RefCell::new(run) });
    tracing::subscriber::with_default(listener, || lives(&stage, seed))?;

    let mut run = stage.run.borrow_mut();
    run.crew = None;
    // What is left acts no longer than it may.
    let until_ns = stage.now.now_ns() + 4 * plan.config.timing.period_ns;
    run.advance(&stage.now, until_ns);
    let judge = &mut run.judge;
    let outcome = Outcome {
        seed,
        class: plan.class,
        robots: plan.config.scenario.robots.len(),
        workers: plan.workers,
        shown: std::mem::take(&mut judge.shown),
        failures: judge.failures().to_vec(),
        digest: judge.digest.0,
        story: std::mem::take(&mut judge.story),
        faults: plan.faults,
        periods: run.periods,
    };
    let apart = std::mem::take(&mut run.judge.apart);
    Ok((outcome, apart))
}

/// One daemon after the other, until one ends by itself.
fn lives(stage: &Rc<Stage>, seed: u64) -> Result<(), SimulationError> {
    let mut epoch = 1000;
    loop {
        let now_ns = stage.now.now_ns();
        let control_loop = {
            let mut run = stage.run.borrow_mut();
            let mut config = run.plan.config.clone();
            for (robot, goal_m) in config.scenario.robots.iter_mut().zip(&run.goals_m) {
                robot.goal_m = *goal_m;
            }
            let period_ns = config.timing.period_ns;
            let transport = Transport::new(world::FLEET, &config.channel)?.in_memory(Arc::clone(&run.memory));
            let shelf = Arc::new(RouteShelf::new(config.places()));
            let robots = Arc::new(Robots::new(&config));
            let switches = run.switches.clone();
            let (routes, made) = (Arc::clone(&shelf), config.clone());
            let make = move |worker: usize| {
                let switch = Rc::clone(switches.get(worker)?);
                let group = RobotGroup::among(&made, Arc::clone(&robots)).ok()?;
                let solver = Box::new(FaultySolver(Rc::clone(&switch)));
                let group = group.with_routes(Arc::clone(&routes)).solved_by(solver);
                Some(Hand { group, switch })
            };
            // Another phase than the daemon before, and than the drivers.
            let start_ns = now_ns + 2 * period_ns + if epoch > 1000 { seed * 7_919 % period_ns } else { 0 };
            let workers = run.plan.workers;
            let outline = Outline { config, transport, workers, epoch, start_ns, shelf };
            let clock = OnStage(Rc::clone(stage));
            let (control_loop, crew) = build(outline, clock, &stage.now, make, |source| Box::new(source))?;
            run.operator.attach(crew.node.admin()?);
            run.crew = Some(crew);
            let period = run.world.period(now_ns);
            let begin = Fault {
                number: usize::MAX,
                kind: Kind::Begin,
                from: period,
                periods: BEGIN,
                target: 0,
                chance: 0.0,
            };
            run.begin(begin);
            let outside = run.world.outside.clone();
            run.judge.restart(&outside);
            control_loop
        };
        let Err(panic) = catch_unwind(AssertUnwindSafe(|| control_loop.run())) else {
            let mut run = stage.run.borrow_mut();
            run.look(stage.now.now_ns());
            return Ok(());
        };
        let mut run = stage.run.borrow_mut();
        let period = run.world.period(stage.now.now_ns());
        if !panic.is::<Killed>() {
            let text = panic.downcast_ref::<String>().map_or("a panic", String::as_str);
            run.judge.fail(period, None, 'd', format!("the loop panicked: {text}"));
            return Ok(());
        }
        let down = run.kill(period);
        let until_ns = stage.now.now_ns() + down * run.plan.config.timing.period_ns;
        run.advance(&stage.now, until_ns);
        epoch += 1;
    }
}

#[cfg(test)]
mod tests;
