//! One-way transfers over the daemon's channels, polled: a state there, a command back.

use std::time::Duration;

use clearway::channel::{Attachment, Reader, Record, Transport, Writer};
use clearway::clock::{Clock, MonotonicClock};
use clearway::figures::LatencyHistogram;
use clearway::realtime::ThreadGrant;
use clearway::wire::{RobotCommand, RobotState};
use clearway_signals::Stop;
use miette::{IntoDiagnostic, Result, miette};

use super::child::{Child, Findings, Role, Task, say_ready};
use super::plan::{PATIENT_POLLS, Seats, enter_real_time};
use super::world::{Interrupt, World};
use super::{ROBOTS, TRANSFER_FLEET};

/// The first transfers map each other's memory and are not counted.
const WARM_UP: u64 = 100;
/// A transfer that takes longer is lost, ns.
const LOST_NS: u64 = 100_000_000;

/// One-way times in both directions.
#[derive(Debug)]
pub(super) struct Transfers {
    /// A state of 8 robots.
    pub(super) state: LatencyHistogram,
    /// Commands for 8 robots.
    pub(super) command: LatencyHistogram,
    pub(super) lost: u64,
    pub(super) refused: Vec<String>,
}

/// Sends `samples` states to another process, which answers each with commands.
pub(super) fn to_process(
    world: &World,
    seats: &Seats,
    priority: u8,
    samples: u64,
    interrupt: &Interrupt,
) -> Result<Transfers> {
    let task = Task::new(world, Role::Echo, seats.other, below(priority), Duration::from_secs(60));
    let transport = task.transport(TRANSFER_FLEET)?;
    let (child, ready) = Child::start(&task)?;
    let (command, lost, mut grant) = in_thread(transport, priority, seats.own, samples, interrupt)?;
    grant.refused.extend(ready.refused);
    let findings = child.finish()?;
    Ok(Transfers { state: findings.histogram("state")?, command, lost, refused: grant.refused })
}

/// The same within this process: the other end is a thread.
pub(super) fn to_thread(
    world: &World,
    seats: &Seats,
    priority: u8,
    samples: u64,
    interrupt: &Interrupt,
) -> Result<Transfers> {
    let over = Stop::default();
    let task = Task::new(world, Role::Echo, seats.other, below(priority), Duration::ZERO);
    let transport = task.transport(TRANSFER_FLEET)?;
    let near = transport.clone();
    let (ready, readiness) = std::sync::mpsc::sync_channel(1);
    let (other, flag) = (seats.other, Interrupt::by(over.clone()));
    let echo = std::thread::spawn(move || {
        let ends = Far::attach(&transport, "bench-echo");
        let refused = enter_real_time(below(priority), other).refused;
        let _ = ready.send(());
        Ok::<_, miette::Report>((echo(ends?, &flag)?, refused))
    });
    readiness.recv().into_diagnostic()?;
    let result = in_thread(near, priority, seats.own, samples, interrupt);
    over.ask();
    let (state, refused) = echo.join().map_err(|_| miette!("the answering thread panicked"))??;
    let (command, lost, mut grant) = result?;
    grant.refused.extend(refused);
    Ok(Transfers { state, command, lost, refused: grant.refused })
}

fn below(priority: u8) -> u8 {
    priority.saturating_sub(1).max(1)
}

/// A writer in one direction and a reader in the other.
struct Ends<W: Record, R: Record> {
    // Ports go before the node they belong to.
    writer: Writer<W>,
    reader: Reader<R>,
    _node: Attachment,
}

type Near = Ends<RobotState, RobotCommand>;
type Far = Ends<RobotCommand, RobotState>;

impl<W: Record, R: Record> Ends<W, R> {
    fn attach(transport: &Transport, name: &str) -> Result<Self> {
        let node = transport.attach(name)?;
        Ok(Self { writer: node.writer(ROBOTS)?, reader: node.reader_or_create(ROBOTS)?, _node: node })
    }
}

/// The sending end; returns the times of the answers.
fn in_thread(
    transport: Transport,
    priority: u8,
    cpu: usize,
    samples: u64,
    interrupt: &Interrupt,
) -> Result<(LatencyHistogram, u64, ThreadGrant)> {
    let interrupt = interrupt.clone();
    let thread = std::thread::spawn(move || {
        let ends = Near::attach(&transport, "bench")?;
        let mut times = LatencyHistogram::new().into_diagnostic()?;
        let grant = enter_real_time(priority, Some(cpu));
        let lost = send_and_wait(ends, &mut times, samples, &interrupt)?;
        Ok((times, lost, grant))
    });
    thread.join().map_err(|_| miette!("the sending thread panicked"))?
}

fn send_and_wait(
    mut ends: Near,
    times: &mut LatencyHistogram,
    samples: u64,
    interrupt: &Interrupt,
) -> Result<u64> {
    let clock = MonotonicClock;
    let mut lost = 0;
    ends.writer.connect()?;
    for tick in 0..samples + WARM_UP {
        // As the daemon does: the loan is taken before it is needed.
        ends.writer.prepare()?;
        let sent_ns = clock.now_ns();
        ends.writer.publish(|header, robots| {
            header.tick = tick;
            header.stamp_ns = sent_ns;
            fill(robots);
        })?;
        let mut idle = 0_u32;
        loop {
            if let Some(sample) = ends.reader.next()? {
                let now_ns = clock.now_ns();
                // An answer to one that was given up is none to this one.
                if sample.header().tick == tick {
                    if tick >= WARM_UP {
                        times.record(now_ns.saturating_sub(sample.header().stamp_ns));
                    }
                    break;
                }
            } else if clock.now_ns() - sent_ns > LOST_NS {
                lost += 1;
                break;
            }
            idle += 1;
            rest(idle);
        }
        if interrupt.is_set() || lost > 10 {
            break;
        }
    }
    Ok(lost)
}

/// All of a state's records are written, as the daemon does.
fn fill(robots: &mut [RobotState]) {
    for (id, robot) in (0..).zip(robots) {
        *robot =
            RobotState { id, x_m: f64::from(id), goal_y_m: 1.0, radius_m: 0.15, ..RobotState::default() };
    }
}

/// Between two polls.
fn rest(idle: u32) {
    if idle.is_multiple_of(PATIENT_POLLS) {
        std::thread::yield_now();
    } else {
        std::hint::spin_loop();
    }
}

/// The answering end; returns the times of what it received.
fn echo(mut ends: Far, over: &Interrupt) -> Result<LatencyHistogram> {
    let clock = MonotonicClock;
    let mut times = LatencyHistogram::new().into_diagnostic()?;
    ends.writer.connect()?;
    ends.writer.prepare()?;
    let mut idle = 0_u32;
    while !over.is_set() {
        let Some(sample) = ends.reader.next()? else {
            idle = idle.wrapping_add(1);
            rest(idle);
            continue;
        };
        let now_ns = clock.now_ns();
        let header = *sample.header();
        if header.tick >= WARM_UP {
            times.record(now_ns.saturating_sub(header.stamp_ns));
        }
        ends.writer.publish(|answer, robots| {
            answer.tick = header.tick;
            answer.stamp_ns = clock.now_ns();
            for (command, state) in robots.iter_mut().zip(sample.robots()) {
                *command = RobotCommand { id: state.id, v_mps: state.x_m, ..RobotCommand::default() };
            }
        })?;
        ends.writer.prepare()?;
    }
    Ok(times)
}

/// What the answering process runs.
pub(super) fn echo_process(task: &Task, over: &Interrupt) -> Result<Findings> {
    let ends = Far::attach(&task.transport(TRANSFER_FLEET)?, "bench-echo")?;
    say_ready(enter_real_time(task.priority, task.cpu).refused)?;
    let mut findings = Findings::default();
    findings.add("state", &echo(ends, over)?);
    Ok(findings)
}

impl Transfers {
    /// Nothing was measured.
    pub(super) fn none() -> Result<Self> {
        let empty = LatencyHistogram::new().into_diagnostic()?;
        Ok(Self { state: empty.clone(), command: empty, lost: 0, refused: Vec::new() })
    }
}
