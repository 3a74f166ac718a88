//! `clearway figures` as a person runs it. How figures look is for people to judge.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of this test that is gone when it ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("clearway-figures-{name}-{}", std::process::id())))
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }

    /// Every file's name and text.
    fn files(&self) -> BTreeMap<String, String> {
        let entries = std::fs::read_dir(&self.0).unwrap().map(|entry| entry.unwrap().path());
        entries
            .map(|path| {
                let name = path.file_name().unwrap().to_str().unwrap().to_owned();
                (name, std::fs::read_to_string(path).unwrap())
            })
            .collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn figures(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_clearway")).arg("figures").args(args).current_dir(root).output().unwrap()
}

fn texts(svg: &str) -> Vec<String> {
    let tree = roxmltree::Document::parse(svg).unwrap();
    let words = tree.descendants().filter(|node| node.has_tag_name("text"));
    words.filter_map(|node| Some(node.text()?.trim().to_owned())).collect()
}

const LAWS: [&str; 3] = ["certified (finite time)", "exp (exponential)", "paper (as printed)"];

#[test]
fn every_figure_is_there_with_its_axes_and_legend_and_the_same_bytes_every_time() {
    let (first, second) = (Folder::new("first"), Folder::new("second"));
    let output = figures(&["--out", first.path(), "--seeds", "3", "--data", "--jobs", "1"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(figures(&["--out", second.path(), "--seeds", "3", "--data", "--jobs", "3"]).status.success());
    let files = first.files();
    assert_eq!(files, second.files());

    let mut expected: Vec<(String, Vec<&str>)> = vec![
        ("fig1-trajectories-exp".into(), vec!["x [m]", "y [m]", "start", "goal", "all headings 0"]),
        ("fig2-trajectories-certified".into(), vec!["x [m]", "y [m]", "every 0.5 s"]),
        ("fig2-trajectories-paper".into(), vec!["x [m]", "y [m]", "bodies collide"]),
        ("fig3-inputs".into(), vec!["time [s]", "mean v [m/s]", "mean ω [rad/s]", "mean |ω| [rad/s]"]),
        ("fig4-distance".into(), vec!["time [s]", "mean distance to goal [m]", "tolerance"]),
        ("clearance".into(), vec!["time [s]", "smallest clearance [m]", "required"]),
        ("lyapunov".into(), vec!["time [s]", "largest V = ½d² [m²]", "bound (14)"]),
    ];
    for (name, words) in &mut expected[3..] {
        words.extend(LAWS);
        if name.starts_with("fig") {
            words.push("80 % of the runs");
        }
    }
    for scenario in ["swap8", "swap8-zero", "swap8-heading-0"] {
        expected.push((format!("timelapse-{scenario}"), vec!["x [m]", "t = 0.00 s"]));
    }
    for (name, words) in &expected {
        let texts = texts(&files[&format!("{name}.svg")]);
        for word in words {
            assert!(texts.iter().any(|text| text == word), "{name}: {word} in {texts:?}");
        }
        let csv = &files[&format!("{name}.csv")];
        assert!(csv.starts_with("panel,series,x_axis,y_axis,x,y\n") && csv.lines().count() > 50, "{name}");
    }
    // Only the printed law collides.
    for name in ["fig1-trajectories-exp", "fig2-trajectories-certified"] {
        let texts = texts(&files[&format!("{name}.svg")]);
        assert!(!texts.iter().any(|text| text == "bodies collide" || text == "gap too small"), "{name}");
    }
    // Every period of the first run of each case under each law.
    for scenario in ["swap8", "swap8-zero", "swap8-heading-0"] {
        for law in ["certified", "exp", "paper"] {
            let run = &files[&format!("run-{scenario}-{law}.csv")];
            let rows: Vec<Vec<f64>> = run
                .lines()
                .skip(1)
                .map(|row| row.split(',').map(|cell| cell.parse().unwrap()).collect())
                .collect();
            assert_eq!(rows.len() % 8, 0);
            assert!(rows.iter().all(|row| row.len() == 10 && row.iter().all(|x| x.is_finite())));
            let least = rows.iter().map(|row| row[9]).fold(f64::INFINITY, f64::min);
            assert_eq!(least < 0.0, law == "paper", "{scenario} {law}: {least}");
            // At the end everybody is inside the tolerance: V = ½ε².
            assert!(rows[rows.len() - 8..].iter().all(|row| row[7] <= 0.5 * 0.05 * 0.05));
        }
    }
    assert_eq!(files.len(), 2 * expected.len() + 3 + 9, "{:?}", files.keys());
    for (name, text) in files.iter().filter(|(_, text)| text.starts_with("<svg")) {
        assert!(text.len() < 300_000 && !text.contains("NaN"), "{name}: {} bytes", text.len());
    }
}

#[test]
fn an_animation_has_a_time_for_every_value() {
    let folder = Folder::new("animated");
    assert!(figures(&["--out", folder.path(), "--scenario", "swap8"]).status.success());
    let svg = &folder.files()["timelapse-swap8-animated.svg"];
    let tree = roxmltree::Document::parse(svg).unwrap();
    let moving =
        tree.descendants().filter(|n| n.has_tag_name("animateTransform") || n.has_tag_name("animate"));
    let (mut robots, mut marks) = (0, 0);
    for node in moving {
        let list = |name: &str| node.attribute(name).unwrap().split(';').collect::<Vec<_>>();
        let times: Vec<f64> = list("keyTimes").iter().map(|t| t.parse().unwrap()).collect();
        assert_eq!(times.len(), list("values").len());
        assert!(times[0] == 0.0 && times.is_sorted() && times.iter().all(|t| *t <= 1.0), "{times:?}");
        if node.has_tag_name("animate") {
            marks += 1;
        } else {
            robots += 1;
            assert_eq!(times.last(), Some(&1.0));
        }
    }
    // Eight robots under two laws, each moved and turned; every pair meets under the printed one.
    assert_eq!((robots, marks), (32, 28));
}

#[test]
fn a_scenario_of_ones_own_is_drawn_with_its_obstacles() {
    let folder = Folder::new("own");
    let output =
        figures(&["--out", folder.path(), "--scenario", "docs/examples/crossing.toml", "--timing", "ideal"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let files = folder.files();
    assert!(files.contains_key("timelapse-crossing.svg"), "{:?}", files.keys());
    let texts = texts(&files["fig2-trajectories-certified.svg"]);
    assert!(texts.iter().any(|text| text == "crossing"), "{texts:?}");
}

#[test]
fn wrong_arguments_name_the_remedy() {
    let folder = Folder::new("wrong");
    for (args, words) in [
        (vec!["--out", folder.path(), "--scenario", "swap9"], "did you mean"),
        (vec!["--out", folder.path(), "--set", "controller.profile=exp"], "every figure shows all"),
        (vec!["--out", folder.path(), "--set", "controller.gama=1"], "did you mean `gamma`"),
        (vec!["--out", folder.path(), "--scenario", "swap8", "--scenario", "swap8"], "the same name"),
        (vec!["--out", "/proc/nowhere"], "/proc/nowhere cannot be made"),
        (vec![], "--out"),
    ] {
        let output = figures(&args);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {error}");
        assert!(error.contains(words), "{args:?}: {error}");
    }
}
