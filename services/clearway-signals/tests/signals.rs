//! Signals of a process of its own: this test, started again.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use clearway_signals::{Again, IMPATIENT, Stop};
use rustix::process::{Pid, Signal, kill_process};

/// Not a test of its own: what the started process runs. It says when it listens and when it was asked to
/// end, and then takes its time.
#[test]
fn asked_process() {
    let Ok(role) = std::env::var("CLEARWAY_TEST_SIGNALS") else { return };
    let stop = match role.as_str() {
        "ends" => Stop::listen(Again::Ends),
        "waits" => Stop::listen_to_terminal(Again::Waits),
        _ => Stop::listen_to_parent(),
    };
    let stop = stop.unwrap();
    println!("listening");
    // Bounded, whatever becomes of the test.
    for _ in 0..60_000 {
        if stop.is_asked() {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    println!("asked");
    let mut line = String::new();
    let _ = std::io::stdin().read_line(&mut line);
}

struct Asked {
    process: Child,
    said: BufReader<std::process::ChildStdout>,
}

impl Asked {
    fn start(role: &str) -> Self {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "asked_process", "--nocapture"])
            .env("CLEARWAY_TEST_SIGNALS", role)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(process.stdout.take().unwrap());
        let mut asked = Self { process, said };
        asked.hear("listening");
        asked
    }

    fn hear(&mut self, word: &str) {
        let mut line = String::new();
        while !line.contains(word) {
            line.clear();
            assert_ne!(self.said.read_line(&mut line).unwrap(), 0, "{word:?} is not said");
        }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.process), signal).unwrap();
    }

    /// Lets it come to its end.
    fn status(mut self) -> Option<i32> {
        drop(self.process.stdin.take());
        self.process.wait().unwrap().code()
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_second_signal_ends_who_wants_it_and_leaves_the_others_time() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut patient = Asked::start("ends");
        patient.signal(signal);
        patient.hear("asked");
        assert_eq!(patient.status(), Some(0));
        let mut impatient = Asked::start("ends");
        impatient.signal(signal);
        impatient.hear("asked");
        impatient.signal(Signal::INT);
        assert_eq!(impatient.process.wait().unwrap().code(), Some(IMPATIENT));
    }
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let mut waits = Asked::start("waits");
        waits.signal(signal);
        waits.hear("asked");
        waits.signal(signal);
        assert_eq!(waits.status(), Some(0));
    }
}

#[test]
fn a_child_leaves_the_terminals_signal_to_its_parent() {
    let mut child = Asked::start("child");
    child.signal(Signal::INT);
    child.signal(Signal::TERM);
    child.hear("asked");
    assert_eq!(child.status(), Some(0));
}

#[test]
fn a_program_can_ask_itself() {
    let stop = Stop::default();
    let same = stop.clone();
    assert!(!stop.is_asked());
    same.ask();
    assert!(stop.is_asked());
}
