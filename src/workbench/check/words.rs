//! What a solver's log says of its end.

use super::Report;
use m4gn_base::Error;

/// Longest text of a message.
const LONGEST: usize = 600;

/// Steps that a jump takes, and the solver's next ones.
const FEWEST: usize = 25;

/// A fatal error of OpenFOAM: its text, and whether it is m4gn's.
pub(super) fn fatal(log: &str) -> Option<(String, bool)> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let begin = lines.iter().position(|l| l.contains("FOAM FATAL"))?;
    let rest = &lines[begin + 1..];
    let end = rest.iter().position(|l| l.starts_with("From ")).unwrap_or(rest.len().min(8));
    let text: Vec<&str> = rest[..end].iter().copied().filter(|l| !l.is_empty()).collect();
    let ours = rest[end..].iter().take(2).any(|l| l.contains("m4gn"));
    Some((shown(&text.join(" ")), ours))
}

/// Why OpenFOAM has left the function object out, which it tells as a warning.
fn dropped(log: &str) -> Option<String> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let end = lines.iter().position(|l| l.contains("while loading function object"))?;
    let begin = lines[..end].iter().rposition(|l| l.contains("FOAM Warning"))?;
    let text = lines[begin + 1..end].iter().take_while(|l| !l.starts_with("From ")).filter(|l| !l.is_empty());
    Some(shown(&text.copied().collect::<Vec<_>>().join(" ")))
}

/// What a program said when it failed: OpenFOAM's error, or its own end.
pub(crate) fn words(log: &str, error: &Error) -> String {
    let said = match error {
        Error::File { message, .. } => message.replace("--timeout", "--seconds"),
        error => error.to_string(),
    };
    fatal(log).map_or(said, |(text, _)| text)
}

/// Why a surrogate does not fit; none: it does.
pub(super) fn why(report: &Report, log: &str, failed: Option<&Error>, solver: &str) -> Option<String> {
    let said = failed.map(|e| words(log, e));
    match (said, fatal(log)) {
        (Some(_), Some((text, true))) => Some(text),
        (Some(said), _) if report.jumped => Some(format!("{solver} did not carry on from the jump: {said}")),
        (Some(said), _) => Some(format!("{solver} itself ended in an error, before any jump: {said}")),
        (None, _) if report.surrogate.is_empty() => Some(match dropped(log) {
            Some(text) => format!("{solver} goes on without the function object: {text}"),
            None => format!(
                "{solver} ended without function objects: it executes none, or the run begins at its end"
            ),
        }),
        (None, _) if report.steps == 0 => Some(format!("{solver} made no time step")),
        (None, _) if report.jumped && report.steps_after > 0 => None,
        (None, _) if report.steps < FEWEST => Some(format!(
            "{} steps of {solver} were too few for a jump: the run is too short, or they took too long (--seconds)",
            report.steps
        )),
        (None, _) => Some(format!(
            "there was no jump in {} steps of {solver} up to time {}: its fields do not change",
            report.steps, report.time
        )),
    }
}

/// What the function object said of its jump, and warned of.
pub(super) fn notes(log: &str) -> Vec<String> {
    let lines: Vec<&str> = log.lines().map(plain).collect();
    let told = lines.iter().filter_map(|l| l.strip_prefix("m4gn: ")).find(|l| l.starts_with("jumped "));
    let mut notes: Vec<String> =
        told.iter().map(|l| shown(l.split("; a stride").next().unwrap_or(l))).collect();
    for (i, _) in lines.iter().enumerate().filter(|(_, l)| l.contains("FOAM Warning")) {
        let rest = &lines[i + 1..];
        let head = rest.iter().take_while(|l| l.starts_with("From ") || l.starts_with("in file ")).count();
        if rest[..head].iter().any(|l| l.contains("m4gn")) {
            let text: Vec<&str> = rest[head..].iter().copied().take_while(|l| !l.is_empty()).collect();
            notes.push(shown(&format!("warning: {}", text.join(" "))));
        }
    }
    notes.dedup();
    notes
}

/// What a stride of the dmd surrogate takes with this window, s: what the jump took, and what each further state adds. None: nothing was timed.
pub(super) fn stride(log: &str, window: usize) -> Option<f64> {
    let told =
        |begin: &str| log.lines().map(plain).find_map(|l| l.strip_prefix("m4gn: ")?.split(begin).nth(1));
    let number = |text: &str| text.split_whitespace().next()?.trim_end_matches(';').parse::<f64>().ok();
    let jump = told("jumped 1 steps").and_then(|l| number(l.split(" in ").nth(1)?))?;
    let states = told(": fit of ").and_then(number)?;
    let each = told("each state of the window adds ").and_then(number)?;
    Some(jump + (window as f64 - states) * each)
}

/// A line without the number of the rank that mpirun puts before it, and blanks.
fn plain(line: &str) -> &str {
    let line = line.trim();
    match line.strip_prefix('[').and_then(|l| l.split_once(']')) {
        Some((rank, rest)) if rank.bytes().all(|b| b.is_ascii_digit()) => rest.trim(),
        _ => line,
    }
}

fn shown(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REFUSED: &str = "Time = 1\n\n[1] --> FOAM FATAL ERROR: \n[1] The dmd surrogate cannot hand states over: there are\n[1]     several \
                           phases\n[1] \n[1]     From void Foam::m4gnState::checkCase()\n[1]     in file m4gnState.C at line 3.\n";
    const OWN: &str = "--> FOAM FATAL IO ERROR: \ncannot find file\n\nfile: 0/U at line 0.\n\n    From virtual readStream\n    in file r.C\n";

    fn failed() -> Error {
        Error::file("log.icoFoam", "icoFoam failed (exit status: 1)")
    }

    #[test]
    fn a_refusal_is_told_from_an_error_of_the_solver() {
        let (text, ours) = fatal(REFUSED).unwrap();
        assert_eq!(
            (text.as_str(), ours),
            ("The dmd surrogate cannot hand states over: there are several phases", true)
        );
        assert_eq!(why(&Report::default(), REFUSED, Some(&failed()), "icoFoam").unwrap(), text);
        let own = why(&Report::default(), OWN, Some(&failed()), "icoFoam").unwrap();
        assert_eq!(
            own,
            "icoFoam itself ended in an error, before any jump: cannot find file file: 0/U at line 0."
        );
        let crashed =
            why(&Report { jumped: true, ..Report::default() }, "Time = 3", Some(&failed()), "icoFoam")
                .unwrap();
        assert!(crashed.contains("did not carry on") && crashed.contains("exit status: 1"), "{crashed}");
    }

    #[test]
    fn a_run_that_ends_well_may_not_have_jumped() {
        let of = |report: Report| why(&report, "", None, "icoFoam");
        let made = Report { surrogate: "dmd".into(), steps: 9, ..Report::default() };
        assert!(of(Report::default()).unwrap().contains("it executes none"));
        let regions = "--> FOAM Warning : \n\n    request for region0 failed\n\n    From x\n--> while loading function object 'c'\n";
        let left_out = why(&Report::default(), regions, None, "chtFoam").unwrap();
        assert_eq!(left_out, "chtFoam goes on without the function object: request for region0 failed");
        assert!(of(Report { steps: 0, ..made.clone() }).unwrap().contains("no time step"));
        assert!(of(made.clone()).unwrap().contains("9 steps of icoFoam were too few"));
        assert!(of(Report { steps: 99, ..made.clone() }).unwrap().contains("no jump in 99 steps"));
        assert_eq!(of(Report { jumped: true, steps_after: 5, ..made }), None);
    }

    #[test]
    fn warnings_and_jumps_are_noted() {
        let log = "m4gn: jumped 1 steps of 0.1 s; a stride beside was off\nx\n--> FOAM Warning : \n    From void Foam::m4gnFlowCompletion()\n    in file a\n    sources act\n\n--> FOAM \
                   Warning : \n    From void Foam::other()\n    in file b\n    not ours\n\n";
        assert_eq!(notes(log), ["jumped 1 steps of 0.1 s", "warning: sources act"]);
    }

    #[test]
    fn each_state_of_a_window_has_its_share_of_a_stride() {
        let log = "m4gn: time 1: fit of 14 states, 2 delays\n\nm4gn: each state of the window adds 5.0e-4 s to a stride of the fit\n\nm4gn: jumped 1 steps of 0.1 s to time \
                   2 in 0.018 s; a stride beside";
        assert!((stride(log, 40).unwrap() - 0.031).abs() < 1e-12);
        assert_eq!(stride(&log.replace("adds", "has"), 40), None);
    }
}
