//! One surrogate of a ride, with what is measured of it.

use crate::control::Control;
use crate::log::Log;
use crate::schedule::Step;
use crate::settings::{Mode, RideSettings};
use crate::shadow::Shadow;
use crate::surrogate::Surrogate;
use crate::tables::{Digits, row};
use crate::values::Given;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;

pub(crate) struct Rider<'a> {
    pub surrogate: Box<dyn Surrogate + 'a>,
    pub shadow: Shadow,
    pub control: Option<Control>,
    /// Whether a stride was measured since the last decision.
    pub fresh: bool,
    /// Relative error of the last stride, and that expected of the jump that was decided on.
    pub expected: [f64; 2],
}

impl<'a> Rider<'a> {
    pub fn new(surrogate: Box<dyn Surrogate + 'a>, settings: &RideSettings, log: &mut Log) -> Result<Self> {
        let mut control = None;
        if let Some(given) = &settings.control {
            let mut given = given.clone();
            if settings.mode == Mode::Observe {
                // An observer ends no run.
                given.on_failure = Default::default();
            }
            let growth = |name: &str| surrogate.growth(name);
            let fields = surrogate.advances().iter().map(|a| (a.name.clone(), growth(&a.name)));
            let made = Control::new(fields.collect(), given)?;
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
        Ok(Rider {
            surrogate,
            shadow: Shadow::default(),
            control,
            fresh: false,
            expected: [f64::INFINITY; 2],
        })
    }

    /// Whether a stride beside the solver may begin here.
    pub fn can_begin(&self, step: &Step) -> bool {
        !self.shadow.waiting && self.surrogate.is_ready(step.time)
    }

    pub fn has_arrived(&self, step: &Step) -> bool {
        self.shadow.has_arrived(step, self.surrogate.stride())
    }

    /// Takes up the stride at whose end the solver has arrived: a row and a line of the log. Collective.
    pub fn measure(
        &mut self,
        comm: &Comm,
        step: &Step,
        given: &Given,
        digits: Digits,
        log: &mut Log,
    ) -> Result<()> {
        let fraction = self.shadow.fraction(step, self.surrogate.stride());
        let now = given.values(comm, self.surrogate.advances())?;
        let errors = self.shadow.compare(comm, self.surrogate.as_ref(), &now, fraction);
        let Some(control) = &mut self.control else {
            return Ok(());
        };
        let measured = control.measure(&errors);
        self.fresh = true;
        let (error, estimate) = (control.error(), control.estimate(1));
        log.text += &format!(
            "m4gn: time {}: a stride of the surrogate beside the solver was off by {}, {} is expected of a step\n\n",
            step.name,
            digits.of(error),
            digits.of(estimate)
        );
        let mut columns =
            vec![digits.of(step.shown), self.surrogate.name().into(), digits.of(error), digits.of(estimate)];
        for e in &errors {
            columns.extend([e.error, e.change].map(|v| digits.of(v)));
        }
        if log.strides_head.is_empty() {
            let mut names: Vec<String> = ["Time", "surrogate", "error", "estimate"].map(String::from).into();
            for field in self.surrogate.advances() {
                names.extend(["error", "change"].map(|kind| format!("{kind}({})", field.name)));
            }
            log.strides_head =
                digits.header(&["Strides of the surrogate beside the solver".into()], &[], &names);
        }
        log.strides += &row(&columns);
        measured
    }

    /// Strides of a jump that may begin now, `most` at most; with control none before another stride was measured.
    pub fn allowed(&mut self, most: usize) -> usize {
        let most = self.surrogate.allows(most);
        let Some(control) = &self.control else {
            return most;
        };
        if !std::mem::take(&mut self.fresh) {
            return 0;
        }
        let strides = control.strides(most);
        self.expected = [control.error(), control.estimate(strides.max(1))];
        strides
    }
}
