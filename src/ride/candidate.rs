//! One surrogate of a ride, with what is measured of it.

use crate::control::Control;
use crate::log::Log;
use crate::observe::Observer;
use crate::schedule::Step;
use crate::settings::{Mode, RideSettings};
use crate::shadow::{Shadow, advanced};
use crate::surrogate::{Description, Surrogate};
use crate::tables::Digits;
use m4gn_base::Result;
use m4gn_parallel::Comm;
use m4gn_state::{Layout, Values};

/// What a decision says of a surrogate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Nothing was decided.
    #[default]
    None,
    /// It jumps.
    Jumps,
    /// Its error was too large for a jump.
    Tolerance,
    /// Its error was too large a part of what the solver changed.
    RelTol,
    /// It was not measured, as it can take no stride from here: a fit that does not hold.
    Unfit,
}

impl Verdict {
    /// As the table of strides has it.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::None => "-",
            Verdict::Jumps => "jumps",
            Verdict::Tolerance => "tolerance",
            Verdict::RelTol => "relTol",
            Verdict::Unfit => "unfit",
        }
    }
}

pub(crate) struct Candidate<'a> {
    pub surrogate: Box<dyn Surrogate + 'a>,
    pub shadow: Shadow,
    pub control: Option<Control>,
    /// Mode observe, from its begin.
    pub observer: Option<Observer>,
    /// Whether a stride was measured since the last decision.
    pub fresh: bool,
    /// Relative error of the last stride, and that expected of the jump that was decided on.
    pub expected: [f64; 2],
    pub verdict: Verdict,
    /// Of each array of the tables, error and change of the stride that was measured at this time; none: none was.
    pub measured: Option<Vec<[f64; 2]>>,
    /// Where each of its arrays is among those of the tables.
    pub columns: Vec<usize>,
}

impl<'a> Candidate<'a> {
    /// `fields`: the arrays of the tables, of all surrogates; `alike`: names of those that all advance.
    pub fn new(
        surrogate: Box<dyn Surrogate + 'a>,
        settings: &RideSettings,
        layout: &Layout,
        fields: &[usize],
        alike: &[String],
        log: &mut Log,
    ) -> Result<Self> {
        let description = surrogate.describe();
        let names = layout.pick(&description.advances).into_iter().map(|a| a.name.clone());
        let mut control = None;
        if let Some(own) = &settings.control {
            let mut own = own.clone();
            if settings.mode == Mode::Observe {
                // An observer ends no run.
                own.on_failure = Default::default();
            }
            let known = names.zip(description.growth.iter().cloned());
            let made = Control::new(known.collect(), own)?.among(alike);
            let unknown = made.not_calibrated();
            if !unknown.is_empty() {
                log.text += &format!(
                    "m4gn: the model {} does not say how its errors of {} grow over a jump; they are reckoned to add up. 'm4gn calibrate' \
                     measures it\n\n",
                    description.source,
                    unknown.join(" ")
                );
            }
            control = Some(made);
        }
        let place = |array: &usize| fields.iter().position(|f| f == array);
        let columns = description.advances.iter().filter_map(place).collect();
        log.text += &description.note;
        Ok(Candidate {
            surrogate,
            shadow: Shadow::default(),
            control,
            observer: None,
            fresh: false,
            expected: [f64::INFINITY; 2],
            verdict: Verdict::None,
            measured: None,
            columns,
        })
    }

    pub fn describe(&self) -> &Description {
        self.surrogate.describe()
    }

    pub fn stride(&self) -> f64 {
        self.surrogate.describe().stride
    }

    /// Whether it is a fit of the run's own states.
    pub fn is_fit(&self) -> bool {
        self.surrogate.fits().is_some()
    }

    /// Whether it is a fit that holds.
    pub fn has_fit(&self) -> bool {
        self.surrogate.fits().is_some_and(|fits| fits.has_fit())
    }

    /// Whether a stride can be taken from the state at this time, s.
    pub fn is_ready(&self, time: f64) -> bool {
        self.surrogate.fits().is_none_or(|fits| fits.is_ready(time))
    }

    /// Whether the state after this step of the solver is a snapshot of its fit.
    pub fn wants(&self, step: &Step) -> bool {
        self.surrogate.fits().is_some_and(|fits| fits.wants(step))
    }

    /// Whether it is a fit that needs the solver's states before another surrogate jumps.
    pub fn wants_solver(&self) -> bool {
        self.surrogate.fits().is_some_and(|fits| fits.wants_solver())
    }

    /// Whether this step of the solver is longer than a stride, which saves nothing then. A fit takes longer strides itself.
    pub fn is_outgrown(&self, step: &Step) -> bool {
        !self.is_fit() && self.stride() < step.delta_t * (1.0 - 1e-6)
    }

    /// Whether a stride beside the solver may begin here.
    pub fn can_begin(&self, step: &Step) -> bool {
        !self.shadow.waiting && self.is_ready(step.time)
    }

    /// Whether the stride beside the solver ends here. That of a fit may with the next snapshot, from which a jump may begin.
    pub fn has_arrived(&self, step: &Step) -> bool {
        let (shadow, stride) = (&self.shadow, self.stride());
        let next = || self.is_fit() && shadow.waiting && self.is_ready(step.time);
        shadow.has_arrived(step, stride) || next() && shadow.fraction(step, stride) > 0.5
    }

    /// Its stride is another from here on: what was measured, and what is under way, says nothing of it.
    pub fn begin_anew(&mut self) {
        (self.shadow.waiting, self.fresh) = (false, false);
        self.observer.iter_mut().for_each(Observer::begin_anew);
    }

    /// Takes up the stride at whose end the solver has arrived. Collective.
    pub fn measure(
        &mut self,
        comm: &Comm,
        layout: &Layout,
        step: &Step,
        state: &Values,
        fields: usize,
    ) -> Result<()> {
        let fraction = self.shadow.fraction(step, self.stride());
        let now = advanced(self.surrogate.as_ref(), state);
        let arrays = layout.pick(&self.surrogate.describe().advances);
        let mut errors = self.shadow.compare(comm, &arrays, &now, fraction);
        let Some(control) = &mut self.control else {
            return Ok(());
        };
        let mut row = vec![[f64::NAN; 2]; fields];
        for (&column, e) in self.columns.iter().zip(&errors) {
            row[column] = [e.error, e.change];
        }
        self.measured = Some(row);
        self.fresh = true;
        let least = self.surrogate.fits().map(|fits| fits.least_changes()).unwrap_or_default();
        errors.iter_mut().zip(least).for_each(|(e, least)| e.change = e.change.max(least));
        let found = control.measure(&errors);
        self.expected = [control.error(), control.estimate(1)];
        found
    }

    /// Strides that it may jump, of a fit those that it allows, `most` at most.
    pub fn by_fit(&self, most: usize) -> usize {
        self.surrogate.fits().map_or(most, |fits| fits.allows(most))
    }

    /// Strides of a jump that may begin now, `most` at most; with control none before another stride was measured.
    pub fn allowed(&mut self, most: usize, step: &Step) -> usize {
        let most = self.by_fit(most);
        if self.control.is_none() {
            return most;
        }
        let fresh = std::mem::take(&mut self.fresh);
        let ready = most > 0 && self.is_ready(step.time);
        let Some(control) = self.control.as_ref().filter(|_| fresh && ready) else {
            self.verdict = Verdict::Unfit;
            return 0;
        };
        let strides = control.strides(most);
        self.expected = [control.error(), control.estimate(strides.max(1))];
        self.verdict = match strides {
            0 if self.expected[1] <= control.settings().tolerance => Verdict::RelTol,
            0 => Verdict::Tolerance,
            _ => Verdict::Jumps,
        };
        strides
    }

    /// What was measured and decided, for people: `who` it is, among several.
    pub fn report(&self, who: &str, digits: Digits) -> String {
        if self.expected[0] == f64::INFINITY {
            return format!("{who} beside the solver could not predict a stride");
        }
        let [error, estimate] = self.expected.map(|v| digits.of(v));
        let off = format!("{who} beside the solver had an error of {error} in a stride");
        match self.verdict {
            Verdict::None => format!("{off}, {estimate} is expected of a step"),
            Verdict::Jumps => format!("{off}, {estimate} is expected of a jump"),
            Verdict::Tolerance => format!("{off}, and {estimate} is expected of a step"),
            Verdict::RelTol => format!("{off}, more than relTol of what the solver changed"),
            Verdict::Unfit => format!("{who} has nothing to jump with"),
        }
    }
}
