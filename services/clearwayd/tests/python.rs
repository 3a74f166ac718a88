//! The tests of the Python package `services/clearway-py` against this daemon.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::path::Path;
use std::process::Command;

use support::python::python;

#[test]
fn the_python_package_passes_its_tests_with_this_daemon() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../clearway-py");
    let place = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let requirements = package.join("tests/requirements.txt");
    let Some(python) = python(place, "clearway-py-venv", &requirements) else { return };
    // Every test bounds its own time.
    let run = Command::new(python)
        .args([
            "-B",
            "-m",
            "unittest",
            "discover",
            "--top-level-directory",
            ".",
            "--start-directory",
            "tests",
        ])
        .current_dir(package)
        .env("CLEARWAYD", env!("CARGO_BIN_EXE_clearwayd"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{said}");
    // A suite that was not found passes as well.
    assert!(said.contains("Ran ") && !said.contains("Ran 0 tests"), "{said}");
}
