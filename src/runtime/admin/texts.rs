//! Texts that are longer than one answer: whoever reads one piece by piece goes on with the text that it
//! began with, whatever becomes of the fleet meanwhile.

use std::sync::Arc;

use crate::wire::AdminKind;

/// What the texts that are being read may take together, bytes, beside the one that was begun last.
const READ_BYTES: usize = 64 << 20;
/// A reader that has not asked for the next piece for so long is taken to be gone, ns.
const GONE_NS: u64 = 60_000_000_000;

/// The newest text of each kind, and those that clients are in the middle of.
#[derive(Debug, Default)]
pub(super) struct Texts {
    newest: Vec<(AdminKind, u64, Arc<[u8]>)>,
    /// The one that was asked for longest ago first.
    reading: Vec<Reading>,
}

#[derive(Debug)]
struct Reading {
    client: u128,
    kind: AdminKind,
    text: Arc<[u8]>,
    asked_ns: u64,
}

impl Texts {
    /// The text that was made of what is `version` by now.
    pub(super) fn newest(&self, kind: AdminKind, version: u64) -> Option<Arc<[u8]>> {
        let found = self.newest.iter().find(|(of, at, _)| (*of, *at) == (kind, version));
        found.map(|(_, _, text)| Arc::clone(text))
    }

    /// Remembers the text that was made of `version`.
    pub(super) fn keep(&mut self, kind: AdminKind, version: u64, text: String) -> Arc<[u8]> {
        let text: Arc<[u8]> = text.into_bytes().into();
        self.newest.retain(|(of, _, _)| *of != kind);
        self.newest.push((kind, version, Arc::clone(&text)));
        text
    }

    /// A client has got the beginning of `text` and will ask for more.
    pub(super) fn begin(&mut self, client: u128, kind: AdminKind, text: Arc<[u8]>, now_ns: u64) {
        self.end(client, kind);
        self.reading.retain(|one| now_ns.saturating_sub(one.asked_ns) < GONE_NS);
        let mut bytes: usize = self.reading.iter().map(|one| one.text.len()).sum();
        while bytes > READ_BYTES {
            bytes -= self.reading.remove(0).text.len();
        }
        self.reading.push(Reading { client, kind, text, asked_ns: now_ns });
    }

    /// The text that a client is in the middle of; `None` when it has to begin again.
    pub(super) fn go_on(&mut self, client: u128, kind: AdminKind, now_ns: u64) -> Option<Arc<[u8]>> {
        let at = self.reading.iter().position(|one| (one.client, one.kind) == (client, kind))?;
        let one = Reading { asked_ns: now_ns, ..self.reading.remove(at) };
        let text = Arc::clone(&one.text);
        self.reading.push(one);
        Some(text)
    }

    /// A client has the whole text, or wants another one.
    pub(super) fn end(&mut self, client: u128, kind: AdminKind) {
        self.reading.retain(|one| (one.client, one.kind) != (client, kind));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use AdminKind::{Configuration, Scenario};

    #[test]
    fn each_reader_goes_on_with_the_text_that_it_began_with() {
        let mut texts = Texts::default();
        assert!(texts.newest(Scenario, 0).is_none() && texts.go_on(1, Scenario, 0).is_none());
        let first = texts.keep(Scenario, 0, "first".into());
        texts.begin(1, Scenario, first, 0);
        assert!(texts.newest(Scenario, 1).is_none(), "the fleet has changed");
        let second = texts.keep(Scenario, 1, "second".into());
        texts.begin(2, Scenario, second, 0);
        let read = |texts: &mut Texts, client| {
            texts.go_on(client, Scenario, 1).map(|text| String::from_utf8_lossy(&text).into_owned())
        };
        assert_eq!(read(&mut texts, 1).as_deref(), Some("first"));
        assert_eq!(read(&mut texts, 2).as_deref(), Some("second"));
        assert!(texts.go_on(1, Configuration, 1).is_none());
        texts.end(1, Scenario);
        assert_eq!((read(&mut texts, 1), read(&mut texts, 2).as_deref()), (None, Some("second")));
        // Who has gone leaves nothing behind.
        texts.begin(3, Scenario, Arc::from([0; 4]), GONE_NS + 1);
        assert_eq!((read(&mut texts, 2), texts.reading.len()), (None, 1));
    }

    #[test]
    fn what_is_read_is_bounded_and_who_asked_longest_ago_begins_again() {
        let mut texts = Texts::default();
        let long: Arc<[u8]> = vec![0; READ_BYTES / 2].into();
        for client in 0..6 {
            texts.begin(client, Scenario, Arc::clone(&long), 0);
            texts.go_on(0, Scenario, 0);
        }
        assert!(texts.reading.len() <= 3);
        assert!(texts.go_on(0, Scenario, 0).is_some() && texts.go_on(5, Scenario, 0).is_some());
        assert!(texts.go_on(1, Scenario, 0).is_none());
    }
}
