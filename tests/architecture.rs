//! The table of rooms in ARCHITECTURE.md against each room's Cargo.toml: no room imports more than the table says, and none is
//! missing in it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Of each room those that it imports.
type Rooms = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Names under `[dependencies]` of a Cargo.toml.
fn dependencies(manifest: &str) -> impl Iterator<Item = &str> {
    let lines = manifest
        .lines()
        .skip_while(|line| *line != "[dependencies]")
        .skip(1);
    lines
        .take_while(|line| !line.starts_with('['))
        .filter_map(|line| line.split(['.', ' ', '=']).next().filter(|name| !name.is_empty()))
}

fn manifest(room: &str) -> String {
    std::fs::read_to_string(root().join("src").join(room).join("Cargo.toml")).unwrap()
}

/// What the rooms' Cargo.toml say, tests apart.
fn imported() -> Rooms {
    let folders = std::fs::read_dir(root().join("src")).unwrap();
    let names = folders.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let rooms = names.map(|room| {
        let text = manifest(&room);
        let ours = dependencies(&text).filter_map(|name| name.strip_prefix("m4gn-"));
        let ours = ours.map(String::from).collect();
        (room, ours)
    });
    rooms.collect()
}

/// What the table says: rooms, or `ROOM and what it imports`, separated by commas. A room stands below those that it imports.
fn described(text: &str) -> Result<Rooms, String> {
    let mut rooms = Rooms::new();
    let section = text.split("\n## ").find(|part| part.starts_with("Rooms\n"));
    let section = section.ok_or("no section Rooms")?;
    for row in section.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let (name, words) = (cells[0].trim_matches('`'), cells[cells.len() - 1]);
        let mut imports = BTreeSet::new();
        for word in words.split(", ").filter(|word| *word != "nothing of ours") {
            let room = word.strip_suffix(" and what it imports");
            let above = rooms.get(room.unwrap_or(word));
            let above = above.ok_or(format!("{name}: `{word}` is no room above it"))?;
            if room.is_some() {
                imports.extend(above.iter().cloned());
            }
            imports.insert(room.unwrap_or(word).to_string());
        }
        rooms.insert(name.to_string(), imports);
    }
    Ok(rooms)
}

/// Where the two differ.
fn faults(described: &Rooms, imported: &Rooms) -> Vec<String> {
    let mut faults = Vec::new();
    for (room, imports) in imported {
        match described.get(room) {
            None => faults.push(format!("{room} is not in the table")),
            Some(may) => {
                let more = imports.difference(may);
                faults.extend(more.map(|other| format!("{room} imports {other}, the table does not say so")));
            }
        }
    }
    let gone = described.keys().filter(|room| !imported.contains_key(*room));
    faults.extend(gone.map(|room| format!("{room} is in the table and has no folder")));
    faults
}

#[test]
fn rooms_import_what_the_table_says() {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let found = faults(&described(&text).unwrap(), &imported());
    assert!(found.is_empty(), "ARCHITECTURE.md, Rooms: {found:#?}");
}

/// `libm4gn.so` is loaded by solvers: it has no charts, pages, progress bars or configuration files.
#[test]
fn what_the_solver_loads_draws_nothing() {
    let imported = imported();
    let mut inside = BTreeSet::from(["capi".to_string()]);
    let mut todo: Vec<String> = inside.iter().cloned().collect();
    while let Some(room) = todo.pop() {
        for other in &imported[&room] {
            if inside.insert(other.clone()) {
                todo.push(other.clone());
            }
        }
    }
    for room in &inside {
        let text = manifest(room);
        let found =
            dependencies(&text).find(|name| ["indicatif", "plotters", "png", "toml", "clap"].contains(name));
        assert!(
            found.is_none(),
            "{room} has {found:?} and is a part of libm4gn.so"
        );
    }
    for room in ["report", "train", "workbench", "cli"] {
        assert!(!inside.contains(room), "{room} is a part of libm4gn.so");
    }
}

#[test]
fn what_differs_is_named() {
    let table = |imports: &str| {
        let rows = ["| `mesh` | - | nothing of ours |", "| `model` | - | mesh |"];
        format!(
            "# A\n\n## Rooms\n\n{}\n| `step` | - | {imports} |\n\n## Next\n",
            rows.join("\n")
        )
    };
    let set = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<BTreeSet<_>>();
    let real = |step: &[&str]| {
        Rooms::from([
            ("mesh".into(), set(&[])),
            ("model".into(), set(&["mesh"])),
            ("step".into(), set(step)),
        ])
    };
    let whole = described(&table("model and what it imports")).unwrap();
    assert_eq!(whole["step"], set(&["mesh", "model"]));
    assert!(faults(&whole, &real(&["mesh", "model"])).is_empty());
    let part = described(&table("model")).unwrap();
    let found = faults(&part, &real(&["mesh", "model"]));
    assert_eq!(found, ["step imports mesh, the table does not say so"]);
    let mut more = real(&["model"]);
    more.insert("new".into(), set(&[]));
    assert_eq!(faults(&part, &more), ["new is not in the table"]);
    more.remove("new");
    more.remove("mesh");
    assert_eq!(faults(&part, &more), ["mesh is in the table and has no folder"]);
    assert!(
        described(&table("nowhere"))
            .unwrap_err()
            .contains("`nowhere` is no room")
    );
}
