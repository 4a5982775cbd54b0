//! What came of the jumps of a run: a table, notes, and whether all is well.

use super::Jump;
use m4gn_report::{Table, figure};
use serde::Serialize;
use std::collections::BTreeMap;

/// What came of a jump.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Verified {
    /// What the run says of it.
    #[serde(flatten)]
    pub jump: Jump,
    /// Time from which it was recomputed, s; none: nothing was.
    pub from: Option<f64>,
    /// Time of the comparison, s.
    pub to: Option<f64>,
    /// Earlier jumps that have a part of this stretch: their errors count as well.
    pub earlier_jumps: usize,
    /// Errors of the fields over the largest variation so far.
    pub errors: BTreeMap<String, f64>,
    /// Errors of holding the fields from which it was recomputed.
    pub holding: BTreeMap<String, f64>,
    /// Largest error of the fields that the tolerance holds for, of all where it holds for none.
    pub worst: Option<f64>,
    /// Whether that is within the tolerance; none: there is none, or nothing was compared.
    pub within: Option<bool>,
    /// Why it could not be compared.
    pub why: Option<String>,
    /// Whether the solver, or the comparison, has failed.
    pub failed: bool,
}

/// What came of a run.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Folder.
    pub case: String,
    /// Its solver.
    pub application: String,
    /// All jumps.
    pub jumps: Vec<Verified>,
    /// Correctors at which the run's time steps end, short of their tolerance, where they do: such a solver goes on otherwise from files.
    pub capped: Option<u64>,
}

impl Report {
    /// A row a jump.
    pub fn table(&self) -> Table {
        let mut fields: Vec<&String> = self.jumps.iter().flat_map(|j| j.errors.keys()).collect();
        fields.sort();
        fields.dedup();
        let mut headers: Vec<String> =
            ["jump", "begun s", "ended s", "from s", "to s"].map(String::from).into();
        headers.extend(fields.iter().map(|f| format!("error({f})")));
        headers.extend(["worst", "of holding", "the run said", "tolerance"].map(String::from));
        let mut table = Table::new(headers);
        let time = |value: Option<f64>| figure(value, 6);
        for (i, one) in self.jumps.iter().enumerate() {
            let jump = &one.jump;
            let mark = if one.earlier_jumps > 0 { "*" } else { "" };
            let mut row = vec![format!("{} {}", i + 1, jump.surrogate)];
            row.extend([Some(jump.begun), Some(jump.ended)].map(time));
            row.extend([time(one.from) + mark, time(one.to)]);
            row.extend(fields.iter().map(|f| figure(one.errors.get(*f).copied(), 3)));
            row.extend([one.worst, one.of_holding(), jump.estimate, jump.tolerance].map(|v| figure(v, 3)));
            table.row(row);
        }
        table
    }

    /// What the table does not say.
    pub fn notes(&self) -> Vec<String> {
        let counted = |is: &dyn Fn(&Verified) -> bool| self.jumps.iter().filter(|j| is(j)).count();
        let mut notes = Vec::new();
        let part = counted(&|j| j.to.is_some_and(|to| j.jump.is_behind(to)));
        let (earlier, open) = (counted(&|j| j.earlier_jumps > 0), counted(&|j| j.why.is_some() && !j.failed));
        if earlier > 0 {
            notes.push(format!("*: in {earlier} the errors of jumps before count as well: nothing is written where they begin"));
        }
        if part > 0 {
            notes.push(format!("{part} are compared within the jump: nothing is written where they end"));
        }
        if open > 0 {
            notes.push(format!(
                "{open} cannot be verified: no times are there to recompute them from and to compare at"
            ));
        }
        if earlier + part + open > 0 {
            notes.push(
                "writeJumps yes; in the dictionary of m4gnSurrogate writes where each jump begins and ends, purgeWrite 0; in controlDict keeps it"
                    .into(),
            );
        }
        if let Some(cap) = self.capped {
            notes.push(format!(
                "the run's time steps end at nCorrectors {cap}: {} goes on otherwise from files, and errors of that count as well. \
                 Raise nCorrectors until steps reach their tolerance, and run it again",
                self.application
            ));
        }
        let failed = self.jumps.iter().enumerate().filter(|(_, j)| j.failed);
        notes
            .extend(failed.map(|(i, j)| format!("jump {}: {}", i + 1, j.why.as_deref().unwrap_or_default())));
        notes
    }

    /// What is wrong with the run, or with what was to be shown of it; none: all that was compared is within the tolerance.
    pub fn fault(&self) -> Option<String> {
        let beyond = self.jumps.iter().filter(|j| j.within == Some(false)).count();
        let failed = self.jumps.iter().filter(|j| j.failed).count();
        let compared = self.jumps.iter().filter(|j| j.worst.is_some()).count();
        let all = self.jumps.len();
        match (beyond, failed, compared) {
            (1.., ..) => Some(format!("{beyond} of {all} jumps have an error above the tolerance")),
            (_, 1.., _) => Some(format!("{failed} of {all} jumps could not be recomputed")),
            (_, _, 0) => Some("no jump could be verified".into()),
            _ => None,
        }
    }
}

impl Verified {
    /// The largest error over that of holding, of the fields that count.
    pub(super) fn of_holding(&self) -> Option<f64> {
        let worst = self.worst?;
        let (name, _) = self.errors.iter().find(|(_, e)| **e == worst)?;
        let holding = self.holding.get(name)?;
        (*holding > 0.0).then(|| worst / holding)
    }
}
