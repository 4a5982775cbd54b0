//! A training configuration for a data set: fields, stride and noise from its frames, width from the time that there is.

use crate::bench::{Runs, Trial};
use crate::signal::median;
use m4gn_base::{Error, Result, refuse};
use m4gn_data::{Split, Trajectory, interval, list};
use m4gn_domain::body::gap::cell_size;
use m4gn_learn::NativeBackend;
use m4gn_report::{number, seconds};
use m4gn_train::config::Config;
use m4gn_train::model_of;
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

/// Trajectories that are read, spread over those there are, and values of each of their frames.
const READ: usize = 8;
const VALUES: usize = 4096;

/// Least strides in a trajectory, and frames: those of the four strides that a training unrolls at its end.
const STRIDES: usize = 25;
const FRAMES: usize = 5;

/// Noise over what a field changes by in a stride.
const NOISE: f64 = 0.25;

/// Nodes to which finer meshes are agglomerated.
const NODES: usize = 2000;

/// Widths, and the updates that a training should have.
const WIDTHS: [usize; 3] = [128, 64, 32];
const UPDATES: f64 = 6000.0;
/// Fewer updates train nothing.
const FEWEST_UPDATES: f64 = 100.0;

/// How a field moves in one trajectory, in its own unit (root mean squares).
struct Motion {
    /// Its values.
    level: f64,
    /// Its distance from its mean in time.
    spread: f64,
    /// Its change over 1, 2, ... frames.
    change: Vec<f64>,
}

impl Motion {
    fn of(frames: &[Vec<f32>], longest: usize) -> Self {
        let rms = |sum: f64, n: usize| (sum / n.max(1) as f64).sqrt();
        let n = frames[0].len();
        let mut mean = vec![0.0; n];
        for frame in frames {
            mean.iter_mut().zip(frame).for_each(|(m, &x)| *m += f64::from(x) / frames.len() as f64);
        }
        let all = || frames.iter().flat_map(|f| f.iter().zip(&mean));
        let change = |lag: usize| {
            let pairs = frames.iter().zip(&frames[lag..]);
            let sum: f64 =
                pairs.flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| f64::from(b - a).powi(2)).sum();
            rms(sum, n * (frames.len() - lag))
        };
        Motion {
            level: rms(all().map(|(&x, _)| f64::from(x).powi(2)).sum(), n * frames.len()),
            spread: rms(all().map(|(&x, m)| (f64::from(x) - m).powi(2)).sum(), n * frames.len()),
            change: (1..=longest).map(change).collect(),
        }
    }

    /// Whether it is the same at all times, but for rounding.
    fn steady(&self) -> bool {
        self.spread <= 1e-6 * self.level
    }
}

/// A field of the data set.
struct Field {
    name: String,
    vector: bool,
    /// Of a body, all but its displacement, which is all that its network has.
    beside: bool,
    motions: Vec<Motion>,
    values: Vec<f32>,
}

/// What the network does with it.
#[derive(Debug, PartialEq)]
enum Part {
    /// The change over a stride is predicted, or the value, of a positive field on a logarithmic scale above its floor.
    Predicted { output: &'static str, floor: Option<f64> },
    /// It is the solver's.
    Given,
    /// It says nothing, or follows from others.
    Out,
}

impl Field {
    fn part(&self) -> Part {
        let (least, most) = (self.value(0.0), self.value(1.0));
        match self.name.as_str() {
            "nut" | "alphat" => Part::Out,
            _ if self.beside => Part::Out,
            name if name == "deltaT" || self.motions.iter().all(Motion::steady) => {
                if most - least > 1e-6 * most.abs().max(least.abs()) { Part::Given } else { Part::Out }
            }
            "p" | "p_rgh" => Part::Predicted { output: "value", floor: None },
            _ => {
                let wide = !self.vector && least >= 0.0 && most > 100.0 * self.value(0.5);
                let floor = wide.then(|| 1e-3 * self.value(0.5)).filter(|f| *f > 0.0);
                Part::Predicted { output: "delta", floor }
            }
        }
    }

    /// The value below which this share of all lies.
    fn value(&self, share: f64) -> f64 {
        f64::from(self.values[(share * (self.values.len() - 1) as f64) as usize])
    }

    /// The median over the trajectories.
    fn median(&self, of: impl Fn(&Motion) -> f64) -> f64 {
        median(self.motions.iter().filter(|m| !m.steady()).map(of)).unwrap_or(0.0)
    }

    /// Its change over so many frames, over its distance from its mean: 2 sin(pi n/N) of a wave of N frames.
    fn turned(&self, frames: usize) -> f64 {
        self.median(|m| m.change[frames - 1] / m.spread)
    }
}

/// What the frames of a data set say.
struct Seen {
    trajectories: usize,
    cells: usize,
    dim: usize,
    interval: f64,
    /// Mean distance of its nodes, m.
    spacing: f64,
    body: bool,
    viscosities: Vec<f64>,
    fields: Vec<Field>,
}

impl Seen {
    fn of(folder: &Path) -> Result<Self> {
        let mut all = list(folder)?.iter().map(Trajectory::open).collect::<Result<Vec<_>>>()?;
        all.retain(|t| t.split() == Split::Train && t.times().len() >= FRAMES);
        // Those of runs that were killed early would shorten the strides of all
        let most = all.iter().map(|t| t.times().len()).max().unwrap_or(0);
        all.retain(|t| 2 * t.times().len() >= most);
        let trajectories = all.len();
        let (Some(first), Some(shortest)) = (all.first(), all.iter().map(|t| t.times().len()).min()) else {
            return Err(Error::file(
                folder,
                format!(
                    "no trajectory of split `train` with at least {FRAMES} frames: make some with `m4gn generate`"
                ),
            ));
        };
        let mean = |t: &Trajectory| interval(t.times()).map_or(f64::NAN, |(mean, _)| mean);
        let (interval, dim, body) = (mean(first), first.mesh().dim(), first.body().is_some());
        for t in &all {
            refuse(
                (mean(t) - interval).abs() > 1e-3 * interval,
                |m| Error::file(t.path(), m),
                || {
                    let (found, expected) = (number(mean(t), 4), number(interval, 4));
                    format!(
                        "a frame each {found} s, expected each {expected} s, as in {}",
                        first.path().display()
                    )
                },
            )?;
        }
        let step = all.len().div_ceil(READ);
        let read: Vec<&Trajectory> = all.iter().step_by(step).collect();
        let longest = ((shortest - 1) / STRIDES).max(1);
        let fields = first.fields().iter().map(|meta| {
            let mut field = Field {
                name: meta.name.clone(),
                vector: meta.vector,
                beside: body && meta.name != "D",
                motions: Vec::new(),
                values: Vec::new(),
            };
            for t in &read {
                let width = t.field(&meta.name)?.components(t.mesh().dim());
                let every = t.mesh().cell_global.len().div_ceil(VALUES).max(1);
                let some = |frame: usize| -> Result<Vec<f32>> {
                    let values = t.read_frame(&meta.name, frame)?.cells;
                    Ok(values.chunks_exact(width).step_by(every).flatten().copied().collect())
                };
                let frames = (0..t.times().len()).map(some).collect::<Result<Vec<_>>>()?;
                field.values.extend(frames.last().into_iter().flatten());
                field.motions.push(Motion::of(&frames, longest));
            }
            field.values.sort_by(f32::total_cmp);
            Ok(field)
        });
        let fields = fields.collect::<Result<Vec<_>>>()?;
        // Of flows that do not record it: of a solid it is Poisson's ratio.
        let implied = |t: &&Trajectory| t.field("nu").is_ok() && t.fields().iter().all(|f| f.name != "nu");
        let viscosities = all.iter().filter(implied).filter_map(|t| t.provenance()["nu"].as_f64());
        let mut viscosities: Vec<f64> = viscosities.collect();
        viscosities.sort_by(f64::total_cmp);
        viscosities.dedup();
        let spacing = match first.body() {
            Some(body) => cell_size(&body.positions, &body.edges),
            None => first.mesh().cell_sizes().iter().sum::<f64>() / first.mesh().n_cells() as f64,
        };
        let cells = first.mesh().cell_global.len();
        Ok(Seen { trajectories, cells, dim, interval, spacing, body, viscosities, fields })
    }

    /// Frames of a stride: as many as turn no wave by more than a sixth of its period.
    fn stride(&self) -> usize {
        let moving = || self.fields.iter().filter(|f| matches!(f.part(), Part::Predicted { .. }));
        let longest = moving().flat_map(|f| &f.motions).map(|m| m.change.len()).min().unwrap_or(1);
        let fits = |frames: &usize| moving().all(|f| f.turned(*frames) <= 1.0);
        (1..=longest).take_while(fits).last().unwrap_or(1)
    }
}

/// What it is taken from, for people, and the text of the configuration.
#[derive(Debug)]
pub struct Suggestion {
    /// What was seen, a line each.
    pub seen: Vec<String>,
    /// The configuration (TOML).
    pub text: String,
}

/// The configuration of a training of so many minutes on this machine.
///
/// # Errors
/// [`Error::File`] for a folder without trajectories to train on, or whose frame intervals differ; [`Error::Input`] where no field
/// moves, and for minutes in which there are fewer than a hundred updates; what a training would refuse.
pub fn suggest(folder: &Path, minutes: f64) -> Result<Suggestion> {
    let seen = Seen::of(folder)?;
    let coarse = !seen.body && seen.cells > NODES * 3 / 2;
    let nodes = if coarse { NODES } else { seen.cells };
    let (width, bf16, step) = width(&seen, nodes, minutes)?;
    if minutes * 60.0 < FEWEST_UPDATES * step {
        return Err(Error::Input(format!(
            "{minutes} minutes are too few: an update of the smallest network takes {} ms here, and {FEWEST_UPDATES} of them take {} minutes; \
             expected more, better {}",
            number(step * 1e3, 3),
            number(FEWEST_UPDATES * step / 60.0, 2),
            number(UPDATES * step / 60.0, 2)
        )));
    }
    let stride = seen.stride();
    let text = text(&seen, stride, coarse.then_some(nodes), width, bf16, minutes);
    model_of(folder, &Config::parse(&text)?)?;
    let mut lines = vec![
        format!(
            "{} trajectories of {} nodes, a frame each {} s",
            seen.trajectories,
            seen.cells,
            number(seen.interval, 4)
        ),
        format!("a stride of {stride} frames"),
        format!(
            "width {width}{}: {} ms an update with two graphs, some {:.0} updates in {minutes} minutes",
            if bf16 { " in bf16" } else { "" },
            number(step * 1e3, 3),
            minutes * 60.0 / step
        ),
    ];
    for field in &seen.fields {
        let what = match field.part() {
            Part::Predicted { .. } => {
                let turned = number(field.turned(stride), 2);
                format!("predicted; changes over a stride by {turned} of its deviation from its mean in time")
            }
            Part::Given => "an input".into(),
            Part::Out => "left out".into(),
        };
        lines.push(format!("{}: {what}", field.name));
    }
    if seen.fields.iter().any(|f| matches!(f.part(), Part::Predicted { .. }) && f.turned(1) > 1.0) {
        lines.push(
            "from frame to frame waves turn by more than a sixth of their period: record more often".into(),
        );
    }
    Ok(Suggestion { seen: lines, text })
}

/// The largest width with which a training has [`UPDATES`], whether in bf16, and the time of an update, s.
fn width(seen: &Seen, nodes: usize, minutes: f64) -> Result<(usize, bool, f64)> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get().min(2));
    let time = |width: usize, bf16: bool| -> Result<f64> {
        let hex = seen.dim == 3;
        let trial = Trial {
            nodes,
            hex,
            layers: 8,
            width,
            hidden: 1,
            segments: Some(segments(nodes)),
            batch: 2,
            unroll: 1,
            threads,
            bf16,
        };
        let prepared = trial.prepare()?;
        let mut backend = NativeBackend::new(&prepared.training, &prepared.spec, &prepared.work, threads)?;
        let mut optimiser = prepared.optimiser();
        let run = || prepared.step(&mut backend, &mut optimiser).map(drop);
        Ok(Runs::For(Duration::from_millis(300)).time(run)?.median() * 1e-3)
    };
    let mut found = (0, false, f64::INFINITY);
    for width in WIDTHS {
        let (fp32, bf16) = (time(width, false)?, time(width, true)?);
        found = (width, bf16 < 0.9 * fp32, fp32.min(bf16));
        if minutes * 60.0 >= UPDATES * found.2 {
            break;
        }
    }
    Ok(found)
}

/// Segments of some 36 nodes.
fn segments(nodes: usize) -> usize {
    (nodes / 36).clamp(4, 144).min(nodes)
}

/// The configuration, with the reasons beside.
fn text(seen: &Seen, stride: usize, coarse: Option<usize>, width: usize, bf16: bool, minutes: f64) -> String {
    let (mut fields, mut noise, mut out) = (String::new(), Vec::new(), Vec::new());
    for field in &seen.fields {
        let name = &field.name;
        let entry = match field.part() {
            Part::Out => {
                out.push(name.as_str());
                continue;
            }
            Part::Given => format!("name = {name:?}, input = true, output = \"none\""),
            Part::Predicted { output, floor } => {
                let change = field.median(|m| m.change[stride - 1]);
                let deviation = if floor.is_some() { 0.02 } else { NOISE * change };
                noise.push(format!("{name:?} = {deviation:.1e}"));
                let floor = floor.map_or(String::new(), |f| format!(", floor = {f:.1e}"));
                format!("name = {name:?}, input = {}, output = \"{output}\"{floor}", !seen.body)
            }
        };
        let _ = writeln!(fields, "    {{ {entry} }},");
    }
    if seen.viscosities.len() > 1 {
        fields += "    { name = \"nu\", input = true, output = \"none\" },\n";
    }
    let mut text = format!("# Of {} trajectories.", seen.trajectories);
    if !out.is_empty() {
        let _ = write!(text, " Left out, since the same everywhere or what others give: {}.", out.join(", "));
    }
    let interval = seen.interval * stride as f64;
    let _ = write!(
        text,
        "\n\n[model]\nstride = {:<20} # s, {stride} recorded frames: one, or no more than turn a wave by a sixth of its period\n",
        seconds(interval)
    );
    if let Some(nodes) = coarse {
        let times = (seen.cells as f64 / nodes as f64).powf(1.0 / seen.dim as f64);
        let _ = writeln!(
            text,
            "resolution = {:<16.3e} # m: some {nodes} nodes on {} cells",
            seen.spacing * times,
            seen.cells
        );
    }
    let _ = write!(
        text,
        "width = {width}\nhidden_layers = 1\nactivation = \"relu\"\nlayers_before = 4\nlayers_after = 4\nfields = [\n{fields}]\n\n\
         [macro]\nlayers = 3\nheads = 4\nffn_width = {}\nrwse_steps = 0\ncentroids = true\noffsets = true\n\n",
        2 * width
    );
    let nodes = coarse.unwrap_or(seen.cells);
    let count = segments(nodes);
    if seen.body {
        let _ = write!(
            text,
            "[contact]\nradius = {:<20.1e} # m: two edges\n\n[segments]\nmethod = \"slic-mdode\"\nmodes = 1\ncount = {count}\n",
            2.0 * seen.spacing
        );
    } else {
        let _ = write!(
            text,
            "[segments]\nmethod = \"metis\"\ncount = {count:<21} # of some {} nodes\n",
            nodes / count
        );
    }
    let _ = write!(
        text,
        "\n[training]\nmax_minutes = {minutes}\n\
         schedule = \"time\"           # the rate and the unrolled strides go by the time; steps are shares of it\n\
         steps = 10000\nbatch_size = 2\nprecision = \"{}\"\noptimiser = \"muon\"\nlearning_rate = 1e-3\nlearning_rate_end = 1e-5\n\
         warmup_steps = 100\ndecay_steps = 9000\ndecay = \"cosine\"\nrestarts = [{{ step = 9000, learning_rate = 1e-4 }}]\n\
         betas = [0.9, 0.99]\ngradient_clip = 1.0\nema_decay = 0.995\n\
         noise = {{ {} }}     # a quarter of the change over a stride; 0.02 of a logarithm\n\
         unroll = [[0, 1], [7500, 4]]\nnormaliser_steps = 200\nnormaliser_warmup = 50\nvalidation_interval = 500\n",
        if bf16 { "bf16" } else { "fp32" },
        noise.join(", ")
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(name: &str, frames: &[Vec<f32>], longest: usize) -> Field {
        let mut values = frames.last().unwrap().clone();
        values.sort_by(f32::total_cmp);
        let motions = vec![Motion::of(frames, longest)];
        Field { name: name.into(), vector: false, beside: false, motions, values }
    }

    fn seen(fields: Vec<Field>) -> Seen {
        Seen {
            trajectories: 1,
            cells: 5000,
            dim: 2,
            interval: 0.01,
            spacing: 0.01,
            body: false,
            viscosities: vec![],
            fields,
        }
    }

    /// sin(2 pi (x + t)/25) at the nodes x = 0 .. 24, a hundred frames.
    fn wave(offset: f32) -> Vec<Vec<f32>> {
        let at = |n: usize| offset + (std::f32::consts::TAU * n as f32 / 25.0).sin();
        (0..100).map(|t| (0..25).map(|x| at(x + t)).collect()).collect()
    }

    #[test]
    fn a_stride_turns_a_wave_by_a_sixth_of_its_period() {
        let one = field("T", &wave(0.0), 10);
        let (spread, change) = (one.motions[0].spread, one.motions[0].change[4]);
        assert!((spread - 0.5f64.sqrt()).abs() < 1e-6);
        // 2 sin(pi 5/25) times its root mean square; that of four frames is below 1, that of five is not.
        assert!((change / spread - 2.0 * (std::f64::consts::PI / 5.0).sin()).abs() < 1e-5);
        assert_eq!(seen(vec![one]).stride(), 4);
    }

    #[test]
    fn the_same_field_at_all_times_is_given_or_says_nothing() {
        let frames = |x: [f32; 2]| vec![x.to_vec(); 3];
        assert_eq!(field("h", &frames([1.0, 2.0]), 1).part(), Part::Given);
        assert_eq!(field("h", &frames([2.0, 2.0]), 1).part(), Part::Out);
        assert_eq!(field("deltaT", &[vec![1.0; 2], vec![2.0; 2], vec![3.0; 2]], 1).part(), Part::Out);
        // Of 1, 2^8, 3^8, ... the largest is more than a hundred times the median
        let wide =
            field("k", &[vec![1.0; 9], vec![1.0; 9], (1..=9).map(|n| (n as f32).powi(8)).collect()], 1);
        assert_eq!(wide.part(), Part::Predicted { output: "delta", floor: Some(1e-3 * 5f64.powi(8)) });
    }

    #[test]
    fn trajectories_of_few_frames_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, frames: usize| {
            let path = folder.path().join(name);
            m4gn_samples::training::write_trajectory(&path, 0, Split::Train, frames).unwrap();
        };
        write("0.h5", 4);
        let error = Seen::of(folder.path()).err().unwrap().to_string();
        assert!(error.contains("with at least 5 frames"), "{error}");
        write("1.h5", 30);
        write("2.h5", 14);
        assert_eq!(Seen::of(folder.path()).unwrap().trajectories, 1);
    }

    #[test]
    fn the_text_is_a_configuration() {
        let of = |interval: f64| {
            let fields = vec![field("p", &wave(0.0), 10), field("ddt(D)", &wave(2.0), 10)];
            let seen = Seen { interval, ..seen(fields) };
            Config::parse(&text(&seen, 4, Some(2000), 64, false, 30.0)).unwrap()
        };
        // Whatever digits and zeros the stride has
        assert_eq!([2.5e-11, 2.5e5].map(|interval| of(interval).model.stride), [1e-10, 1e6]);
        // A body with its stress
        let stress = Field { beside: true, ..field("sigmaEq", &wave(2.0), 10) };
        let body = Seen { body: true, ..seen(vec![field("D", &wave(0.0), 10), stress]) };
        let config = Config::parse(&text(&body, 4, None, 64, false, 30.0)).unwrap();
        assert_eq!(config.model.fields.len(), 1);
        let config = of(0.01);
        assert_eq!((config.model.stride, config.segments.count), (0.04, 55));
        // sqrt(5000/2000) times the spacing
        assert_eq!(config.model.resolution, Some(1.581e-2));
        // A quarter of 2 sin(4 pi/25) times sqrt(1/2)
        assert!((config.training.noise["ddt(D)"] - 0.17).abs() < 0.001);
        assert_eq!(config.training.max_minutes, Some(30.0));
    }
}
