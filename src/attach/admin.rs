use std::time::{Duration, Instant};

use miette::Diagnostic;
use thiserror::Error;

use super::LOOK_EVERY;
use crate::channel::{AdminPort, Attachment, ChannelError};
use crate::clock::{Clock, MonotonicClock};
use crate::journal::StoppedBy;
use crate::model::RobotSpec;
use crate::wire::{AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, NO_ROBOT, admin_flags};

/// How often a text is begun before it is given up.
const BEGINNINGS: usize = 8;

/// Why a request was not carried out.
#[derive(Debug, Error, Diagnostic)]
pub enum AdminError {
    /// The channel failed, or there is no daemon.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Channel(#[from] ChannelError),

    /// No answer came in time. The request has expired and is not carried out later; whether it was before,
    /// nobody has said.
    #[error("the daemon did not answer within {} ms", timeout.as_millis())]
    #[diagnostic(help(
        "it may have ended, be stopped, or have periods longer than that: look at it, or wait longer"
    ))]
    Timeout {
        /// How long was waited.
        timeout: Duration,
    },

    /// A text could not be read as a whole: the daemon was started again meanwhile, or too many others
    /// read as well, and so again and again.
    #[error("a text could not be read to its end, {BEGINNINGS} times")]
    #[diagnostic(help("ask again"))]
    Interrupted,

    /// The daemon refused.
    #[error("refused ({}): {text}", code.map_or("unknown", AdminCode::name))]
    Refused {
        /// Why; `None` for a code of a later version.
        code: Option<AdminCode>,
        /// The robot that it is about.
        robot: Option<u32>,
        /// Why, in words.
        text: String,
    },
}

impl AdminError {
    /// The daemon's reason, if it refused.
    pub fn code(&self) -> Option<AdminCode> {
        match self {
            Self::Refused { code, .. } => *code,
            _ => None,
        }
    }
}

/// A request that was carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// Which run of the daemon.
    pub epoch: u64,
    /// Tick of the first commands that obey it; the state of the tick before already shows it.
    pub acts_from_tick: u64,
}

/// How the daemon is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// All figures.
    pub figures: AdminAnswer,
    /// What the real-time set-up fell short in, a line each.
    pub degraded: Vec<String>,
}

impl Status {
    /// Whether the fleet is paused, until it is resumed.
    pub fn is_paused(&self) -> bool {
        self.figures.has(admin_flags::PAUSED)
    }

    /// Whether an operator stopped the fleet, or the daemon did at its start, until that is cleared.
    pub fn is_stopped(&self) -> bool {
        self.figures.has(admin_flags::STOPPED)
    }

    /// Why the daemon stopped the fleet at its start, if it did and nobody has cleared it.
    pub fn stopped_at_start(&self) -> Option<StoppedBy> {
        let causes = [
            (admin_flags::STOPPED_BY_RESTARTS, StoppedBy::Restarts),
            (admin_flags::STOPPED_BY_JOURNAL, StoppedBy::Journal),
        ];
        causes.into_iter().find(|(flag, _)| self.is_stopped() && self.figures.has(*flag)).map(|(_, by)| by)
    }
}

/// Asks the daemon for things, one at a time, and waits for the answer.
///
/// Every request expires when its answer is not waited for any more, so that nothing is carried out
/// late.
#[derive(Debug)]
pub struct AdminClient {
    port: AdminPort,
    timeout: Duration,
    tickets: u64,
}

impl AdminClient {
    /// How long an answer is waited for unless another time is set.
    pub const TIMEOUT: Duration = Duration::from_secs(2);

    pub(super) fn new(node: &Attachment) -> Result<Self, ChannelError> {
        Ok(Self { port: node.admin()?, timeout: Self::TIMEOUT, tickets: 0 })
    }

    /// Waits for answers at most `timeout`, and at most a minute.
    #[must_use]
    pub fn with_timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout.min(Duration::from_secs(60));
        self
    }

    /// How is the daemon doing?
    ///
    /// # Errors
    /// [`AdminError::Timeout`], as all of these, when no answer comes.
    pub fn status(&mut self) -> Result<Status, AdminError> {
        let (figures, text) = self.read(AdminKind::Status)?;
        Ok(Status { figures, degraded: text.lines().map(str::to_owned).collect() })
    }

    /// The configuration in force, as TOML.
    ///
    /// # Errors
    /// [`AdminError`].
    pub fn configuration(&mut self) -> Result<String, AdminError> {
        self.read(AdminKind::Configuration).map(|(_, text)| text)
    }

    /// The scenario as it is now, as TOML: robots, goals, obstacles.
    ///
    /// # Errors
    /// [`AdminError`].
    pub fn scenario(&mut self) -> Result<String, AdminError> {
        self.read(AdminKind::Scenario).map(|(_, text)| text)
    }

    /// Sends robot `id` to a new goal, m.
    ///
    /// # Errors
    /// [`AdminError::Refused`] when it cannot have that goal; it keeps the one it has.
    pub fn set_goal(&mut self, id: u32, x_m: f64, y_m: f64) -> Result<Done, AdminError> {
        self.set_goals(&[(id, x_m, y_m)])
    }

    /// Sends several robots to new goals, in the same period: all of them or none.
    ///
    /// # Errors
    /// [`AdminError::Refused`] when one of them cannot have its goal; all keep theirs.
    pub fn set_goals(&mut self, goals: &[(u32, f64, f64)]) -> Result<Done, AdminError> {
        let record =
            |&(id, goal_x_m, goal_y_m)| AdminRobot { id, goal_x_m, goal_y_m, ..AdminRobot::default() };
        self.order(AdminKind::SetGoals, &goals.iter().map(record).collect::<Vec<_>>())
    }

    /// Everybody holds until resumed.
    ///
    /// # Errors
    /// [`AdminError`].
    pub fn pause(&mut self) -> Result<Done, AdminError> {
        self.order(AdminKind::Pause, &[])
    }

    /// Goes on after a pause.
    ///
    /// # Errors
    /// [`AdminError::Refused`] while the fleet is stopped.
    pub fn resume(&mut self) -> Result<Done, AdminError> {
        self.order(AdminKind::Resume, &[])
    }

    /// Everybody stops, until that is cleared.
    ///
    /// # Errors
    /// [`AdminError`].
    pub fn stop(&mut self) -> Result<Done, AdminError> {
        self.order(AdminKind::Stop, &[])
    }

    /// Takes the latch off a stop; the fleet is paused then.
    ///
    /// # Errors
    /// [`AdminError`].
    pub fn clear(&mut self) -> Result<Done, AdminError> {
        self.order(AdminKind::Clear, &[])
    }

    /// One more robot, at rest where its start says.
    ///
    /// # Errors
    /// [`AdminError::Refused`] when there is no room for it in the fleet, at its start or at its goal.
    pub fn add_robot(&mut self, robot: &RobotSpec) -> Result<Done, AdminError> {
        let record = AdminRobot {
            id: robot.id.0,
            reserved: 0,
            goal_x_m: robot.goal_m.x,
            goal_y_m: robot.goal_m.y,
            start_x_m: robot.start.position_m.x,
            start_y_m: robot.start.position_m.y,
            start_theta_rad: robot.start.theta_rad,
            radius_m: robot.radius_m,
        };
        self.order(AdminKind::AddRobot, &[record])
    }

    /// One robot fewer. The others keep clear of it no longer: it has to be out of their way.
    ///
    /// # Errors
    /// [`AdminError::Refused`] when there is no such robot.
    pub fn remove_robot(&mut self, id: u32) -> Result<Done, AdminError> {
        self.order(AdminKind::RemoveRobot, &[AdminRobot { id, ..AdminRobot::default() }])
    }

    fn order(&mut self, kind: AdminKind, robots: &[AdminRobot]) -> Result<Done, AdminError> {
        let (answer, _) = self.ask(kind, (0, 0), robots)?;
        Ok(Done { epoch: answer.epoch, acts_from_tick: answer.acts_from_tick })
    }

    /// A text, piece by piece if it is long, and all of it of one moment.
    fn read(&mut self, kind: AdminKind) -> Result<(AdminAnswer, String), AdminError> {
        for _ in 0..BEGINNINGS {
            let (first, mut bytes) = self.ask(kind, (0, 0), &[])?;
            while (bytes.len() as u64) < first.text_bytes {
                // Of the same run: another one would go on with another text.
                match self.ask(kind, (first.epoch, bytes.len() as u64), &[]) {
                    Ok((answer, piece)) if answer.text_bytes == first.text_bytes && !piece.is_empty() => {
                        bytes.extend_from_slice(&piece);
                    }
                    // It does not keep the text any more, or is another one: from the beginning.
                    Ok(_) => break,
                    Err(e) if matches!(e.code(), Some(AdminCode::Busy | AdminCode::OtherEpoch)) => break,
                    Err(e) => return Err(e),
                }
            }
            if bytes.len() as u64 == first.text_bytes {
                return Ok((first, String::from_utf8_lossy(&bytes).into_owned()));
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Err(AdminError::Interrupted)
    }

    fn ask(
        &mut self,
        kind: AdminKind,
        (epoch, offset): (u64, u64),
        robots: &[AdminRobot],
    ) -> Result<(AdminAnswer, Vec<u8>), AdminError> {
        self.tickets += 1;
        let (sent, timeout) = (Instant::now(), self.timeout);
        let patience_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
        let request = AdminRequest {
            ticket: self.tickets,
            expires_ns: MonotonicClock.now_ns().saturating_add(patience_ns),
            epoch,
            offset,
            kind: kind as u32,
            reserved: 0,
        };
        let waiting = self.port.ask(&request, robots)?;
        let (answer, text) = loop {
            if let Some(answer) = waiting.answer()? {
                break answer;
            }
            if sent.elapsed() >= timeout {
                return Err(AdminError::Timeout { timeout });
            }
            std::thread::sleep(LOOK_EVERY);
        };
        if answer.code == AdminCode::Done as u32 {
            return Ok((answer, text));
        }
        Err(AdminError::Refused {
            code: AdminCode::from_code(answer.code),
            robot: (answer.robot != NO_ROBOT).then_some(answer.robot),
            text: String::from_utf8_lossy(&text).into_owned(),
        })
    }
}
