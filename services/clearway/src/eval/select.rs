//! Which scenarios are meant.

use clearway::scenario::Scenario;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::path::Path;

/// Names as they are, folders as their scenario files in order of name, `suite` as its members.
pub(super) fn expand(names: &[String]) -> Result<Vec<String>> {
    let mut all = Vec::new();
    for name in names {
        if name == "suite" {
            all.extend(Scenario::suite());
        } else if Path::new(name).is_dir() {
            all.extend(files(name)?);
        } else {
            all.push(name.clone());
        }
    }
    Ok(all)
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
