//! TOML files that are another file but for some entries.
//!
//! `base = "other.toml"` names the other file, from the folder of the one that says so. Of its table what the list `remove` names is
//! taken out, such as `macro` or `training.noise.D`; then the file's own entries are put in, tables into tables.

use m4gn_base::{Error, Result, files};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The file's content, with that of its bases.
///
/// # Errors
/// [`Error::File`] naming the file that cannot be read or is no TOML, a base that is not there or leads back to the file, and an entry
/// that `T` does not have.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = text(path)?;
    match parse(path, &text)?.contains_key("base") {
        // Its messages have the line
        false => toml::from_str(&text).map_err(|e| wrong(path, &e)),
        true => {
            let (table, bases) = with_bases(path, &mut Vec::new())?;
            let bases: Vec<_> = bases.iter().map(|b| b.display().to_string()).collect();
            T::deserialize(Value::Table(table)).map_err(|e| {
                wrong(path, &format!("with its base {}: {}", bases.join(", "), e.to_string().trim()))
            })
        }
    }
}

/// The file's table, with those of its bases.
///
/// # Errors
/// As [`read`].
pub fn table(path: &Path) -> Result<Table> {
    Ok(with_bases(path, &mut Vec::new())?.0)
}

/// Entries of `from` in place of those of `to`, tables within tables.
pub fn merge(to: &mut Table, from: &Table) {
    for (key, value) in from {
        match (to.get_mut(key), value) {
            (Some(Value::Table(to)), Value::Table(from)) => merge(to, from),
            _ => {
                to.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Takes out a key such as `model.layers`; false where it is not there.
pub fn remove(table: &mut Table, key: &str) -> bool {
    match key.split_once('.') {
        None => table.remove(key).is_some(),
        Some((first, rest)) => {
            table.get_mut(first).and_then(Value::as_table_mut).is_some_and(|inner| remove(inner, rest))
        }
    }
}

/// The table, and the files that it is based on. `above`: the files that are based on this one.
fn with_bases(path: &Path, above: &mut Vec<PathBuf>) -> Result<(Table, Vec<PathBuf>)> {
    let mut own = parse(path, &text(path)?)?;
    let Some(base) = own.remove("base") else { return Ok((own, Vec::new())) };
    let base = base.as_str().ok_or_else(|| wrong(path, "base: expected the path of a file"))?;
    let file = path.parent().unwrap_or(Path::new("")).join(base);
    let found =
        file.canonicalize().map_err(|e| wrong(path, &format!("base \"{base}\" cannot be read: {e}")))?;
    above.push(path.canonicalize().unwrap_or_else(|_| path.to_path_buf()));
    if above.contains(&found) {
        return Err(wrong(path, &format!("base \"{base}\" is itself based on this file")));
    }
    let (mut table, mut bases) = with_bases(&file, above)?;
    let names: Vec<String> = match own.remove("remove") {
        None => Vec::new(),
        Some(names) => names.try_into().map_err(|_| wrong(path, "remove: expected a list of keys"))?,
    };
    if let Some(name) = names.iter().find(|name| !remove(&mut table, name)) {
        return Err(wrong(path, &format!("remove: there is no {name} in the base \"{base}\"")));
    }
    merge(&mut table, &own);
    bases.insert(0, file);
    Ok((table, bases))
}

fn text(path: &Path) -> Result<String> {
    files::read_text(path).map_err(|e| wrong(path, &format!("cannot be read: {e}")))
}

fn parse(path: &Path, text: &str) -> Result<Table> {
    text.parse().map_err(|e: toml::de::Error| wrong(path, &e))
}

fn wrong(path: &Path, message: &(impl ToString + ?Sized)) -> Error {
    Error::file(path, message.to_string().trim())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Settings {
        #[allow(dead_code)]
        a: Table,
        #[allow(dead_code)]
        b: Option<u64>,
    }

    /// Files of one folder, and the message for the first one.
    fn message(files: &[(&str, &str)]) -> String {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            std::fs::create_dir_all(dir.path().join(name).parent().unwrap()).unwrap();
            std::fs::write(dir.path().join(name), text).unwrap();
        }
        read::<Settings>(&dir.path().join(files[0].0)).unwrap_err().to_string()
    }

    #[test]
    fn tables_merge_and_other_entries_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
        std::fs::create_dir(dir.path().join("in")).unwrap();
        put("root.toml", "b = 1\n[a]\nx = 1\ny = [1, 2]\nz = { u = 1, v = 2 }\n[a.w]\nk = 1\n");
        put("in/middle.toml", "base = \"../root.toml\"\n[a]\ny = [3]\nz = { u = 3 }\n");
        put(
            "in/top.toml",
            "base = \"middle.toml\"\nremove = [\"a.w\", \"a.z.v\", \"b\"]\n[a]\nx = 4\nw = { n = 1 }\n",
        );
        let expected = "[a]\nx = 4\ny = [3]\nz = { u = 3 }\nw = { n = 1 }\n".parse::<Table>().unwrap();
        let top = dir.path().join("in/top.toml");
        assert_eq!(table(&top).unwrap(), expected);
        assert_eq!(Value::Table(read::<Settings>(&top).unwrap().a), expected["a"]);
    }

    #[test]
    fn what_is_wrong_is_said_with_the_file() {
        let base = |text| ("b.toml", text);
        for (files, expected) in [
            (vec![("t.toml", "base = \"t.toml\"")], "t.toml: base \"t.toml\" is itself based on this file"),
            (
                vec![("t.toml", "base = \"b.toml\""), base("base = \"./t.toml\"")],
                "b.toml: base \"./t.toml\" is itself based",
            ),
            (vec![("t.toml", "base = \"b.toml\"")], "t.toml: base \"b.toml\" cannot be read: No such file"),
            (vec![("t.toml", "base = 3")], "t.toml: base: expected the path of a file"),
            (vec![("t.toml", "base = \"b.toml\""), base("a = ")], "b.toml: TOML parse error at line 1"),
            (vec![("t.toml", "base = \"b.toml\""), base("[a]\n[c]")], "b.toml: unknown field `c`"),
            (
                vec![("t.toml", "base = \"b.toml\"\nremove = [\"a.x\"]"), base("[a]")],
                "t.toml: remove: there is no a.x",
            ),
            (
                vec![("t.toml", "base = \"b.toml\"\nremove = 1"), base("[a]")],
                "t.toml: remove: expected a list",
            ),
            (vec![("t.toml", "remove = [\"a\"]\n[a]")], "unknown field `remove`"),
            (vec![("t.toml", "[a]\n[c]")], "line 2"),
        ] {
            let found = message(&files);
            assert!(found.contains(expected), "{expected}: {found}");
        }
    }
}
