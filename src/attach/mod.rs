//! For other processes: read along with a running daemon, tell it what was seen, and give it orders.
//!
//! A [`Client`] is one thread's membership in a fleet. From it come subscribers to what the daemon
//! publishes, a publisher of observations, and an [`AdminClient`] for an operator's requests. Nothing
//! here can slow the daemon down. World frame, metres, radians, `CLOCK_MONOTONIC` ns.
//!
//! ```no_run
//! use clearway::attach::Client;
//! use std::time::Duration;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let client = Client::connect("default")?;
//! let mut states = client.states()?;
//! if let Some(sample) = states.wait(Duration::from_secs(1))? {
//!     for robot in sample.present() {
//!         println!("{}: ({:.2}, {:.2}) m", robot.id, robot.x_m, robot.y_m);
//!     }
//! }
//! client.admin()?.set_goal(3, 1.5, -2.0)?;
//! # Ok(())
//! # }
//! ```

mod admin;
mod observe;

pub use admin::{AdminClient, AdminError, Done, Status};
pub use observe::ObservationPublisher;

use std::time::{Duration, Instant};

use crate::channel::{Attachment, ChannelError, Reader, Received, Record, Transport};
use crate::config::ChannelConfig;
use crate::wire::{RobotCommand, RobotState, RobotTelemetry};

/// How long a channel is waited for that a running daemon does not offer: it may have begun just now, and
/// makes one after the other.
const STARTING: Duration = Duration::from_secs(2);

/// Between two looks for a daemon or a channel.
const LOOK_FOR_EVERY: Duration = Duration::from_millis(10);

/// Between two looks at a channel.
const LOOK_EVERY: Duration = Duration::from_micros(200);

/// A thread's membership in a fleet. What it hands out stays in the thread that asked for it.
#[derive(Debug)]
pub struct Client {
    node: Attachment,
    fleet: String,
}

impl Client {
    /// Joins a fleet whose daemon runs. `CLEARWAY_IOX2_PREFIX` and `CLEARWAY_IOX2_ROOT` say where its
    /// channels live, if they are set.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when none runs; the reasons for which shared memory cannot be joined.
    pub fn connect(fleet: &str) -> Result<Self, ChannelError> {
        Self::connect_at(fleet, &ChannelConfig::default().with_environment())
    }

    /// The same for channels that live where `location` says.
    ///
    /// # Errors
    /// Those of [`Client::connect`].
    pub fn connect_at(fleet: &str, location: &ChannelConfig) -> Result<Self, ChannelError> {
        let transport = Transport::new(fleet, location)?;
        let client = Self { node: transport.visit("client")?, fleet: fleet.to_owned() };
        if client.node.has_daemon() {
            return Ok(client);
        }
        Err(ChannelError::NoDaemon { service: transport.service_name(RobotState::CHANNEL) })
    }

    /// The same, and waits for the daemon to start if it has to.
    ///
    /// # Errors
    /// Those of [`Client::connect`], after `patience`.
    pub fn wait_for(fleet: &str, patience: Duration) -> Result<Self, ChannelError> {
        Self::wait_for_at(fleet, &ChannelConfig::default().with_environment(), patience)
    }

    /// The same for channels that live where `location` says.
    ///
    /// # Errors
    /// Those of [`Client::connect`], after `patience`.
    pub fn wait_for_at(
        fleet: &str,
        location: &ChannelConfig,
        patience: Duration,
    ) -> Result<Self, ChannelError> {
        let end = Instant::now() + patience;
        loop {
            match Self::connect_at(fleet, location) {
                Err(ChannelError::NoDaemon { .. }) if Instant::now() < end => {
                    std::thread::sleep(LOOK_FOR_EVERY);
                }
                result => return result,
            }
        }
    }

    /// Opens a channel of the daemon. One that is missing may come while the daemon starts.
    fn patiently<T>(&self, open: impl Fn() -> Result<T, ChannelError>) -> Result<T, ChannelError> {
        let end = Instant::now() + STARTING;
        loop {
            match open() {
                Err(ChannelError::NoDaemon { .. }) if Instant::now() < end && self.node.has_daemon() => {
                    std::thread::sleep(LOOK_FOR_EVERY);
                }
                result => return result,
            }
        }
    }

    /// The fleet's name.
    pub fn fleet(&self) -> &str {
        &self.fleet
    }

    /// The fleet's states, one sample a period.
    ///
    /// # Errors
    /// [`ChannelError::Schema`] when the daemon speaks another version, [`ChannelError::Port`] when there
    /// is no place for another reader.
    pub fn states(&self) -> Result<Subscriber<RobotState>, ChannelError> {
        self.patiently(|| self.node.reader()).map(|reader| Subscriber { reader })
    }

    /// The fleet's commands, one sample a period.
    ///
    /// # Errors
    /// Those of [`Client::states`].
    pub fn commands(&self) -> Result<Subscriber<RobotCommand>, ChannelError> {
        self.patiently(|| self.node.reader()).map(|reader| Subscriber { reader })
    }

    /// How each period went.
    ///
    /// # Errors
    /// Those of [`Client::states`].
    pub fn telemetry(&self) -> Result<Subscriber<RobotTelemetry>, ChannelError> {
        self.patiently(|| self.node.reader()).map(|reader| Subscriber { reader })
    }

    /// A publisher of what is seen of `robots` robots, for a daemon with `source.kind = "observation"`.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when the daemon does not listen to observations, and those of
    /// [`Client::states`].
    pub fn observations(&self, robots: usize) -> Result<ObservationPublisher, ChannelError> {
        self.patiently(|| ObservationPublisher::new(&self.node, robots))
    }

    /// For an operator's requests, answered within [`AdminClient::TIMEOUT`] unless another time is set.
    ///
    /// # Errors
    /// Those of [`Client::states`].
    pub fn admin(&self) -> Result<AdminClient, ChannelError> {
        self.patiently(|| AdminClient::new(&self.node))
    }
}

/// Reads what the daemon publishes, in place.
#[derive(Debug)]
pub struct Subscriber<R: Record> {
    reader: Reader<R>,
}

impl<R: Record> Subscriber<R> {
    /// The oldest sample that has not been read, if there is one. Does not wait. What was corrupted on its
    /// way is left out and counted.
    ///
    /// # Errors
    /// [`ChannelError::Transfer`] when too many samples are held.
    #[expect(clippy::should_implement_trait, reason = "an iterator would end at the first gap")]
    pub fn next(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        self.reader.next()
    }

    /// Copies the oldest sample that has not been read to `records` and verifies the copy; its header. For
    /// who moves a robot by it. Does not wait.
    ///
    /// # Errors
    /// Those of [`Subscriber::next`].
    pub fn next_copy(&mut self, records: &mut Vec<R>) -> Result<Option<R::Header>, ChannelError> {
        self.reader.next_copy(records)
    }

    /// Samples so far that were corrupted on their way, and were not handed out.
    pub fn corrupt(&self) -> u64 {
        self.reader.corrupt()
    }

    /// The newest sample, if any arrived and is intact; drops those before it. Does not wait.
    ///
    /// # Errors
    /// Those of [`Subscriber::next`].
    pub fn newest(&mut self) -> Result<Option<Received<R>>, ChannelError> {
        self.reader.newest()
    }

    /// The oldest sample that has not been read, waited for at most `patience`: `None` after that, as
    /// when the daemon has ended.
    ///
    /// # Errors
    /// Those of [`Subscriber::next`].
    pub fn wait(&mut self, patience: Duration) -> Result<Option<Received<R>>, ChannelError> {
        let end = Instant::now() + patience;
        loop {
            let found = self.reader.next()?;
            if found.is_some() || Instant::now() >= end {
                return Ok(found);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
}
