//! Which scenarios are meant.

use clearway::scenario::Scenario;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::path::Path;

/// Seeds that one range may name.
const SEEDS_MAX: u64 = 100_000;

/// Names as they are, folders as their scenario files in order of name, `suite` as its members.
pub(super) fn expand(names: &[String]) -> Result<Vec<String>> {
    let mut all = Vec::new();
    for name in names {
        if name == "suite" {
            all.extend(Scenario::suite());
        } else if let Some((stem, first, last)) = seeds(name) {
            if first > last || last - first >= SEEDS_MAX {
                let help = format!("write {stem}-A..B with A at most B, up to {SEEDS_MAX} seeds");
                return Err(miette!(help = help, "{name} is no range of seeds"));
            }
            all.extend((first..=last).map(|seed| format!("{stem}-{seed}")));
        } else if Path::new(name).is_dir() {
            all.extend(files(name)?);
        } else {
            all.push(name.clone());
        }
    }
    Ok(all)
}

/// Stem, first and last seed of `random-20-0..49`; both ends are meant.
fn seeds(name: &str) -> Option<(&str, u64, u64)> {
    let (first, last) = name.split_once("..")?;
    let (stem, first) = first.rsplit_once('-')?;
    Some((stem, first.parse().ok()?, last.parse().ok()?))
}

/// The scenario files of a folder.
fn files(folder: &str) -> Result<Vec<String>> {
    let listed = || -> std::io::Result<Vec<String>> {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|ending| ending == "toml") && path.is_file() {
                files.push(path.to_string_lossy().into_owned());
            }
        }
        files.sort();
        Ok(files)
    };
    let files = listed().into_diagnostic().wrap_err_with(|| format!("{folder} cannot be listed"))?;
    if files.is_empty() {
        let help = "name a folder that holds scenario files";
        return Err(miette!(help = help, "{folder} has no .toml file"));
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::expand;

    fn names(given: &str) -> Vec<String> {
        expand(&[given.to_owned()]).unwrap()
    }

    #[test]
    fn a_range_of_seeds_is_its_members() {
        assert_eq!(names("random-8-3..5"), ["random-8-3", "random-8-4", "random-8-5"]);
        assert_eq!(names("swap8-heading-7..7"), ["swap8-heading-7"]);
        // What is no range is a name, and has to be one.
        for name in ["swap8", "../mine.toml", "circle-2..x"] {
            assert_eq!(names(name), [name]);
        }
        for name in ["random-8-5..3", "random-8-0..100000"] {
            let error = expand(&[name.to_owned()]).unwrap_err();
            assert!(error.to_string().contains(name) && error.help().is_some(), "{error:?}");
        }
    }
}
