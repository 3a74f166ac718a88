use std::io::Read;

use miette::{IntoDiagnostic, WrapErr, miette};

/// A robot and where it is to go, m.
type Goal = (u32, f64, f64);

/// Goals from a file, or from standard input for `-`: a robot's id and its goal, m, on each line.
pub(super) fn read(file: &str) -> miette::Result<Vec<Goal>> {
    let mut text = String::new();
    let read = if file == "-" {
        std::io::stdin().read_to_string(&mut text).map(|_| ())
    } else {
        std::fs::read_to_string(file).map(|all| text = all)
    };
    read.into_diagnostic().wrap_err_with(|| format!("{file} cannot be read"))?;
    let goals = parse(&text).map_err(|(line, problem)| miette!("{file}:{line}: {problem}"))?;
    if goals.is_empty() {
        return Err(miette!(help = "write a line `ID X Y` for each robot", "{file} holds no goal"));
    }
    Ok(goals)
}

/// # Errors
/// The line, from 1, and what is wrong with it.
fn parse(text: &str) -> Result<Vec<Goal>, (usize, String)> {
    let mut goals = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = content.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty()).collect();
        let goal = match words[..] {
            [] => continue,
            [id, x, y] => id.parse().ok().zip(x.parse().ok().zip(y.parse().ok())),
            _ => None,
        };
        let Some((id, (x, y))) = goal else {
            return Err((
                index + 1,
                format!("`{}` is not a robot's id and its goal, x and y in m", line.trim()),
            ));
        };
        goals.push((id, x, y));
    }
    Ok(goals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_remarks_and_mistakes() {
        let text = "# night shift\n0 4 -1.5\n\n 3,2e1;-7 # the far corner\n";
        assert_eq!(parse(text), Ok(vec![(0, 4.0, -1.5), (3, 20.0, -7.0)]));
        for (text, line) in [("0 1\n", 1), ("0 1 2\n1 2 3 4\n", 2), ("\n\n-1 2 3\n", 3), ("a 1 2", 1)] {
            assert_eq!(parse(text).unwrap_err().0, line, "{text:?}");
        }
    }
}
