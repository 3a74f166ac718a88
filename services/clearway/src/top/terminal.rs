//! The terminal: keys in, screens out, and everything as it was at the end.

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
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

/// Shows the fleet until the operator, or a signal, ends it.
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
