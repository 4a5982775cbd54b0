//! What the script of a tutorial, `Allrun`, does before its solver.

use std::collections::VecDeque;

/// The commands of a case.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Commands {
    /// Before the solver.
    pub prepare: Vec<Vec<String>>,
    /// Whether the case's own script runs the solver on several ranks.
    pub parallel: bool,
    /// Lines of that script that are not understood.
    pub unknown: Vec<String>,
}

/// Lines of a tutorial's script that are not commands for a run.
const OF_SCRIPTS: [&str; 7] = ["#", ". ", "source ", "application=", "set ", "exit", "./Allrun.pre"];

/// What may be done, or several times, and where it ends.
const OPENS: [&str; 5] = ["if", "for", "while", "until", "case"];
const CLOSES: [&str; 3] = ["fi", "done", "esac"];

/// Lines within that are no commands.
const BETWEEN: [&str; 3] = ["then", "else", "do"];

/// Most words of loops that are written out, a loop's own in each of its lines.
const WRITTEN_OUT: usize = 10_000;

/// First fields of a case that are kept for its start.
pub(crate) const ORIGINAL: &str = "0.orig";

/// The commands of a script up to the solver `application`. `original`: whether restore0Dir takes [`ORIGINAL`], as the case has it and no first fields,
/// which may be the user's.
pub(crate) fn of_script(script: &str, application: &str, original: bool) -> Commands {
    let mut found = Commands::default();
    let mut depth = 0_usize;
    // The way from the case's folder to where commands are done, and those outside of brackets
    let (mut place, mut outer) = (Vec::<String>::new(), Vec::new());
    let mut variables = Vec::<(String, String)>::new();
    for line in lines(script) {
        let line = variables.iter().fold(line, |line, (name, value)| with_value(&line, name, value));
        let line = line.as_str();
        let all = words(line);
        // What is behind || is done where a command fails, and ends a run itself
        let ends = |w: &&str| !(w.starts_with(['#', '>']) || *w == "||");
        let mut words: Vec<&str> = all.iter().map(String::as_str).take_while(ends).collect();
        while words.last() == Some(&";") {
            words.pop();
        }
        let Some(&first) = words.first() else { continue };
        variables.retain(|(name, _)| !all.iter().any(|w| w.split_once('=').is_some_and(|(n, _)| n == name)));
        if let (0, [word], true) = (depth, &words[..], place.is_empty())
            && let Some(variable) = variable(word)
        {
            variables.push(variable);
            continue;
        }
        // solids4foam has its own of the same names
        let first = first.strip_prefix("solids4Foam::").unwrap_or(first);
        let runs = ["runApplication", "runParallel"].contains(&first);
        if runs {
            words.remove(0);
        }
        while let Some(option) = words.first().filter(|w| runs && w.starts_with('-')).copied() {
            let value = ["-s", "-suffix", "-n", "-np", "-decomposeParDict"].contains(&option);
            words.drain(..(1 + usize::from(value)).min(words.len()));
        }
        let program = words.first().copied().unwrap_or_default();
        let is_solver = |word: &str| {
            let bare = word.trim_matches(|c: char| "$(){}`".contains(c));
            [application, "getApplication"].contains(&bare) || bare == "application" && word.contains('$')
        };
        // As a script without OpenFOAM's functions has it
        let of_ranks = ["mpirun", "mpiexec", "srun", "foamJob"].contains(&first);
        let solves = match of_ranks {
            true => words.iter().any(|word| is_solver(word)),
            false => is_solver(if runs { program } else { first }),
        };
        // That of another case, as one whose fields are mapped, prepares this one
        let told = |part: &String| !part.is_empty() && !part.starts_with(['$', '-']);
        let elsewhere = !place.is_empty() && place.iter().all(told);
        if solves && !elsewhere {
            let parallel = |word: &&str| ["-parallel", "-p"].contains(word);
            found.parallel |=
                depth == 0 && (first == "runParallel" || of_ranks && words.iter().any(parallel));
            break;
        }
        let closes = |word: &&str| CLOSES.contains(word);
        let opens = OPENS.contains(&first);
        if CLOSES.contains(&first) {
            depth = depth.saturating_sub(1);
            continue;
        } else if opens && !words.iter().any(closes) {
            depth += 1;
        }
        if depth > 0 || opens {
            if !BETWEEN.contains(&line) {
                found.unknown.push(line.to_string());
            }
            continue;
        }
        match first {
            "(" => outer.push(place.clone()),
            ")" => place = outer.pop().unwrap_or_default(),
            "cd" if words.len() == 1 => go(&mut place, "~"),
            "cd" => {
                let pairs = words.windows(2).filter(|pair| pair[0] == "cd");
                pairs.for_each(|pair| go(&mut place, pair[1]));
            }
            _ => {}
        }
        let more = line.contains("&&") || line.trim_end_matches(';').contains(';');
        if !place.is_empty() || first == "cd" && more {
            found.unknown.push(line.to_string());
            continue;
        }
        if first == "cd" {
            continue;
        }
        if first == "restore0Dir" {
            if original {
                found.prepare.push(["cp", "-rT", ORIGINAL, "0"].map(String::from).into());
            }
            continue;
        }
        let plain = !line.contains(['$', '*', ';', '|', '&', '(', '"', '\'', '{', '`']);
        let leads_out = line.split([' ', '<', '>']).any(|path| path.starts_with('/') || path.contains(".."));
        let (rest, written) = (words.get(1..).unwrap_or_default(), line.contains('>'));
        let of_files = match first.trim_start_matches('\\') {
            program @ ("cp" | "mv") if words.len() > 2 && !written => Some([&[program][..], rest].concat()),
            // A script goes on where it is there
            "mkdir" if !written => Some([&["mkdir", "-p"][..], rest].concat()),
            // Its output is a file by a shell alone
            "m4" if written && !leads_out => Some(vec!["sh", "-c", line]),
            _ => None,
        };
        if let Some(command) = of_files.filter(|_| plain) {
            found.prepare.push(command.into_iter().map(String::from).collect());
            continue;
        }
        let several = |word: &&str| ["&&", "|", "&", ";"].contains(word);
        if !runs || words.iter().any(|word| word.contains('$') || several(word)) {
            if !OF_SCRIPTS.iter().any(|begin| line.starts_with(begin)) {
                found.unknown.push(line.to_string());
            }
            continue;
        }
        // What else than ending a script does then is told
        let otherwise = all.iter().skip_while(|word| *word != "||").nth(1);
        if otherwise.is_some_and(|word| !["exit", "return"].contains(&word.as_str())) {
            found.unknown.extend(line.split_once("||").map(|(_, rest)| format!("||{rest}")));
        }
        match program {
            "decomposePar" | "" => found.parallel |= program == "decomposePar",
            // The whole case is prepared
            "reconstructPar" | "reconstructParMesh" | "redistributePar" => {}
            // What it does is told by itself
            "./Allrun.pre" => {}
            _ => found.prepare.push(words.iter().map(|w| w.to_string()).collect()),
        }
    }
    found
}

/// The lines of a script: one that goes on is one, and a loop over words that stand there is written out.
fn lines(script: &str) -> Vec<String> {
    let mut rest: VecDeque<String> =
        script.replace("\\\n", " ").lines().map(|line| line.trim().to_string()).collect();
    let (mut lines, mut room) = (Vec::new(), WRITTEN_OUT);
    while let Some(line) = rest.pop_front() {
        let words_of_line = words(&line);
        let head: Vec<&str> = words_of_line.iter().map(String::as_str).collect();
        let plain = |w: &&str| w.chars().all(|c| c.is_alphanumeric() || "._-/+".contains(c)) && *w != "do";
        let found = match &head[..] {
            ["for", name, "in", values @ .., ";", "do"]
            | ["for", name, "in", values @ .., ";"]
            | ["for", name, "in", values @ ..]
                if values.iter().all(plain) =>
            {
                let mut depth = 1;
                let closes = |line: &String| {
                    let words = words(line);
                    let first = words.first().map_or("", String::as_str);
                    let closed = words.iter().any(|w| CLOSES.contains(&w.as_str()));
                    depth +=
                        i32::from(OPENS.contains(&first) && !closed) - i32::from(CLOSES.contains(&first));
                    depth == 0
                };
                rest.iter().position(closes).map(|end| (*name, values, end))
            }
            _ => None,
        };
        let Some((name, values, end)) = found.filter(|(_, _, end)| (end + 1) * head.len() < room) else {
            lines.push(line);
            continue;
        };
        // Loops within loops multiply
        room -= (end + 1) * head.len();
        let body: Vec<String> = rest.drain(..=end).filter(|l| l != "do").collect();
        for value in values.iter().rev() {
            let with = |line: &String| with_value(line, name, value);
            body[..body.len() - 1].iter().rev().for_each(|line| rest.push_front(with(line)));
        }
    }
    lines
}

/// Name and value of a variable that a word gives, where the value is plain. The solver's name is that of the case.
fn variable(word: &str) -> Option<(String, String)> {
    let (name, value) = word.split_once('=')?;
    let plain = |text: &str, more: &str| text.chars().all(|c| c.is_ascii_alphanumeric() || more.contains(c));
    let fits = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') && name != "application";
    (fits && plain(name, "_") && plain(value, "._-/+ ")).then(|| (name.into(), value.into()))
}

/// A line with a value in place of `$name` and `${name}`.
fn with_value(line: &str, name: &str, value: &str) -> String {
    let mut pieces = line.split('$');
    let mut text = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        let bare = || {
            piece
                .strip_prefix(name)
                .filter(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
        };
        match piece.strip_prefix(&format!("{{{name}}}")[..]).or_else(bare) {
            Some(rest) => text += &format!("{value}{rest}"),
            None => text += &format!("${piece}"),
        }
    }
    text
}

/// Follows a `cd`; the folder of the script is the case's.
fn go(place: &mut Vec<String>, to: &str) {
    if to.contains("%/*") || to.contains("dirname") {
        place.clear();
        return;
    }
    for part in to.trim_end_matches('/').split('/') {
        match part {
            "." => {}
            ".." if place.last().is_some_and(|last| last != "..") => {
                place.pop();
            }
            part => place.push(part.to_string()),
        }
    }
}

/// Whether commands copy and move files alone.
pub(crate) fn of_files(commands: &[Vec<String>]) -> bool {
    commands.iter().all(|c| ["cp", "mv", "mkdir", "sh"].contains(&c[0].as_str()))
}

/// The words of a line; blanks and semicolons within quotes are of a word, others are none or one by itself.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars() {
        match quote {
            Some(q) if c == q => quote = None,
            None if c == '"' || c == '\'' => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            None if c.is_whitespace() => words.extend(word.take()),
            None if c == ';' => words.extend(word.take().into_iter().chain([";".into()])),
            _ => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tutorial_s_script_is_understood_up_to_its_solver() {
        let script = "#!/bin/sh\ncd ${0%/*} || exit 1\n. $WM_PROJECT_DIR/bin/tools/RunFunctions\n\nrestore0Dir\nrunApplication blockMesh\n\\cp a b\n\\mv b c\nrm a\n\
                      runApplication -s 1 topoSet -dict system/a # cells\nrunApplication decomposePar\nrunApplication \
                      reconstructParMesh -constant\nrunParallel redistributePar -decompose\nrunParallel $(getApplication)\nrunApplication \
                      reconstructPar\n";
        let found = of_script(script, "icoFoam", true);
        let expected: Vec<Vec<String>> = vec![
            ["cp", "-rT", "0.orig", "0"].map(String::from).into(),
            vec!["blockMesh".into()],
            ["cp", "a", "b"].map(String::from).into(),
            ["mv", "b", "c"].map(String::from).into(),
            vec!["topoSet".into(), "-dict".into(), "system/a".into()],
        ];
        assert_eq!(found, Commands { prepare: expected, parallel: true, unknown: vec!["rm a".into()] });
        let either = "runApplication a || runApplication b\nrunApplication c || exit 1\n";
        let found = of_script(either, "icoFoam", false);
        assert_eq!(found.prepare, [["a"], ["c"]]);
        assert_eq!(found.unknown, ["|| runApplication b"]);
        let quoted = of_script(
            "restore0Dir\nrunApplication transformPoints \\\n    -scale '(2 1 1)' # m\n",
            "icoFoam",
            false,
        );
        assert_eq!(quoted.prepare, [["transformPoints", "-scale", "(2 1 1)"]]);
        assert!(!of_script("runApplication icoFoam\nrunApplication foamToVTK\n", "icoFoam", true).parallel);
        let set =
            "runApplication foamDictionary -set 'uniform 1;' -entry value 0/T\nrunApplication checkMesh ;\n";
        let found = of_script(set, "icoFoam", false);
        let command = ["foamDictionary", "-set", "uniform 1;", "-entry", "value", "0/T"].map(String::from);
        assert_eq!(found.prepare, [command.to_vec(), vec!["checkMesh".into()]]);
    }

    #[test]
    fn variables_of_a_script_have_their_values() {
        let script = "decompDict=\"-decomposeParDict system/decomposeParDict.6\" # six\nmesh=fine\nrunApplication blockMesh -dict system/$mesh\n\
                      runApplication $decompDict decomposePar\nrunParallel $decompDict snappyHexMesh -overwrite\nrestore0Dir -processor\n\
                      runParallel ${decompDict} $(getApplication)\nrunApplication reconstructPar\n";
        let found = of_script(script, "icoFoam", true);
        let expected: [&[&str]; 3] = [
            &["blockMesh", "-dict", "system/fine"],
            &["snappyHexMesh", "-overwrite"],
            &["cp", "-rT", ORIGINAL, "0"],
        ];
        assert_eq!(found.prepare, expected);
        assert!(found.parallel && found.unknown.is_empty(), "{found:?}");
        let script = "a=x\nif [ $1 ]\nthen\n    a=y\nfi\nb=$(ls)\nrunApplication topoSet $a\n";
        let found = of_script(script, "icoFoam", true);
        assert!(found.prepare.is_empty(), "it may have another value");
        assert_eq!(found.unknown, ["if [ $1 ]", "a=y", "b=$(ls)", "runApplication topoSet $a"]);
    }

    #[test]
    fn what_may_be_done_is_left_out() {
        let script = "solids4Foam::runApplication blockMesh\nif [ \"$1\" = foam ]; then mirrorMesh; fi\nif [ \"$coupling\" = true ]\nthen\n    \
                      runApplication changeDictionary\nfi\nfor i in $(ls)\ndo\n    runApplication -s $i refineMesh -dict system/refine.$i\ndone\n\
                      runApplication setFields\nif [ \"$1\" = parallel ]\nthen\n    runApplication decomposePar\n    \
                      solids4Foam::runParallel icoFoam\nfi\nrunApplication foamToVTK\n";
        let found = of_script(script, "icoFoam", true);
        assert_eq!(found.prepare, [["blockMesh"], ["setFields"]]);
        assert!(!found.parallel, "it is serial by default");
        assert_eq!(found.unknown.len(), 7, "{:?}", found.unknown);
        assert!(found.unknown.contains(&"runApplication changeDictionary".to_string()));
    }

    #[test]
    fn a_loop_over_words_is_written_out() {
        let script = "for i in 1 2; do\n    runApplication -s $i topoSet -dict system/set.${i}\n    for d in x y\n    do\n        \
                      cp $d.$i $dd\n    done\ndone\nfor f in a; do cp $f b; done\nrunApplication icoFoam\n";
        let found = of_script(script, "icoFoam", true);
        let sets = |i: &str| vec!["topoSet".to_string(), "-dict".into(), format!("system/set.{i}")];
        assert_eq!(found.prepare, [sets("1"), sets("2")]);
        assert_eq!(
            found.unknown,
            ["cp x.1 $dd", "cp y.1 $dd", "cp x.2 $dd", "cp y.2 $dd", "for f in a; do cp $f b; done"]
        );
        assert_eq!(of_script("for i in 1\nrunApplication a\n", "icoFoam", true).prepare, [["a"]; 0]);
        let deep = "for i in 0 1 2 3 4 5 6 7 8 9\n".repeat(12) + &"done\n".repeat(12);
        assert!(lines(&deep).len() < WRITTEN_OUT);
    }

    #[test]
    fn what_is_done_in_other_folders_is_left_out() {
        let script = "cd \"${0%/*}\" || exit\ncd mesh && runApplication blockMesh; cd ..\nrunApplication setFields\ncd mesh\nrunApplication checkMesh\ncd ..\n(\n    cd a/b || exit\n\n    \
                      runApplication topoSet\n)\ncp a b\ncd ../other && mv c d\ncp e f\nrunApplication icoFoam\n";
        let found = of_script(script, "icoFoam", true);
        assert_eq!(found.prepare, [vec!["setFields"], vec!["cp", "a", "b"]]);
        let left = ["cd mesh && runApplication blockMesh; cd ..", "cd mesh", "runApplication checkMesh", "("];
        assert_eq!(found.unknown[..4], left);
        assert_eq!(
            found.unknown[4..],
            [
                "cd a/b || exit",
                "runApplication topoSet",
                ")",
                "cd ../other && mv c d",
                "cp e f",
                "runApplication icoFoam"
            ]
        );
    }

    #[test]
    fn what_comes_behind_a_plain_solver_is_left_out() {
        for (solver, parallel) in
            [("icoFoam > log", false), ("mpirun -np 2 icoFoam -parallel | tee log", true)]
        {
            let found = of_script(&format!("cp a b\nblockMesh\n{solver}\ncp 1/U c\n"), "icoFoam", false);
            assert_eq!(found.prepare, [["cp", "a", "b"]]);
            assert_eq!((found.parallel, found.unknown), (parallel, vec!["blockMesh".to_string()]));
        }
    }

    #[test]
    fn the_solver_is_found_however_it_is_started() {
        for (solver, parallel) in [
            ("$application > log.run", false),
            ("mpirun -np 4 $(getApplication) -parallel > log &", true),
            ("foamJob -parallel -screen icoFoam", true),
            ("foamJob `getApplication`", false),
            ("runParallel \"${application}\"", true),
        ] {
            let script = format!(
                "application=$(getApplication)\nrunApplication blockMesh || exit 1\n{solver}\nrunApplication foamToVTK\n"
            );
            let found = of_script(&script, "icoFoam", false);
            assert_eq!(
                (&found.prepare[..], found.parallel),
                (&[vec!["blockMesh".to_string()]][..], parallel),
                "{solver}"
            );
            assert!(found.unknown.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn a_solver_of_another_case_is_not_the_end() {
        let script = "cd inlet\nrunApplication $(getApplication)\ncd ..\nrunApplication blockMesh;\nrunApplication mapFields inlet\n\
                      runApplication topoSet && runApplication setFields\nrunParallel icoFoam\n";
        let found = of_script(script, "icoFoam", false);
        assert_eq!(found.prepare, [vec!["blockMesh"], vec!["mapFields", "inlet"]]);
        let left = [
            "cd inlet",
            "runApplication $(getApplication)",
            "runApplication topoSet && runApplication setFields",
        ];
        assert_eq!((found.unknown, found.parallel), (left.map(String::from).to_vec(), true));
    }

    #[test]
    fn files_that_a_script_makes_are_made() {
        let script = "mkdir constant/polyMesh\nm4 -P system/mesh.m4 > system/blockMeshDict\nm4 < ../mesh.m4 > a\nmkdir $name\n";
        let found = of_script(script, "icoFoam", true);
        let m4 = ["sh", "-c", "m4 -P system/mesh.m4 > system/blockMeshDict"];
        assert_eq!(found.prepare, [["mkdir", "-p", "constant/polyMesh"], m4]);
        assert_eq!(found.unknown, ["m4 < ../mesh.m4 > a", "mkdir $name"]);
    }
}
