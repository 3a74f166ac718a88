//! Every class of mistake in a scenario file names its line, its key and the remedy.

use clearway::document::{ErrorKind, Problem};
use clearway::scenario::Scenario;
use miette::Diagnostic;

/// A sound scenario; each case replaces one line of it.
const SOUND: &str = r#"schema = 1
name = "pair"
tolerance_m = 0.05
duration_s = 30.0
[limits]
v_mps = [0.0, 5.0]
omega_radps = [-1.0, 1.0]
safety_margin_m = 0.15
[[robot]]
id = 4
radius_m = 0.15
start = { x_m = -4.0, y_m = 0.0, theta_rad = 0.0 }
goal = { x_m = 4.0, y_m = 0.0 }
[[robot]]
id = 2
radius_m = 0.15
start = { x_m = 4.0, y_m = 0.0 }
goal = { x_m = -4.0, y_m = 0.0 }
[[obstacle]]
circle = { x_m = 0.0, y_m = 0.0, radius_m = 0.5 }
[[obstacle]]
segment = { from_m = [0.0, 1.0], to_m = [0.0, 2.0] }
"#;

fn problems(text: &str) -> Vec<Problem> {
    match Scenario::parse(text, "pair.toml") {
        Ok(scenario) => panic!("accepted: {scenario:?}"),
        Err(error) => error.problems().cloned().collect(),
    }
}

/// Replaces `line` (from 1) of the sound scenario.
fn with_line(line: usize, by: &str) -> String {
    let replaced = SOUND.lines().enumerate().map(|(i, old)| if i + 1 == line { by } else { old });
    replaced.collect::<Vec<_>>().join("\n")
}

#[test]
fn the_sound_scenario_is_read_sorted_and_complete() {
    let s = Scenario::parse(SOUND, "pair.toml").unwrap();
    assert_eq!(s.robots.iter().map(|r| r.id.0).collect::<Vec<_>>(), [2, 4]);
    assert!((s.robots[0].start.theta_rad - std::f64::consts::PI).abs() < 1e-15, "toward the goal");
    assert_eq!((s.robots.len(), s.obstacles.len()), (2, 2));
}

#[test]
#[allow(clippy::too_many_lines)] // A table.
fn one_changed_line_gives_its_line_key_and_remedy() {
    use ErrorKind::{Contradiction, MissingKey, OutOfRange, Syntax, UnknownKey, WrongType};
    // Line, what stands there, kind, key, part of the message, part of the help.
    let cases = [
        (1, "", MissingKey, "schema", "is missing", "schema = 1"),
        (1, "schema = 2", OutOfRange, "schema", "version 2", "schema = 1"),
        (1, "schema = \"1\"", WrongType, "schema", "is a string", "an integer"),
        (2, "", MissingKey, "name", "is missing", "name = "),
        (2, "name = \"\"", OutOfRange, "name", "1 to 64 bytes", "short name"),
        (2, "name = pair", Syntax, "", "string", "double quotes"),
        (3, "tolerance_m = -0.1", OutOfRange, "tolerance_m", "above 0", "range"),
        (3, "tolerance_m = nan", OutOfRange, "tolerance_m", "finite number, is ", "finite"),
        (3, "tolerence_m = 0.1", UnknownKey, "tolerence_m", "not a known key", "did you mean `tolerance_m`?"),
        (4, "duration_s = 0", OutOfRange, "duration_s", "above 0", "range"),
        (4, "name = \"twice\"", Syntax, "", "duplicate key", "TOML"),
        (6, "v_mps = [1.0, 5.0]", OutOfRange, "limits.v_mps", "could not stop", "at most 0"),
        (6, "v_mps = [5.0, 0.0]", OutOfRange, "limits.v_mps", "could not stop", "smallest value first"),
        (6, "v_mps = [0.0, 0.0]", OutOfRange, "limits.v_mps", "no robot could move", "above 0"),
        (6, "v_mps = [0.0, inf]", WrongType, "limits.v_mps", "two numbers", "[a, b]"),
        (6, "v_mps = 5.0", WrongType, "limits.v_mps", "two numbers", "[a, b]"),
        (7, "omega_radps = [0.1, 1.0]", OutOfRange, "limits.omega_radps", "does not contain 0", "at most 0"),
        (8, "safety_margin_m = -0.15", OutOfRange, "limits.safety_margin_m", "at least 0", "range"),
        (8, "margin_m = 0.15", UnknownKey, "limits.margin_m", "not a known key", "known here: v_mps"),
        (10, "id = 2", Contradiction, "robot[1].id", "two robots have the id 2", "an id of its own"),
        (10, "id = -1", WrongType, "robot[0].id", "not negative", "not negative"),
        (10, "id = 4294967296", OutOfRange, "robot[0].id", "32 bits", "from 0"),
        (10, "id = 99999999999999999999", OutOfRange, "robot[0].id", "beyond 64 bits", "integer"),
        (10, "", MissingKey, "robot[0].id", "is missing", "id = 0"),
        (11, "radius_m = -0.15", OutOfRange, "robot[0].radius_m", "above 0", "range"),
        (11, "radius_m = \"15 cm\"", WrongType, "robot[0].radius_m", "is a string", "a finite number"),
        (12, "start = { x_m = -4.0 }", MissingKey, "robot[0].start.y_m", "is missing", "y_m = 0.0"),
        (12, "start = [-4.0, 0.0]", WrongType, "robot[0].start", "is a list", "a table"),
        (
            12,
            "start = { x_m = 1e9, y_m = 0 }",
            OutOfRange,
            "robot[0].start",
            "x has to be at least -100000",
            "range",
        ),
        (
            12,
            "start = { x_m = -4, y_m = 0, theta_rad = 90.0 }",
            OutOfRange,
            "robot[0].start.theta_rad",
            "more than one turn",
            "not degrees",
        ),
        (
            12,
            "start = { x_m = 3.9, y_m = 0.0 }",
            Contradiction,
            "robot[1].start",
            "the starts of robots 2 and 4 are 0.100 m apart",
            "at least 0.450 m",
        ),
        (
            13,
            "goal = { x_m = 0, y_m = 0.6 }",
            Contradiction,
            "robot[0].goal",
            "0.600 m from obstacle 0",
            "0.800 m",
        ),
        (13, "gaol = { x_m = 4, y_m = 0 }", MissingKey, "robot[0].goal", "is missing", "goal = {"),
        (
            18,
            "goal = { x_m = 3.7, y_m = 0.2 }",
            Contradiction,
            "robot[1].goal",
            "the goals",
            "at least 0.450 m",
        ),
        (20, "", MissingKey, "obstacle[0].circle", "is missing", "or segment = {"),
        (
            20,
            "circle = { x_m = 0, y_m = 0, radius_m = -1 }",
            OutOfRange,
            "obstacle[0].circle",
            "radius_m has to be at least 0",
            "range",
        ),
        (
            22,
            "segment = { from_m = [0, 1], to_m = [0] }",
            WrongType,
            "obstacle[1].segment.to_m",
            "two",
            "[a, b]",
        ),
    ];
    for (line, text, kind, key, message, help) in cases {
        let problems = problems(&with_line(line, text));
        let found = &problems[0];
        let context = format!("line {line} `{text}`: {found}");
        assert_eq!((found.kind(), found.key()), (kind, key), "{context}");
        assert!(found.message().contains(message), "{context}");
        let advice = found.help().unwrap_or_else(|| panic!("no help: {context}")).to_string();
        assert!(advice.contains(help), "{context}: {advice}");
        // What is missing is reported where its section starts; of two robots, the later one.
        let at = match (kind, line) {
            (MissingKey, 1 | 2) => 1,
            (MissingKey, 10 | 13) => 9,
            (MissingKey, 20) => 19,
            (Contradiction, 10) => 15,
            (Contradiction, 12) => 17,
            _ => line,
        };
        assert_eq!(found.line(), Some(at), "{context}");
        assert!(found.to_string().starts_with(&format!("pair.toml:{at}: ")), "{context}");
    }
}

#[test]
fn overlaps_point_at_both_places() {
    let error = Scenario::parse(&with_line(12, "start = { x_m = 3.9, y_m = 0.0 }"), "pair.toml").unwrap_err();
    let labels: Vec<_> = error.labels().unwrap().map(|l| l.label().unwrap().to_owned()).collect();
    assert_eq!(labels, ["too close", "to this"]);
}

#[test]
fn several_mistakes_are_reported_together_in_order() {
    let text = SOUND.replace("tolerance_m", "tolerance").replace("id = 2\n", "id = true\n");
    let found: Vec<_> = problems(&text).iter().map(|p| (p.line().unwrap(), p.key().to_owned())).collect();
    assert_eq!(found, [(3, "tolerance".to_owned()), (15, "robot[1].id".to_owned())]);
    let error = Scenario::parse(&text, "pair.toml").unwrap_err();
    assert!(error.to_string().ends_with("(and one more problem)"), "{error}");
    assert_eq!(error.related().unwrap().count(), 1);
}

#[test]
fn a_fleet_is_neither_empty_nor_endless() {
    let empty = problems("schema = 1\nname = \"none\"\n");
    assert_eq!(empty[0].message(), "the fleet is empty");
    let robot = |i: usize| {
        format!("[[robot]]\nid={i}\nradius_m=0.1\nstart={{x_m={i},y_m=0}}\ngoal={{x_m={i},y_m=0}}\n")
    };
    let many: String = (0..=Scenario::MAX_ROBOTS).map(robot).collect();
    let many = problems(&format!("schema = 1\nname = \"many\"\n{many}"));
    assert_eq!((many.len(), many[0].kind()), (1, ErrorKind::TooLarge));
}

#[test]
fn files_that_cannot_be_read_say_why() {
    let missing = Scenario::resolve("no/such/file.toml").unwrap_err();
    assert_eq!(missing.kind(), ErrorKind::Unreadable);
    assert!(missing.to_string().starts_with("no/such/file.toml: cannot be read: "), "{missing}");

    let dir = std::env::temp_dir().join(format!("clearway-scenario-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = dir.join(name);
        std::fs::write(&path, bytes).unwrap();
        Scenario::load(&path).unwrap_err()
    };
    let latin = write("latin.toml", b"schema = 1\nname = \"caf\xe9\"\n");
    assert!(latin.to_string().ends_with("cannot be read: line 2 is not UTF-8"), "{latin}");
    let large = write("large.toml", &vec![b'#'; (4 << 20) + 1]);
    assert_eq!(large.kind(), ErrorKind::TooLarge);
    assert_eq!(Scenario::load(&dir).unwrap_err().kind(), ErrorKind::Unreadable);
    std::fs::remove_dir_all(&dir).unwrap();
}

#[test]
fn the_example_in_the_documentation_is_sound() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/examples/crossing.toml");
    let s = Scenario::resolve(path).unwrap();
    assert_eq!((s.name.as_str(), s.robots.len(), s.obstacles.len()), ("crossing", 3, 2));
}
