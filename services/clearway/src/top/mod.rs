//! `clearway top`: a fleet on a terminal, live, or once for a script.
//!
//! Samples go from [`feed`] and answers from [`asker`] into [`model`]; [`draw`] and [`json`] show it. The
//! loop publishes without waiting for anybody, so that nothing here can slow it down.

mod asker;
mod draw;
mod feed;
mod json;
mod model;
mod robot;
mod terminal;
#[cfg(test)]
mod tests;
mod text;
mod times;
mod view;

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use clearway::channel::{ChannelError, Transport};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::ChannelConfig;
use clearway::figures::LatencyHistogram;
use draw::Look;
use feed::Feed;
use miette::{IntoDiagnostic, WrapErr, miette};
use model::Model;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

use asker::Asker;
use view::View;

/// Watch a fleet: robots, deadlines, histograms, slacks, who is attached.
///
/// Reads along with a running daemon, or waits for one, and comes back when it is started again. Control
/// does not notice: what this is too slow for is counted.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway top
  clearway top --fleet night --redraw-hz 1   over a slow line
  clearway top --once                        one screen, as text
  clearway top --once --json | jq '.window.release_lateness_ns.p99'
  clearway top --once --json --seconds 10 --wait 30

Keys: 1 to 4 views, s order, f filter, arrows scroll, ? help, q end.
NO_COLOR turns colours off; without a UTF-8 locale the screen is ASCII.

Exit codes: 0 done, 2 the command line is wrong or there is no terminal,
            3 (with --once) no daemon runs for the fleet, or it is silent.

Environment: CLEARWAY_IOX2_PREFIX and CLEARWAY_IOX2_ROOT say where the channels
live, as for clearwayd.")]
pub(crate) struct Args {
    /// Name of the fleet
    #[arg(long, value_name = "NAME", default_value = "default")]
    fleet: String,
    /// Screens a second, from 0.1 to 30; keys are answered at once
    #[arg(long, value_name = "HZ", default_value_t = 4.0, value_parser = rate)]
    redraw_hz: f64,
    /// Print one screen and end
    #[arg(long)]
    once: bool,
    /// With --once: as one JSON object
    #[arg(long, requires = "once")]
    json: bool,
    /// With --once: how long to collect, s, from 0.1 to 3600
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = window, requires = "once")]
    seconds: f64,
    /// With --once: how long to wait for a daemon, s
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = patience, requires = "once")]
    wait: f64,
}

fn in_range(text: &str, from: f64, to: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (from..=to).contains(&value) => Ok(value),
        _ => Err(format!("give a number from {from} to {to}")),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    in_range(text, 0.1, 30.0)
}

fn window(text: &str) -> Result<f64, String> {
    in_range(text, 0.1, 3600.0)
}

fn patience(text: &str) -> Result<f64, String> {
    in_range(text, 0.0, 1e6)
}

/// No daemon runs for the fleet, or it is silent.
const NO_DAEMON: u8 = 3;

/// Size of the screen that `--once` prints.
const PRINTED: (u16, u16) = (80, 24);

/// Shows the fleet; the exit status.
pub(crate) fn run(args: &Args) -> miette::Result<u8> {
    let on_terminal = std::io::stdout().is_terminal() && std::io::stdin().is_terminal();
    if !args.once && !on_terminal {
        return Err(miette!(
            help = "print one screen with --once, or one JSON object with --once --json",
            "`clearway top` needs a terminal to draw on"
        ));
    }
    let transport = Transport::new(&args.fleet, &ChannelConfig::default().with_environment())?;
    let service = transport.service_name(clearway::channel::Channel::State);
    let mut feed = Feed::new(transport)?;
    let empty = LatencyHistogram::new().into_diagnostic().wrap_err("no histogram can be made")?;
    let mut model = Model::new(&args.fleet, empty, MonotonicClock.now_ns());
    if args.once {
        return once(args, service, &mut feed, &mut model);
    }
    let asker = Asker::start(&args.fleet).into_diagnostic().wrap_err("no thread can be started")?;
    let redraw_every = Duration::from_secs_f64(1.0 / args.redraw_hz);
    terminal::run(&mut feed, &asker, &mut model, Look::from_environment(), redraw_every)
        .into_diagnostic()
        .wrap_err("the terminal cannot be used")?;
    Ok(0)
}

/// Collects for the window and prints.
fn once(args: &Args, service: String, feed: &mut Feed, model: &mut Model) -> miette::Result<u8> {
    let begun = Instant::now();
    loop {
        feed.poll(model);
        if model.attached {
            break;
        }
        if begun.elapsed().as_secs_f64() >= args.wait {
            if let Some(trouble) = &model.trouble {
                return Err(miette!("{trouble}"));
            }
            eprintln!("{:?}", miette::Report::new(ChannelError::NoDaemon { service }));
            return Ok(NO_DAEMON);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let asker = Asker::start(&args.fleet).into_diagnostic().wrap_err("no thread can be started")?;
    let (begun, window) = (Instant::now(), Duration::from_secs_f64(args.seconds));
    let bar =
        (args.seconds > 2.0 && std::io::stderr().is_terminal()).then(indicatif::ProgressBar::new_spinner);
    while begun.elapsed() < window {
        feed.poll(model);
        asker.poll(model);
        if let Some(bar) = &bar {
            bar.set_message(format!("{:.0} of {:.0} s", begun.elapsed().as_secs_f64(), args.seconds));
            bar.tick();
        }
        std::thread::sleep(Feed::patience(model).min(window.saturating_sub(begun.elapsed())));
    }
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    feed.poll(model);
    // The first answer may still be on its way.
    let end = Instant::now() + asker::TIMEOUT;
    while model.status.is_none() && model.unanswered.is_none() && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(5));
        asker.poll(model);
    }
    let now_ns = MonotonicClock.now_ns();
    crate::show(&if args.json {
        format!("{:#}\n", json::object(model, now_ns, args.seconds))
    } else {
        printed(model, Look { colour: false, ..Look::from_environment() }, now_ns)
    });
    Ok(if model.is_live(now_ns) { 0 } else { NO_DAEMON })
}

/// The overview as text.
fn printed(model: &Model, look: Look, now_ns: u64) -> String {
    let mut view = View::default();
    json::plain(screen(PRINTED, model, &mut view, look, now_ns).into_iter())
}

/// The lines of a screen of columns × lines.
fn screen(
    (width, height): (u16, u16),
    model: &Model,
    view: &mut View,
    look: Look,
    now_ns: u64,
) -> Vec<String> {
    // A terminal in memory cannot fail.
    let Ok(mut terminal) = Terminal::new(TestBackend::new(width, height));
    let Ok(drawn) = terminal.draw(|frame| draw::screen(frame, model, view, look, now_ns));
    let row =
        |y| (0..width).filter_map(|x| drawn.buffer.cell((x, y))).map(ratatui::buffer::Cell::symbol).collect();
    (0..height).map(row).collect()
}
