//! Decides which surrogate jumps, and for how many strides. A fit that holds goes first; before one does, the network may jump. Strides
//! beside the solver measure each of them, and control lets it jump.

use crate::answer::Phase;
use crate::candidate::Verdict;
use crate::control::Control;
use crate::jump::Jump;
use crate::ride::Ride;
use crate::settings::Mode;
use crate::tables::row;
use m4gn_base::{Error, Result};
use serde_json::{Map, Value, json};

impl Ride<'_> {
    /// Compares where the solver has come a stride. The run ends where all surrogates that may have a turn stay bad and the settings say stop.
    /// Collective.
    pub(crate) fn measure(&mut self) -> Result<()> {
        let (mut failure, n) = (None, self.fields.len());
        for candidate in &mut self.candidates {
            (candidate.verdict, candidate.measured) = (Verdict::None, None);
            if candidate.has_arrived(&self.step) {
                let found = candidate.measure(&self.comm, &self.layout, &self.step, &self.present, n);
                match found {
                    Err(e @ Error::Numerical(_)) => failure = Some(e),
                    other => other?,
                }
                self.totals.measured += 1;
            }
        }
        // They are measured at different times, and of those that are no fits the first alone
        let first = self.candidates.iter().position(|c| !c.is_fit());
        let mut turns = self.candidates.iter().enumerate().filter(|(i, c)| c.is_fit() || Some(*i) == first);
        match failure {
            Some(e) if turns.all(|(_, c)| c.control.as_ref().is_some_and(Control::stays_bad)) => Err(e),
            _ => Ok(()),
        }
    }

    /// Who may take the next jump: a fit that holds, else the first surrogate that is none; none while a fit needs the solver's states.
    pub(crate) fn turn(&self) -> Option<usize> {
        let fit = self.candidates.iter().position(|c| c.has_fit());
        if fit.is_some() || self.candidates.iter().any(|c| c.wants_solver()) {
            return fit;
        }
        self.candidates.iter().position(|c| !c.is_fit())
    }

    /// The solver goes on from here: strides beside it begin, where one could be followed by a jump. `anew`: from another state than it
    /// arrived at. Collective.
    pub(crate) fn begin_shadows(&mut self, anew: bool) -> Result<()> {
        for candidate in &mut self.candidates {
            candidate.shadow.waiting &= !anew;
        }
        // What a step does that is longer than a stride would be compared with a prediction of less
        let may = |&i: &usize| {
            self.candidates[i].can_begin(&self.step) && !self.candidates[i].is_outgrown(&self.step)
        };
        let Some(turn) = self.turn().filter(may) else { return Ok(()) };
        let duration = self.candidates[turn].stride();
        let ahead = self.ahead(turn, false, duration)?;
        let candidate = &mut self.candidates[turn];
        let start = crate::surrogate::Start { state: &self.present, ahead: ahead.as_ref(), duration };
        let bad = candidate.shadow.begin(candidate.surrogate.as_mut(), &self.step, start)?;
        self.stepped = true;
        self.log.not_finite(&self.step.name, bad);
        Ok(())
    }

    /// The jump that may begin now.
    pub(crate) fn next_jump(&mut self) -> Result<Option<Jump>> {
        let step = self.step.clone();
        self.totals.first_time.get_or_insert(step.time);
        let controlled = self.settings.control.is_some();
        if step.index - self.handed_back < self.schedule.solver_steps {
            return Ok(None);
        }
        if let Some(cuts) = self.candidates.iter().position(|c| c.surrogate.fits().is_some_and(|f| f.cuts()))
        {
            return Ok(Some(self.jump_of(cuts, 1, "start_up")));
        }
        if self.candidates.iter().any(|c| c.surrogate.fits().is_some_and(|f| f.waits())) {
            return Ok(None);
        }
        let turn = self.turn();
        // What was measured before another's turn says nothing of the next one.
        let others = self.candidates.iter_mut().enumerate().filter(|(i, _)| Some(*i) != turn);
        others.for_each(|(_, c)| c.fresh = false);
        let Some(turn) = turn else { return Ok(None) };
        let (digits, candidate) = (self.digits(), &mut self.candidates[turn]);
        let stride = candidate.stride();
        if candidate.is_outgrown(&step) {
            candidate.fresh = false;
            let source = candidate.describe().source.clone();
            self.log.short_stride(&step.name, &source, [digits.of(stride), digits.of(step.delta_t)]);
            return Ok(None);
        }
        let measured = !controlled || candidate.fresh && candidate.is_ready(step.time);
        if !measured || !self.schedule.fits(&step, step.delta_t, stride, 1.0) {
            return Ok(None);
        }
        let (most, judgement) = self.watch.most(&step.name, self.schedule.surrogate_steps);
        self.log.judged(&step, "correctors", judgement, &mut self.decisions);
        let most = [self.schedule.surrogate_steps, most, self.quantities.most(most)];
        if most[2] == 0 {
            return Ok(None);
        }
        let by_fit = self.candidates[turn].by_fit(most[2]);
        let strides = self.candidates[turn].allowed(most[2], &step);
        let limits =
            [(most[1], "correctors"), (most[2], "quantities"), (by_fit, "fit"), (strides, "control")];
        // The first that leaves no more than this
        let limited = limits.iter().find(|(n, _)| *n == strides && *n < most[0]).map_or("longest", |l| l.1);
        self.totals.refused += usize::from(strides == 0 && controlled);
        if strides == 0 {
            return Ok(None);
        }
        let candidate = &self.candidates[turn];
        let expected = candidate.control.as_ref().map(|_| candidate.expected);
        Ok(Some(Jump { expected, ..self.jump_of(turn, strides, limited) }))
    }

    /// A jump of which nothing is taken, from the present state.
    pub(crate) fn jump_of(&self, surrogate: usize, strides: usize, limited: &'static str) -> Jump {
        let (delta_t, began) = (self.step.delta_t, self.totals.seconds);
        Jump { surrogate, strides, delta_t, began, limited, ..Jump::default() }
    }

    /// Who a surrogate is, in messages.
    pub(crate) fn who(&self, candidate: usize) -> String {
        match self.candidates.len() {
            1 => "the surrogate".into(),
            _ => format!("the {} surrogate", self.candidates[candidate].describe().name),
        }
    }

    /// Tells that a jump begins, where one does.
    pub(crate) fn tell_begun(&mut self) {
        let Phase::Jumping(jump) = &self.phase else { return };
        let candidate = &self.candidates[jump.surrogate];
        let (jumper, control) = (candidate.describe(), candidate.control.as_ref());
        let [error, estimate] = jump.expected.map_or([None; 2], |e| e.map(Some));
        let advanced = self.layout.pick(&jumper.advances);
        let decided = json!({
            "surrogate": jumper.name, "strides": jump.strides, "stride": jumper.stride, "limited_by": jump.limited, "error": error,
            "estimate": estimate, "fields": advanced.iter().map(|a| &a.name).collect::<Vec<_>>(),
            "tolerance": control.map(|c| c.settings().tolerance), "held": control.map(|c| c.held()),
        });
        self.decisions.tell(&self.step, "jump_begun", &decided);
    }

    /// Tells what was measured at this time and what was decided by it: a line of the log, and a row for each surrogate.
    pub(crate) fn tell_measured(&mut self) {
        let digits = self.digits();
        let decided = self.candidates.iter().any(|c| c.verdict != Verdict::None);
        let all = self.candidates.iter().enumerate();
        let reports: Vec<String> = all
            .filter(|(_, c)| c.measured.is_some() || c.verdict != Verdict::None)
            .map(|(i, c)| c.report(&self.who(i), digits))
            .collect();
        if reports.is_empty() || self.settings.control.is_none() {
            return;
        }
        let (time, reports) = (&self.step.name, reports.join("; "));
        let jumper = self.candidates.iter().position(|c| c.verdict == Verdict::Jumps);
        let text = match jumper {
            Some(jumper) => format!("m4gn: time {time}: {reports}: {} jumps\n\n", self.who(jumper)),
            None if decided => format!("m4gn: no jump at time {time}: {reports}. The solver goes on\n\n"),
            None => format!("m4gn: time {time}: {reports}\n\n"),
        };
        self.log.text += &text;
        if decided {
            let refused = std::mem::replace(&mut self.log.refused, jumper.is_none());
            if refused && let Some(jumper) = jumper {
                self.log.text += &format!("m4gn: {} may jump again\n\n", self.who(jumper));
            }
        }
        if !self.log.strides.begun {
            let names = ["Time", "surrogate", "error", "estimate", "decision"].map(String::from);
            let pairs = self.layout.pick(&self.fields);
            let pairs =
                pairs.iter().flat_map(|f| ["error", "change"].map(|kind| format!("{kind}({})", f.name)));
            let names: Vec<String> = names.into_iter().chain(pairs).collect();
            let lines = ["Strides of the surrogates beside the solver".into()];
            self.log.strides.begin(digits.header(&lines, &[], &names));
        }
        for candidate in &mut self.candidates {
            if candidate.measured.is_none() && candidate.verdict == Verdict::None {
                continue;
            }
            let measured =
                candidate.measured.take().unwrap_or_else(|| vec![[f64::NAN; 2]; self.fields.len()]);
            let fields = self.layout.pick(&self.fields);
            let each = |k: usize| -> Map<String, Value> {
                let values = fields.iter().zip(&measured).filter(|(_, v)| v[k].is_finite());
                values.map(|(f, v)| (f.name.clone(), json!(v[k]))).collect()
            };
            let decided = json!({
                "surrogate": candidate.describe().name, "error": candidate.expected[0], "estimate": candidate.expected[1],
                "decision": candidate.verdict.word(), "errors": each(0), "changes": each(1),
            });
            self.decisions.tell(&self.step, "stride", &decided);
            let [error, estimate] = candidate.expected.map(|v| digits.of(v));
            let mut columns = vec![
                digits.of(self.step.output_time),
                candidate.describe().name.clone(),
                error,
                estimate,
                candidate.verdict.word().into(),
            ];
            columns.extend(measured.iter().flatten().map(|v| digits.of(*v)));
            self.log.strides.text += &row(&columns);
        }
    }

    /// Whether strides are taken beside the solver for jumps.
    pub(crate) fn is_controlled(&self) -> bool {
        self.settings.mode == Mode::Replace && self.settings.control.is_some() && self.is_measured(&self.step)
    }
}
