//! The host: a solver of its own, which does what the ride says.

use crate::toy::{self, Toy, at};
use crate::{Action, Answer, Host as Guest, Ride, RideSettings, Step, Surrogate, Text};
use m4gn_base::Result;
use m4gn_parallel::Comm;
use m4gn_state::Values;

/// The solver's time step, s.
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

/// A host whose state is two numbers.
pub struct Host {
    pub ride: Ride<'static>,
    pub state: [f64; 2],
    pub time: f64,
    pub index: i64,
    pub end: f64,
    pub events: Vec<Event>,
    pub log: String,
    pub warnings: Vec<String>,
    pub tables: [String; 4],
    /// Durations and solver steps of the strides.
    pub strides: Vec<(f64, i64)>,
    /// Where states are written: after steps of the solver, and after strides.
    pub folder: Option<std::path::PathBuf>,
    /// Correctors of the solver's next steps.
    pub correctors: Vec<[usize; 2]>,
    /// Strides of the jump that is going on.
    jumped: usize,
    /// The first component is reported, in a jump with so much more.
    pub report: Option<f64>,
    /// Steps that the solver leaves out of what it tells.
    pub every: i64,
    /// Stops the run at the first time after this one.
    pub stop_after: f64,
}

impl Host {
    pub fn new(ride: Ride<'static>, end: f64) -> Self {
        Host {
            ride,
            state: toy::solver(0.0),
            time: 0.0,
            index: 0,
            end,
            events: Vec::new(),
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
        }
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
        Step { correctors: None, ..at(self.time, DT, self.end, self.index) }
    }

    fn listen(&mut self) {
        self.log += &self.ride.take(Text::Log);
        loop {
            let warning = self.ride.take(Text::Warning);
            if warning.is_empty() {
                break;
            }
            self.warnings.push(warning);
        }
        let kinds = [Text::Jumps, Text::Strides, Text::Errors, Text::SegmentErrors];
        for (table, kind) in self.tables.iter_mut().zip(kinds) {
            *table += &self.ride.take(kind);
        }
    }

    fn file(&self) -> Option<std::path::PathBuf> {
        let folder = self.folder.as_ref()?;
        Some(folder.join(format!("{:.1}.state", self.time)))
    }

    fn save(&self) {
        if let Some(path) = self.file() {
            self.ride.save(&path).unwrap();
            let [a, b] = self.state.map(f64::to_bits);
            std::fs::write(path.with_extension("host"), format!("{a} {b}")).unwrap();
        }
    }

    /// Runs to the end of the run.
    pub fn run(&mut self) -> Result<()> {
        while self.time < self.end - 0.5 * DT {
            self.solve();
            if self.index % self.every != 0 {
                continue;
            }
            let correctors = (!self.correctors.is_empty()).then(|| self.correctors.remove(0));
            let step = Step { correctors, ..self.step() };
            let state = toy::of(self.state);
            // Without the state where it is not asked for.
            let wanted = self.ride.wants(&step);
            let answer = self.ride.solved(step, wanted.then_some(&view(&state)[..]))?;
            self.save();
            self.go_on(answer)?;
        }
        self.listen();
        Ok(())
    }

    fn solve(&mut self) {
        self.state = toy::later(self.state, DT);
        self.time = (self.time + DT) * 1e12;
        self.time = self.time.round() / 1e12;
        self.index += 1;
        match self.events.last_mut() {
            Some(Event::Solved(n)) => *n += 1,
            _ => self.events.push(Event::Solved(1)),
        }
    }

    /// Does what the ride says until the solver is to work again.
    pub fn go_on(&mut self, mut answer: Answer) -> Result<()> {
        loop {
            let now = toy::of(self.state);
            if let (Some(more), Action::Solve | Action::Stride | Action::HandBack) =
                (self.report, answer.action)
            {
                let more = if self.jumped > 0 { more } else { 0.0 };
                self.ride.reported(&[self.state[0] + more])?;
            }
            answer = match answer.action {
                Action::Solve => break,
                Action::Stride => {
                    let mut next = now.clone();
                    let mut places: Vec<&mut [f64]> = next.iter_mut().map(Vec::as_mut_slice).collect();
                    let answer = self.ride.stride(&mut places)?;
                    if answer.action == Action::Advance {
                        self.state = [next[0][0], next[0][1]];
                    } else {
                        assert_eq!(next, now, "a stride that is not used leaves the state");
                    }
                    answer
                }
                Action::Advance => {
                    self.time = ((self.time + answer.duration) * 1e12).round() / 1e12;
                    self.index += answer.solver_steps;
                    self.strides.push((answer.duration, answer.solver_steps));
                    self.jumped += 1;
                    if self.time > self.stop_after {
                        self.end = self.time;
                    }
                    self.ride.spent(0.25, 0.5);
                    let who = answer.surrogate;
                    let state = toy::of(self.state);
                    let next = self.ride.advanced(self.step(), answer.state.then_some(&view(&state)[..]))?;
                    self.save();
                    if next.action == Action::HandBack {
                        self.events.push(Event::Jumped(who, self.jumped));
                    }
                    next
                }
                Action::HandBack => {
                    if !matches!(self.events.last(), Some(Event::Jumped(..))) && self.jumped > 0 {
                        self.events.push(Event::Jumped(answer.surrogate, self.jumped));
                    }
                    self.jumped = 0;
                    let quantities = [("energy".to_string(), 0.5)];
                    let state = answer.state.then_some(&view(&now)[..]).map(<[_]>::to_vec);
                    self.ride.handed_back(self.step(), state.as_deref(), &quantities)?
                }
            };
        }
        self.listen();
        Ok(())
    }

    /// A host that goes on from the state of another one at a time.
    pub fn carried_on(from: &Host, settings: &str, toy: Toy, time: f64) -> Result<Host> {
        let file = from.folder.as_ref().unwrap().join(format!("{time:.1}.state"));
        let (ride, end) = (self::from(settings, Some(toy), time)?, from.end);
        let mut host = Host::new(ride, end);
        (host.time, host.index) = (time, (time / DT).round() as i64);
        host.state = from.state_at(time);
        let state = toy::of(host.state);
        host.report = from.report;
        let answer = host.ride.load(&file, host.step(), &view(&state))?;
        host.jumped = usize::from(answer.stepped);
        host.go_on(answer)?;
        Ok(host)
    }

    /// The state that was written at a time: beside the ride's, for the host.
    fn state_at(&self, time: f64) -> [f64; 2] {
        let text = std::fs::read_to_string(self.folder.as_ref().unwrap().join(format!("{time:.1}.host")));
        let values: Vec<u64> = text.unwrap().split(' ').map(|v| v.parse().unwrap()).collect();
        [f64::from_bits(values[0]), f64::from_bits(values[1])]
    }
}
