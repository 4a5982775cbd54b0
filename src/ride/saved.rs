//! What a ride keeps for a run that is carried on.

use crate::answer::{Action, Answer, Phase};
use crate::conditions::Conditions;
use crate::control::Controlled;
use crate::fit_control::FitControl;
use crate::jump::Jump;
use crate::quantities::Quantities;
use crate::restart;
use crate::ride::Ride;
use crate::schedule::Step;
use crate::settings::Mode;
use crate::shadow::Shadow;
use crate::surrogate::Resumed;
use crate::totals::Totals;
use crate::watch::Watch;
use m4gn_base::{Error, Result};
use m4gn_state::Values;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The description of a state.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// Ranks that wrote it.
    ranks: i32,
    /// Rows of the undecomposed mesh.
    rows: usize,
    /// Time of the state, s.
    time: f64,
    /// Strides of a jump that are left; -1: the solver is at work. Time that has gone of the first of them, s.
    left: i64,
    gone: f64,
    /// Whether some of its strides have been taken, and what was measured before it, and expected of it.
    begun: bool,
    expected: Option<[f64; 2]>,
    /// The surrogate that jumps, or would next.
    jumper: usize,
    /// Steps of the solver since it took over.
    since: i64,
    /// The solver's time step, s.
    delta_t: f64,
    watch: Watch,
    quantities: Quantities,
    totals: Totals,
    conditions: Conditions,
    refused: bool,
    /// How many decisions have been told.
    decisions: usize,
    surrogates: Vec<Saved>,
    /// What the host keeps there.
    host: String,
}

/// One surrogate in it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    name: String,
    source: String,
    digest: String,
    fresh: bool,
    control: Option<Controlled>,
    /// Number of the part that is its own state.
    own: Option<usize>,
    fit_control: Option<FitControl>,
    shadow: Option<Begun>,
}

/// A stride that is under way.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Begun {
    time: f64,
    finite: bool,
    /// Number of the part with the first field at the start; the others follow, then those at the end of the stride.
    part: usize,
}

/// What the host kept in a state (`host` of the settings). Not collective.
///
/// # Errors
/// [`Error::File`] for what is no state of a ride, or is damaged.
pub fn host_of(path: &Path) -> Result<String> {
    let (found, _) = restart::read::<Description>(path, &restart::bytes(path)?)?;
    Ok(found.host)
}

impl Ride<'_> {
    /// Writes the state at the present time: behind [`solved`](Self::solved) or [`advanced`](Self::advanced). The first rank does.
    /// Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] between a stride and [`advanced`](Self::advanced); [`Error::File`]; what was there before then stays.
    pub fn save(&self, path: &Path) -> Result<()> {
        if matches!(self.phase, Phase::Advancing(_)) {
            return Err(self.out_of_turn("save"));
        }
        let mut parts = Vec::new();
        let mut surrogates = Vec::new();
        for candidate in &self.candidates {
            let surrogate = candidate.surrogate.as_ref();
            let mut keep = |bytes: Vec<u8>| {
                parts.push(bytes);
                parts.len() - 1
            };
            let own = self.comm.agree(surrogate.save())?.map(&mut keep);
            let shadow = &candidate.shadow;
            let begun = shadow.waiting.then(|| {
                let both = shadow.start.iter().chain(&shadow.predicted);
                let gathered: Vec<Vec<u8>> = both.map(|v| restart::bytes_of(&self.whole(v))).collect();
                let numbers: Vec<usize> = gathered.into_iter().map(&mut keep).collect();
                Begun {
                    time: shadow.begun,
                    finite: shadow.finite,
                    part: numbers.first().copied().unwrap_or(0),
                }
            });
            let description = surrogate.describe();
            surrogates.push(Saved {
                name: description.name.clone(),
                source: description.source.clone(),
                digest: description.digest.clone(),
                fresh: candidate.fresh,
                control: candidate.control.as_ref().and_then(|c| c.state()),
                own,
                fit_control: surrogate.fits().map(|fits| fits.control.clone()),
                shadow: begun,
            });
        }
        let jump = self.phase.jump();
        let description = Description {
            ranks: self.comm.size(),
            rows: self.rows,
            time: self.step.time,
            left: self.left(),
            gone: jump.map_or(0.0, |jump| jump.part(self.candidates[jump.surrogate].stride())),
            begun: jump.is_some_and(|jump| !jump.is_new()),
            expected: jump.and_then(|jump| jump.expected).filter(|e| e.iter().all(|v| v.is_finite())),
            jumper: jump.map_or(self.totals.last, |jump| jump.surrogate),
            since: self.step.index - self.handed_back,
            delta_t: self.step.delta_t,
            watch: self.watch.clone(),
            quantities: self.quantities.clone(),
            totals: self.totals.clone(),
            conditions: self.conditions.clone(),
            refused: self.log.refused,
            decisions: self.decisions.count,
            surrogates,
            host: self.settings.host.clone(),
        };
        let written = match self.comm.is_root() {
            true => restart::write(path, &description, &parts),
            false => Ok(()),
        };
        self.comm.agree(written)
    }

    /// Values of all ranks in the order of the undecomposed mesh, on the first one. Fields of other rows than the mesh's are those of the
    /// ranks one after the other. Collective.
    fn whole(&self, values: &[f64]) -> Vec<f64> {
        let (Some(numbers), Some(parts)) = (self.comm.gather(&self.global), self.comm.gather(values)) else {
            return Vec::new();
        };
        let total: usize = parts.iter().map(Vec::len).sum();
        let rows: usize = numbers.iter().map(Vec::len).sum();
        let n = total / rows.max(1);
        let mut whole = vec![0.0; total];
        for (numbers, part) in numbers.iter().zip(&parts) {
            for (&number, row) in numbers.iter().zip(part.chunks_exact(n.max(1))) {
                whole[number as usize * n..][..n].copy_from_slice(row);
            }
        }
        whole
    }

    /// This rank's rows of values in the order of the undecomposed mesh.
    fn own(&self, whole: &[f64], components: usize) -> Vec<f64> {
        let rows = self.global.iter().map(|&number| number as usize * components);
        rows.flat_map(|at| whole[at..at + components].iter().copied()).collect()
    }

    /// Goes on from what another run saved at the present time, `step`, on a host that has the state of that time; the first rank reads. What
    /// is left of a jump that it was in is taken first: the answer is [`Action::Stride`](crate::Action::Stride),
    /// [`Action::HandBack`](crate::Action::HandBack) where the state is the last one of the jump and has been handed back already, else
    /// [`Action::Solve`](crate::Action::Solve). What was fitted and measured under [other conditions](Self::made_under) is not taken up: the
    /// solver goes on. Collective; all ranks fail together, and the ride is then as it was.
    ///
    /// # Errors
    /// [`Error::File`] for what is no state of a ride, is damaged, or is of another mesh or time; [`Error::Model`] for that of other
    /// surrogates; [`Error::Input`] within a jump, and for a state that does not fit.
    pub fn load(&mut self, path: &Path, step: Step, state: &[&[f64]]) -> Result<Answer> {
        if self.phase != Phase::Solving {
            return Err(Error::Input("ride: a state is taken up before the first step".into()));
        }
        self.checked("load", Some(state), true)?;
        let read = match self.comm.is_root() {
            true => restart::bytes(path),
            false => Ok(Vec::new()),
        };
        let mut bytes = self.comm.agree(read)?;
        self.comm.broadcast(&mut bytes);
        let read = restart::read::<Description>(path, &bytes);
        let (found, parts) = self.comm.agree(read)?;
        drop(bytes);
        let taken = self.take_up(path, &found, &parts, &step);
        let shadows = self.comm.agree(taken)?;
        let name = self.settings.name.clone();
        if self.settings.mode == Mode::Observe {
            self.log.text +=
                &format!("m4gn: {name} begins to observe: what it kept as it replaced is not taken up\n\n");
            return Ok(self.answer(Action::Solve));
        }
        let changed = self.conditions.changed(&found.conditions);
        self.comm.agree_with(Ok(()), &changed)?;
        let step = Step { delta_t: if found.left < 0 { step.delta_t } else { found.delta_t }, ..step };
        let later = step.time - found.time;
        let (solves, holds) = (found.left < 0, changed.is_empty());
        let at = Resumed { step: &step, state, later, solves, holds };
        let mut holds = vec![at.holds; self.candidates.len()];
        let pairs = self.candidates.iter_mut().zip(&found.surrogates).zip(&mut holds);
        for (((candidate, saved), holds), shadow) in pairs.zip(shadows) {
            if let Some(part) = saved.own {
                // A rank may miss files of its own
                let anew = self.comm.agree(candidate.surrogate.restore(&parts[part], &at))?;
                *holds &= anew.is_none();
                let note = anew.map(|why| format!("m4gn: {name}: {why}: its fit begins anew\n\n"));
                self.log.text += &note.unwrap_or_default();
            } else {
                // A fit whose states were not kept
                *holds &= !candidate.is_fit();
            }
            if !*holds {
                continue;
            }
            (candidate.shadow, candidate.fresh) = (shadow, saved.fresh);
            if let (Some(fits), Some(saved)) = (candidate.surrogate.fits_mut(), &saved.fit_control) {
                fits.control = saved.clone();
            }
            if let (Some(control), Some(saved)) = (&mut candidate.control, &saved.control) {
                control.restore(saved)?;
            }
        }
        self.keep(state);
        self.totals = found.totals;
        self.totals.by.resize(self.candidates.len(), (0, 0.0));
        let ended = found.left >= 0 && !holds[found.jumper];
        if at.holds {
            (self.watch, self.log.refused) = (found.watch, found.refused);
            self.quantities.carry_on(found.quantities);
        }
        self.handed_back = step.index - if ended || !at.holds { 0 } else { found.since };
        self.decisions.carry_on(found.decisions);
        self.log.text += &format!("m4gn: {name} goes on from its state at time {}", step.name);
        if found.ranks != self.comm.size() {
            self.log.text += &format!(", written by {} ranks", found.ranks);
        }
        if !at.holds {
            self.log.text += &format!(
                " under other conditions: {changed}. What was fitted and measured before is dropped"
            );
        } else if found.left > 0 && !ended {
            self.log.text += &format!(", in a jump of which {} steps are left", found.left);
        }
        self.log.text += "\n\n";
        let solves = ended || !at.holds;
        self.step = step;
        if solves {
            if found.begun {
                self.tell_back_at_restart(found.jumper);
            }
            return Ok(self.answer(Action::Solve));
        }
        if found.left < 0 {
            // The run that was stopped here let no jump begin that went past its end.
            let answer = self.begun();
            self.tell_begun();
            return answer;
        }
        let jump = Jump {
            gone: found.gone,
            carried_on: found.begun,
            over: found.left == 0,
            expected: found.expected,
            ..self.jump_of(found.jumper, found.left as usize, "")
        };
        self.stepped |= found.begun;
        let answer = self.behind_stride(jump);
        // Where no stride was taken yet the state is the solver's.
        if let Some(fits) =
            self.candidates[found.jumper].surrogate.fits().filter(|fits| found.begun && fits.has_fit())
        {
            // The state of the jump, where the host's solver has made some of it anew.
            let mut own: Values = state.iter().map(|v| v.to_vec()).collect();
            let mut places: Vec<&mut [f64]> = own.iter_mut().map(Vec::as_mut_slice).collect();
            fits.earlier(0.0, &mut places)?;
            self.keep(&own.iter().map(Vec::as_slice).collect::<Vec<_>>());
        }
        Ok(answer)
    }

    /// The strides that go on beside the solver, of a state that fits; nothing is changed. The ranks have all of the state.
    fn take_up(
        &self,
        path: &Path,
        found: &Description,
        parts: &[Vec<u8>],
        step: &Step,
    ) -> Result<Vec<Shadow>> {
        let file = |what: String| Error::file(path, what);
        if found.surrogates.len() != self.candidates.len() {
            return Err(Error::Model(format!(
                "{}: the state of a run with {} surrogates, and this one has {}",
                path.display(),
                found.surrogates.len(),
                self.candidates.len()
            )));
        }
        for (candidate, saved) in self.candidates.iter().zip(&found.surrogates) {
            let own = candidate.describe();
            if (&saved.name, &saved.digest) != (&own.name, &own.digest) {
                return Err(Error::Model(format!(
                    "The run up to time {} had another model, {} (digest {}); this one has {} ({})",
                    step.name, saved.source, saved.digest, own.source, own.digest
                )));
            }
        }
        if (found.time - step.time).abs() > 0.5 * step.delta_t.max(found.delta_t) {
            return Err(file(format!(
                "it is the state at {} s, and this run begins at {} s",
                found.time, step.time
            )));
        }
        let usable = found.delta_t.is_finite()
            && found.delta_t > 0.0
            && found.left >= -1
            && found.gone.is_finite()
            && found.gone >= 0.0
            && found.since >= 0;
        if self.rows != found.rows
            || !usable
            || found.jumper >= self.candidates.len()
            || found.totals.last >= self.candidates.len()
            || found.totals.by.len() > self.candidates.len()
        {
            return Err(file(format!(
                "it is the state of a run on {} cells, and this mesh has {}",
                found.rows, self.rows
            )));
        }
        let mut shadows = Vec::new();
        for (candidate, saved) in self.candidates.iter().zip(&found.surrogates) {
            let stride = self.layout.pick(&candidate.describe().advances);
            if saved.own.is_some_and(|part| part >= parts.len()) {
                return Err(file("a part of it is missing".into()));
            }
            if saved.control.as_ref().is_some_and(|c| c.fields.len() != stride.len()) {
                return Err(file("its controller has other fields".into()));
            }
            shadows.push(match &saved.shadow {
                // Rows of other fields than the mesh's are the ranks' own: they begin anew on another number of ranks.
                Some(begun) => {
                    let n = stride.len();
                    let mut values = Vec::new();
                    for i in 0..2 * n {
                        let field = &stride[i % n];
                        let part = parts.get(begun.part + i);
                        let part = part.ok_or_else(|| file("a part of it is missing".into()))?;
                        let whole = restart::values_of(part, self.rows * field.components)
                            .map_err(|e| file(e.to_string()))?;
                        values.push(self.own(&whole, field.components));
                    }
                    let predicted = values.split_off(n);
                    Shadow {
                        waiting: true,
                        begun: begun.time + (step.time - found.time),
                        finite: begun.finite,
                        idle: false,
                        start: values,
                        predicted,
                    }
                }
                None => Shadow::default(),
            });
        }
        Ok(shadows)
    }
}
