//! Orders to a running daemon and questions about it.

mod goals;
mod status;

pub(crate) use status::value as status_value;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Subcommand;
use clearway::attach::{AdminClient, AdminError, Client, Done};
use clearway::channel::ChannelError;
use clearway::geometry::{Pose, Vec2};
use clearway::model::{RobotId, RobotSpec};
use clearway::wire::AdminCode;

/// The daemon refused.
const REFUSED: u8 = 1;
/// No daemon runs for the fleet, or it does not answer.
const NO_DAEMON: u8 = 3;

/// Between two attempts at a daemon that is busy.
const RETRY_EVERY: Duration = Duration::from_millis(20);

macro_rules! after_help {
    ($examples:literal) => {
        concat!(
            "Examples:\n",
            $examples,
            "\n\nExit codes: 0 done, 1 refused, 2 the command line or a file is wrong,\n",
            "            3 no daemon runs for the fleet, or it does not answer.\n\n",
            "Environment: CLEARWAY_IOX2_PREFIX and CLEARWAY_IOX2_ROOT say where the channels\n",
            "live, as for clearwayd."
        )
    };
}

/// Which daemon, and how long to wait for it.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Daemon {
    /// Name of the fleet
    #[arg(long, value_name = "NAME", default_value = "default")]
    fleet: String,
    /// How long to wait for the answer, s; an order that is not answered by then is not carried out
    /// later
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    timeout: f64,
}

/// What an operator asks of a running daemon.
#[derive(Debug, Subcommand)]
pub(crate) enum Order {
    /// Say how the running daemon is doing
    #[command(after_help = after_help!("  clearway status\n  clearway status --json --fleet night | jq .arrived"))]
    Status {
        #[command(flatten)]
        daemon: Daemon,
        /// As one JSON object
        #[arg(long)]
        json: bool,
    },
    /// Send a robot to a new goal; a goal that it cannot have is refused, and it keeps the last one
    #[command(after_help = after_help!("  clearway goal 3 1.5 -2        robot 3 to (1.5, -2) m"))]
    Goal {
        /// Id of the robot
        id: u32,
        /// World frame, m
        #[arg(allow_hyphen_values = true)]
        x: f64,
        /// World frame, m
        #[arg(allow_hyphen_values = true)]
        y: f64,
        #[command(flatten)]
        daemon: Daemon,
    },
    /// Send several robots to new goals in the same period, all of them or none
    #[command(after_help = after_help!(
        "  clearway goals shift.txt\n  printf '0 4 0\\n1 4 2\\n' | clearway goals -\n\nA line of the file is `ID X Y`, in m; what follows a # is a remark."))]
    Goals {
        /// The file; - for standard input
        file: String,
        #[command(flatten)]
        daemon: Daemon,
    },
    /// Hold every robot where it is, until `resume`
    #[command(after_help = after_help!("  clearway pause"))]
    Pause(Daemon),
    /// Go on after a pause; after a stop, `clear` it first
    #[command(after_help = after_help!("  clearway resume\n  clearway clear && clearway resume    after a stop"))]
    Resume(Daemon),
    /// Stop every robot; latched until `clear`, and nobody moves before `resume`
    #[command(after_help = after_help!("  clearway stop"))]
    Stop(Daemon),
    /// Take the latch off a stop; the fleet is paused then, and nobody moves before `resume`
    #[command(after_help = after_help!("  clearway clear && clearway resume"))]
    Clear(Daemon),
    /// Add a robot; the daemon has to have room for it (admin.capacity)
    #[command(after_help = after_help!(
        "  clearway add 9 --radius 0.2 --start 0 4 --goal 6 4 --heading 1.57"))]
    Add {
        /// Its id
        id: u32,
        /// Radius of the disc that covers its body, m
        #[arg(long, value_name = "M")]
        radius: f64,
        /// Where it stands, m
        #[arg(long, num_args = 2, value_names = ["X", "Y"], allow_negative_numbers = true)]
        start: Vec<f64>,
        /// Where it is to go, m
        #[arg(long, num_args = 2, value_names = ["X", "Y"], allow_negative_numbers = true)]
        goal: Vec<f64>,
        /// Its heading, rad
        #[arg(long, value_name = "RAD", default_value_t = 0.0, allow_negative_numbers = true)]
        heading: f64,
        #[command(flatten)]
        daemon: Daemon,
    },
    /// Remove a robot that has been taken away: the others do not keep clear of it any longer
    #[command(after_help = after_help!("  clearway remove 9"))]
    Remove {
        /// Its id
        id: u32,
        #[command(flatten)]
        daemon: Daemon,
    },
    /// Print the configuration in force
    #[command(after_help = after_help!(
        "  clearway config\n  clearway config --scenario > now.toml    today's robots, goals and obstacles"))]
    Config {
        /// The scenario instead: today's robots, goals and obstacles
        #[arg(long)]
        scenario: bool,
        #[command(flatten)]
        daemon: Daemon,
    },
}

/// Carries out an order.
pub(crate) fn run(order: &Order) -> ExitCode {
    match carry_out(order) {
        Ok(text) => {
            crate::show(&text);
            ExitCode::SUCCESS
        }
        Err(Failure::Input(report)) => crate::wrong(&report),
        Err(Failure::Admin(error)) => {
            let code = match &error {
                AdminError::Refused { .. } => REFUSED,
                AdminError::Channel(ChannelError::FleetName { .. } | ChannelError::Location { .. }) => {
                    crate::WRONG_INPUT
                }
                _ => NO_DAEMON,
            };
            eprintln!("{:?}", miette::Report::new(error));
            ExitCode::from(code)
        }
    }
}

enum Failure {
    /// The command line or a file.
    Input(miette::Report),
    Admin(AdminError),
}

impl From<AdminError> for Failure {
    fn from(error: AdminError) -> Self {
        Self::Admin(error)
    }
}

impl From<miette::Report> for Failure {
    fn from(report: miette::Report) -> Self {
        Self::Input(report)
    }
}

/// What is to be printed.
fn carry_out(order: &Order) -> Result<String, Failure> {
    match order {
        Order::Status { daemon, json } => {
            let status = ask(daemon, AdminClient::status)?;
            Ok(if *json {
                status::json(&daemon.fleet, &status)
            } else {
                status::text(&daemon.fleet, &status)
            })
        }
        Order::Config { daemon, scenario: false } => Ok(ask(daemon, AdminClient::configuration)?),
        Order::Config { daemon, scenario: true } => Ok(ask(daemon, AdminClient::scenario)?),
        Order::Goal { id, x, y, daemon } => {
            let done = ask(daemon, |admin| admin.set_goal(*id, *x, *y))?;
            Ok(said(&format!("robot {id} goes to ({x}, {y}) m"), done))
        }
        Order::Goals { file, daemon } => {
            let goals = goals::read(file)?;
            let done = ask(daemon, |admin| admin.set_goals(&goals))?;
            Ok(said(&format!("{} robots have new goals", goals.len()), done))
        }
        Order::Pause(daemon) => Ok(said("paused until `clearway resume`", ask(daemon, AdminClient::pause)?)),
        Order::Resume(daemon) => Ok(said("resumed", ask(daemon, AdminClient::resume)?)),
        Order::Stop(daemon) => Ok(said("stopped until `clearway clear`", ask(daemon, AdminClient::stop)?)),
        Order::Clear(daemon) => {
            Ok(said("cleared; `clearway resume` lets them drive", ask(daemon, AdminClient::clear)?))
        }
        Order::Add { id, radius, start, goal, heading, daemon } => {
            let ([x, y], [goal_x, goal_y]) = (&start[..], &goal[..]) else {
                return Err(miette::miette!("--start and --goal take two numbers each").into());
            };
            let robot = RobotSpec {
                id: RobotId(*id),
                radius_m: *radius,
                start: Pose { position_m: Vec2::new(*x, *y), theta_rad: *heading },
                goal_m: Vec2::new(*goal_x, *goal_y),
                foreign_speed_mps: None,
            };
            Ok(said(&format!("robot {id} has joined"), ask(daemon, |admin| admin.add_robot(&robot))?))
        }
        Order::Remove { id, daemon } => {
            Ok(said(&format!("robot {id} is gone"), ask(daemon, |admin| admin.remove_robot(*id))?))
        }
    }
}

fn said(what: &str, done: Done) -> String {
    format!("{what} (from tick {})\n", done.acts_from_tick)
}

/// Asks, and again while the daemon is busy and there is time.
fn ask<T>(
    daemon: &Daemon,
    mut request: impl FnMut(&mut AdminClient) -> Result<T, AdminError>,
) -> Result<T, Failure> {
    let timeout = Duration::try_from_secs_f64(daemon.timeout)
        .map_err(|_| miette::miette!("--timeout has to be a time in seconds, is {}", daemon.timeout))?;
    let end = Instant::now() + timeout;
    let client = Client::connect(&daemon.fleet).map_err(AdminError::from)?;
    let mut admin = client.admin().map_err(AdminError::from)?.with_timeout(timeout);
    loop {
        match request(&mut admin) {
            Err(error) if error.code() == Some(AdminCode::Busy) && Instant::now() < end => {
                std::thread::sleep(RETRY_EVERY);
                admin = admin.with_timeout(end.saturating_duration_since(Instant::now()));
            }
            result => return Ok(result?),
        }
    }
}
