//! One surrogate of a ride, with what is measured of it.

use crate::control::Control;
use crate::log::Log;
use crate::observe::Observer;
use crate::schedule::Step;
use crate::settings::{Mode, RideSettings};
use crate::shadow::Shadow;
use crate::surrogate::Surrogate;
use crate::tables::Digits;
use crate::values::Given;
use m4gn_base::Result;
use m4gn_parallel::Comm;

/// What a decision says of a surrogate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Nothing was decided.
    #[default]
    None,
    /// It jumps.
    Jumps,
    /// Another one is nearer to the solver.
    Another,
    /// It was off by too much for a jump.
    Tolerance,
    /// It was off by too much of what the solver changed.
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
            Verdict::Another => "another",
            Verdict::Tolerance => "tolerance",
            Verdict::RelTol => "relTol",
            Verdict::Unfit => "unfit",
        }
    }
}

pub(crate) struct Rider<'a> {
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
    /// Of each field of the tables, error and change of the stride that was measured at this time; none: none was.
    pub measured: Option<Vec<[f64; 2]>>,
    /// Where each of its fields is among those of the tables.
    pub columns: Vec<usize>,
}

impl<'a> Rider<'a> {
    /// `fields`: of the tables, of all surrogates.
    pub fn new(
        surrogate: Box<dyn Surrogate + 'a>,
        settings: &RideSettings,
        fields: &[String],
        log: &mut Log,
    ) -> Result<Self> {
        let mut control = None;
        if let Some(given) = &settings.control {
            let mut given = given.clone();
            if settings.mode == Mode::Observe {
                // An observer ends no run.
                given.on_failure = Default::default();
            }
            let growth = |name: &str| surrogate.growth(name);
            let known = surrogate.advances().iter().map(|a| (a.name.clone(), growth(&a.name)));
            let made = Control::new(known.collect(), given)?;
            let unknown = made.not_calibrated();
            if !unknown.is_empty() {
                log.text += &format!(
                    "m4gn: the model {} does not say how its errors of {} grow over a jump; they are reckoned to add up. 'm4gn calibrate' \
                     measures it\n\n",
                    surrogate.source(),
                    unknown.join(" ")
                );
            }
            control = Some(made);
        }
        let place = |name: &String| fields.iter().position(|f| f == name);
        let columns = surrogate.advances().iter().filter_map(|a| place(&a.name)).collect();
        Ok(Rider {
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

    /// Whether a stride beside the solver may begin here.
    pub fn can_begin(&self, step: &Step) -> bool {
        !self.shadow.waiting && self.surrogate.is_ready(step.time)
    }

    pub fn has_arrived(&self, step: &Step) -> bool {
        self.shadow.has_arrived(step, self.surrogate.stride())
    }

    /// Whether no decision has to wait for it: its stride beside the solver has been measured, or none is under way, and it can jump from
    /// here or not at all.
    pub fn is_settled(&self, step: &Step) -> bool {
        match self.fresh {
            true => self.surrogate.is_ready(step.time) || self.surrogate.allows(1) == 0,
            false => !self.shadow.waiting,
        }
    }

    /// Takes up the stride at whose end the solver has arrived. Collective.
    pub fn measure(&mut self, comm: &Comm, step: &Step, given: &Given, fields: usize) -> Result<()> {
        let fraction = self.shadow.fraction(step, self.surrogate.stride());
        let now = given.values(comm, self.surrogate.advances())?;
        let errors = self.shadow.compare(comm, self.surrogate.as_ref(), &now, fraction);
        let Some(control) = &mut self.control else {
            return Ok(());
        };
        let mut row = vec![[f64::NAN; 2]; fields];
        for (&column, e) in self.columns.iter().zip(&errors) {
            row[column] = [e.error, e.change];
        }
        self.measured = Some(row);
        self.fresh = true;
        let found = control.measure(&errors);
        self.expected = [control.error(), control.estimate(1)];
        found
    }

    /// Strides of a jump that may begin now, `most` at most; with control none before another stride was measured.
    pub fn allowed(&mut self, most: usize, step: &Step) -> usize {
        let most = self.surrogate.allows(most);
        let Some(control) = &self.control else {
            return most;
        };
        if !std::mem::take(&mut self.fresh) || most == 0 || !self.surrogate.is_ready(step.time) {
            self.verdict = Verdict::Unfit;
            return 0;
        }
        let strides = control.strides(most);
        self.expected = [control.error(), control.estimate(strides.max(1))];
        self.verdict = match strides {
            0 if self.expected[1] <= control.settings().tolerance => Verdict::RelTol,
            0 => Verdict::Tolerance,
            _ => Verdict::Another,
        };
        strides
    }

    /// What was measured and decided, for people: `who` it is, among several.
    pub fn said(&self, who: &str, digits: Digits) -> String {
        let [error, estimate] = self.expected.map(|v| digits.of(v));
        let off = format!("{who} beside the solver was off by {error} in a stride");
        match self.verdict {
            Verdict::None => format!("{off}, {estimate} is expected of a step"),
            Verdict::Jumps | Verdict::Another => format!("{off}, {estimate} is expected of a jump"),
            Verdict::Tolerance => format!("{off}, and {estimate} is expected of a step"),
            Verdict::RelTol => format!("{off}, more than relTol of what the solver changed"),
            Verdict::Unfit => format!("{who} has nothing to jump with"),
        }
    }
}
