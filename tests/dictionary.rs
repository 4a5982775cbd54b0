//! docs/dictionary.md and the entries that the code takes agree.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

type Words = BTreeSet<String>;

/// Where the settings are that dictionaries hand on to the core.
const SETTINGS: [&str; 6] = [
    "src/adapt/settings.rs",
    "src/model/segmentation.rs",
    "src/ride/control.rs",
    "src/ride/dmd_settings.rs",
    "src/ride/settings.rs",
    "src/step/options.rs",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The texts of all files below a folder with these endings.
fn texts(folder: &str, endings: &[&str]) -> Vec<(PathBuf, String)> {
    let (mut found, mut open) = (Vec::new(), vec![root().join(folder)]);
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| endings.iter().any(|end| e == *end)) {
                let text = fs::read_to_string(&path).unwrap();
                found.push((path, text));
            }
        }
    }
    assert!(found.len() > 10, "{folder}");
    found
}

/// What stands between two marks, each time.
fn between<'a>(text: &'a str, open: &'a str, close: &'a str) -> impl Iterator<Item = &'a str> {
    text.split(open).skip(1).filter_map(move |rest| Some(rest.split_once(close)?.0))
}

/// Entries of the tables whose first column is one, and of the others (`state`, node types) none.
fn documented() -> Words {
    let text = fs::read_to_string(root().join("docs/dictionary.md")).unwrap();
    let (mut entries, mut table) = (Words::new(), false);
    for line in text.lines() {
        match line.strip_prefix('|').and_then(|rest| rest.split('|').next()) {
            None => table = false,
            Some(first) if first.contains("entry") => table = true,
            Some(first) if table => {
                let quoted = first.split('`').skip(1).step_by(2);
                entries.extend(quoted.map(str::to_string));
            }
            Some(_) => {}
        }
    }
    entries
}

#[test]
fn what_the_code_takes_is_documented() {
    let documented = documented();
    assert!(documented.len() > 80, "{documented:?}");
    let mut taken = Words::new();
    for (path, text) in texts("openfoam", &["C"]) {
        let lists = ["checkKeys\n", "checkKeys(", "ownKeys_ =\n"];
        for list in lists.iter().flat_map(|call| text.split(call).skip(1)) {
            // The definition of the check has no list
            let Some((list, _)) = list.split_once('{').and_then(|(_, rest)| rest.split_once('}')) else {
                continue;
            };
            if list.contains(';') {
                continue;
            }
            let names: Vec<String> = list.split('"').skip(1).step_by(2).map(str::to_string).collect();
            assert!(names.iter().all(|n| !n.contains(' ')), "{}: {names:?}", path.display());
            taken.extend(names);
        }
    }
    for file in SETTINGS {
        let text = fs::read_to_string(root().join(file)).unwrap();
        let structs: Vec<&str> = between(&text, "deny_unknown_fields", "\n}").collect();
        assert!(!structs.is_empty(), "{file}");
        taken.extend(structs.iter().flat_map(|body| between(body, "\n    pub ", ":").map(camel)));
    }
    // Of a material, which docs/solids.md has, and what hosts other than OpenFOAM say
    let others =
        ["E", "nu", "mu", "K", "rho", "planeStress", "cellSegment", "isa", "name", "host", "setupSeconds"];
    let missing: Vec<&String> =
        taken.iter().filter(|name| !others.contains(&name.as_str()) && !documented.contains(*name)).collect();
    assert!(taken.len() > 70, "{taken:?}");
    assert!(missing.is_empty(), "docs/dictionary.md lacks {missing:?}");
}

#[test]
fn what_is_documented_is_taken() {
    let mut known = Words::new();
    for (_, text) in texts("openfoam", &["C", "H"]) {
        known.extend(text.lines().flat_map(|line| line.split('"').skip(1).step_by(2).map(str::to_string)));
    }
    for (_, text) in texts("src", &["rs"]) {
        known.extend(between(&text, "pub ", ":").map(camel));
        known.extend(text.lines().flat_map(|line| line.split('"').skip(1).step_by(2).map(camel)));
    }
    // OpenFOAM reads these itself, and `any dictionary` is a heading
    let openfoam = [
        "timeStart",
        "timeEnd",
        "writeControl",
        "writeInterval",
        "writePrecision",
        "writeToFile",
        "useUserTime",
    ];
    let unknown: Vec<String> = documented()
        .into_iter()
        .filter(|name| !openfoam.contains(&name.as_str()) && !known.contains(name))
        .collect();
    assert!(unknown.is_empty(), "docs/dictionary.md has entries that nothing takes: {unknown:?}");
}

/// `distance_scale` as a dictionary has it.
fn camel(name: &str) -> String {
    let mut parts = name.split('_');
    let first = parts.next().unwrap_or_default().to_string();
    parts.fold(first, |all, part| {
        let mut letters = part.chars();
        let begin: String = letters.next().iter().flat_map(|c| c.to_uppercase()).collect();
        all + &begin + letters.as_str()
    })
}
