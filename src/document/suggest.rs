/// Longer words are no misspelling of anything, and comparing them costs memory.
const WORD_MAX: usize = 64;

/// The candidate that `word` is most likely a misspelling of: at most a third of it differs.
pub(crate) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .filter(|c| *c != word && word.len() <= WORD_MAX)
        .map(|c| (strsim::damerau_levenshtein(word, c), c))
        .filter(|&(distance, c)| distance <= 1.max(word.len().max(c.len()) / 3))
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, c)| c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_words_are_suggested_and_far_ones_are_not() {
        let keys = ["radius_m", "start", "goal", "id"];
        assert_eq!(nearest("radius", keys.into_iter()), Some("radius_m"));
        assert_eq!(nearest("gaol", keys.into_iter()), Some("goal"));
        assert_eq!(nearest("colour", keys.into_iter()), None);
    }
}
