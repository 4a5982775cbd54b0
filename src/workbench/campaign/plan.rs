//! Which start a run tries, by what finished runs took.

use super::cycle::{self, length, offset};
use super::start::{Scale, Sister, Start, ratio};
use crate::signal::median;
use m4gn_base::listed;

/// What is taken from sisters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The limit cycles of the finished runs around it, interpolated at one phase.
    Cycle,
    /// The last state of the nearest one.
    Nearest,
}

impl Kind {
    /// As records have it.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Cycle => "cycle",
            Kind::Nearest => "nearest",
        }
    }
}

/// What a run tries to start from: the first of these that can be had.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Each kind with why.
    pub kinds: Vec<(Kind, Option<String>)>,
    /// Why it is cold where none can be had.
    pub cold: Option<String>,
}

/// Runs of a kind after which it is judged.
const TRIED: usize = 2;
/// Periods that a run has, at least, to go on for one more.
const PERIODS: f64 = 5.0;

impl Plan {
    /// Of the finished runs, nearest first.
    ///
    /// A kind pays where the median of what its runs took, each over what the nearest cold run took, is below 1; a start
    /// without an answer counts with the cold run behind it. A kind is tried until two runs have begun so, and again, where no other pays, if none has
    /// begun from as near as twice the distance of this run's nearest sister.
    pub fn new(start: Start, sisters: &[Sister]) -> Plan {
        let mut kinds = match start {
            Start::Cold => Vec::new(),
            Start::Nearest => vec![(Kind::Nearest, None)],
            Start::Auto => vec![(Kind::Cycle, None), (Kind::Nearest, None)],
        };
        let mut cold = None;
        match (start, sisters.first()) {
            (Start::Cold, _) | (Start::Nearest, Some(_)) => {}
            (_, None) => cold = Some("no sister is finished".to_string()),
            (Start::Auto, Some(first)) => {
                let judged =
                    [Kind::Cycle, Kind::Nearest].map(|kind| (kind, share(kind, sisters, first.far())));
                let words = |share: f64| format!("took {} of a cold run", m4gn_report::number(share, 2));
                let told = |(k, s): &(Kind, Option<f64>)| Some(format!("{} {}", k.name(), words((*s)?)));
                let all = listed(judged.iter().filter_map(told));
                let mut some: Vec<(Kind, Option<f64>)> =
                    judged.into_iter().filter(|(_, share)| share.is_none_or(|s| s < 1.0)).collect();
                // Those that are new, those that pay, those that may now
                let place = |(kind, share): &(Kind, Option<f64>)| {
                    share.unwrap_or(if of(*kind, sisters).count() < TRIED { 0.0 } else { 1.0 })
                };
                some.sort_by(|a, b| place(a).total_cmp(&place(b)));
                let why = |share: Option<f64>| Some(share.map_or("tried".to_string(), words));
                kinds = some.into_iter().map(|(kind, share)| (kind, why(share))).collect();
                cold = (!all.is_empty()).then_some(all);
            }
        }
        Plan { kinds, cold }
    }

    /// Time between two states that a run stores for its sisters, and how many it keeps; none: its last one. Where cycles are to be had, of the period
    /// that the nearest sister has.
    pub fn stored(&self, mesh: &str, sisters: &[Sister], scale: Scale<'_>) -> Option<(f64, usize)> {
        let nearest = sisters.first().filter(|_| self.cycles(mesh, sisters))?;
        Some(cycle::stored(nearest.record.period? / ratio(scale, &nearest.record).unwrap_or(1.0)))
    }

    /// The same of a run that has ended without, and for that goes on for a period of its own.
    pub fn behind(
        &self,
        mesh: &str,
        sisters: &[Sister],
        period: Option<f64>,
        duration: f64,
    ) -> Option<(f64, usize)> {
        let short = |period: &f64| period * PERIODS <= duration;
        period.filter(short).filter(|_| self.cycles(mesh, sisters)).map(cycle::stored)
    }

    /// Whether cycles are asked for, and on this mesh.
    fn cycles(&self, mesh: &str, sisters: &[Sister]) -> bool {
        !mesh.is_empty()
            && self.kinds.iter().any(|(kind, _)| *kind == Kind::Cycle)
            && (sisters.is_empty() || sisters.iter().any(|s| s.record.mesh == mesh))
    }
}

/// Those that began so, also in vain.
fn of(kind: Kind, sisters: &[Sister]) -> impl Iterator<Item = &Sister> {
    sisters.iter().filter(move |s| {
        let start = &s.record.start;
        start.kind == kind.name() || start.tried.as_deref() == Some(kind.name())
    })
}

/// What runs of a kind took, of what the cold run took that was nearest to each; none: it is to be tried. `far`: how far the run's nearest sister is.
fn share(kind: Kind, sisters: &[Sister], far: f64) -> Option<f64> {
    let cost = |s: &Sister| s.record.cost.to_answer().max(0.01);
    let near = of(kind, sisters).filter(|s| s.record.start.far.is_some_and(|f| f <= 2.0 * far));
    let shares = near.filter_map(|s| {
        let away = |other: &&Sister| length(&offset(&s.offset, &other.offset));
        let cold = sisters.iter().filter(|s| s.record.start.kind == "cold");
        Some((s.record.cost.tried + cost(s)) / cost(cold.min_by(|a, b| away(a).total_cmp(&away(b)))?))
    });
    median(shares).filter(|_| of(kind, sisters).count() >= TRIED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::start::nearest_first;
    use crate::campaign::start::tests::at;

    /// What is tried by a run at 0, as words, and why it is cold else.
    fn tried(sisters: &mut [Sister]) -> (Vec<String>, Option<String>) {
        nearest_first(sisters);
        let plan = Plan::new(Start::Auto, sisters);
        let word =
            |(kind, why): (Kind, Option<String>)| format!("{} {}", kind.name(), why.unwrap_or_default());
        (plan.kinds.into_iter().map(word).collect(), plan.cold)
    }

    #[test]
    fn what_did_not_pay_is_left_until_sisters_are_half_as_far() {
        let mut all = vec![at(0.5, "cold", 10.0, None), at(1.0, "nearest", 11.0, Some(0.5))];
        assert_eq!(tried(&mut all).0, ["cycle tried", "nearest tried"], "one is no judgement");
        all.push(at(-0.25, "nearest", 14.0, Some(0.5)));
        let cold = Some("nearest took 1.2 of a cold run".to_string());
        // The nearest is 0.25 away, and both began at 0.5
        assert_eq!(tried(&mut all), (vec!["cycle tried".to_string()], cold));
        all.push(at(0.2, "cold", 9.0, Some(0.3)));
        assert_eq!(tried(&mut all).0, ["cycle tried", "nearest tried"], "none began from as near as 0.4");
        all.push(at(-0.2, "nearest", 9.0, Some(0.1)));
        assert_eq!(tried(&mut all).0, ["cycle tried"], "9 of 9");
        all.extend([at(0.3, "cycle", 20.0, Some(0.1)), at(0.4, "cycle", 20.0, Some(0.1))]);
        let (kinds, cold) = tried(&mut all);
        assert_eq!((kinds.len(), cold.unwrap().contains("cycle took 2.1 of a cold run")), (0, true));
    }

    #[test]
    fn a_start_that_gives_no_answer_does_not_pay() {
        let in_vain = |place: f64| {
            let mut sister = at(place, "cold", 10.0, Some(0.5));
            sister.record.start.tried = Some("nearest".into());
            sister.record.cost.tried = 5.0;
            sister
        };
        let mut all = vec![at(1.0, "cold", 10.0, None), in_vain(0.5)];
        assert_eq!(tried(&mut all).0, ["cycle tried", "nearest tried"], "one is no judgement");
        all.push(in_vain(-0.5));
        let cold = Some("nearest took 1.5 of a cold run".to_string());
        assert_eq!(tried(&mut all), (vec!["cycle tried".to_string()], cold));
        assert_eq!(all[0].record.cost.total(), 15.0);
    }

    #[test]
    fn what_paid_most_is_taken_first() {
        // Of the cold runs at both ends, 20 and 5: halves, and four fifths
        let mut all = vec![
            at(-1.0, "cold", 20.0, None),
            at(1.0, "cold", 5.0, None),
            at(-0.5, "nearest", 10.0, Some(0.5)),
            at(-0.9, "nearest", 10.0, Some(0.5)),
            at(0.9, "cycle", 4.0, Some(0.5)),
            at(0.5, "cycle", 4.0, Some(0.5)),
        ];
        let first = ["nearest took 0.50 of a cold run", "cycle took 0.80 of a cold run"];
        assert_eq!(tried(&mut all).0, first);
        all.reverse();
        assert_eq!(tried(&mut all).0, first, "whatever the order of the records");
        // No run of the nearest state began from as near as this, and cycles pay
        for s in all.iter_mut().filter(|s| s.record.start.kind == "nearest") {
            s.record.start.far = Some(1.5);
        }
        assert_eq!(tried(&mut all).0, ["cycle took 0.80 of a cold run", "nearest tried"]);
    }

    #[test]
    fn states_are_stored_where_cycles_are_to_be_had() {
        let (sisters, none): ([Sister; 1], [Sister; 0]) = ([at(0.5, "cold", 10.0, None)], []);
        let auto = Plan::new(Start::Auto, &sisters);
        assert_eq!(auto.stored("m", &sisters, None), Some((0.25 / 8.0, 10)));
        assert_eq!(auto.stored("m", &sisters, Some(("U", "1"))), Some((0.125 / 8.0, 10)));
        assert_eq!(auto.stored("another mesh", &sisters, None), None);
        assert_eq!(auto.stored("m", &none, None), None);
        // A first run goes on where it has five periods
        let first = Plan::new(Start::Auto, &none);
        let behind = |plan: &Plan, period, duration| plan.behind("m", &none, period, duration);
        assert_eq!(behind(&first, Some(0.8), 4.0), Some((0.1, 10)));
        assert_eq!(behind(&first, Some(0.8), 3.9), None);
        assert_eq!(behind(&first, None, 8.0), None);
        assert_eq!(behind(&Plan::new(Start::Nearest, &none), Some(0.8), 8.0), None);
        assert_eq!(auto.behind("another mesh", &sisters, Some(0.8), 8.0), None);
    }
}
