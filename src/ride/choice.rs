//! Who jumps, and how far: each surrogate is measured on strides beside the solver, and of those that control lets jump the one takes the
//! next jump that was off by least.

use crate::jump::Jump;
use crate::ride::Ride;
use crate::rider::Verdict;
use crate::settings::Mode;
use crate::tables::row;
use crate::values::Given;
use m4gn_base::Result;

impl Ride<'_> {
    /// Compares where the solver has come a stride. The run ends where all surrogates stay bad and the settings say stop. Collective.
    pub(crate) fn measure(&mut self, given: &Given) -> Result<()> {
        let (mut failures, n) = (Vec::new(), self.fields.len());
        for rider in &mut self.riders {
            (rider.verdict, rider.measured) = (Verdict::None, None);
            if rider.has_arrived(&self.step) {
                failures.extend(rider.measure(&self.comm, &self.step, given, n).err());
                self.totals.measured += 1;
            }
        }
        match failures.len() == self.riders.len() {
            true => Err(failures.remove(0)),
            false => Ok(()),
        }
    }

    /// Who needs the solver's states before any surrogate jumps.
    fn waited_for(&self) -> Option<usize> {
        let wants = self.riders.iter().position(|r| r.surrogate.wants_solver());
        wants.filter(|_| self.settings.mode == Mode::Replace)
    }

    /// Says where the others begin to wait, and where their turn comes.
    pub(crate) fn tell_waiting(&mut self) {
        if self.riders.len() < 2 || !self.is_controlled() {
            return;
        }
        let whom = self.waited_for();
        let before = std::mem::replace(&mut self.log.waited_for, whom);
        let Some(one) = before.xor(whom) else { return };
        let (time, wanting) = (&self.step.name, self.who(one));
        let others = (0..self.riders.len()).filter(|i| *i != one).map(|i| self.who(i));
        let others = others.collect::<Vec<_>>().join(" and ");
        self.log.text += &match (whom, self.riders[one].surrogate.allows(1)) {
            (Some(_), _) => {
                format!(
                    "m4gn: time {time}: {others} waits, not measured, while {wanting} is given the solver's states\n\n"
                )
            }
            (None, 0) => format!("m4gn: time {time}: {others} has its turn: the last fit was far off\n\n"),
            (None, _) => {
                format!("m4gn: time {time}: {others} is measured again, beside a fit that holds\n\n")
            }
        };
    }

    /// The solver goes on from here: strides beside it begin, where one could be followed by a jump. `anew`: from another state than it arrived
    /// at. Collective.
    pub(crate) fn begin_shadows(&mut self, anew: bool, given: &Given) -> Result<()> {
        let waits = self.waited_for().is_some();
        for rider in &mut self.riders {
            rider.shadow.waiting &= !anew;
            if !waits && rider.can_begin(&self.step) {
                let bad = rider.shadow.begin(&self.comm, rider.surrogate.as_mut(), &self.step, given)?;
                self.stepped = true;
                self.log.not_finite(&self.step.name, bad);
            }
        }
        Ok(())
    }

    /// The jump that may begin now. Collective.
    pub(crate) fn next_jump(&mut self) -> Result<Option<Jump>> {
        let step = self.step.clone();
        self.totals.first_time.get_or_insert(step.time);
        // The next jump is most likely by whom the last one was.
        let stride = self.riders[self.totals.last].surrogate.stride();
        let measured = self.settings.control.is_none() || self.riders.iter().any(|r| r.fresh);
        if step.index - self.handed_back < self.schedule.solver_steps
            || !measured
            || !self.riders.iter().all(|r| r.is_settled(&step))
        {
            return Ok(None);
        }
        let (most, said) = self.watch.most(&step.name, self.schedule.surrogate_steps);
        self.log.judged(said);
        let most = self.quantities.most(most);
        if most == 0 {
            return Ok(None);
        }
        if self.schedule.fits(&step, step.delta_t, stride, 1.0) {
            self.learn(most)?;
        }
        let Some((surrogate, strides)) = self.choose(most) else {
            return Ok(None);
        };
        let rider = &mut self.riders[surrogate];
        if !self.schedule.fits(&step, step.delta_t, rider.surrogate.stride(), 1.0) {
            rider.verdict = Verdict::None;
            return Ok(None);
        }
        Ok(Some(Jump {
            surrogate,
            strides,
            done: 0,
            carried_on: false,
            delta_t: step.delta_t,
            over: false,
            began: self.totals.seconds,
            expected: rider.control.as_ref().map(|_| rider.expected),
        }))
    }

    /// Who jumps, and how far.
    fn choose(&mut self, most: usize) -> Option<(usize, usize)> {
        let mut best: Option<(usize, usize)> = None;
        for i in 0..self.riders.len() {
            let strides = self.riders[i].allowed(most, &self.step);
            let error = |i: usize| self.riders[i].expected[0];
            if strides > 0 && best.is_none_or(|(other, _)| error(i) < error(other)) {
                best = Some((i, strides));
            }
        }
        best = best.filter(|_| self.waited_for().is_none());
        if let Some((who, _)) = best {
            self.riders[who].verdict = Verdict::Jumps;
        }
        self.totals.refused += usize::from(best.is_none() && self.settings.control.is_some());
        best
    }

    /// Who a surrogate is, in messages.
    pub(crate) fn who(&self, rider: usize) -> String {
        match self.riders.len() {
            1 => "the surrogate".into(),
            _ => format!("the {} surrogate", self.riders[rider].surrogate.name()),
        }
    }

    /// Tells what was measured at this time and what was decided by it: a line of the log, and a row for each surrogate.
    pub(crate) fn tell_measured(&mut self) {
        let digits = self.digits();
        let decided = self.riders.iter().any(|r| r.verdict != Verdict::None);
        let all = self.riders.iter().enumerate();
        let told: Vec<String> = all
            .filter(|(_, r)| r.measured.is_some() || r.verdict != Verdict::None)
            .map(|(i, r)| r.said(&self.who(i), digits))
            .collect();
        if told.is_empty() || self.settings.control.is_none() {
            return;
        }
        let (time, told) = (&self.step.name, told.join("; "));
        let jumper = self.riders.iter().position(|r| r.verdict == Verdict::Jumps);
        let text = match jumper {
            Some(jumper) => format!("m4gn: time {time}: {told}: {} jumps\n\n", self.who(jumper)),
            None if decided => format!("m4gn: no jump at time {time}: {told}. The solver goes on\n\n"),
            None => format!("m4gn: time {time}: {told}\n\n"),
        };
        self.log.text += &text;
        if decided {
            let refused = std::mem::replace(&mut self.log.refused, jumper.is_none());
            if refused && let Some(jumper) = jumper {
                self.log.text += &format!("m4gn: {} may jump again\n\n", self.who(jumper));
            }
        }
        if self.log.strides_head.is_empty() && self.totals.stride_rows == 0 {
            let names = ["Time", "surrogate", "error", "estimate", "decision"].map(String::from);
            let pairs =
                self.fields.iter().flat_map(|f| ["error", "change"].map(|kind| format!("{kind}({f})")));
            let names: Vec<String> = names.into_iter().chain(pairs).collect();
            self.log.strides_head =
                digits.header(&["Strides of the surrogates beside the solver".into()], &[], &names);
        }
        for rider in &mut self.riders {
            if rider.measured.is_none() && rider.verdict == Verdict::None {
                continue;
            }
            let measured = rider.measured.take().unwrap_or_else(|| vec![[f64::NAN; 2]; self.fields.len()]);
            let [error, estimate] = rider.expected.map(|v| digits.of(v));
            let mut columns = vec![
                digits.of(self.step.shown),
                rider.surrogate.name().into(),
                error,
                estimate,
                rider.verdict.word().into(),
            ];
            columns.extend(measured.iter().flatten().map(|v| digits.of(*v)));
            self.log.strides += &row(&columns);
            self.totals.stride_rows += 1;
        }
    }
}
