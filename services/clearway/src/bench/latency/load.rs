//! What the machine is kept busy with meanwhile.

use std::time::Duration;

use clap::ValueEnum;
use clearway::channel::{CommandReader, StateReader};
use miette::Result;
use serde::{Deserialize, Serialize};

use super::child::{Child, Findings, Role, Task, say_ready};
use super::plan::Seats;
use super::world::{Interrupt, World};
use super::{CONTROL_FLEET, TRANSFER_FLEET};

/// Bytes of each of the two buffers of the memory load: more than the outer cache of most processors.
const BUFFER_BYTES: usize = 64 << 20;
/// Between two visits of the churn.
const VISIT_EVERY: Duration = Duration::from_millis(5);

/// What a run is measured under.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Load {
    /// Nothing of ours.
    Idle,
    /// A program that computes without end on the other CPU.
    Cpu,
    /// A program that copies 64 MiB back and forth on the other CPU.
    Memory,
    /// A program that joins the channels and leaves them again, 150 times a second or so.
    Churn,
}

impl Load {
    pub(super) const ALL: [Self; 4] = [Self::Idle, Self::Cpu, Self::Memory, Self::Churn];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Cpu => "cpu",
            Self::Memory => "memory",
            Self::Churn => "churn",
        }
    }

    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Idle => "nothing but the benchmark's own processes",
            Self::Cpu => "an ordinary process that computes without a pause, pinned to the other CPU",
            Self::Memory => "an ordinary process that copies 64 MiB back and forth, pinned to the other CPU",
            Self::Churn => {
                "an ordinary process, pinned to the other CPU, that every 5 ms joins the channels as a reader, \
                 reads what is there and leaves"
            }
        }
    }

    /// Starts it, if there is anything to start.
    pub(super) fn start(self, world: &World, seats: &Seats, limit: Duration) -> Result<Option<Child>> {
        let disturbance = match self {
            Self::Idle => return Ok(None),
            Self::Cpu => Disturbance::Cpu,
            Self::Memory => Disturbance::Memory,
            Self::Churn => Disturbance::Churn,
        };
        let task = Task::new(world, Role::Load(disturbance), seats.other, 0, limit);
        Child::start(&task).map(|(child, _)| Some(child))
    }
}

/// What a disturbing process does.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum Disturbance {
    Cpu,
    Memory,
    Churn,
}

/// What the disturbing process runs.
pub(super) fn disturb(task: &Task, disturbance: Disturbance, over: &Interrupt) -> Result<Findings> {
    let refused = super::plan::enter_ordinary(task.cpu);
    let mut findings = Findings::default();
    let rounds = match disturbance {
        Disturbance::Cpu => {
            say_ready(refused)?;
            compute(over)
        }
        Disturbance::Memory => {
            let (mut a, mut b) = (vec![1_u8; BUFFER_BYTES], vec![2_u8; BUFFER_BYTES]);
            say_ready(refused)?;
            let mut rounds = 0;
            while !over.is_set() {
                a.copy_from_slice(std::hint::black_box(&b));
                b.copy_from_slice(std::hint::black_box(&a));
                rounds += 2;
            }
            rounds
        }
        Disturbance::Churn => {
            say_ready(refused)?;
            let mut visits = 0;
            while !over.is_set() {
                for fleet in [TRANSFER_FLEET, CONTROL_FLEET] {
                    // There is a daemon at some times and none at others, and both are as well.
                    visits += u64::from(visit(task, fleet).is_ok());
                }
                std::thread::sleep(VISIT_EVERY);
            }
            visits
        }
    };
    findings.counts.push(("rounds".to_owned(), rounds));
    Ok(findings)
}

fn compute(over: &Interrupt) -> u64 {
    let (mut x, mut rounds) = (1.000_000_1_f64, 0);
    while !over.is_set() {
        for _ in 0..10_000 {
            x = std::hint::black_box(x * 1.000_000_1).sqrt();
        }
        rounds += 1;
    }
    rounds
}

fn visit(task: &Task, fleet: &str) -> Result<()> {
    let node = task.transport(fleet)?.attach("visitor")?;
    let mut states: StateReader = node.reader()?;
    let mut commands: CommandReader = node.reader()?;
    states.newest()?;
    commands.newest()?;
    Ok(())
}
