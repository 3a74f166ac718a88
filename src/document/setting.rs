use super::error::{ErrorKind, Problem};
use super::section::Section;
use super::source::Place;
use super::suggest::nearest;
use super::tree::Value;
use std::fmt::Display;
use std::ops::{Bound, RangeBounds, RangeInclusive};

/// A setting that was asked for: what its documentation has to say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Asked {
    /// The key with its path.
    pub(crate) key: String,
    /// The values it takes.
    pub(crate) range: String,
    /// What it is when it is left out.
    pub(crate) default: String,
    /// The value before the document is read, as TOML; `None`: nothing, and what then happens is in
    /// `default`.
    pub(crate) value: Option<String>,
}

/// A choice that is written by name.
pub(crate) trait Named: Copy + 'static {
    /// Every choice.
    const ALL: &'static [Self];

    /// Its name.
    fn name(self) -> &'static str;
}

/// Settings with a default: `target` holds it and is replaced when the key is there and sound. Each
/// returns where the value stands, for rules that concern two of them.
impl Section<'_> {
    fn asked(&self, key: &str, range: &str, default: &dyn Display, value: Option<String>) {
        let (key, range, default) = (self.path_of(key), range.to_owned(), default.to_string());
        self.doc.asked(Asked { key, range, default, value });
    }

    fn out_of_range(&self, key: &str, place: &Place, range: &str) {
        let message = format!("has to be {range}, is {}", place.text());
        let problem = Problem::new(ErrorKind::OutOfRange, self.path_of(key), message);
        self.doc.report(problem.at(place, "out of range").advise(format!("give a value {range}")));
    }

    /// A number inside `range`.
    pub(crate) fn set_number(
        &mut self,
        key: &'static str,
        target: &mut f64,
        range: impl RangeBounds<f64>,
    ) -> Option<Place> {
        let words = in_words(&range);
        self.asked(key, &words, target, Some(format!("{target:?}")));
        let found = self.number(key)?;
        if !range.contains(&found.value) {
            self.out_of_range(key, &found.place, &words);
            return None;
        }
        *target = found.value;
        Some(found.place)
    }

    /// An integer inside `range`, which has to fit `T`.
    pub(crate) fn set_integer<T: TryFrom<u64> + Display>(
        &mut self,
        key: &'static str,
        target: &mut T,
        range: RangeInclusive<u64>,
    ) -> Option<Place> {
        self.asked(key, &in_words(&range), target, Some(target.to_string()));
        let (value, place) = self.integer_in(key, &range)?;
        *target = T::try_from(value).ok()?;
        Some(place)
    }

    /// An integer that may be left out; `default` says what then happens.
    pub(crate) fn set_integer_or<T: TryFrom<u64> + Display>(
        &mut self,
        key: &'static str,
        target: &mut Option<T>,
        range: RangeInclusive<u64>,
        default: &str,
    ) -> Option<Place> {
        self.asked(key, &in_words(&range), &default, target.as_ref().map(T::to_string));
        let (value, place) = self.integer_in(key, &range)?;
        *target = Some(T::try_from(value).ok()?);
        Some(place)
    }

    /// A time in µs, inside `range_us`, kept in ns.
    pub(crate) fn set_micros(
        &mut self,
        key: &'static str,
        target_ns: &mut u64,
        range_us: RangeInclusive<u64>,
    ) -> Option<Place> {
        let mut us = *target_ns / 1000;
        let place = self.set_integer(key, &mut us, range_us)?;
        *target_ns = us.saturating_mul(1000);
        Some(place)
    }

    /// A time in s, inside `range_s`, kept in ns.
    pub(crate) fn set_seconds(
        &mut self,
        key: &'static str,
        target_ns: &mut u64,
        range_s: RangeInclusive<u64>,
    ) -> Option<Place> {
        let mut s = *target_ns / 1_000_000_000;
        let place = self.set_integer(key, &mut s, range_s)?;
        *target_ns = s.saturating_mul(1_000_000_000);
        Some(place)
    }

    /// A time in µs that may be left out, kept in ns.
    pub(crate) fn set_micros_or(
        &mut self,
        key: &'static str,
        target_ns: &mut Option<u64>,
        range_us: RangeInclusive<u64>,
        default: &str,
    ) -> Option<Place> {
        let mut us = target_ns.map(|ns| ns / 1000);
        let place = self.set_integer_or::<u64>(key, &mut us, range_us, default)?;
        *target_ns = us.map(|us| us.saturating_mul(1000));
        Some(place)
    }

    /// Yes or no.
    pub(crate) fn set_flag(&mut self, key: &'static str, target: &mut bool) -> Option<Place> {
        self.asked(key, "true or false", target, Some(target.to_string()));
        let found = self.read(key, |node| match node.value {
            Value::Flag(flag) => Ok(flag),
            _ => Err("true or false"),
        })?;
        *target = found.value;
        Some(found.place)
    }

    /// One of the names of `T`.
    pub(crate) fn set_choice<T: Named>(&mut self, key: &'static str, target: &mut T) -> Option<Place> {
        let names: Vec<&str> = T::ALL.iter().map(|choice| choice.name()).collect();
        let listed = names.join(", ");
        self.asked(key, &listed, &target.name(), Some(quoted(target.name())));
        let found = self.text(key)?;
        let Some(choice) = T::ALL.iter().find(|choice| choice.name() == found.value) else {
            let guess = nearest(&found.value, names.iter().copied());
            let guess = guess.map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let problem = Problem::new(
                ErrorKind::UnknownName,
                self.path_of(key),
                format!("`{}` is not one of {listed}", found.value),
            );
            self.doc.report(
                problem.at(&found.place, "unknown name").advise(format!("{guess}choose one of {listed}")),
            );
            return None;
        };
        *target = *choice;
        Some(found.place)
    }

    /// Different integers inside `range`.
    pub(crate) fn set_distinct(
        &mut self,
        key: &'static str,
        target: &mut Vec<usize>,
        range: RangeInclusive<u64>,
        default: &str,
    ) {
        let value = (!target.is_empty()).then(|| format!("{target:?}"));
        self.asked(key, &format!("a list of different integers {}", in_words(&range)), &default, value);
        let Some(found) = self.naturals(key) else { return };
        target.clear();
        for (i, item) in found.iter().enumerate() {
            if !range.contains(&item.value) {
                self.out_of_range(key, &item.place, &in_words(&range));
            }
            if let Some(first) = found[..i].iter().find(|earlier| earlier.value == item.value) {
                let message = format!("{} is listed twice", item.value);
                let problem = Problem::new(ErrorKind::Contradiction, self.path_of(key), message);
                self.doc.report(
                    problem
                        .at(&item.place, "again")
                        .at(&first.place, "first here")
                        .advise("remove one of them"),
                );
            }
            target.extend(usize::try_from(item.value));
        }
    }

    fn integer_in(&mut self, key: &'static str, range: &RangeInclusive<u64>) -> Option<(u64, Place)> {
        let found = self.natural(key)?;
        if !range.contains(&found.value) {
            self.out_of_range(key, &found.place, &in_words(range));
            return None;
        }
        Some((found.value, found.place))
    }
}

/// A text as TOML.
pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A range as it is written in messages and in the documentation.
fn in_words<T: Display>(range: &impl RangeBounds<T>) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Included(a), Bound::Included(b)) => format!("from {a} to {b}"),
        (Bound::Excluded(a), Bound::Included(b)) => format!("above {a} and at most {b}"),
        (Bound::Included(a), Bound::Excluded(b)) => format!("at least {a} and below {b}"),
        (Bound::Excluded(a), Bound::Excluded(b)) => format!("above {a} and below {b}"),
        (Bound::Included(a), Bound::Unbounded) => format!("at least {a}"),
        (Bound::Excluded(a), Bound::Unbounded) => format!("above {a}"),
        (Bound::Unbounded, Bound::Included(b)) => format!("at most {b}"),
        (Bound::Unbounded, Bound::Excluded(b)) => format!("below {b}"),
        (Bound::Unbounded, Bound::Unbounded) => "any".to_owned(),
    }
}
