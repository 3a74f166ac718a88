//! A Python with pinned packages for the tests that need one, made once below the target directory.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use super::process::skipped;

/// What pip says when it cannot reach the package index.
const UNREACHABLE: [&str; 5] = [
    "NewConnectionError",
    "ConnectTimeout",
    "ReadTimeout",
    "ProxyError",
    "Temporary failure in name resolution",
];

/// The interpreter of the virtual environment `name` below `place`, with the packages of the file
/// `requirements`. `None`, and said so, where Python, its `venv` or pip, or the package index is not there.
///
/// # Panics
/// When the packages are refused: a wrong pin is no reason to skip.
pub fn python(place: &Path, name: &str, requirements: &Path) -> Option<PathBuf> {
    static MAKING: Mutex<()> = Mutex::new(());
    let _one = MAKING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let wanted = std::fs::read_to_string(requirements).unwrap();
    let folder = place.join(name);
    let (program, made) = (folder.join("bin/python"), folder.join("made-for.txt"));
    if std::fs::read_to_string(&made).is_ok_and(|text| text == wanted) {
        return Some(program);
    }
    let check = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))";
    if let Err(reason) = run(Command::new("python3").args(["-c", check])) {
        skipped(name, &format!("python3 of version 3.10 or newer with venv and pip is not there: {reason}"));
        return None;
    }
    if let Err(reason) = run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder)) {
        skipped(name, &format!("no virtual environment: {reason}"));
        return None;
    }
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "2", "-r"];
    match run(Command::new(&program).args(pip).arg(requirements)) {
        Ok(()) => {
            std::fs::write(made, wanted).unwrap();
            Some(program)
        }
        Err(reason) if UNREACHABLE.iter().any(|word| reason.contains(word)) => {
            skipped(name, &format!("pip cannot reach the package index: {reason}"));
            None
        }
        Err(reason) => panic!("pip cannot install {}: {reason}", requirements.display()),
    }
}

fn run(command: &mut Command) -> Result<(), String> {
    let output = command.output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    if output.status.success() { Ok(()) } else { Err(said) }
}
