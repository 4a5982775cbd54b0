//! Entries are said in one place: those of the core in its settings structs, those that OpenFOAM's classes read in the table of the
//! class's header. The tables of docs/, the C header and the classes' headers are made of them. `M4GN_WRITE_TABLES=1` writes them.
//!
//! A table stands between a line with `[table SOURCE...]` and one with `[end]`. A source is the name of a struct's table or of a class;
//! `-entry` leaves one out.

mod tree;

use m4gn_base::settings::table::{Entry, Table};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use tree::{files, read};

/// A row as the tables have it; texts with their code in backticks.
#[derive(Clone, Debug)]
struct Row {
    name: String,
    text: String,
    /// Empty: no.
    required: String,
    default: String,
    /// As JSON: of an entry of the core.
    json: String,
}

/// The form of a file's tables.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Page,
    Foam,
    C,
}

/// The texts of all files below these folders with one of these endings.
fn texts(folders: &[&str], endings: &[&str]) -> BTreeMap<PathBuf, String> {
    let files = files(folders, endings).into_iter();
    files.map(|path| (path.clone(), read(path))).collect()
}

fn classes() -> BTreeMap<PathBuf, String> {
    texts(&["openfoam"], &["H"])
}

/// `distance_scale` as a dictionary has it.
fn camel(name: &str) -> String {
    let mut parts = name.split('_');
    let first = parts.next().unwrap_or_default().to_string();
    parts.fold(first, |all, part| all + &part[..1].to_uppercase() + &part[1..])
}

/// `distanceScale` as JSON has it; a word in capitals stays.
fn snake(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        match c.is_ascii_uppercase() && text.ends_with(|before: char| before.is_ascii_lowercase()) {
            true => text += &format!("_{}", c.to_ascii_lowercase()),
            false => text.push(c),
        }
    }
    text
}

/// The pieces of a text in backticks, changed.
fn code(text: &str, change: impl Fn(&str) -> String) -> String {
    let piece = |(i, piece): (usize, &str)| if i % 2 == 1 { change(piece) } else { piece.to_string() };
    text.split('`').enumerate().map(piece).collect()
}

/// A default as a dictionary has it.
fn in_dictionary(value: &Value) -> String {
    match value {
        Value::Bool(yes) => if *yes { "yes" } else { "no" }.into(),
        Value::Null | Value::Object(_) => String::new(),
        Value::String(word) => word.clone(),
        Value::Array(all) if all.is_empty() => String::new(),
        Value::Array(all) => {
            format!("({})", all.iter().map(in_dictionary).collect::<Vec<_>>().join(" "))
        }
        Value::Number(n) => n.to_string().trim_end_matches(".0").to_string(),
    }
}

fn row_of_core(entry: &Entry) -> Row {
    let unit = if entry.unit.is_empty() { String::new() } else { format!(" [{}]", entry.unit) };
    let default = entry.default.as_ref().map(in_dictionary).filter(|d| !d.is_empty());
    let default = default.map(|d| format!("`{d}`"));
    Row {
        name: camel(entry.name),
        text: entry.text.trim_end_matches('.').to_string() + &unit,
        required: if entry.default.is_none() { "yes".into() } else { String::new() },
        default: entry.shown.map(String::from).or(default).unwrap_or_default(),
        json: entry.default.as_ref().map_or("required".into(), |d| d.to_string().replace(',', ", ")),
    }
}

/// `\c word` as a page has it.
fn in_backticks(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once("\\c ") {
        let end = match after.starts_with('(') {
            true => after.find(')').map_or(after.len(), |i| i + 1),
            false => {
                let word = &after[..after.find([' ', ',', ';', ':']).unwrap_or(after.len())];
                // A bracket that the word has not opened closes one of the text.
                word.strip_suffix(')').filter(|inner| !inner.contains('(')).unwrap_or(word).len()
            }
        };
        out += &format!("{before}`{}`", &after[..end]);
        rest = &after[end..];
    }
    out + rest
}

/// A text without its references to classes, which a page's reader does not see.
fn without_classes(text: &str) -> String {
    let mut pieces = text.split(", see Foam::");
    let first = pieces.next().unwrap_or_default().to_string();
    pieces.fold(first, |all, piece| all + piece.trim_start_matches(|c: char| c.is_ascii_alphanumeric()))
}

/// The rows of a class's own table, which begins with `Property`.
fn rows_of_class(text: &str) -> Vec<Row> {
    let own = text.split("[table ").next().unwrap_or_default();
    let Some((_, rest)) = own.split_once("Property ") else {
        return Vec::new();
    };
    let lines = rest.lines().skip(1).take_while(|line| !line.contains("\\endtable"));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [name, text, required, default] = cells[..] else {
            panic!("expected Property | Description | Required | Default: {line}");
        };
        let word = |d: &str| d.starts_with(['(', '{']) || !d.contains(' ');
        let default = match default {
            "" => String::new(),
            d if d.contains("\\c ") || !word(d) => in_backticks(d),
            d => format!("`{d}`"),
        };
        let required = if required == "no" { String::new() } else { required.to_string() };
        Row { name: name.into(), text: in_backticks(text), required, default, json: String::new() }
    };
    lines.map(row).collect()
}

/// The class's name that a header is called by.
fn class(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().into_owned()
}

/// The rows that the sources of a marker name.
fn rows(sources: &str, tables: &[Table], classes: &BTreeMap<PathBuf, String>) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for word in sources.split_whitespace() {
        if let Some(name) = word.strip_prefix('-') {
            let place = rows.iter().rposition(|row| row.name == name);
            rows.remove(
                place.unwrap_or_else(|| panic!("[table {sources}]: there is no {name} to leave out")),
            );
        } else if let Some(table) = tables.iter().find(|t| t.name == word) {
            rows.extend(table.entries.iter().map(row_of_core));
        } else {
            let found = classes.iter().find(|(path, _)| class(path) == word);
            let (_, text) = found.unwrap_or_else(|| panic!("[table {sources}]: there is no table {word}"));
            rows.extend(rows_of_class(text));
        }
    }
    rows
}

/// Words of a text in lines of this width.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().unwrap();
        if line.is_empty() {
            *line = word.into();
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            *line += &format!(" {word}");
        } else {
            lines.push(word.into());
        }
    }
    lines
}

fn written(rows: &[Row], form: Form) -> String {
    let mut out = String::new();
    match form {
        Form::Page => {
            out += "| entry | meaning | default |\n| --- | --- | --- |\n";
            for row in rows {
                let default = match row.required.as_str() {
                    "" => row.default.clone(),
                    "yes" => "required".into(),
                    when => format!("required {when}"),
                };
                out += &format!("| `{}` | {} | {default} |\n", row.name, without_classes(&row.text));
            }
        }
        Form::Foam => {
            out += "    \\table\n        Property | Description | Required | Default\n";
            for row in rows {
                let required = if row.required.is_empty() { "no" } else { &row.required };
                let word = |c: &str| if c.contains(' ') { c.to_string() } else { format!("\\c {c}") };
                let (text, default) = (code(&row.text, word), code(&row.default, |c| c.into()));
                let line = format!("{} | {text} | {required} | {default}", row.name);
                out += &format!("        {}\n", line.trim_end());
            }
            out += "    \\endtable\n";
        }
        Form::C => {
            let wide = |of: fn(&Row) -> usize, least| rows.iter().map(of).max().unwrap_or(0).max(least) + 2;
            let name = wide(|row| snake(&row.name).len(), 4);
            let default = wide(|row| row.json.len(), 7);
            out += &format!(" *   {:name$}{:default$}meaning\n", "name", "default");
            for row in rows {
                let shown = match row.default.is_empty() || row.default.starts_with('`') && row.json != "null"
                {
                    true => String::new(),
                    false => format!("; {}: {}", row.json, row.default),
                };
                let text = code(&format!("{}{shown}", row.text), snake);
                let text = text.replace("(dictionary)", "(object)").replace("(dictionaries)", "(objects)");
                let indent = format!(" *   {:w$}", "", w = name + default);
                let first = format!(" *   {:name$}{:default$}", snake(&row.name), row.json);
                for (i, line) in wrapped(&text, 128 - indent.len()).iter().enumerate() {
                    out += &format!("{}{line}\n", if i == 0 { &first } else { &indent });
                }
            }
        }
    }
    out
}

/// A file with its tables made anew, and the sources that they name.
fn anew(
    text: &str,
    form: Form,
    tables: &[Table],
    classes: &BTreeMap<PathBuf, String>,
) -> (String, Vec<String>) {
    let (mut out, mut sources, mut inside) = (String::new(), Vec::new(), false);
    for line in text.split_inclusive('\n') {
        inside &= !line.contains("[end]");
        if !inside {
            out += line;
        }
        if let Some((_, marker)) = line.split_once("[table ") {
            let named = marker.split(']').next().unwrap();
            out += &written(&rows(named, tables, classes), form);
            sources.extend(named.split_whitespace().map(String::from));
            inside = true;
        }
    }
    assert!(!inside, "a [table ...] without [end]");
    (out, sources)
}

#[test]
fn tables_are_those_of_the_settings() {
    let (tables, classes) = (m4gn::tables(), classes());
    let write = std::env::var_os("M4GN_WRITE_TABLES").is_some();
    let (mut stale, mut named) = (Vec::new(), BTreeMap::<&str, BTreeSet<String>>::new());
    for (ending, form) in [("md", Form::Page), ("H", Form::Foam), ("h", Form::C)] {
        for (path, text) in texts(&["docs", "openfoam", "cpp"], &[ending]) {
            let (found, sources) = anew(&text, form, &tables, &classes);
            named.entry(ending).or_default().extend(sources);
            if found != text && write {
                fs::write(&path, found).unwrap();
            } else if found != text {
                stale.push(path);
            }
        }
    }
    assert!(stale.is_empty(), "M4GN_WRITE_TABLES=1 writes the tables of {stale:?} anew");
    let core: BTreeSet<String> = tables.iter().map(|t| t.name.to_string()).collect();
    let missing: Vec<_> = core.difference(&named["h"]).collect();
    assert!(missing.is_empty(), "the C header lacks the tables {missing:?}");
    let own = classes.iter().filter(|(_, text)| !rows_of_class(text).is_empty());
    let all: BTreeSet<String> = own.map(|(path, _)| class(path)).chain(core).collect();
    // Not for dictionaries
    let others = ["modes".into(), "segments_request".into()].into();
    let missing: Vec<_> = all.difference(&(&named["md"] | &others)).cloned().collect();
    assert!(missing.is_empty(), "docs/ lacks the tables {missing:?}");
}

/// Entries of the dictionary that stand in tables, made or not.
fn documented() -> BTreeSet<String> {
    let text = read("docs/reference/dictionary.md");
    let (mut entries, mut table) = (BTreeSet::new(), false);
    for line in text.lines() {
        match line.strip_prefix('|').and_then(|rest| rest.split('|').next()) {
            None => table = false,
            Some(first) if first.contains("entry") => table = true,
            Some(first) if table => entries.extend(first.split('`').skip(1).step_by(2).map(String::from)),
            Some(_) => {}
        }
    }
    entries
}

#[test]
fn entries_that_classes_take_are_documented() {
    let documented = documented();
    assert!(documented.len() > 80, "{documented:?}");
    let mut taken = BTreeSet::new();
    // What OpenFOAM reads of any function object is listed beside the check of keys.
    let own = |path: &PathBuf| class(path) != "m4gnDictionary";
    for (path, text) in texts(&["openfoam"], &["C", "H"]).into_iter().filter(|(path, _)| own(path)) {
        for list in
            ["checkKeys(", "Keys_ =", "Keys_.append(", "eys() const {", "eys() {", "eys()\n{", "keys({"]
        {
            for rest in text.split(list).skip(1) {
                let list = rest.split([';', '}']).next().unwrap();
                let names = list.split('"').skip(1).step_by(2);
                taken.extend(names.map(|name| (name.to_string(), class(&path))));
            }
        }
    }
    // Of a material, which stand in the text; OpenFOAM's own
    let others = ["E", "nu", "mu", "K", "rho", "planeStress", "writePrecision", "writeToFile", "useUserTime"];
    let known = |name: &String| documented.contains(name) || others.contains(&name.as_str());
    let missing: Vec<_> = taken.iter().filter(|(name, _)| !known(name)).collect();
    assert!(taken.len() > 50, "{taken:?}");
    assert!(missing.is_empty(), "docs/reference/dictionary.md lacks {missing:?}");
}

#[test]
fn entries_of_classes_are_read_with_the_default_that_is_documented() {
    let code = texts(&["openfoam"], &["C"]);
    let all: String = code.values().cloned().collect();
    let mut compared = 0;
    for (path, header) in classes() {
        for row in rows_of_class(&header) {
            let quoted = format!("\"{}\"", row.name);
            assert!(all.contains(&quoted), "{}: nothing reads {}", path.display(), row.name);
            // Where the class reads it itself, whatever others of this name are.
            let own = code.iter().find(|(p, text)| class(p) == class(&path) && text.contains(&quoted));
            let found = literals(own.map_or(&all, |(_, text)| text), &quoted);
            let default = row.default.trim_matches('`').to_string();
            compared += usize::from(!found.is_empty());
            // A sentence says what no literal does.
            let sentence = default.contains(' ') && default.starts_with(char::is_alphabetic);
            let said = sentence
                || found.is_empty()
                || found.iter().any(|f| default == *f || default.starts_with(&format!("{f},")));
            assert!(
                said,
                "{}: {} is {default} in the table and {found:?} in the code",
                path.display(),
                row.name
            );
        }
    }
    assert!(compared > 15, "{compared}");
}

/// Literal defaults of an entry: `getOrDefault<type>("name", LITERAL)`.
fn literals(code: &str, quoted: &str) -> Vec<String> {
    let calls = code.split("OrDefault<").skip(1).filter_map(|rest| {
        let (_, arguments) = rest.split_once(">(")?;
        let default = arguments.strip_prefix(quoted)?.strip_prefix(',')?.trim_start();
        let literal = match default.strip_prefix('"') {
            Some(text) => text.split('"').next()?,
            None => default.split([')', ',']).next()?,
        };
        match literal {
            "true" => Some("yes".to_string()),
            "false" => Some("no".to_string()),
            number if number.parse::<f64>().is_ok() || default.starts_with('"') => Some(number.to_string()),
            _ => None,
        }
    });
    calls.collect()
}
