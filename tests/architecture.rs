//! What ARCHITECTURE.md says of the rooms is what the build lets them import.

use super::tree::{files, read, root};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

type Rooms = BTreeMap<String, BTreeSet<String>>;

fn names(text: &str, separators: &[char]) -> BTreeSet<String> {
    let words = text.split(separators).map(str::trim).filter(|w| !w.is_empty());
    words.map(str::to_owned).collect()
}

/// The table below a heading of ARCHITECTURE.md: its first column against its last, in which `ROOM and what it imports` is short for
/// a room above and its own list.
fn table(text: &str, heading: &str) -> Rooms {
    let (_, rest) = text.split_once(&format!("\n{heading}\n")).expect(heading);
    let section = rest.split("\n## ").next().unwrap();
    let mut rooms = Rooms::new();
    for row in section.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        let mut imports = names(cells[cells.len() - 1].trim(), &[',']);
        imports.remove("nothing of ours");
        for word in imports.clone() {
            if let Some(room) = word.strip_suffix(" and what it imports") {
                imports.remove(&word);
                imports.insert(room.into());
                imports.extend(rooms[room].iter().cloned());
            }
        }
        rooms.insert(cells[0].trim().trim_matches('`').into(), imports);
    }
    rooms
}

/// What stands between two pieces of a text; nothing where the first does not occur.
fn between<'a>(text: &'a str, start: &str, end: &str) -> &'a str {
    let Some((_, rest)) = text.split_once(start) else {
        return "";
    };
    rest.split_once(end).expect(end).0
}

/// Names under `[dependencies]` of the Cargo.toml of a room in src/.
fn dependencies(room: &str) -> BTreeSet<String> {
    let text = read(format!("src/{room}/Cargo.toml"));
    let (_, rest) = text.split_once("\n[dependencies]\n").unwrap_or_default();
    let lines = rest.lines().take_while(|line| !line.starts_with('['));
    let first = lines.filter_map(|line| line.split(['.', ' ', '=']).next());
    first.filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

/// What the Cargo.toml of each room in src/ lets it import.
fn crates() -> Rooms {
    let folders = fs::read_dir(root().join("src")).unwrap();
    let rooms = folders.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let imports = |room: String| {
        let all = dependencies(&room);
        let ours = all.iter().filter_map(|name| name.strip_prefix("m4gn-"));
        (room, ours.map(str::to_owned).collect())
    };
    rooms.map(imports).collect()
}

/// Rooms that are missing in the table or have no folder, and imports that the table does not have.
fn faults(table: &Rooms, crates: &Rooms) -> Vec<String> {
    let mut faults = Vec::new();
    for (room, imports) in crates {
        match table.get(room) {
            None => faults.push(format!("{room} is not in the table")),
            Some(may) => {
                let more = imports.difference(may);
                faults.extend(more.map(|other| format!("{room} imports {other}")));
            }
        }
    }
    let gone = table.keys().filter(|room| !crates.contains_key(*room));
    faults.extend(gone.map(|room| format!("{room} has no folder")));
    faults
}

#[test]
fn rooms_of_src_import_no_more_than_the_table_says() {
    let found = faults(&table(&read("ARCHITECTURE.md"), "## Rooms"), &crates());
    assert!(found.is_empty(), "ARCHITECTURE.md, Rooms: {found:#?}");
}

#[test]
fn what_differs_from_the_table_of_src_is_named() {
    let of = |imports: &str| {
        let rows =
            format!("| `mesh` | - | nothing of ours |\n| `model` | - | mesh |\n| `step` | - | {imports} |\n");
        table(&format!("# A\n\n## Rooms\n\n{rows}\n## Next\n"), "## Rooms")
    };
    let found = |imports: &str, rooms: [(&str, &str); 3]| {
        let rooms = rooms.map(|(room, imports)| (room.to_owned(), names(imports, &[' '])));
        faults(&of(imports), &Rooms::from(rooms))
    };
    let real = [("mesh", ""), ("model", "mesh"), ("step", "mesh model")];
    assert!(found("model and what it imports", real).is_empty());
    assert_eq!(found("model", real), ["step imports mesh"]);
    let renamed = [("mesh", ""), ("models", ""), ("step", "mesh")];
    assert_eq!(found("mesh", renamed), ["models is not in the table", "model has no folder"]);
}

/// `libm4gn.so` is loaded by solvers: it has no charts, pages, progress bars or configuration files, and PETSc is in a library beside it.
#[test]
fn what_the_solver_loads_draws_nothing() {
    let rooms = crates();
    let mut inside = BTreeSet::from(["capi".to_owned()]);
    while let Some(next) = inside.iter().flat_map(|room| &rooms[room]).find(|room| !inside.contains(*room)) {
        inside.insert(next.clone());
    }
    for room in &inside {
        assert!(
            !["report", "slepc", "train", "workbench", "cli"].contains(&&room[..]),
            "{room} is a part of libm4gn.so"
        );
        for name in ["indicatif", "plotters", "png", "toml", "clap"] {
            let found = dependencies(room).contains(name);
            assert!(!found, "{room} has {name} and is a part of libm4gn.so");
        }
    }
}

/// The lints of the workspace deny `unsafe` but where a module allows it.
#[test]
fn unsafe_code_is_allowed_where_the_architecture_says() {
    let text = read("ARCHITECTURE.md");
    let item = between(&text, "\n8. `unsafe` occurs in ", "\n9. ");
    let paths = item.split('`').skip(1).step_by(2);
    let named = paths.flat_map(|path| match path.split_once('{') {
        Some((before, rest)) => {
            let (words, after) = rest.split_once('}').expect(path);
            words.split(',').map(|word| format!("{before}{word}{after}")).collect()
        }
        None => vec![path.to_owned()],
    });
    let root = root();
    let sources = files(&["src"], &["rs"]).into_iter();
    let allowed = sources.filter(|path| read(path).contains("allow(unsafe_code"));
    let places = allowed.map(|path| {
        let path = path.strip_prefix(&root).unwrap();
        let whole = path.ends_with("lib.rs") || path.ends_with("mod.rs");
        let place = if whole { path.parent().unwrap() } else { path };
        place.to_str().unwrap().to_owned()
    });
    assert_eq!(places.collect::<BTreeSet<_>>(), named.collect::<BTreeSet<_>>());
}

/// The folders of openfoam/, and that of the bridge.
fn openfoam_folders() -> Vec<PathBuf> {
    let below = fs::read_dir(root().join("openfoam")).unwrap().map(|entry| entry.unwrap().path());
    below.chain([root().join("cpp/bridge")]).collect()
}

fn room_of(folder: &Path) -> String {
    folder.file_name().unwrap().to_str().unwrap().to_owned()
}

/// What the CMakeLists.txt below openfoam/ and the build script of the bridge let each room include.
fn openfoam_rooms() -> Rooms {
    let mut rooms = Rooms::new();
    for folder in openfoam_folders() {
        if folder.join("CMakeLists.txt").exists() {
            let text = read(folder.join("CMakeLists.txt"));
            let own_project = between(&text, "set(imports ", ")");
            let imports = format!("{own_project} {}", between(&text, "IMPORTS ", ")"));
            rooms.insert(room_of(&folder), names(&imports, &[' ', '\n']));
        } else if folder.join("build.rs").exists() {
            let text = read(folder.join("build.rs"));
            let includes = names(between(&text, ".includes([", "])"), &[',']);
            let ours = includes.iter().filter_map(|i| i.trim_matches('"').strip_prefix("../../openfoam/"));
            rooms.insert(room_of(&folder), ours.map(str::to_owned).collect());
        }
    }
    rooms
}

#[test]
fn rooms_of_openfoam_import_what_the_table_says() {
    assert_eq!(table(&read("ARCHITECTURE.md"), "## Rooms of openfoam/"), openfoam_rooms());
}

#[test]
fn no_room_of_openfoam_imports_itself_through_others() {
    let rooms = openfoam_rooms();
    for room in rooms.keys() {
        let mut reached = rooms[room].clone();
        while let Some(next) = reached.iter().flat_map(|r| &rooms[r]).find(|r| !reached.contains(*r)) {
            reached.insert(next.clone());
        }
        assert!(!reached.contains(room), "{room} imports itself through {reached:?}");
    }
}

/// A header is found by the name of its file alone, so a second one of this name would hide it.
#[test]
fn headers_of_openfoam_have_one_room() {
    let mut seen = BTreeMap::new();
    for folder in openfoam_folders().into_iter().filter(|folder| folder.is_dir()) {
        let room = room_of(&folder);
        for entry in fs::read_dir(folder).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".H") {
                let other = seen.insert(name.clone(), room.clone());
                assert_eq!(other, None, "{name} is in {room} as well");
            }
        }
    }
}
