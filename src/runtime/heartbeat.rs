use std::sync::Arc;
use std::time::{Duration, Instant};

use super::supervisor::Supervisor;

/// Periods without commands after which the loop hangs, is kept from running, or has no memory for them.
const SILENT_PERIODS: u32 = 3;
/// What this thread may sleep and be late in addition.
const SLACK: Duration = Duration::from_millis(50);
/// Far longer than a round of the thread that takes stops: one does about a millisecond of work.
const ADMIN_PATIENCE: Duration = Duration::from_secs(10);
/// Between two lines about how it goes.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// What the supervisor is told: that the first commands are out, then twice in every time that it gives us
/// that commands go out, all workers made their last period and operators' stops are taken, and that the run
/// ends. Nothing while one of these fails: it then ends this process and starts another.
#[derive(Debug)]
pub(super) struct Heartbeat {
    supervisor: Option<Arc<Supervisor>>,
    /// The loop hangs, or commands nobody, when it publishes nothing for this long.
    patience: Duration,
    /// When the commands of a period were last published.
    commanded: Option<Instant>,
    /// Rounds of the thread that takes operators' stops, and when there was a new one.
    admin: (u64, Instant),
    ready: bool,
    stopping: bool,
    due: Instant,
    status_due: Instant,
}

impl Heartbeat {
    pub(super) fn new(supervisor: Option<Arc<Supervisor>>, period: Duration) -> Self {
        let now = Instant::now();
        Self {
            supervisor,
            patience: SILENT_PERIODS * period + SLACK,
            commanded: None,
            admin: (0, now),
            ready: false,
            stopping: false,
            due: now,
            status_due: now,
        }
    }

    /// The loop has left the record of a period, and `published` its commands or not.
    pub(super) fn period_over(&mut self, published: bool) {
        if published {
            self.commanded = Some(Instant::now());
        }
    }

    /// The thread that takes operators' stops has made so many `rounds`.
    pub(super) fn operators_heard(&mut self, rounds: u64) {
        if self.admin.0 != rounds {
            self.admin = (rounds, Instant::now());
        }
    }

    /// Says what is due, if the workers have `answered` the last period, commands go out and stops are taken.
    pub(super) fn beat(&mut self, answered: bool, status: impl FnOnce() -> String) {
        let Some(supervisor) = self.supervisor.clone().filter(|_| self.commanded.is_some()) else { return };
        let now = Instant::now();
        if !self.ready {
            self.ready = supervisor.tell("READY=1\n");
        }
        if now >= self.status_due && supervisor.tell(&format!("STATUS={}\n", status())) {
            self.status_due = now + STATUS_EVERY;
        }
        let goes_on = self.commanded.is_some_and(|at| at.elapsed() < self.patience)
            && self.admin.1.elapsed() < ADMIN_PATIENCE;
        // What is due stays due until all is well again, or there is room for it.
        if let Some(within) = supervisor.watchdog()
            && now >= self.due
            && goes_on
            && answered
            && supervisor.tell("WATCHDOG=1\n")
        {
            self.due = now + within / 2;
        }
    }

    /// Says that the run ends.
    pub(super) fn stopping(&mut self) {
        if let Some(supervisor) = &self.supervisor
            && !self.stopping
        {
            self.stopping = supervisor.tell("STOPPING=1\n");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::net::{SocketAddr, UnixDatagram};

    /// A heartbeat that is due at once, every time, and who hears it.
    fn beating(name: &str) -> (Heartbeat, UnixDatagram) {
        let name = format!("clearway_{name}_{}", std::process::id());
        let listener = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        listener.set_nonblocking(true).unwrap();
        let supervisor = Supervisor::at(format!("@{name}").as_bytes(), Some(Duration::from_nanos(1)));
        (Heartbeat::new(Some(Arc::new(supervisor.unwrap())), Duration::from_millis(1)), listener)
    }

    fn beats(heartbeat: &mut Heartbeat, listener: &UnixDatagram) -> usize {
        heartbeat.beat(true, String::new);
        let mut bytes = [0; 64];
        let heard = std::iter::from_fn(|| listener.recv(&mut bytes).ok().map(|n| bytes[..n].to_vec()));
        heard.filter(|said| said.starts_with(b"WATCHDOG=1")).count()
    }

    #[test]
    fn periods_whose_commands_do_not_go_out_keep_no_heartbeat_up() {
        let (mut heartbeat, listener) = beating("unsent");
        heartbeat.period_over(false);
        assert_eq!(beats(&mut heartbeat, &listener), 0);
        heartbeat.period_over(true);
        assert_eq!(beats(&mut heartbeat, &listener), 1);
        // Every loan fails from now on, or every sample is late.
        std::thread::sleep(heartbeat.patience);
        heartbeat.period_over(false);
        assert_eq!(beats(&mut heartbeat, &listener), 0);
        heartbeat.period_over(true);
        assert_eq!(beats(&mut heartbeat, &listener), 1);
    }

    #[test]
    fn there_is_no_heartbeat_while_nobody_takes_stops() {
        let (mut heartbeat, listener) = beating("deaf");
        let deaf_since = Instant::now().checked_sub(ADMIN_PATIENCE).unwrap();
        heartbeat.period_over(true);
        heartbeat.operators_heard(7);
        assert_eq!(beats(&mut heartbeat, &listener), 1);
        heartbeat.admin.1 = deaf_since;
        heartbeat.operators_heard(7);
        heartbeat.period_over(true);
        assert_eq!(beats(&mut heartbeat, &listener), 0);
        heartbeat.operators_heard(8);
        assert_eq!(beats(&mut heartbeat, &listener), 1);
    }
}
