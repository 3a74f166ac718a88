use super::error::{ConfigError, ErrorKind, Problem};
use super::source::{OVERRIDE, Place, Source};
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::de::{DeTable, DeValue};

/// A value and where it stands.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) value: Value,
    pub(super) place: Place,
}

/// A TOML value. Numbers keep what was written apart: `5` is an integer, `5.0` is not.
#[derive(Debug, Clone)]
pub(super) enum Value {
    Text(String),
    /// `None` when it does not fit 64 bits with a sign.
    Integer(Option<i64>),
    Float(f64),
    Flag(bool),
    Time,
    List(Vec<Node>),
    Table(Table),
}

impl Value {
    /// What it is, with its article.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "a string",
            Self::Integer(_) => "an integer",
            Self::Float(_) => "a number",
            Self::Flag(_) => "a boolean",
            Self::Time => "a date or time",
            Self::List(_) => "a list",
            Self::Table(_) => "a table",
        }
    }
}

/// A key's place and its value.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) key: Place,
    pub(super) node: Node,
}

pub(super) type Table = BTreeMap<String, Entry>;

/// The tree of a TOML text.
pub(super) fn parse(source: &Source) -> Result<Table, ConfigError> {
    match DeTable::parse(source.inner()) {
        Ok(table) => Ok(read_table(table.get_ref(), source)),
        Err(error) => {
            let place = Place::new(source, error.span().unwrap_or(0..0));
            Err(Problem::new(ErrorKind::Syntax, "", error.message().replace('\n', ", "))
                .at(&place, "here")
                .advise("write TOML: `key = value` on a line of its own, text in double quotes, sections as [name]")
                .into())
        }
    }
}

/// Puts `newer` over `older`: tables are merged, everything else is replaced.
pub(super) fn overlay(older: &mut Table, newer: Table) {
    for (key, entry) in newer {
        match (older.get_mut(&key).map(|e| &mut e.node.value), entry.node.value) {
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            (_, value) => {
                older.insert(key, Entry { key: entry.key, node: Node { value, place: entry.node.place } });
            }
        }
    }
}

fn read_table(table: &DeTable<'_>, source: &Source) -> Table {
    let entry = |(key, value): (&toml::Spanned<_>, &toml::Spanned<DeValue<'_>>)| {
        let name: &std::borrow::Cow<'_, str> = key.get_ref();
        let entry = Entry {
            key: Place::new(source, key.span()),
            node: Node {
                value: read_value(value.get_ref(), source),
                place: Place::new(source, value.span()),
            },
        };
        (name.clone().into_owned(), entry)
    };
    table.iter().map(entry).collect()
}

fn read_value(value: &DeValue<'_>, source: &Source) -> Value {
    match value {
        DeValue::String(text) => Value::Text(text.clone().into_owned()),
        DeValue::Integer(n) => Value::Integer(i64::from_str_radix(n.as_str(), n.radix()).ok()),
        DeValue::Float(x) => Value::Float(x.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(flag) => Value::Flag(*flag),
        DeValue::Datetime(_) => Value::Time,
        DeValue::Array(list) => {
            let node = |item: &toml::Spanned<DeValue<'_>>| Node {
                value: read_value(item.get_ref(), source),
                place: Place::new(source, item.span()),
            };
            Value::List(list.iter().map(node).collect())
        }
        DeValue::Table(table) => Value::Table(read_table(table, source)),
    }
}

/// The tree of one `--set` argument, `section.key=value`. A value that is not TOML is a string, so
/// that names need no quotes on a command line.
pub(super) fn parse_override(argument: &str) -> Result<Table, ConfigError> {
    let source = |text: String| -> Source { Arc::new(miette::NamedSource::new(OVERRIDE, text)) };
    let given = source(argument.to_owned());
    let Some((key, value)) = argument.split_once('=') else {
        return Err(Problem::new(ErrorKind::Syntax, argument, "there is no `=`")
            .of(OVERRIDE)
            .advise("write it as --set section.key=value")
            .into());
    };
    if argument.contains('\n') {
        return Err(Problem::new(ErrorKind::Syntax, key, "more than one line")
            .of(OVERRIDE)
            .advise("give one --set for each key")
            .into());
    }
    parse(&given).or_else(|problem| {
        let quoted = toml::Value::String(value.trim().to_owned());
        parse(&source(format!("{key}={quoted}"))).map_err(|_| problem)
    })
}
