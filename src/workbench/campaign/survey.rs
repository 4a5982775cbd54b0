//! What a case says of itself before a campaign is made of it: its commands, and where it uses the parameters.

use super::case::{PARAMETERS, Source, takes_original};
use super::sampling::{Parameter, Values};
use super::table::number;
use crate::generate::process::ends;
use crate::user_case::script::{Commands, ORIGINAL, of_files, of_script};
use crate::user_case::{BLOCK_MESH, has_mesh, mentions, names};
use m4gn_base::{Error, Result, files, listed};
use std::path::Path;

/// Of files longer than twice this the begin and the end are searched, bytes of each: a field has its include and its boundary conditions there.
const SEARCHED: usize = 1 << 20;
/// Most lines that are shown.
const SHOWN: usize = 12;

/// The commands that come before the solver: `Allrun.pre`, and the lines of `Allrun` in the form of OpenFOAM's tutorials and those that copy or move files.
/// Where none of them runs a program, `blockMesh` if the case has its dictionary and no mesh, or one that depends on a parameter.
pub fn commands(source: &Source, parameters: &[Parameter]) -> Commands {
    let at = |name: &str| source.folder.join(name);
    let original = at(ORIGINAL).is_dir() && !at("0").exists();
    let script = files::read_text(at("Allrun")).unwrap_or_default();
    let mut found = of_script(&script, &source.application, original);
    let there: Vec<&str> = BLOCK_MESH.into_iter().filter(|f| at(f).is_file()).collect();
    if at("Allrun.pre").is_file() {
        found.prepare.insert(0, vec!["./Allrun.pre".into()]);
    } else if of_files(&found.prepare)
        && !there.is_empty()
        && (!has_mesh(&source.folder) || there.iter().any(|f| depends(source, f, parameters)))
    {
        found.prepare.push(vec!["blockMesh".into()]);
    }
    found
}

/// Whether a file of the case, or one that it includes, uses a parameter.
fn depends(source: &Source, file: &str, parameters: &[Parameter]) -> bool {
    let all = source.files().unwrap_or_default();
    let (mut left, mut seen) = (vec![file.to_string()], Vec::<String>::new());
    while let Some(file) = left.pop() {
        let text = files::read_text(source.folder.join(&file)).unwrap_or_default();
        if parameters.iter().any(|p| uses(&text, &p.name)) {
            return true;
        }
        let lines = text.lines().filter_map(|line| line.trim_start().strip_prefix("#include"));
        for name in lines.filter_map(|line| line.split('"').nth(1)?.rsplit('/').next()) {
            let named = |path: &&String| path.rsplit('/').next() == Some(name) && !seen.contains(*path);
            left.extend(all.iter().filter(named).cloned());
        }
        seen.push(file);
    }
    false
}

/// Names and texts of files.
type Texts = [(String, String)];

/// What is said of files and folders beside the case that its dictionaries name: runs are made in copies of the case alone.
///
/// # Errors
/// [`Error::File`] where the case cannot be read.
pub fn beside(case: &Path, texts: &Texts) -> Result<Option<String>> {
    let own = names(case)?;
    let mut others = case.parent().map_or(Ok(Vec::new()), names).unwrap_or_default();
    others.retain(|name| !own.contains(name) && Some(name.as_ref()) != case.file_name());
    let mut found = Vec::new();
    for (file, text) in texts.iter().filter(|(file, _)| file.contains('/')) {
        let mut lines =
            text.lines().filter(|line| line.contains("../") && !line.trim_start().starts_with("//"));
        let named = |line: &str| others.iter().find(|name| mentions(line, &format!("../{name}")));
        found.extend(lines.find_map(named).map(|name| format!("{file} names ../{name}")));
    }
    let more =
        "which lies beside the case, and runs are made in copies of the case alone: move it into the case";
    Ok((!found.is_empty()).then(|| format!("{}, {more}", listed(found))))
}

/// The case's files that may use a parameter, and their texts.
///
/// # Errors
/// [`Error::File`] where the case cannot be read.
pub fn texts(source: &Source) -> Result<Vec<(String, String)>> {
    let mut texts = Vec::new();
    for name in source.files()? {
        if !name.contains("polyMesh/") || name.ends_with("blockMeshDict") {
            let text = ends(&source.folder.join(&name), SEARCHED);
            texts.push((name, text));
        }
    }
    Ok(texts)
}

/// Checks that some file of the case uses each parameter, and returns the files that use one without including [`PARAMETERS`].
///
/// # Errors
/// [`Error::Input`] naming the parameter that no file uses, and the lines that may hold its value, first fields that lose theirs, or the file that has
/// them from one run's folder.
pub fn check_uses(source: &Source, parameters: &[Parameter], texts: &Texts) -> Result<Vec<String>> {
    let names = source.files()?;
    for parameter in parameters {
        let name = &parameter.name;
        if !texts.iter().any(|(_, text)| uses(text, name)) {
            return Err(Error::Input(unused(&source.folder, parameter, texts)));
        }
    }
    for (file, text) in texts {
        if let Some(path) = text.lines().map(without_comment).find_map(of_one_folder) {
            return Err(Error::Input(format!(
                "{}: {file} names {path}, which is the same for all runs: expected each run's own, \"<system>/simulationParameters\" in dictionaries and \
                 {PARAMETERS} in scripts",
                source.folder.display()
            )));
        }
    }
    let text = |name: &str| texts.iter().find(|(n, _)| n == name).map_or("", |(_, text)| text.as_str());
    let used = |name: &str| parameters.iter().any(|p| uses(text(name), &p.name));
    let replaces = takes_original(text("Allrun.pre"));
    let commands = commands(source, parameters).prepare;
    let copied = |field: &str| {
        commands.iter().any(|command| {
            // The folder itself would go into the one that is there
            let onto = command.iter().any(|word| {
                word == "--no-target-directory"
                    || word.starts_with('-') && !word.starts_with("--") && word.contains('T')
            });
            let from = |word: &String| match word.strip_prefix("./").unwrap_or(word).strip_prefix(ORIGINAL) {
                Some("" | "/") => onto,
                Some("/." | "/./") => true,
                Some(path) => path.strip_prefix('/').is_some_and(|path| Path::new(field).starts_with(path)),
                None => false,
            };
            command.split_last().is_some_and(|(_, sources)| sources.iter().any(from))
        })
    };
    for field in names.iter().filter_map(|name| name.strip_prefix("0/")) {
        let (first, original) = (format!("0/{field}"), format!("{ORIGINAL}/{field}"));
        let script = match (replaces, copied(field) && names.contains(&original)) {
            (true, _) => Some("Allrun.pre"),
            (false, true) => Some("Allrun"),
            (false, false) => None,
        };
        let fault = match (used(&first), used(&original), script) {
            (true, false, Some(script)) => format!(
                "{first} uses a parameter, and {script} puts {ORIGINAL} in its place, which does not: expected it there as well"
            ),
            (false, true, None) => format!(
                "{original} uses a parameter, and {first}, which runs begin with, does not: remove the folder 0 where it is a copy of \
                 {ORIGINAL}, or write the parameter into {first} as well"
            ),
            _ => continue,
        };
        return Err(Error::Input(format!("{}: {fault}", source.folder.display())));
    }
    let includes = |text: &str| text.contains("simulationParameters");
    let alone =
        texts.iter().filter(|(_, text)| !includes(text) && parameters.iter().any(|p| uses(text, &p.name)));
    Ok(alone.map(|(name, _)| name.clone()).collect())
}

/// Whether a text has `$name` or `${name}` outside of comments, of whatever scope (`$..name`), or reads the parameter from the file of all: by its name
/// in quotes, in place of an entry before the include, or, of a script, by its name alone.
fn uses(text: &str, name: &str) -> bool {
    let word = |c: char| c.is_alphanumeric() || c == '_';
    // Of a field in binary, or compressed, some line has any short name by chance
    let binary = |c: char| c.is_control() && !"\t\r".contains(c);
    let lines: Vec<&str> = text.lines().map(without_comment).filter(|line| !line.contains(binary)).collect();
    let dollar = |line: &&str| {
        let behind = line.split('$').skip(1).map(|rest| rest.trim_start_matches(['{', '.', ':', '/']));
        behind.filter_map(|rest| rest.strip_prefix(name)).any(|rest| !rest.starts_with(word))
    };
    let shared = |line: &&str| line.contains("simulationParameters");
    let includes = |line: &&str| line.trim_start().starts_with("#include") && shared(line);
    let quoted = format!("\"{name}\"");
    let included = lines.iter().rposition(includes);
    // The file's own entry of this name takes its place from there on, unless it takes its value
    let mut depth = 0_usize;
    let outermost = |line: &&str| {
        let own = depth == 0 && line.split_whitespace().next() == Some(name) && !dollar(line);
        let [opened, closed] = [['{', '('], ['}', ')']].map(|brackets| line.matches(brackets).count());
        depth = (depth + opened).saturating_sub(closed);
        own
    };
    let own: Vec<bool> = lines.iter().map(outermost).collect();
    let behind = included.map_or(0, |at| at + 1);
    let end = own[behind..].iter().position(|own| *own).map_or(lines.len(), |i| behind + i);
    lines[..end].iter().any(dollar)
        || match included {
            Some(at) => {
                lines.iter().any(|line| line.contains(&quoted))
                    || lines[..at].iter().any(|line| line.split_whitespace().next() == Some(name))
            }
            None => lines.iter().any(shared) && lines.iter().any(|line| mentions(line, name)),
        }
}

/// The absolute path of [`PARAMETERS`] in a line, if it has one.
fn of_one_folder(line: &str) -> Option<&str> {
    let words = line.split(|c: char| c.is_whitespace() || "\"'=;".contains(c));
    words.filter(|word| word.ends_with(PARAMETERS)).find(|word| word.starts_with(['/', '~']))
}

/// A line up to its comment, which a blank or the end of an entry comes before: of a path or a script two slashes are none.
fn without_comment(line: &str) -> &str {
    let begins = |at: &usize| !line[..*at].ends_with(|c: char| !c.is_whitespace() && !";{})".contains(c));
    let comment = line.match_indices("//").map(|(at, _)| at).find(begins);
    comment.map_or(line, |at| &line[..at])
}

/// What is said of a parameter that no file uses.
fn unused(case: &Path, parameter: &Parameter, texts: &Texts) -> String {
    let name = &parameter.name;
    let lines = |wanted: &dyn Fn(&str) -> bool| -> Vec<String> {
        let of = |(file, text): &(String, String)| -> Vec<String> {
            let lines = text
                .lines()
                .enumerate()
                .filter(|(_, line)| line.len() < 200 && !line.trim_start().starts_with("//") && wanted(line));
            lines.map(|(i, line)| format!("{file}, line {}: {}", i + 1, line.trim())).collect()
        };
        // Lines of a part have other numbers
        texts.iter().filter(|(_, text)| text.len() <= SEARCHED).flat_map(of).take(SHOWN).collect()
    };
    let may_be = |word: &str| match (&parameter.values, number(word)) {
        (Values::Range([low, high]), Some(v)) => v != 0.0 && v >= *low && v <= *high,
        (Values::List(values), Some(v)) => v != 0.0 && values.iter().any(|w| number(w) == Some(v)),
        (Values::List(values), None) => values.iter().any(|w| w == word),
        _ => false,
    };
    let holds = |line: &str| line.split(|c: char| c.is_whitespace() || "();".contains(c)).any(may_be);
    let mut found = lines(&|line| mentions(line, name));
    if found.is_empty() {
        found = lines(&holds);
    }
    let where_ = match found.is_empty() {
        true => "No line was found that has such a value.".to_string(),
        false => format!("Lines that may be meant:\n  {}", found.join("\n  ")),
    };
    format!(
        "{}: expected a file that uses the parameter {name}, found none. In the file that has its value, write\n  #include \
         \"<{}>/{}\"\nabove, and ${name} in place of the value; behind an entry {name} of its own, ${name} has that entry's value. {where_}",
        case.display(),
        PARAMETERS.split('/').next().unwrap_or_default(),
        PARAMETERS.split('/').next_back().unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    #[test]
    fn a_parameter_is_used_where_its_value_counts() {
        let include = "#include \"<system>/simulationParameters\"\n";
        for (text, used) in [
            ("a $U;", true),
            ("a ${U};", true),
            ("a $..U;", true),
            ("a ${/U:-1};", true),
            ("a #calc \"2*$U\";", true),
            ("a $U0;\nb $U_x;", false),
            ("// a $U;\nb 1;", false),
            ("b 1; // a $U", false),
            ("b 1;//a $U", false),
            ("a \"http://host/$U\";", true),
        ] {
            assert_eq!(uses(text, "U"), used, "{text}");
        }
        assert!(!uses(&format!("object U;\n{include}U 1;"), "U"), "the entry behind counts");
        assert!(!uses(&format!("{include}U 1;\na $U;"), "U"), "as for what is behind");
        assert!(!uses("U 1;\na $U;", "U"));
        assert!(!uses("a\u{3}$U;\nb 1;", "U"), "numbers in binary");
        let lists = "fields\n(\n    p\n    U\n);\na $U;";
        for text in [lists, "nu $U;\nU 1;", "b\n{\n    U 1;\n}\na $U;", "U [0 1 -1 0 0 0 0] $U;\na $U;"] {
            assert!(uses(&format!("U 2;\n{include}{text}"), "U"), "{text}");
        }
        assert!(uses(&format!("object a;\nU 1;\n{include}"), "U"), "the one that is included counts");
        assert!(uses(&format!("{include}a #codeStream {{ dict.lookup(\"U\") }}"), "U"));
        assert!(uses("of() { foamDictionary -entry \"$1\" -value system/simulationParameters; }\nof U", "U"));
    }

    fn beside(case: &Path) -> Result<Option<String>> {
        let source = Source { folder: case.to_path_buf(), ..Source::default() };
        super::beside(case, &texts(&source)?)
    }

    fn check_uses(source: &Source, parameters: &[Parameter]) -> Result<Vec<String>> {
        super::check_uses(source, parameters, &texts(source)?)
    }

    fn source(list: &[(&str, &str)]) -> (tempfile::TempDir, Source) {
        let dir = crate::fixtures::folder(list);
        let folder = dir.path().to_path_buf();
        (dir, Source { folder, application: "icoFoam".into(), ..Source::default() })
    }

    #[test]
    fn what_a_case_takes_from_beside_it_is_told() {
        let dir = crate::fixtures::folder(&[
            ("common/nu", ""),
            ("system/nu", ""),
            ("case/constant/nu", "// ../../common\nnu 1;\n"),
            ("case/system/controlDict", "#include \"../constant/nu\"\n#include \"../system/nu\"\n"),
        ]);
        let case = dir.path().join("case");
        assert_eq!(beside(&case).unwrap(), None);
        crate::fixtures::write(&case, &[("0/U", "#include \"../../common/nu\"\n")]);
        assert!(
            beside(&case).unwrap().unwrap().starts_with("0/U names ../common, which lies beside the case")
        );
    }

    #[test]
    fn commands_are_those_of_the_case_s_scripts() {
        let script =
            "./Allrun.pre\nrunApplication setFields\nrunApplication decomposePar\nrunParallel icoFoam\n";
        let (_dir, own) = source(&[("Allrun.pre", ""), ("Allrun", script)]);
        let found = commands(&own, &[]);
        assert_eq!(found.prepare, [["./Allrun.pre"], ["setFields"]]);
        assert!(found.parallel && found.unknown.is_empty(), "{found:?}");
        for (of_user, taken) in [("1/U", 2), ("0/U", 1)] {
            let script = "runApplication blockMesh\nrestore0Dir\n";
            let (_dir, case) = source(&[("Allrun", script), ("0.orig/U", ""), (of_user, "")]);
            assert_eq!(commands(&case, &[]).prepare.len(), taken, "first fields may be the user's");
        }
        let (_dir, block) = source(&[("system/blockMeshDict", "$n"), ("constant/polyMesh/faces", "")]);
        assert!(commands(&block, &[]).prepare.is_empty());
        assert_eq!(commands(&block, &["n=1,2".parse().unwrap()]).prepare, [["blockMesh"]]);
        let (_dir, plain) = source(&[("system/blockMeshDict", "$n"), ("Allrun", "blockMesh\ncp a b\n")]);
        assert_eq!(commands(&plain, &[]).prepare, [vec!["cp", "a", "b"], vec!["blockMesh"]]);
        let (_dir, included) = source(&[
            ("system/blockMeshDict", "#include \"<system>/sizes\"\n"),
            ("system/sizes", "#include \"sizes\"\nn $n;"),
            ("constant/polyMesh/faces", ""),
        ]);
        assert!(commands(&included, &["m=1,2".parse().unwrap()]).prepare.is_empty());
        assert_eq!(commands(&included, &["n=1,2".parse().unwrap()]).prepare, [["blockMesh"]]);
    }

    #[test]
    fn a_parameter_that_no_file_uses_is_told_with_the_lines_that_may_be_meant() {
        let (_dir, case) = source(&[
            ("0/U", "internalField uniform (0 0 0);\nvalue uniform (1.5 0 0);\n// 1.5\n"),
            ("constant/transportProperties", "nu 0.01;\n"),
            ("system/geometry", "size $size;\n"),
        ]);
        let of = |text: &str| check_uses(&case, &[text.parse().unwrap()]);
        let message = of("Uin=1:2").unwrap_err().to_string();
        for expected in [
            "uses the parameter Uin",
            "#include \"<system>/simulationParameters\"",
            "$Uin",
            "0/U, line 2: value uniform (1.5 0 0);",
        ] {
            assert!(message.contains(expected), "{expected}: {message}");
        }
        assert!(!message.contains("line 3"), "{message}");
        fails(of("nu=0.1:0.2"), &["constant/transportProperties, line 1: nu 0.01;"]);
        fails(of("b=7,8"), &["No line was found"]);
        let cells = "(0 0 0)\n".repeat(400_000);
        let long = format!("#include \"<system>/simulationParameters\"\n{cells}value uniform ($Uin 0 0);\n");
        let (_dir, developed) = source(&[("0/U", &long)]);
        assert!(check_uses(&developed, &["Uin=1:2".parse().unwrap()]).unwrap().is_empty());
        let (_dir, undone) = source(&[("0/U", "$Uin"), ("0.orig/U", "1"), ("Allrun.pre", "restore0Dir")]);
        fails(
            check_uses(&undone, &["Uin=1:2".parse().unwrap()]),
            &["0/U uses a parameter, and Allrun.pre puts 0.orig in its place"],
        );
        let (_dir, of_ranks) =
            source(&[("0/U", "$Uin"), ("0.orig/U", "1"), ("Allrun.pre", "restore0Dir -processor")]);
        check_uses(&of_ranks, &["Uin=1:2".parse().unwrap()]).unwrap();
        let (_dir, stale) = source(&[("0/U", "1"), ("0.orig/U", "$Uin"), ("Allrun", "cp -r 0.orig 0\n")]);
        fails(
            check_uses(&stale, &["Uin=1:2".parse().unwrap()]),
            &["0.orig/U uses a parameter, and 0/U, which runs begin with"],
        );
        for (script, copied) in [
            ("cp 0.orig/U 0/U", true),
            ("cp -rT 0.orig 0", true),
            ("cp -r ./0.orig/. 0", true),
            ("cp -a 0.orig 0", false),
            ("cp -r 0.orig/ 0", false),
            ("cp 0.orig/p 0/p", false),
        ] {
            let script = ("Allrun", script);
            let (_dir, case) = source(&[("0/U", "1"), ("0.orig/U", "$Uin"), script]);
            assert_eq!(check_uses(&case, &["Uin=1:2".parse().unwrap()]).is_ok(), copied, "{script:?}");
            let (_dir, case) = source(&[("0/U", "$Uin"), ("0.orig/U", "1"), script]);
            assert_eq!(check_uses(&case, &["Uin=1:2".parse().unwrap()]).is_err(), copied, "{script:?}");
        }
        for (path, told) in [("/a/case", true), ("~/case", true), ("$FOAM_CASE", false), ("..", false)] {
            let text = format!("#include \"{path}/{PARAMETERS}\"\nvalue uniform ($Uin 0 0);\n");
            let (_dir, case) = source(&[("0/U", &text)]);
            assert_eq!(check_uses(&case, &["Uin=1:2".parse().unwrap()]).is_err(), told, "{path}");
        }
        assert_eq!(of("size=1:2").unwrap(), ["system/geometry"], "used, and not included");
        assert!(of("siz=1:2").is_err());
    }
}
