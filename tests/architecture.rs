//! What ARCHITECTURE.md says of the rooms is what the build lets them import.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

type Rooms = BTreeMap<String, BTreeSet<String>>;

fn read(path: impl AsRef<Path>) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn names(text: &str, separators: &[char]) -> BTreeSet<String> {
    let words = text.split(separators).map(str::trim).filter(|w| !w.is_empty());
    words.map(str::to_owned).collect()
}

/// The table below a heading of ARCHITECTURE.md: its first column against its last.
fn table(heading: &str) -> Rooms {
    let text = read("ARCHITECTURE.md");
    let (_, rest) = text.split_once(&format!("\n{heading}\n")).expect(heading);
    let section = rest.split("\n## ").next().unwrap();
    let mut rooms = Rooms::new();
    for row in section.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        let imports = match cells[cells.len() - 1].trim() {
            "nothing of ours" => BTreeSet::new(),
            list => names(list, &[',']),
        };
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

/// What the CMakeLists.txt and the build script below openfoam/ let each room include.
fn openfoam_rooms() -> Rooms {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam");
    let mut rooms = Rooms::new();
    for entry in fs::read_dir(root).unwrap() {
        let folder = entry.unwrap().path();
        let room = folder.file_name().unwrap().to_str().unwrap().to_owned();
        if folder.join("CMakeLists.txt").exists() {
            let text = read(folder.join("CMakeLists.txt"));
            let own_project = between(&text, "set(imports ", ")");
            let imports = format!("{own_project} {}", between(&text, "IMPORTS ", ")"));
            rooms.insert(room, names(&imports, &[' ', '\n']));
        } else if folder.join("build.rs").exists() {
            let text = read(folder.join("build.rs"));
            let includes = names(between(&text, ".includes([", "])"), &[',']);
            let ours = includes.iter().filter_map(|i| i.trim_matches('"').strip_prefix("../"));
            let imports = ours.filter(|i| !i.contains('/')).map(str::to_owned).collect();
            rooms.insert(room, imports);
        }
    }
    rooms
}

#[test]
fn rooms_of_openfoam_import_what_the_table_says() {
    assert_eq!(table("## Rooms of openfoam/"), openfoam_rooms());
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
    for room in openfoam_rooms().into_keys() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam").join(&room);
        for entry in fs::read_dir(folder).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".H") {
                let other = seen.insert(name.clone(), room.clone());
                assert_eq!(other, None, "{name} is in {room} as well");
            }
        }
    }
}
