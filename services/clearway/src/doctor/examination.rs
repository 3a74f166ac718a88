//! What the findings are made from.

use clearway::channel::{Census, Transport};
use clearway::config::{AdminConfig, ChannelConfig, Config, RealTimeConfig, RealTimePolicy, Wakeup};
use clearway::realtime::{Role, Seat, enter};

use crate::host::Host;

/// Robots that room is looked for when there is no configuration.
const ROBOTS: usize = 100;

/// Everything that the findings are made from, so that a test can make it up.
pub(super) struct Examination {
    /// Files below the root.
    pub(super) host: Host,
    /// Answers of the running kernel; `None` when another root is examined.
    pub(super) live: Option<Live>,
    /// Priority that the loop is to have.
    pub(super) priority: u8,
    /// Robots that there has to be room for.
    pub(super) robots: usize,
    /// Where the channels are.
    pub(super) channel: ChannelConfig,
    /// Bytes of shared memory that the daemon's channels can fill; `None` when the location is unusable.
    pub(super) needed_bytes: Option<u64>,
    /// The configuration that is to be held against the host.
    pub(super) config: Option<Config>,
}

/// What only the running kernel can say.
pub(super) struct Live {
    /// Whether a thread got `SCHED_FIFO`.
    pub(super) fifo: Result<(), String>,
    /// Bytes in `/dev/shm`: free, all.
    pub(super) shared_memory: Option<(u64, u64)>,
    /// Whether CPUs may be kept out of idle states.
    pub(super) may_stay_awake: bool,
    /// Step of the timers, ns.
    pub(super) timer_step_ns: u64,
    /// Who is attached; or why that could not be found out.
    pub(super) census: Result<Census, String>,
}

impl Examination {
    /// Of the host, for `config` or for a fleet of medium size.
    pub(super) fn new(host: Host, config: Option<Config>, is_live: bool) -> Self {
        let realtime = config.as_ref().map_or_else(RealTimeConfig::default, |c| c.realtime.clone());
        let channel = config.as_ref().map_or_else(ChannelConfig::default, |c| c.channel.clone());
        let robots = config.as_ref().map_or(ROBOTS, Config::places);
        let admin = config.as_ref().map_or_else(AdminConfig::default, |c| c.admin);
        let fleet = config.as_ref().map_or("default", |c| c.fleet.as_str());
        let transport = Transport::new(fleet, &channel);
        let live = is_live.then(|| Live {
            fifo: probe_fifo(&realtime),
            shared_memory: rustix::fs::statvfs("/dev/shm")
                .ok()
                .map(|s| (s.f_bavail.saturating_mul(s.f_frsize), s.f_blocks.saturating_mul(s.f_frsize))),
            // Opened and not written to it asks for nothing.
            may_stay_awake: std::fs::OpenOptions::new().write(true).open("/dev/cpu_dma_latency").is_ok(),
            timer_step_ns: timer_step_ns(),
            census: transport.as_ref().map_err(ToString::to_string).and_then(|transport| {
                // Before anybody has ever attached there is no directory to look into.
                if channel.root.exists() {
                    transport.census().map_err(|e| e.to_string())
                } else {
                    Ok(Census::default())
                }
            }),
        });
        Self {
            host,
            live,
            priority: realtime.priority,
            robots,
            needed_bytes: transport.ok().map(|transport| transport.needed_bytes(robots, admin.max_clients)),
            channel,
            config,
        }
    }
}

/// Asks for the loop's priority in a thread that ends at once.
fn probe_fifo(config: &RealTimeConfig) -> Result<(), String> {
    let config = RealTimeConfig { policy: RealTimePolicy::Prefer, wakeup: Wakeup::Futex, ..config.clone() };
    let seat = Seat { cpu: None, alone: false };
    let grant = std::thread::spawn(move || enter(Role::Loop, &config, seat)).join();
    match grant {
        Ok(grant) if grant.policy == "fifo" => Ok(()),
        // The remedy is the finding's.
        Ok(grant) => Err(grant.refused.first().map_or_else(
            || "no reason given".to_owned(),
            |why| why.split("; ").next().and_then(|why| why.rsplit(": ").next()).unwrap_or(why).to_owned(),
        )),
        Err(_) => Err("the thread that asked for it ended".to_owned()),
    }
}

fn timer_step_ns() -> u64 {
    let step = rustix::time::clock_getres(rustix::time::ClockId::Monotonic);
    step.tv_sec.unsigned_abs() * 1_000_000_000 + step.tv_nsec.unsigned_abs()
}
