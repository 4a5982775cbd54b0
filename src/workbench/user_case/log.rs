//! OpenFOAM's messages in a log: its fatal error and its warnings, which have a form of their own.

use m4gn_base::Error;

/// Longest text of a message.
const LONGEST: usize = 600;

/// A fatal error of OpenFOAM: its text, and whether it is m4gn's.
pub(crate) fn fatal(log: &str) -> Option<(String, bool)> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let begin = lines.iter().position(|l| l.contains("FOAM FATAL"))?;
    let rest = &lines[begin + 1..];
    let end = rest.iter().position(|l| l.starts_with("From ")).unwrap_or(rest.len().min(8));
    Some((joined(&rest[..end]), rest[end..].iter().take(2).any(|l| l.contains("m4gn"))))
}

/// Why OpenFOAM has left the function object of this name out, which it tells as a warning.
pub(crate) fn dropped(log: &str, name: &str) -> Option<String> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let told = format!("while loading function object '{name}'");
    let end = lines.iter().position(|l| l.contains(&told))?;
    let begin = lines[..end].iter().rposition(|l| l.contains("FOAM Warning"))?;
    let from = lines[begin..end].iter().position(|l| l.starts_with("From ")).map_or(end, |n| begin + n);
    Some(joined(&lines[begin + 1..from]))
}

/// m4gn's warnings.
pub(crate) fn warnings(log: &str) -> Vec<String> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let mut found = Vec::new();
    for (i, _) in lines.iter().enumerate().filter(|(_, l)| l.contains("FOAM Warning")) {
        let rest = &lines[i + 1..];
        let head = rest.iter().take_while(|l| l.starts_with("From ") || l.starts_with("in file ")).count();
        if rest[..head].iter().any(|l| l.contains("m4gn")) {
            let end = rest[head..].iter().position(|l| l.is_empty()).map_or(rest.len(), |n| head + n);
            found.push(joined(&rest[head..end]));
        }
    }
    found.dedup();
    found
}

/// What a program said when it failed: OpenFOAM's error, or its own end.
pub(crate) fn words(log: &str, error: &Error) -> String {
    let said = match error {
        Error::File { message, .. } => message.clone(),
        error => error.to_string(),
    };
    fatal(log).map_or(said, |(text, _)| text)
}

/// A line without the number of the rank that mpirun puts before it, and blanks.
fn plain(line: &str) -> &str {
    let line = line.trim();
    match line.strip_prefix('[').and_then(|l| l.split_once(']')) {
        Some((rank, rest)) if rank.bytes().all(|b| b.is_ascii_digit()) => rest.trim(),
        _ => line,
    }
}

/// The lines as one text: a full stop where a line that ends without one is followed by a new sentence or by the file's name.
fn joined(lines: &[&str]) -> String {
    let mut text = String::new();
    for line in lines.iter().filter(|l| !l.is_empty()) {
        let begins = line.starts_with("file: ")
            || line.starts_with(|c: char| c.is_ascii_uppercase())
                && line[1..].starts_with(|c: char| c.is_ascii_lowercase());
        if begins && text.ends_with(|c: char| !c.is_ascii_punctuation() || c == ')') {
            text.push('.');
        }
        text += if text.is_empty() { "" } else { " " };
        text += line;
    }
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_told_from_an_error_of_the_solver() {
        let refused = "Time = 1\n\n[1] --> FOAM FATAL ERROR: \n[1] The dmd surrogate cannot hand states over: there are\n[1]     several \
                       phases\n[1] \n[1]     From void Foam::m4gnState::checkCase()\n[1]     in file m4gnState.C at line 3.\n";
        let text = "The dmd surrogate cannot hand states over: there are several phases";
        assert_eq!(fatal(refused), Some((text.to_string(), true)));
        let own = "--> FOAM FATAL IO ERROR: \ncannot find file\n\nfile: 0/U at line 0.\n\n    From virtual readStream\n    in file r.C\n";
        assert_eq!(fatal(own), Some(("cannot find file. file: 0/U at line 0.".to_string(), false)));
        let failed = Error::file("log.icoFoam", "icoFoam failed (exit status: 1)");
        assert_eq!(words(refused, &failed), text);
        assert_eq!(words("Time = 3", &failed), "icoFoam failed (exit status: 1)");
        let late = "icoFoam was ended after 9 s (--timeout)";
        assert_eq!(words("Time = 3", &Error::file("log.icoFoam", late)), late);
    }

    #[test]
    fn the_whole_of_a_reason_is_told() {
        let log = "--> FOAM FATAL ERROR: \nFunction object m4gnCheck of type m4gnSurrogate: the mesh has moved, and a surrogate has one mesh\n    \
                   Remove the function object, or run on a fixed mesh\n\n    From void Foam::m4gn::refuseMotion()\n    in file m4gnCaseChecks.C\n";
        let (text, ours) = fatal(log).unwrap();
        assert!(ours && text.contains("one mesh. Remove the") && text.ends_with("a fixed mesh"), "{text}");
    }

    #[test]
    fn warnings_are_noted() {
        let log = "--> FOAM Warning : \n    From void Foam::m4gnFlowCompletion()\n    in file a\n    sources act\n    here\n\n--> FOAM \
                   Warning : \n    From void Foam::other()\n    in file b\n    not ours\n\n";
        assert_eq!(warnings(log), ["sources act here"]);
        let of = |why: &str, name: &str| {
            format!(
                "--> FOAM Warning : \n\n    {why}\n\n    From x\n--> while loading function object '{name}'\n"
            )
        };
        let log = of("unknown type", "pictures") + &of("request for region0 failed", "c");
        assert_eq!(dropped(&log, "c").unwrap(), "request for region0 failed");
        assert_eq!(dropped(&log, "d"), None);
    }
}
