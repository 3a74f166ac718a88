//! Whatever stands in a file, reading it ends in a value or in an error that can be shown.

use clearway::config::Config;
use clearway::document::ConfigError;
use clearway::scenario::Scenario;
use miette::{JSONReportHandler, NarratableReportHandler};
use proptest::prelude::*;

const CONFIG: &str = include_str!("../docs/examples/clearway.toml");
const SCENARIO: &str = include_str!("../docs/examples/crossing.toml");

/// Shows the error in every way there is; the first line carries a place or a reason.
fn show(error: &ConfigError) {
    let mut text = String::new();
    NarratableReportHandler::new().render_report(&mut text, error).unwrap();
    JSONReportHandler::new().render_report(&mut text, error).unwrap();
    for problem in error.problems() {
        assert!(!problem.message().is_empty() && !problem.to_string().contains('\n'), "{problem}");
    }
    assert!(!text.is_empty());
}

fn read(text: &str) {
    if let Err(error) = Scenario::parse(text, "s.toml") {
        show(&error);
    }
    if let Err(error) = Config::parse(text, "c.toml") {
        show(&error);
    }
}

/// Both examples with a few bytes replaced, removed or repeated, cut to valid UTF-8.
fn mutated() -> impl Strategy<Value = String> {
    let edit = (any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..4_u8, any::<char>());
    let base = prop::sample::select(vec![CONFIG, SCENARIO]);
    (base, prop::collection::vec(edit, 1..8)).prop_map(|(base, edits)| {
        let mut chars: Vec<char> = base.chars().collect();
        for (at, length, kind, char) in edits {
            let at = at.index(chars.len());
            let until = (at + length.index(40)).min(chars.len());
            match kind {
                0 => drop(chars.drain(at..until)),
                1 => chars.insert(at, char),
                2 => chars[at] = "=[]{}\"'\n.,#-+e09"[..].chars().nth(length.index(16)).unwrap_or('#'),
                _ => {
                    let copy: Vec<char> = chars[at..until].to_vec();
                    chars.splice(at..at, copy);
                }
            }
            if chars.is_empty() {
                break;
            }
        }
        chars.into_iter().collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn mutated_files_never_panic(text in mutated()) {
        read(&text);
    }

    #[test]
    fn arbitrary_text_never_panics(text in "\\PC*") {
        read(&text);
    }

    #[test]
    fn arbitrary_overrides_never_panic(text in ".*", value in ".*") {
        for argument in [text.clone(), format!("timing.{text}={value}"), format!("scenario={value}.toml")] {
            if let Err(error) = Config::with_overrides(None, &[argument]) {
                let mut shown = String::new();
                NarratableReportHandler::new().render_report(&mut shown, &error).unwrap();
            }
        }
    }
}

#[test]
fn truncated_files_never_panic() {
    for base in [CONFIG, SCENARIO] {
        for end in (0..base.len()).filter(|&end| base.is_char_boundary(end)) {
            read(&base[..end]);
        }
    }
}

#[test]
fn deep_nesting_is_an_error_and_not_a_stack_overflow() {
    read(&format!("schema = {}", "[".repeat(200_000)));
    read(&format!("schema{} = 1", ".a".repeat(100_000)));
    read(&format!("schema = {}1{}", "{a=".repeat(50_000), "}".repeat(50_000)));
}

#[test]
fn a_file_full_of_mistakes_is_reported_briefly() {
    let text = (0..100_000).map(|i| format!("k{i} = 1\n")).collect::<Vec<_>>().concat();
    let error = Scenario::parse(&text, "s.toml").unwrap_err();
    assert_eq!(error.problems().count(), 20);
    let text = format!("schema = 1\nname = \"x\"\n\"new\\nline{}\" = 1\n", "y".repeat(1 << 20));
    let error = Scenario::parse(&text, "s.toml").unwrap_err().to_string();
    assert!(error.len() < 1000 && error.contains("new\\nline") && !error.contains('\n'), "{error}");
}
