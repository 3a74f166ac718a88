use std::time::{Duration, Instant};

use clearway::attach::{Client, ObservationPublisher, Subscriber};
use clearway::channel::ChannelError;
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{Config, RealTimePolicy};
use clearway::model::RobotId;
use clearway::realtime::{Role, Seat, enter};
use clearway::robots::{Outgoing, RemoteRobots, Report};
use clearway::scenario::Scenario;
use clearway::wire::{RobotCommand, RobotState};
use clearway_signals::Stop;
use miette::miette;

use crate::arguments::Arguments;
use crate::display::{Display, line};
use crate::trajectory::Trajectory;

/// Between two looks for a daemon.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How long a daemon that runs may take to listen to observations.
const LISTENS_WITHIN: Duration = Duration::from_secs(2);
/// Looks at the commands in each period: they come a whole period before they act, unless they are stops.
const LOOKS_PER_PERIOD: u64 = 32;
/// Wheels that lag stand after this many time constants, to a thousandth.
const LAGS_TO_STAND: f64 = 7.0;

/// Why there is no report.
pub(crate) enum Failure {
    /// The daemon runs something else.
    Mismatch(miette::Report),
    /// Anything else.
    Other(miette::Report),
}

impl From<miette::Report> for Failure {
    fn from(error: miette::Report) -> Self {
        Self::Other(error)
    }
}

impl From<ChannelError> for Failure {
    fn from(error: ChannelError) -> Self {
        Self::Other(error.into())
    }
}

/// What is needed of the daemon's channels.
struct Ports {
    commands: Subscriber<RobotCommand>,
    states: Subscriber<RobotState>,
    observations: ObservationPublisher,
    /// Last, because the others are part of it.
    _client: Client,
}

/// The robots of this process, and what they are told and tell.
pub(crate) struct Simulation<'a> {
    arguments: &'a Arguments,
    config: Config,
    own: Scenario,
    ids: Vec<RobotId>,
    robots: RemoteRobots,
    /// The sample of commands that is heard.
    commands: Vec<RobotCommand>,
    trajectory: Option<Trajectory>,
    end: Option<Instant>,
}

impl<'a> Simulation<'a> {
    pub(crate) fn new(arguments: &'a Arguments, config: Config, own: Scenario) -> miette::Result<Self> {
        let trajectory = arguments.trajectory.as_deref().map(Trajectory::create).transpose()?;
        let now_ns = MonotonicClock.now_ns();
        let robots = RemoteRobots::new(&config, own.clone(), arguments.link(&config), now_ns);
        let end = arguments.duration.map(|s| Instant::now() + Duration::from_secs_f64(s));
        let ids = robots.ids().collect();
        Ok(Self { arguments, ids, config, own, robots, commands: Vec::new(), trajectory, end })
    }

    /// Runs until it is asked to end.
    pub(crate) fn run(mut self, stop: &Stop, display: &mut Display) -> Result<Report, Failure> {
        let (scenario, fleet) = (&self.own.name, &self.config.fleet);
        display.say(&format!("clearway-plant  {scenario}: {} robots, fleet {fleet:?}", self.ids.len()));
        self.enter(display);
        if let Some(mut ports) = self.attach(stop, display)? {
            display.say("attached");
            self.drive(&mut ports, stop, display)?;
        }
        self.robots.advance(MonotonicClock.now_ns());
        self.keep()?;
        Ok(self.robots.report())
    }

    fn over(&self, stop: &Stop) -> bool {
        stop.is_asked() || self.end.is_some_and(|end| Instant::now() >= end)
    }

    fn enter(&self, display: &Display) {
        if !self.arguments.realtime {
            return;
        }
        let mut config = self.config.realtime.clone();
        if config.policy == RealTimePolicy::Off {
            config.policy = RealTimePolicy::Prefer;
        }
        for refused in enter(Role::Robots, &config, Seat { cpu: None, alone: false }).refused {
            display.say(&format!("DEGRADED  {refused}"));
        }
    }

    /// Waits for a daemon that listens to observations; `None`: it was asked to end before.
    fn attach(&self, stop: &Stop, display: &mut Display) -> Result<Option<Ports>, Failure> {
        let mut daemon_since = None;
        while !self.over(stop) {
            match self.ports() {
                Ok(ports) => return Ok(Some(ports)),
                Err((true, ChannelError::NoDaemon { service })) => {
                    let since = *daemon_since.get_or_insert_with(Instant::now);
                    if since.elapsed() > LISTENS_WITHIN {
                        return Err(Failure::Mismatch(miette!(
                            help = "start it with --set source.kind=observation, or with kind = \
                                    \"observation\" in the section [source] of its configuration",
                            "the daemon of the fleet {:?} has its own plant and does not listen to \
                             {service}",
                            self.config.fleet
                        )));
                    }
                }
                Err((false, ChannelError::NoDaemon { .. })) => daemon_since = None,
                Err((_, e)) => return Err(e.into()),
            }
            if display.is_due() {
                display.update(format!("waiting for the daemon of the fleet {:?}", self.config.fleet));
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(None)
    }

    /// Joins the daemon's channels; with an error, whether there is a daemon.
    fn ports(&self) -> Result<Ports, (bool, ChannelError)> {
        let client = Client::connect_at(&self.config.fleet, &self.config.channel).map_err(|e| (false, e))?;
        let join = || {
            let commands = client.commands()?;
            Ok((commands, client.states()?, client.observations(self.ids.len())?))
        };
        let (commands, states, observations) = join().map_err(|e| (true, e))?;
        Ok(Ports { commands, states, observations, _client: client })
    }

    fn drive(&mut self, ports: &mut Ports, stop: &Stop, display: &mut Display) -> Result<(), Failure> {
        let clock = MonotonicClock;
        let period_ns = self.config.timing.period_ns;
        // A command may be published as late as the deadline, and is missed once its time has begun.
        let margin_ns = self.config.timing.margin_ns() / 2;
        let look_ns = (period_ns / LOOKS_PER_PERIOD).min(margin_ns).clamp(50_000, 5_000_000);
        let every_ns =
            u64::try_from(self.arguments.observe_every(&self.config).as_nanos()).unwrap_or(u64::MAX);
        let mut observe_ns = clock.now_ns();
        while !self.over(stop) {
            let now_ns = clock.now_ns();
            self.robots.advance(now_ns);
            self.hear(ports, now_ns)?;
            if now_ns >= observe_ns {
                // What is seen before anybody listens would only be stale.
                if self.robots.epoch() != 0 {
                    self.robots.observe();
                }
                // In step, and none to catch up with.
                observe_ns += every_ns * ((now_ns - observe_ns) / every_ns.max(1) + 1);
                self.keep()?;
            }
            self.tell(ports, now_ns);
            if self.arguments.once && self.run_ended(now_ns) {
                break;
            }
            if display.is_due() {
                let commanded = self.robots.commanded();
                display.update(line(&self.robots.report(), commanded));
            }
            clock.sleep_until((now_ns + look_ns).min(observe_ns.max(now_ns + 1)));
        }
        Ok(())
    }

    fn hear(&mut self, ports: &mut Ports, now_ns: u64) -> Result<(), Failure> {
        while let Some(header) = ports.commands.next_copy(&mut self.commands)? {
            self.robots.hear(&header, &self.commands, now_ns);
        }
        self.robots.not_heard(ports.commands.corrupt());
        ports.observations.follow(self.robots.epoch());
        if let Some(states) = ports.states.newest()? {
            self.robots.follow(states.robots());
        }
        if let Some(other_ns) = self.robots.other_period_ns() {
            let us = |ns: u64| ns as f64 * 1e-3;
            return Err(Failure::Mismatch(miette!(
                help = "give both the same configuration, or the same --period-us",
                "the daemon's period is {} µs, and this plant was told {} µs",
                us(other_ns),
                us(self.config.timing.period_ns)
            )));
        }
        Ok(())
    }

    /// Sends what has come through the link.
    fn tell(&mut self, ports: &mut Ports, now_ns: u64) {
        while let Some(outgoing) = self.robots.outgoing(now_ns) {
            match outgoing {
                Outgoing::Lost => ports.observations.skip(),
                Outgoing::Sample(stamp_ns, poses) => {
                    // What does not arrive is as good as lost; the next one replaces it.
                    let _ = ports.observations.report(stamp_ns, &poses);
                }
            }
        }
    }

    /// Whether the daemon has ended its run and the robots stand.
    fn run_ended(&self, now_ns: u64) -> bool {
        let rest = Duration::from_secs_f64(
            LAGS_TO_STAND * self.config.disturbance.amplitude.lag_s
                + self.config.disturbance.amplitude.delay_s,
        );
        let rest_ns = u64::try_from(rest.as_nanos()).unwrap_or(u64::MAX);
        self.robots.run_ended_ns().is_some_and(|end_ns| now_ns >= end_ns.saturating_add(rest_ns))
    }

    /// Writes down what the robots did.
    fn keep(&mut self) -> miette::Result<()> {
        let motions = self.robots.take_motions();
        match &mut self.trajectory {
            Some(trajectory) => trajectory.write(&self.ids, &motions),
            None => Ok(()),
        }
    }
}
