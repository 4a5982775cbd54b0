//! The pages: links lead somewhere, commands and entries exist, the README is short.

use super::tree::{files, read, root};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Component, Path, PathBuf},
    process::Command,
};

const FOLDERS: [&str; 12] = [
    "docs", "models", "openfoam", "bench", "configs", "cpp", "examples", "setup", "src", "tests", "tools",
    "torch",
];

fn pages() -> Vec<PathBuf> {
    let top = fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path());
    let top = top.filter(|path| path.extension().is_some_and(|e| e == "md"));
    files(&FOLDERS, &["md"]).into_iter().chain(top).collect()
}

/// A path without `..`, whether there is something or not.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(out.pop()),
            part => out.push(part),
        }
    }
    out
}

/// The anchors of a page's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter_map(|line| line.strip_prefix('#'));
    let anchor = |heading: &str| -> String {
        let heading = heading.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
        heading.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut dead = Vec::new();
    for page in pages() {
        let text = read(&page);
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split([')', ' ', '\n']).next());
        for target in targets.filter(|t| !t.contains("://") && !t.starts_with("mailto:")) {
            let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
            let path = match file {
                "" => page.clone(),
                _ => plain(&page.parent().unwrap().join(file)),
            };
            let is_page = path.extension().is_some_and(|e| e == "md");
            if !path.exists() || is_page && !anchor.is_empty() && !anchors(&read(&path)).contains(anchor) {
                dead.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(dead.is_empty(), "links that lead nowhere: {dead:#?}");
}

/// Lab notes are dated, and no task rests on one.
#[test]
fn no_task_leads_to_the_lab() {
    let pages = files(&["docs/tutorials", "docs/how-to"], &["md"]);
    let found: Vec<_> = pages.iter().filter(|page| read(page).contains("](../lab/")).collect();
    assert!(found.is_empty(), "tasks that link to lab notes: {found:?}");
}

#[test]
fn pages_that_messages_and_comments_name_are_there() {
    let endings = ["rs", "C", "H", "h", "hpp", "cpp", "sh", "toml", "py", "md", "cu"];
    let mut dead = Vec::new();
    for path in files(&FOLDERS, &endings) {
        let text = read(&path);
        for (at, _) in text.match_indices("docs/") {
            let rest = &text[at..];
            let end =
                rest.find(|c: char| !c.is_ascii_alphanumeric() && !"/-_.".contains(c)).unwrap_or(rest.len());
            let name = rest[..end].trim_end_matches('.');
            if [".md", ".png", ".svg"].iter().any(|e| name.ends_with(e)) && !root().join(name).exists() {
                let before = text[..at].rsplit(['(', ' ', '`', '"']).next().unwrap_or_default();
                // A link has been looked at from its own page.
                if !before.contains("..") {
                    dead.push(format!("{}: {name}", path.display()));
                }
            }
        }
    }
    assert!(dead.is_empty(), "pages that are named and are not there: {dead:#?}");
}

#[test]
fn files_of_the_tree_that_pages_name_are_there() {
    let mut gone = Vec::new();
    for page in pages().into_iter().filter(|page| !page.starts_with(root().join("docs/lab"))) {
        let text = read(&page);
        for word in text.split('`').skip(1).step_by(2).flat_map(str::split_whitespace) {
            let is_ours =
                FOLDERS.iter().any(|f| word.strip_prefix(*f).is_some_and(|rest| rest.starts_with('/')));
            let is_plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "/-_.".contains(c));
            // A class of openfoam/ is named without its endings.
            let is_there = |end: &&str| root().join(format!("{word}{end}")).exists();
            if is_ours && is_plain && !["", ".H"].iter().any(is_there) {
                gone.push(format!("{}: {word}", page.display()));
            }
        }
    }
    assert!(gone.is_empty(), "files that are named and are not there: {gone:#?}");
}

#[test]
fn the_readme_is_read_in_two_minutes() {
    let text = read("README.md");
    assert!(text.lines().count() <= 120, "README.md has {} lines", text.lines().count());
    assert!(
        text.split_whitespace().count() <= 1300,
        "README.md has {} words",
        text.split_whitespace().count()
    );
}

/// The help of a command; of `generate` that of what is generated.
fn help(words: &[&str]) -> String {
    let run = Command::new(env!("CARGO_BIN_EXE_m4gn")).args(words).arg("--help").output().unwrap();
    assert!(run.status.success(), "m4gn {words:?} --help: {}", String::from_utf8_lossy(&run.stderr));
    String::from_utf8(run.stdout).unwrap()
}

/// The options that a help lists.
fn options(help: &str) -> BTreeSet<String> {
    let words = help.split(|c: char| c.is_whitespace() || ",'=()".contains(c));
    words.filter(|w| w.starts_with("--")).map(|w| w.trim_end_matches(['.', ';', ':']).to_owned()).collect()
}

/// A page's commands, each a line: indented ones with what a `\` carries on, and those between backticks.
fn commands(text: &str) -> Vec<String> {
    let text = text.replace("\\\n", " ");
    let blocks = text.lines().filter(|line| line.starts_with("    ")).map(str::to_owned);
    let inline = text.split('`').skip(1).step_by(2).map(|piece| piece.replace('\n', " "));
    let parts = blocks.chain(inline).collect::<Vec<_>>();
    let parts = parts.iter().flat_map(|line| line.split(['#', ';', '|', '&']).map(str::trim));
    // Of what stands before it, such as mpirun, nothing is known.
    parts.filter_map(|part| part.find("m4gn ").map(|at| part[at..].to_owned())).collect()
}

#[test]
fn commands_of_the_book_exist() {
    let known = |family: &str| match family.starts_with("deforming") {
        true => "deforming-beam",
        false => "cylinder-flow",
    };
    let mut helps = BTreeMap::new();
    let (mut stale, mut seen) = (Vec::new(), 0);
    let names = names_of_commands();
    for page in files(&["docs/tutorials", "docs/how-to", "docs/reference", "README.md", "models"], &["md"]) {
        for line in commands(&read(&page)) {
            let words: Vec<&str> = line.split_whitespace().skip(1).collect();
            let Some(command) = words.first().filter(|w| w.chars().all(|c| c.is_ascii_lowercase())) else {
                continue;
            };
            if !names.contains(*command) {
                stale.push(format!("{}: m4gn {command}", page.display()));
                continue;
            }
            let path: Vec<&str> = match (*command, words.get(1)) {
                ("generate", Some(family)) => vec!["generate", known(family)],
                ("campaign", Some(verb)) => vec!["campaign", verb],
                _ => vec![command],
            };
            let listed = helps.entry(path.join(" ")).or_insert_with(|| options(&help(&path)));
            for option in words.iter().filter(|w| w.starts_with("--")) {
                let option = option.split(['=', ',', ')', ']', '\'']).next().unwrap();
                seen += 1;
                if !listed.contains(option) {
                    stale.push(format!("{}: m4gn {command} {option}", page.display()));
                }
            }
        }
    }
    assert!(seen > 100, "{seen} options were seen");
    assert!(stale.is_empty(), "the command line does not have {stale:#?}");
}

fn names_of_commands() -> BTreeSet<String> {
    let text = help(&[]);
    let (_, rest) = text.split_once("Commands:\n").unwrap();
    let lines = rest.lines().take_while(|line| line.starts_with("  "));
    lines.filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
}

/// Below `**m4gn COMMAND ...**` a table has the command's options in its first column; none is left out.
#[test]
fn options_of_the_reference_are_those_of_the_commands() {
    let text = read("docs/reference/command-line.md");
    let mut stale = Vec::new();
    let mut listed = BTreeSet::new();
    let mut documented = BTreeSet::new();
    let mut left_out = BTreeSet::new();
    for line in text.lines() {
        let named: Vec<&str> =
            line.split("**m4gn ").skip(1).filter_map(|s| s.split(['*', ' ']).next()).collect();
        if !named.is_empty() {
            listed = named.iter().flat_map(|c| helps(c)).flat_map(|words| options(&help(&words))).collect();
            documented.extend(named.iter().map(ToString::to_string));
            left_out.extend(listed.iter().filter(|option| !text.contains(&format!("`{option}"))).cloned());
        }
        let column = line.strip_prefix("| `--").and_then(|_| line.split(" | ").next()).unwrap_or_default();
        let pieces = column.split('`').skip(1).step_by(2).filter_map(|p| p.split([' ', '=']).next());
        stale.extend(pieces.filter(|p| !listed.contains(*p)).map(|p| format!("{p} in: {line}")));
    }
    assert!(stale.is_empty(), "the command line does not have {stale:#?}");
    assert!(left_out.is_empty(), "the reference does not have {left_out:#?}");
    assert!(documented.len() > 12, "{documented:?}");
}

/// What has the options of a command: itself, or what stands behind it.
fn helps(command: &str) -> Vec<Vec<&str>> {
    match command {
        "generate" => vec![vec!["generate", "cylinder-flow"]],
        "campaign" => ["init", "one", "run", "status", "report"].map(|verb| vec!["campaign", verb]).into(),
        _ => vec![vec![command]],
    }
}

/// Words that OpenFOAM reads of any function object, and results.
const OF_OPENFOAM: [&str; 6] = ["type", "libs", "writeControl", "writeInterval", "timeStart", "timeEnd"];

/// The names before values in a piece of a dictionary; names of dictionaries and elements of lists are none.
fn entries(text: &str) -> Vec<String> {
    let text: String = text.lines().map(|l| l.split("//").next().unwrap().to_owned() + "\n").collect();
    let mut found = Vec::new();
    let mut before = ';';
    for piece in text.split_inclusive([';', '{', '}', '(', ')']) {
        let after = piece.chars().last().unwrap();
        let words = piece.trim_end_matches([';', '{', '}', '(', ')']).split_whitespace().collect::<Vec<_>>();
        if before != '(' && before != ')' && after != '{' && !words.is_empty() {
            found.push(words[0].to_owned());
        }
        before = after;
    }
    found
}

#[test]
fn entries_of_the_book_are_in_the_dictionary() {
    let dictionary = read("docs/reference/dictionary.md");
    let documented: BTreeSet<&str> = dictionary.split('`').skip(1).step_by(2).collect();
    let (mut stale, mut seen) = (Vec::new(), 0);
    for page in files(&["docs/tutorials", "docs/how-to", "README.md"], &["md"]) {
        let text = read(&page);
        let blocks =
            text.split("\n\n").filter(|b| b.starts_with("    ") && b.contains("m4gn") && b.contains("type "));
        for entry in blocks.flat_map(entries).filter(|e| e.chars().all(|c| c.is_ascii_alphanumeric())) {
            seen += 1;
            if !documented.contains(entry.as_str()) && !OF_OPENFOAM.contains(&entry.as_str()) {
                stale.push(format!("{}: {entry}", page.display()));
            }
        }
    }
    assert!(seen > 40, "{seen} entries were seen");
    assert!(stale.is_empty(), "the dictionary does not have {stale:#?}");
}

/// Names of the fields of a struct that a configuration is read into.
fn keys(file: &str, name: &str) -> BTreeSet<String> {
    let text = read(file);
    let (_, rest) =
        text.split_once(&format!("pub struct {name} {{\n")).unwrap_or_else(|| panic!("{file}: {name}"));
    let lines = rest.lines().take_while(|line| *line != "}");
    let names = lines.filter_map(|line| line.trim().strip_prefix("pub ")?.split_once(':'));
    names.map(|(name, _)| name.to_owned()).collect()
}

#[test]
fn keys_of_a_training_are_in_the_reference() {
    let page = read("docs/reference/training.md");
    let documented: BTreeSet<&str> = page.split('`').skip(1).step_by(2).collect();
    for (file, name) in [
        ("src/learn/config.rs", "TrainingConfig"),
        ("src/train/config.rs", "ModelConfig"),
        ("src/model/architecture.rs", "MacroSpec"),
    ] {
        let keys = keys(file, name);
        let missing: Vec<_> = keys.iter().filter(|key| !documented.contains(key.as_str())).collect();
        assert!(keys.len() > 4, "{keys:?}");
        assert!(missing.is_empty(), "docs/reference/training.md lacks {missing:?} of {name}");
    }
}

#[test]
fn calls_of_the_c_abi_exist() {
    let header = read("cpp/include/m4gn.h");
    let page = read("docs/reference/c-abi.md");
    let words = page.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let named: BTreeSet<&str> = words.filter(|w| w.starts_with("m4gn_") || w.starts_with("M4GN_")).collect();
    let gone: Vec<_> = named.iter().filter(|name| !header.contains(**name)).collect();
    assert!(named.len() > 20, "{named:?}");
    assert!(gone.is_empty(), "cpp/include/m4gn.h does not have {gone:?}");
    let makers = header.split("int32_t m4gn_").skip(1).filter_map(|rest| rest.split('(').next());
    let missing: Vec<_> =
        makers.filter(|n| n.ends_with("_new") && !page.contains(&format!("m4gn_{n}"))).collect();
    assert!(missing.is_empty(), "docs/reference/c-abi.md lacks {missing:?}");
}
