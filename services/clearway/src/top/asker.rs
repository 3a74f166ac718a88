//! Asks the daemon how it is doing, once a second, on a thread of its own: an answer that takes its time
//! does not hold up the screen.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use clearway::attach::{AdminClient, AdminError, Client, Status};
use clearway::channel::ChannelError;
use clearway::config::Config;
use clearway::scenario::Scenario;

use super::model::{Law, Model};

const ASK_EVERY: Duration = Duration::from_secs(1);
pub(crate) const TIMEOUT: Duration = Duration::from_millis(800);
/// Between two looks at whether to end.
const NAP: Duration = Duration::from_millis(20);

enum Answer {
    Status(Result<Status, String>),
    Law(Law),
}

/// The thread that asks.
pub(crate) struct Asker {
    answers: Receiver<Answer>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Asker {
    /// # Errors
    /// When there is no thread to be had.
    pub(crate) fn start(fleet: &str) -> std::io::Result<Self> {
        let (send, answers) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let (fleet, ending) = (fleet.to_owned(), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("admin".to_owned())
            .spawn(move || ask_on(&fleet, &send, &ending))?;
        Ok(Self { answers, stop, thread: Some(thread) })
    }

    /// Brings in what was answered.
    pub(crate) fn poll(&self, model: &mut Model) {
        for answer in self.answers.try_iter() {
            match answer {
                Answer::Status(status) => model.answered(status),
                Answer::Law(law) => {
                    if model.run.as_ref().is_none_or(|run| run.epoch <= law.epoch) {
                        model.law = Some(law);
                    }
                }
            }
        }
    }
}

impl Drop for Asker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn ask_on(fleet: &str, send: &Sender<Answer>, stop: &AtomicBool) {
    let mut client: Option<AdminClient> = None;
    let mut known = None;
    while !stop.load(Ordering::Relaxed) {
        let asked = connected(fleet, &mut client).and_then(|admin| {
            let status = admin.status()?;
            let epoch = status.figures.epoch;
            let law = if known == Some(epoch) { None } else { law(admin, epoch)? };
            Ok((status, law))
        });
        let answer = match asked {
            Ok((status, law)) => {
                known = Some(status.figures.epoch);
                if let Some(law) = law {
                    let _ = send.send(Answer::Law(law));
                }
                Ok(status)
            }
            Err(error) => {
                // A daemon that is started again finds no client of the last one.
                client = None;
                Err(error.to_string())
            }
        };
        if send.send(Answer::Status(answer)).is_err() {
            return;
        }
        let naps = ASK_EVERY.as_millis() / NAP.as_millis();
        for _ in 0..naps {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            std::thread::sleep(NAP);
        }
    }
}

fn connected<'a>(
    fleet: &str,
    client: &'a mut Option<AdminClient>,
) -> Result<&'a mut AdminClient, AdminError> {
    let admin = match client.take() {
        Some(admin) => admin,
        None => connect(fleet)?.with_timeout(TIMEOUT),
    };
    Ok(client.insert(admin))
}

fn connect(fleet: &str) -> Result<AdminClient, ChannelError> {
    Client::connect(fleet)?.admin()
}

/// What the configuration in force says; `None` when it is that of a later version.
fn law(admin: &mut AdminClient, epoch: u64) -> Result<Option<Law>, AdminError> {
    let (configuration, scenario) = (admin.configuration()?, admin.scenario()?);
    let parsed = Scenario::parse(&scenario, "scenario")
        .and_then(|scenario| Config::parse_around(&configuration, "configuration", scenario));
    Ok(parsed.ok().map(|config| Law {
        epoch,
        profile: config.controller.profile.name().to_owned(),
        solver: config.controller.solver.name().to_owned(),
        policy: config.realtime.policy.name().to_owned(),
        scenario: config.scenario.name,
        obstacles: config.scenario.obstacles,
    }))
}
