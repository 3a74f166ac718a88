//! iceoryx2's own publish-subscribe benchmark, and the same over the project's channels.
//!
//! Two threads on two CPUs send a sample of 1 KiB back and forth over two services and poll; half the
//! mean time of a round trip is the latency. Blocks of both take turns, so that whatever the machine
//! does happens to both.

use std::sync::Barrier;

use clearway::channel::{CommandReader, Transport, Writer};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::ChannelConfig;
use clearway::wire::{RobotCommand, RobotState};
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use miette::{Result, miette};
use serde::Serialize;

use super::plan::{PATIENT_POLLS, Seats, enter_real_time};
use super::world::{Interrupt, World};

/// Bytes of a sample of the plain pattern, as in iceoryx2's published figures.
const PAYLOAD_BYTES: usize = 1024;
/// Blocks of each kind.
const BLOCKS: usize = 15;
const ROUND_TRIPS: u32 = 5000;
/// The first round trips of a block map memory and are not timed.
const WARM_UP: u32 = 500;
/// A block takes 10 ms; without a real-time priority, on a busy machine, much longer.
const BLOCK_NS_MAX: u64 = 30_000_000_000;
/// Robots whose states fill 1 KiB.
const STATES: usize = PAYLOAD_BYTES / size_of::<RobotState>();
/// Robots whose commands fill 1 KiB.
const COMMANDS: usize = PAYLOAD_BYTES / size_of::<RobotCommand>();

/// One-way means of interleaved blocks, ns.
#[derive(Debug, Serialize)]
pub(super) struct Comparison {
    pattern: &'static str,
    payload_bytes: usize,
    blocks: usize,
    round_trips_per_block: u32,
    /// Median over blocks: plain iceoryx2, nothing written into the sample.
    pub(super) iceoryx2_ns: f64,
    /// Median over blocks: this project's writer and reader, every record of the sample written.
    pub(super) clearway_ns: f64,
    /// The second over the first, median over pairs of blocks.
    pub(super) ratio: f64,
}

/// Measures both.
pub(super) fn compare(
    world: &World,
    seats: &Seats,
    priority: u8,
    interrupt: &Interrupt,
) -> Result<Comparison> {
    let other = seats.other.ok_or_else(|| miette!("a ping-pong needs two CPUs"))?;
    let cpus = [seats.own, other];
    let (mut plain, mut ours) = (Vec::new(), Vec::new());
    for _ in 0..BLOCKS {
        interrupt.check()?;
        plain.push(ping_pong(cpus, priority, |end| Plain::new(&world.channel, end))?);
        ours.push(ping_pong(cpus, priority, |end| Ours::new(&world.channel, end))?);
    }
    let median = |mut times: Vec<f64>| -> f64 {
        times.sort_unstable_by(f64::total_cmp);
        times[times.len() / 2]
    };
    // Of each pair of blocks: what the machine does between two pairs does not count.
    let ratio = median(ours.iter().zip(&plain).map(|(ours, plain)| ours / plain).collect());
    let (iceoryx2_ns, clearway_ns) = (median(plain), median(ours));
    Ok(Comparison {
        pattern: "two threads of one process on two CPUs, polling, a sample there and one back; half of the mean \
                  round trip of each block, median over blocks that take turns",
        payload_bytes: PAYLOAD_BYTES,
        blocks: BLOCKS,
        round_trips_per_block: ROUND_TRIPS,
        iceoryx2_ns,
        clearway_ns,
        ratio,
    })
}

/// Which thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    First,
    Second,
}

/// One thread's two ports.
trait Ports: Sized {
    fn send(&mut self) -> Result<()>;
    fn received(&mut self) -> Result<bool>;
}

/// Mean one-way time of a block, ns.
fn ping_pong<P: Ports>(
    cpus: [usize; 2],
    priority: u8,
    make: impl Fn(End) -> Result<P> + Sync,
) -> Result<f64> {
    let barrier = Barrier::new(2);
    // The ports of both ends are there before either begins; a failure must not keep the other waiting.
    let play = |end: End| {
        let ports = make(end);
        enter_real_time(priority, Some(cpus[end as usize]));
        barrier.wait();
        let mut ports = ports?;
        play_rounds(&mut ports, end, WARM_UP)?;
        let begun_ns = MonotonicClock.now_ns();
        play_rounds(&mut ports, end, ROUND_TRIPS)?;
        Ok::<_, miette::Report>(MonotonicClock.now_ns() - begun_ns)
    };
    let total_ns = std::thread::scope(|scope| {
        let second = scope.spawn(|| play(End::Second));
        let first = scope.spawn(|| play(End::First)).join();
        let second = second.join();
        let panicked = |_| miette!("a thread of the ping-pong panicked");
        second.map_err(panicked)??;
        first.map_err(panicked)?
    })?;
    Ok(total_ns as f64 / f64::from(2 * ROUND_TRIPS))
}

fn play_rounds(ports: &mut impl Ports, end: End, rounds: u32) -> Result<()> {
    // Nobody waits for ever for an end that failed.
    let late_ns = MonotonicClock.now_ns() + BLOCK_NS_MAX;
    for _ in 0..rounds {
        if end == End::First {
            ports.send()?;
        }
        let mut idle = 0_u32;
        while !ports.received()? {
            idle += 1;
            if idle.is_multiple_of(PATIENT_POLLS) {
                std::thread::yield_now();
                if MonotonicClock.now_ns() > late_ns {
                    return Err(miette!("the other end of the ping-pong does not answer"));
                }
            }
        }
        if end == End::Second {
            ports.send()?;
        }
    }
    Ok(())
}

/// iceoryx2 alone.
struct Plain {
    publisher: iceoryx2::port::publisher::Publisher<ipc::Service, [u8], ()>,
    subscriber: iceoryx2::port::subscriber::Subscriber<ipc::Service, [u8], ()>,
    _node: Node<ipc::Service>,
}

impl Plain {
    fn new(channel: &ChannelConfig, end: End) -> Result<Self> {
        let mut config = Config::default();
        let failed = |e: &dyn std::fmt::Debug| miette!("iceoryx2's ports cannot be made: {e:?}");
        config.global.prefix = FileName::new(channel.prefix.as_bytes()).map_err(|e| failed(&e))?;
        let root = channel.root.to_string_lossy().into_owned();
        config.global.set_root_path(&Path::new(root.as_bytes()).map_err(|e| failed(&e))?);
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| failed(&e))?;
        let service = |name: &str| -> Result<PortFactory<ipc::Service, [u8], ()>> {
            node.service_builder(&ServiceName::new(name).map_err(|e| failed(&e))?)
                .publish_subscribe::<[u8]>()
                .max_publishers(1)
                .max_subscribers(1)
                .history_size(0)
                .subscriber_max_buffer_size(1)
                .enable_safe_overflow(true)
                .open_or_create()
                .map_err(|e| failed(&e))
        };
        let (there, back) = (service("bench/there")?, service("bench/back")?);
        let (out, in_) = if end == End::First { (&there, &back) } else { (&back, &there) };
        Ok(Self {
            publisher: out
                .publisher_builder()
                .initial_max_slice_len(PAYLOAD_BYTES)
                .create()
                .map_err(|e| failed(&e))?,
            subscriber: in_.subscriber_builder().create().map_err(|e| failed(&e))?,
            _node: node,
        })
    }
}

impl Ports for Plain {
    fn send(&mut self) -> Result<()> {
        let sample =
            self.publisher.loan_slice_uninit(PAYLOAD_BYTES).map_err(|e| miette!("no loan: {e:?}"))?;
        // SAFETY: the payload is bytes in a shared mapping, which the kernel has filled; any byte is a
        // valid u8. The library's own benchmark sends what is there as well.
        let sample = unsafe { sample.assume_init() };
        sample.send().map_err(|e| miette!("not sent: {e:?}"))?;
        Ok(())
    }

    fn received(&mut self) -> Result<bool> {
        Ok(self.subscriber.receive().map_err(|e| miette!("not received: {e:?}"))?.is_some())
    }
}

/// The project's channels.
enum Ours {
    First {
        out: Writer<RobotState>,
        back: CommandReader,
        _node: clearway::channel::Attachment,
    },
    Second {
        out: Writer<RobotCommand>,
        back: clearway::channel::StateReader,
        _node: clearway::channel::Attachment,
    },
}

impl Ours {
    fn new(channel: &ChannelConfig, end: End) -> Result<Self> {
        let node = Transport::new("pattern", channel)?.attach("bench-pattern")?;
        Ok(match end {
            End::First => {
                Self::First { out: node.writer(STATES)?, back: node.reader_or_create(COMMANDS)?, _node: node }
            }
            End::Second => Self::Second {
                out: node.writer(COMMANDS)?,
                back: node.reader_or_create(STATES)?,
                _node: node,
            },
        })
    }
}

impl Ports for Ours {
    fn send(&mut self) -> Result<()> {
        match self {
            Self::First { out, .. } => {
                out.publish(|_, robots| robots.fill(RobotState { radius_m: 0.15, ..RobotState::default() }))?;
            }
            Self::Second { out, .. } => {
                out.publish(|_, robots| robots.fill(RobotCommand { v_mps: 1.0, ..RobotCommand::default() }))?;
            }
        }
        Ok(())
    }

    fn received(&mut self) -> Result<bool> {
        Ok(match self {
            Self::First { back, .. } => back.next()?.is_some(),
            Self::Second { back, .. } => back.next()?.is_some(),
        })
    }
}
