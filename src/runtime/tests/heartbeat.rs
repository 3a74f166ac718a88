//! What a supervisor hears.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Fault;
use super::faults::Faulty;
use super::support::{self, World, config, lanes, straight};
use crate::admission::Rejections;
use crate::clock::Clock;
use crate::config::Config;
use crate::controller::RouteShelf;
use crate::model::RobotSpec;
use crate::plant::Plant;
use crate::runtime::supervisor::Supervisor;
use crate::runtime::threads::{MakeSource, Outside};
use crate::runtime::{Daemon, Until};
use crate::source::{Instant, StateSource};
use crate::wire::{CommandHeader, RobotCommand, RobotState};

/// A supervisor of the test's own, and what it has heard since it was asked last.
struct Listener {
    socket: std::os::unix::net::UnixDatagram,
    address: String,
}

impl Listener {
    fn new(name: &str) -> Self {
        use std::os::linux::net::SocketAddrExt;
        let name = format!("clearway_{name}_{}", std::process::id());
        let address = std::os::unix::net::SocketAddr::from_abstract_name(&name).unwrap();
        let socket = std::os::unix::net::UnixDatagram::bind_addr(&address).unwrap();
        socket.set_nonblocking(true).unwrap();
        Self { socket, address: format!("@{name}") }
    }

    fn heard(&self) -> Vec<String> {
        let mut bytes = [0; 512];
        std::iter::from_fn(|| {
            let length = self.socket.recv(&mut bytes).ok()?;
            Some(String::from_utf8_lossy(&bytes[..length]).trim_end().to_owned())
        })
        .collect()
    }

    /// Waits until it hears this.
    fn hear(&self, text: &str) {
        support::process::until(|| self.heard().iter().any(|heard| heard == text).then_some(()));
    }

    fn outside(&self) -> Outside {
        let watchdog = Some(std::time::Duration::from_millis(20));
        let supervisor = Supervisor::at(self.address.as_bytes(), watchdog).unwrap();
        Outside { supervisor: Some(Arc::new(supervisor)), ..Outside::default() }
    }
}

const BEAT: &str = "WATCHDOG=1";

#[test]
fn there_is_no_heartbeat_while_a_worker_hangs() {
    let (world, listener) = (World::new("beat"), Listener::new("beat"));
    let hangs = Arc::new(AtomicBool::new(false));
    let hung = Arc::clone(&hangs);
    let fault: Fault = Arc::new(move |_, owned| {
        while owned.start == 0 && hung.load(Ordering::Relaxed) {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    });
    let period_ns = 10_000_000;
    let mut config = config(&world, lanes(2, 5000.0), period_ns);
    config.timing.workers = Some(2);
    let (make, shelf) = (straight(period_ns), Arc::new(RouteShelf::new(2)));
    let start = (config, None);
    let faulty =
        move |owned| Ok::<_, String>(Faulty { inner: make(owned)?, periods: 0, fault: Arc::clone(&fault) });
    let daemon =
        Daemon::start_audited(start, Until::Stopped, listener.outside(), None, shelf, faulty).unwrap();
    listener.hear("READY=1");
    listener.hear(BEAT);

    hangs.store(true, Ordering::Relaxed);
    support::process::until(|| (daemon.progress().workers_silent == 1).then_some(()));
    listener.heard();
    // The loop goes on, and what is due in the meantime is not said.
    let tick = daemon.progress().tick;
    support::process::until(|| (daemon.progress().tick > tick + 30).then_some(()));
    assert!(!listener.heard().iter().any(|heard| heard == BEAT));

    hangs.store(false, Ordering::Relaxed);
    listener.hear(BEAT);
    daemon.stop();
    daemon.join().unwrap();
    assert!(listener.heard().iter().any(|heard| heard == "STOPPING=1"));
}

#[test]
fn there_is_no_heartbeat_while_the_loop_hangs() {
    struct Hanging(Plant, Arc<AtomicBool>);
    impl StateSource for Hanging {
        fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]) {
            while self.1.load(Ordering::Relaxed) {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            self.0.observe(instant, clock, states);
        }
        fn knows_all(&self) -> bool {
            true
        }
        fn admit(&mut self, _: usize, _: &RobotSpec) {}
        fn dismiss(&mut self, _: usize) {}
        fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
            self.0.commit(header, commands, now_ns);
        }
        fn rejections(&self) -> Rejections {
            Rejections::default()
        }
    }
    let (world, listener) = (World::new("loop_beat"), Listener::new("loop_beat"));
    let period_ns = 10_000_000;
    let config = config(&world, lanes(2, 5000.0), period_ns);
    let hangs = Arc::new(AtomicBool::new(false));
    let hung = Arc::clone(&hangs);
    let source: MakeSource = Arc::new(move |config: &Config, start_ns| {
        Box::new(Hanging(Plant::new(&config.scenario, period_ns, start_ns), Arc::clone(&hung)))
    });
    let outside = Outside { source: Some(source), ..listener.outside() };
    let daemon = Daemon::start_controlled(config, Until::Stopped, outside).unwrap();
    listener.hear("READY=1");
    listener.hear(BEAT);
    hangs.store(true, Ordering::Relaxed);
    // Long enough for what was under way, and then for many beats.
    std::thread::sleep(std::time::Duration::from_millis(300));
    listener.heard();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(listener.heard().iter().filter(|heard| *heard == BEAT).count(), 0);
    hangs.store(false, Ordering::Relaxed);
    listener.hear(BEAT);
    drop(daemon);
}
