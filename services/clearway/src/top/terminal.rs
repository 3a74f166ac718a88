//! The terminal: keys in, screens out, and everything as it was at the end.

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, getpid, kill_process};
use std::io;
use std::time::{Duration, Instant};

use clearway::clock::{Clock, MonotonicClock};
use clearway_signals::{Again, Stop};

use super::asker::Asker;
use super::draw::{self, Look};
use super::feed::Feed;
use super::model::Model;
use super::view::{Key, View};

/// What a key press means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Input {
    View(Key),
    Quit,
    Suspend,
    Nothing,
}

fn meaning(key: KeyEvent) -> Input {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    let key = match key.code {
        KeyCode::Char('c') if control => return Input::Quit,
        KeyCode::Char('z') if control => return Input::Suspend,
        KeyCode::Char(_) if control => return Input::Nothing,
        KeyCode::Char('q') => return Input::Quit,
        KeyCode::Char(digit @ '1'..='4') => Key::Tab(digit as usize - '1' as usize),
        KeyCode::Tab => Key::NextTab,
        KeyCode::Char('s') => Key::Sort,
        KeyCode::Char('f') => Key::Filter,
        KeyCode::Up | KeyCode::Char('k') => Key::Up,
        KeyCode::Down | KeyCode::Char('j') => Key::Down,
        KeyCode::PageUp => Key::PageUp,
        KeyCode::PageDown | KeyCode::Char(' ') => Key::PageDown,
        KeyCode::Home | KeyCode::Char('g') => Key::First,
        KeyCode::End | KeyCode::Char('G') => Key::Last,
        KeyCode::Left | KeyCode::Char('h') => Key::Left,
        KeyCode::Right | KeyCode::Char('l') => Key::Right,
        KeyCode::Char('?') => Key::Help,
        KeyCode::Esc => Key::Close,
        _ => return Input::Nothing,
    };
    Input::View(key)
}

/// Puts the terminal back, however this ends. A panic does the same before it says what happened.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// How long the loop may take to end once it is to.
const ENDS_WITHIN: Duration = Duration::from_secs(1);

/// Asks for the end when the terminal is gone: closed, or its connection lost. Then, and when a signal has asked
/// for it, ends the process if it does not end by itself: who reads keys from a terminal that is gone does not
/// come back.
fn watch(stop: Stop) -> io::Result<()> {
    let watching = move || {
        let input = io::stdin();
        let every = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };
        while !stop.is_asked() {
            // That it is gone is told without being asked for.
            let mut ends = [PollFd::new(&input, PollFlags::empty())];
            if poll(&mut ends, Some(&every)).is_ok_and(|count| count > 0) {
                stop.ask();
            }
        }
        std::thread::sleep(ENDS_WITHIN);
        std::process::exit(0);
    };
    std::thread::Builder::new().name("terminal".into()).spawn(watching).map(drop)
}

/// Shows the fleet until the operator, a signal or the end of the terminal ends it.
///
/// # Errors
/// When the terminal cannot be used.
pub(crate) fn run(
    feed: &mut Feed,
    asker: &Asker,
    model: &mut Model,
    look: Look,
    redraw_every: Duration,
) -> io::Result<()> {
    let stop = Stop::listen_to_terminal(Again::Waits)?;
    watch(stop.clone())?;
    let mut terminal = ratatui::try_init()?;
    let _restore = Restore;
    let mut view = View::default();
    let mut drawn: Option<Instant> = None;
    while !stop.is_asked() {
        feed.poll(model);
        asker.poll(model);
        if drawn.is_none_or(|at| at.elapsed() >= redraw_every) {
            terminal.draw(|frame| draw::screen(frame, model, &mut view, look, MonotonicClock.now_ns()))?;
            drawn = Some(Instant::now());
        }
        if !event::poll(Feed::patience(model))? {
            continue;
        }
        match event::read()? {
            Event::Key(key) if key.kind != KeyEventKind::Release => match meaning(key) {
                Input::Quit => return Ok(()),
                Input::Suspend => suspend(&mut terminal)?,
                Input::View(key) => view.press(key),
                Input::Nothing => continue,
            },
            Event::Resize(..) => {}
            _ => continue,
        }
        // What the operator did is seen at once.
        drawn = None;
    }
    Ok(())
}

/// Hands the terminal to the shell until it is brought back.
fn suspend(terminal: &mut DefaultTerminal) -> io::Result<()> {
    ratatui::try_restore()?;
    kill_process(getpid(), Signal::TSTP)?;
    *terminal = ratatui::try_init()?;
    terminal.clear()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_mean_what_the_help_says() {
        let plain = |code| meaning(KeyEvent::new(code, KeyModifiers::NONE));
        let control = |letter| meaning(KeyEvent::new(KeyCode::Char(letter), KeyModifiers::CONTROL));
        assert_eq!((plain(KeyCode::Char('q')), control('c')), (Input::Quit, Input::Quit));
        assert_eq!((control('z'), control('s')), (Input::Suspend, Input::Nothing));
        assert_eq!(plain(KeyCode::Char('3')), Input::View(Key::Tab(2)));
        assert_eq!(plain(KeyCode::Char('G')), Input::View(Key::Last));
        assert_eq!(plain(KeyCode::F(1)), Input::Nothing);
    }
}
