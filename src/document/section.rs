use super::Document;
use super::error::{ErrorKind, Problem};
use super::source::Place;
use super::suggest::nearest;
use super::tree::{Entry, Node, Table, Value};

/// A value that was read, and where it stands.
#[derive(Debug, Clone)]
pub(crate) struct Found<T> {
    pub(crate) value: T,
    pub(crate) place: Place,
}

/// A table that is being read. Asking for a key makes it known; [`Section::finish`] reports the
/// keys that nobody asked for. Problems go to the document, and the reading goes on.
pub(crate) struct Section<'d> {
    pub(super) doc: &'d Document,
    table: Option<&'d Table>,
    place: Place,
    path: String,
    known: Vec<&'static str>,
}

impl<'d> Section<'d> {
    pub(super) fn new(doc: &'d Document, table: Option<&'d Table>, place: Place, path: String) -> Self {
        Self { doc, table, place, path, known: Vec::new() }
    }

    /// Where the section starts: its header, or the top of the file.
    pub(crate) fn place(&self) -> &Place {
        &self.place
    }

    /// Its own path, `robot[2].start`; empty at the top.
    pub(crate) fn path(&self) -> &str {
        &self.path
    }

    /// A key of this section with the section's path.
    pub(crate) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    pub(super) fn entry(&mut self, key: &'static str) -> Option<&'d Entry> {
        self.known.push(key);
        self.table?.get(key)
    }

    /// Reads a key by `read`, which says what it wanted when it gets something else.
    pub(super) fn read<T>(
        &mut self,
        key: &'static str,
        read: impl FnOnce(&'d Node) -> Result<T, &'static str>,
    ) -> Option<Found<T>> {
        let node = &self.entry(key)?.node;
        match read(node) {
            Ok(value) => Some(Found { value, place: node.place.clone() }),
            Err(wanted) => {
                self.wrong_type(key, node, wanted);
                None
            }
        }
    }

    fn wrong_type(&self, key: &str, node: &Node, wanted: &str) {
        let (kind, found) = match &node.value {
            // The type is right and the value is none.
            Value::Float(x) if !x.is_finite() => (ErrorKind::OutOfRange, node.place.text()),
            Value::Integer(None) => (ErrorKind::OutOfRange, "beyond 64 bits"),
            value => (ErrorKind::WrongType, value.kind()),
        };
        let problem = Problem::new(kind, self.path_of(key), format!("has to be {wanted}, is {found}"));
        self.doc.report(problem.at(&node.place, "here").advise(format!("give {wanted}")));
    }

    /// A finite number; an integer is one too.
    pub(crate) fn number(&mut self, key: &'static str) -> Option<Found<f64>> {
        self.read(key, number)
    }

    /// An integer that is not negative.
    pub(crate) fn natural(&mut self, key: &'static str) -> Option<Found<u64>> {
        self.read(key, natural)
    }

    /// A string.
    pub(crate) fn text(&mut self, key: &'static str) -> Option<Found<String>> {
        self.read(key, text)
    }

    /// Two finite numbers, `[a, b]`.
    pub(crate) fn pair(&mut self, key: &'static str) -> Option<Found<[f64; 2]>> {
        let wanted = "two numbers, [a, b]";
        self.read(key, |node| match &node.value {
            Value::List(list) => match list.as_slice() {
                [a, b] => Ok([number(a).map_err(|_| wanted)?, number(b).map_err(|_| wanted)?]),
                _ => Err(wanted),
            },
            _ => Err(wanted),
        })
    }

    /// A list of integers that are not negative, each with its place.
    pub(crate) fn naturals(&mut self, key: &'static str) -> Option<Vec<Found<u64>>> {
        let wanted = "a list of integers that are not negative";
        let items = |node: &'d Node| match &node.value {
            Value::List(list) => list
                .iter()
                .map(|n| Ok(Found { value: natural(n).map_err(|_| wanted)?, place: n.place.clone() }))
                .collect(),
            _ => Err(wanted),
        };
        self.read(key, items).map(|found| found.value)
    }

    /// A table, `[key]` or `key = { … }`. An absent one reads as empty.
    pub(crate) fn section(&mut self, key: &'static str) -> Section<'d> {
        self.section_if_there(key)
            .unwrap_or_else(|| Section::new(self.doc, None, self.place.clone(), self.path_of(key)))
    }

    /// A table, or `None` when it is absent.
    pub(crate) fn section_if_there(&mut self, key: &'static str) -> Option<Section<'d>> {
        let found = self.read(key, |node| match &node.value {
            Value::Table(table) => Ok(table),
            _ => Err("a table"),
        })?;
        Some(Section::new(self.doc, Some(found.value), found.place, self.path_of(key)))
    }

    /// An array of tables, `[[key]]`.
    pub(crate) fn sections(&mut self, key: &'static str) -> Vec<Section<'d>> {
        let wanted = "an array of tables, [[…]]";
        let tables = |node: &'d Node| match &node.value {
            Value::List(list) => list
                .iter()
                .map(|n| match &n.value {
                    Value::Table(table) => Ok((table, &n.place)),
                    _ => Err(wanted),
                })
                .collect::<Result<Vec<_>, _>>(),
            _ => Err(wanted),
        };
        let found = self.read(key, tables).map_or(Vec::new(), |found| found.value);
        let section = |(i, (table, place)): (usize, (&'d Table, &Place))| {
            Section::new(self.doc, Some(table), place.clone(), format!("{}[{i}]", self.path_of(key)))
        };
        found.into_iter().enumerate().map(section).collect()
    }

    /// Reports `key` as missing, with an example of what to write, when it is not there.
    pub(crate) fn require<T>(&self, key: &str, found: Option<T>, example: &str) -> Option<T> {
        if found.is_none() && !self.table.is_some_and(|t| t.contains_key(key)) {
            let problem = Problem::new(ErrorKind::MissingKey, self.path_of(key), "is missing");
            self.doc.report(problem.at(&self.place, "in here").advise(format!("add {example}")));
        }
        found
    }

    /// Reports a value that is sound TOML and still not acceptable.
    pub(crate) fn refuse(&self, key: &str, place: &Place, message: &str, help: &str) {
        let problem = Problem::new(ErrorKind::OutOfRange, self.path_of(key), message);
        self.doc.report(problem.at(place, "here").advise(help));
    }

    /// Reads the key `schema`, which has to be `version`.
    pub(crate) fn check_schema(&mut self, version: u64) {
        let schema = self.natural("schema");
        let Some(schema) = self.require("schema", schema, &format!("schema = {version} at the top")) else {
            return;
        };
        if schema.value != version {
            let message =
                format!("version {} of the format is not known here, only {version} is", schema.value);
            self.refuse(
                "schema",
                &schema.place,
                &message,
                &format!("write schema = {version}, or update this program"),
            );
        }
    }

    /// Reports every key that was not asked for.
    pub(crate) fn finish(self) {
        let unknown = self.table.into_iter().flatten().filter(|(key, _)| !self.known.contains(&key.as_str()));
        for (key, entry) in unknown {
            let guess = nearest(key, self.known.iter().copied());
            let guess = guess.map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let help = format!("{guess}known here: {}", self.known.join(", "));
            let problem = Problem::new(ErrorKind::UnknownKey, self.path_of(key), "is not a known key");
            self.doc.report(problem.at(&entry.key, "unknown").advise(help));
        }
    }
}

fn number(node: &Node) -> Result<f64, &'static str> {
    match node.value {
        Value::Float(x) if x.is_finite() => Ok(x),
        // Settings and coordinates stay far below 2⁵³; what does not is out of every range anyway.
        Value::Integer(Some(n)) => Ok(n as f64),
        _ => Err("a finite number"),
    }
}

fn natural(node: &Node) -> Result<u64, &'static str> {
    let wanted = "an integer that is not negative";
    match node.value {
        Value::Integer(Some(n)) => u64::try_from(n).map_err(|_| wanted),
        _ => Err(wanted),
    }
}

fn text(node: &Node) -> Result<String, &'static str> {
    match &node.value {
        Value::Text(text) => Ok(text.clone()),
        // `--set fleet=7` needs no quotes either.
        Value::Integer(_) | Value::Float(_) | Value::Flag(_) if node.place.is_override() => {
            Ok(node.place.text().to_owned())
        }
        _ => Err("a string"),
    }
}
