//! Findings for people, in 80 columns.

use std::fmt::Write;

use textwrap::Options;

use super::Diagnosis;
use super::finding::{Finding, Status};

const COLUMNS: usize = 80;
const NAME_COLUMNS: usize = 20;

pub(super) fn text(diagnosis: &Diagnosis) -> String {
    let mut out = String::new();
    for finding in &diagnosis.findings {
        entry(&mut out, finding);
    }
    let d = diagnosis;
    let verdict = match d.exit_code {
        0 if d.warnings == 0 => "Nothing stands in the way of real time.",
        0 => "Real time is possible; the warnings make it late now and then.",
        1 => "Real time is not possible until the failures are dealt with.",
        _ => "Not everything could be examined.",
    };
    let counts =
        format!("{} ok, {} warnings, {} failures, {} not examined", d.ok, d.warnings, d.failures, d.unknown);
    // Writing to a string cannot fail.
    let _ = write!(out, "\n{counts}\n{verdict}\n");
    out
}

fn entry(out: &mut String, finding: &Finding) {
    let head = format!("{:<7} {:<NAME_COLUMNS$}", finding.status.name(), finding.name);
    let indent = " ".repeat(head.chars().count());
    paragraph(out, &head, &indent, &finding.value);
    if finding.status != Status::Ok {
        paragraph(out, "          ", "          ", &finding.why);
        paragraph(out, "        → ", "          ", &finding.remedy);
    }
}

fn paragraph(out: &mut String, first: &str, rest: &str, text: &str) {
    // Commands are to be copied: no hyphen is put in or broken at.
    let options = Options::new(COLUMNS)
        .initial_indent(first)
        .subsequent_indent(rest)
        .break_words(false)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    for line in textwrap::wrap(text, options) {
        let _ = writeln!(out, "{}", line.trim_end());
    }
}
