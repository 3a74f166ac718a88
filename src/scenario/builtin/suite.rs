//! The suite: the built-in scenarios that a control law is held to.

/// Seeds of each random family.
const SEEDS: u64 = 50;

/// The names of the suite, family by family.
pub(crate) fn names() -> Vec<String> {
    let mut names: Vec<String> = ["swap8", "swap8-zero"].map(str::to_owned).into();
    names.extend((0..100).map(|seed| format!("swap8-heading-{seed}")));
    let mut counts = |stem: &str, counts: &[u32]| names.extend(counts.iter().map(|n| format!("{stem}-{n}")));
    counts("circle", &[2, 3, 4, 10, 20, 50, 100, 200]);
    counts("rows", &[4, 6, 10, 16, 24]);
    counts("columns", &[4, 6, 10, 16, 24]);
    counts("parked-wall", &[3, 5, 9, 15]);
    counts("parked-wall-wide", &[3, 5, 9, 15]);
    counts("doorway", &[1, 2, 4, 6, 8, 12]);
    counts("doorway-both", &[2, 4, 6, 8, 12]);
    counts("pillars", &[2, 4, 8, 12, 16]);
    names.extend(["head-on", "head-on-parked"].map(str::to_owned));
    for robots in [8, 20, 40, 100] {
        names.extend((0..SEEDS).map(|seed| format!("random-{robots}-{seed}")));
    }
    names
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_name_of_the_suite_is_built_in_and_listed_once() {
        let names = super::names();
        let unique: std::collections::BTreeSet<&String> = names.iter().collect();
        assert_eq!(unique.len(), names.len());
        for name in &names {
            crate::scenario::Scenario::builtin(name).unwrap();
        }
    }
}
