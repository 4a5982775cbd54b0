//! The host: a solver of its own, which does what the ride says.

use crate::toy::{self, Toy, at};
use crate::{Action, Answer, Host as Guest, Ride, RideSettings, Step, Surrogate, Text};
use m4gn_base::Result;
use m4gn_parallel::Comm;
use m4gn_state::Values;
use std::cell::Cell;
use std::rc::Rc;

/// The toy's time step, s.
pub const DT: f64 = 0.1;

/// A ride of such a surrogate from time 0 on.
pub fn ride(settings: &str, toy: Option<Toy>) -> Result<Ride<'static>> {
    from(settings, toy, 0.0)
}

pub fn from(settings: &str, toy: Option<Toy>, time: f64) -> Result<Ride<'static>> {
    let settings = RideSettings::parse(settings)?;
    let index = (time / DT).round() as i64;
    let guest = Guest {
        layout: toy::layout(),
        network: toy.map(|toy| Box::new(toy) as Box<dyn Surrogate>),
        ahead: None,
        global: vec![0, 1],
        owners: vec![0, 1],
    };
    Ride::new(Comm::serial(), guest, settings, at(time, DT, 1e9, index))
}

/// The arrays of a state as a host hands them over.
pub fn view(state: &Values) -> Vec<&[f64]> {
    state.iter().map(Vec::as_slice).collect()
}

/// What happened in a run, in the order in which it did.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The solver made so many steps.
    Solved(usize),
    /// A jump of so many strides by a surrogate.
    Jumped(usize, usize),
}

/// Stops a run where it says so, behind a step or a stride.
pub type Stop<'a> = &'a mut dyn FnMut(&Host) -> bool;

pub struct Host {
    pub ride: Ride<'static>,
    pub state: Values,
    pub time: f64,
    pub index: i64,
    pub end: f64,
    /// The step of the solver behind a time, and how many of them come between two states of a jump; 0: strides are whole.
    pub delta_t: fn(f64) -> f64,
    pub looks: f64,
    /// What the solver makes of the state behind a stride.
    pub follow: fn(&mut Values),
    pub events: Vec<Event>,
    /// Strides of each jump, the time at which it ended, and who jumped.
    pub jumps: Vec<(usize, f64, usize)>,
    pub solved: usize,
    pub log: String,
    pub warnings: Vec<String>,
    /// Of jumps, strides, an observer's errors, those in segments, and modes.
    pub tables: [String; 5],
    /// Durations and solver steps of the strides.
    pub strides: Vec<(f64, i64)>,
    /// Where states are written: after steps of the solver, and after strides.
    pub folder: Option<std::path::PathBuf>,
    /// Correctors of the solver's next steps.
    pub correctors: Vec<[usize; 2]>,
    /// Strides of the jump that is going on.
    pub jumped: usize,
    /// The first component is reported, in a jump with so much more.
    pub report: Option<f64>,
    /// Steps that the solver leaves out of what it tells.
    pub every: i64,
    /// Ends the run at the first time after this one.
    pub stop_after: f64,
    /// The time, for a surrogate that knows the solver.
    pub clock: Rc<Cell<f64>>,
}

impl Host {
    /// At such a step of the solver.
    pub fn at(ride: Ride<'static>, step: &Step, state: Values, clock: Rc<Cell<f64>>) -> Self {
        Host {
            ride,
            state,
            time: step.time,
            index: step.index,
            end: step.end_time,
            delta_t: |_| DT,
            looks: 0.0,
            follow: |_| (),
            events: Vec::new(),
            jumps: Vec::new(),
            solved: 0,
            log: String::new(),
            warnings: Vec::new(),
            tables: Default::default(),
            strides: Vec::new(),
            folder: None,
            correctors: Vec::new(),
            jumped: 0,
            report: None,
            every: 1,
            stop_after: f64::INFINITY,
            clock,
        }
    }

    /// One whose solver is the toy's.
    pub fn new(ride: Ride<'static>, end: f64) -> Self {
        let host = Host::at(ride, &at(0.0, DT, end, 0), toy::state(0.0), Rc::default());
        Host { follow: |state| *state = toy::of([state[0][0], state[0][1]]), ..host }
    }

    pub fn of(settings: &str, toy: Toy, end: f64) -> Self {
        Host::new(ride(settings, Some(toy)).unwrap(), end)
    }

    /// One that has run to its end.
    pub fn ran(settings: &str, toy: Toy, end: f64) -> Self {
        let mut host = Host::of(settings, toy, end);
        host.run().unwrap();
        host
    }

    pub fn step(&self) -> Step {
        let delta_t = (self.delta_t)(self.time);
        Step { within: self.looks * delta_t, ..at(self.time, delta_t, self.end, self.index) }
    }

    pub fn listen(&mut self) {
        self.log += &self.ride.take(Text::Log);
        loop {
            let warning = self.ride.take(Text::Warning);
            if warning.is_empty() {
                break;
            }
            self.warnings.push(warning);
        }
        let kinds = [Text::Jumps, Text::Strides, Text::Errors, Text::SegmentErrors, Text::Modes];
        for (table, kind) in self.tables.iter_mut().zip(kinds) {
            *table += &self.ride.take(kind);
        }
    }

    fn save(&self) {
        if let Some(folder) = &self.folder {
            let path = folder.join(format!("{:.1}.state", self.time));
            self.ride.save(&path).unwrap();
            let [a, b] = [0, 1].map(|i| self.state[0][i].to_bits());
            std::fs::write(path.with_extension("host"), format!("{a} {b}")).unwrap();
        }
    }

    /// Runs to the end of the run, with the toy's solver.
    pub fn run(&mut self) -> Result<()> {
        let solver = |_: f64, state: &[f64]| toy::of(toy::later([state[0], state[1]], DT));
        self.run_with(&solver, &mut |_| false)
    }

    /// The same with a solver: the state at a time, and the first array of that a step before.
    pub fn run_with(&mut self, solver: &dyn Fn(f64, &[f64]) -> Values, stop: Stop) -> Result<()> {
        while self.time < self.end - 0.5 * (self.delta_t)(self.time) {
            self.pass((self.delta_t)(self.time), 1);
            self.state = solver(self.time, &self.state[0]);
            self.solved += 1;
            match self.events.last_mut() {
                Some(Event::Solved(n)) => *n += 1,
                _ => self.events.push(Event::Solved(1)),
            }
            if self.index % self.every != 0 {
                continue;
            }
            let correctors = (!self.correctors.is_empty()).then(|| self.correctors.remove(0));
            let step = Step { correctors, ..self.step() };
            // Without the state where it is not asked for.
            let wanted = self.ride.wants(&step);
            let answer = self.ride.solved(step, wanted.then_some(&view(&self.state)[..]))?;
            self.save();
            self.listen();
            if stop(self) || self.go_on(answer, stop)? {
                break;
            }
        }
        self.listen();
        Ok(())
    }

    fn pass(&mut self, duration: f64, steps: i64) {
        self.time = ((self.time + duration) * 1e12).round() / 1e12;
        self.index += steps;
        self.clock.set(self.time);
    }

    /// Does what the ride says until the solver is to work again. Whether it was stopped.
    pub fn go_on(&mut self, mut answer: Answer, stop: Stop) -> Result<bool> {
        let mut who = answer.surrogate;
        loop {
            if let (Some(more), Action::Solve | Action::Stride | Action::HandBack) =
                (self.report, answer.action)
            {
                let more = if self.jumped > 0 { more } else { 0.0 };
                self.ride.reported(&[self.state[0][0] + more])?;
            }
            answer = match answer.action {
                Action::Solve => break,
                Action::Stride => {
                    let mut next = self.state.clone();
                    let mut places: Vec<&mut [f64]> = next.iter_mut().map(Vec::as_mut_slice).collect();
                    let answer = self.ride.stride(&mut places)?;
                    let advanced = answer.action == Action::Advance;
                    assert!(advanced || next == self.state, "a stride that is not used leaves the state");
                    assert!(answer.whole || next[1..] == self.state[1..], "a network makes what it advances");
                    self.state = next;
                    answer
                }
                Action::Advance => {
                    self.pass(answer.duration, answer.solver_steps);
                    (self.follow)(&mut self.state);
                    self.strides.push((answer.duration, answer.solver_steps));
                    self.jumped += 1;
                    if self.time > self.stop_after {
                        self.end = self.time;
                    }
                    self.ride.spent(0.25, 0.5);
                    who = answer.surrogate;
                    let state = answer.state.then_some(view(&self.state));
                    let next = self.ride.advanced(self.step(), state.as_deref())?;
                    self.save();
                    if stop(self) {
                        return Ok(true);
                    }
                    next
                }
                Action::HandBack => {
                    if self.jumped > 0 {
                        self.events.push(Event::Jumped(who, self.jumped));
                        self.jumps.push((self.jumped, self.time, who));
                    }
                    self.jumped = 0;
                    let quantities = [("energy".to_string(), 0.5)];
                    let state = answer.state.then_some(view(&self.state));
                    self.ride.handed_back(self.step(), state.as_deref(), &quantities)?
                }
            };
        }
        self.listen();
        Ok(false)
    }

    /// A host that goes on from the state of another one at a time.
    pub fn carried_on(from: &Host, settings: &str, toy: Toy, time: f64) -> Result<Host> {
        let file = from.folder.as_ref().unwrap().join(format!("{time:.1}.state"));
        let mut host = Host::new(self::from(settings, Some(toy), time)?, from.end);
        (host.time, host.index, host.report) = (time, (time / DT).round() as i64, from.report);
        // Beside the ride's state is the host's.
        let text = std::fs::read_to_string(file.with_extension("host")).unwrap();
        let mut bits = text.split(' ').map(|v| v.parse().unwrap());
        host.state = toy::of([0, 1].map(|_| f64::from_bits(bits.next().unwrap())));
        let answer = host.ride.load(&file, host.step(), &view(&host.state))?;
        host.jumped = usize::from(answer.stepped);
        host.go_on(answer, &mut |_| false)?;
        Ok(host)
    }
}
