//! `m4gn convert`: data sets and weights of others, and for others.

use m4gn_base::{Error, Result, lock, refuse};
use m4gn_data::{Split, Trajectory, is_trajectory, list};
use m4gn_exchange::{export, import, weights};
use m4gn_mesh::NodeType;
use m4gn_model::Model;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Convert data sets and weights of others to m4gn's, and m4gn's to files of others
///
/// Into m4gn's: DeepMind's MeshGraphNets data (*.tfrecord with meta.json beside it), NumPy archives (*.npz) and HDF5 copies (*.h5) of such flows
/// on triangles and of bodies of tetrahedra that an obstacle touches, to OUT.h5 or into the folder OUT. Out of m4gn's: a trajectory, or a folder of them, to *.npz or to a series
/// for ParaView (*.pvd). The names and the contents of files say what they are.
///
/// Weights: a PyTorch state dict (*.safetensors, *.pt, *.pth) with the names of PhysicsNeMo's MeshGraphNet or of m4gn's models becomes a
/// model that is --like another one in all that weights do not say; a model becomes a state dict --as physicsnemo or pytorch.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// File or folder to read
    input: PathBuf,
    /// File or folder to write: *.h5, *.npz, *.pvd, or a folder
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// What is written, where the name of OUT does not say it: of trajectories into the folder OUT, or of a model
    #[arg(long = "as", value_enum, value_name = "KIND")]
    kind: Option<Kind>,
    /// What imported trajectories are for [default: train, valid or test as the file's name begins, else train]
    #[arg(long)]
    split: Option<Split>,
    /// Time between frames, s, of files that do not say it
    #[arg(long, value_name = "S")]
    dt: Option<f64>,
    /// Of bodies, whose material the file does not say: Poisson's ratio [default: 0.4]
    #[arg(long, value_name = "NU")]
    poisson: Option<f64>,
    /// Most trajectories that are read
    #[arg(long, value_name = "N", value_parser = crate::number::count)]
    count: Option<usize>,
    /// Of weights: the model that says fields, stride, node types and, where the weights have none, normalisers
    #[arg(long, value_name = "MODEL")]
    like: Option<PathBuf>,
    /// Of weights with PhysicsNeMo's names: the order of their one-hot node types [default: the model's]
    #[arg(long, value_name = "TYPE,...", value_delimiter = ',', value_parser = node_type)]
    node_types: Option<Vec<NodeType>>,
}

fn node_type(name: &str) -> std::result::Result<NodeType, String> {
    let names = NodeType::ALL.map(NodeType::name).join(", ");
    NodeType::ALL.into_iter().find(|t| t.name() == name).ok_or_else(|| format!("expected one of {names}"))
}

/// What a trajectory or a model is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// NumPy archive
    Npz,
    /// Series for ParaView
    Vtu,
    /// State dict with the names of PhysicsNeMo's MeshGraphNet
    Physicsnemo,
    /// State dict with m4gn's own names
    Pytorch,
}

pub fn run(args: Args) -> Result<()> {
    let input = args.input.as_path();
    let ending = input.extension().and_then(|e| e.to_str());
    if matches!(ending, Some("safetensors" | "pt" | "pth")) {
        return weights(&args);
    }
    if args.like.is_some() || args.node_types.is_some() {
        return Err(Error::Input(
            "--like, --node-types: these are for weights (*.safetensors, *.pt, *.pth)".into(),
        ));
    }
    if input.join("system/controlDict").exists() {
        return Err(Error::file(
            input,
            "is a case of OpenFOAM: give its controlDict an m4gnRecorder and run its solver with -postProcess, which records the time folders",
        ));
    }
    let own = input.is_dir() || input.extension().is_some_and(|e| e == "h5") && is_trajectory(input)?;
    match own {
        true => out(&args),
        false => into(&args),
    }
}

/// Options that nothing would heed are an error.
fn not_imported(args: &Args) -> Result<()> {
    if args.split.is_none() && args.dt.is_none() && args.poisson.is_none() {
        return Ok(());
    }
    Err(Error::Input(format!(
        "--split, --dt, --poisson: these are for files of others that become trajectories, which {} does not: leave them out",
        args.input.display()
    )))
}

/// Weights of others to a model, or a model to weights for others.
fn weights(args: &Args) -> Result<()> {
    not_imported(args)?;
    let types = args.node_types.as_deref();
    for (given, option, what) in [
        (args.count.is_some(), "--count", "trajectories"),
        (args.kind.is_some() && args.like.is_some(), "--like", "weights that become a model"),
        (args.kind == Some(Kind::Pytorch) && types.is_some(), "--node-types", "PhysicsNeMo's names"),
    ] {
        refuse(given, Error::Input, || format!("{option}: it is for {what}: leave it out"))?;
    }
    let _claimed = super::claim_outputs([Some(&*args.out)], [Some(&*args.input), args.like.as_deref()])?;
    let naming = match args.kind {
        None => {
            let Some(like) = &args.like else {
                return Err(Error::Input(
                    "weights need --like MODEL, whose fields, stride and normalisers they get; a model is written for others --as \
                     physicsnemo or --as pytorch"
                        .into(),
                ));
            };
            let name_file = |e| match e {
                Error::Model(what) => Error::file(&args.input, what),
                other => other,
            };
            let like = Model::read(like)?;
            let model = weights::model(weights::read(&args.input)?, &like, types).map_err(name_file)?;
            model.write(&args.out)?;
            println!("wrote {}: {}", args.out.display(), model.spec.architecture.name().name());
            return Ok(());
        }
        Some(Kind::Physicsnemo) => weights::Naming::PhysicsNemo,
        Some(Kind::Pytorch) => weights::Naming::Own,
        Some(_) => return Err(Error::Input("--as: a model is written as physicsnemo or pytorch".into())),
    };
    let tensors = weights::state_dict(&Model::read(&args.input)?, naming, types)?;
    weights::write(&tensors, &args.out)?;
    println!("wrote {}: {} tensors", args.out.display(), tensors.len());
    Ok(())
}

/// Files of others to trajectories.
fn into(args: &Args) -> Result<()> {
    if args.kind.is_some() {
        return Err(Error::Input(format!(
            "--as: {} becomes trajectories, NAME.h5 or a folder of them: leave it out",
            args.input.display()
        )));
    }
    refuse(args.out.extension().is_some_and(|e| e == "npz" || e == "pvd"), Error::Input, || {
        format!(
            "--out {}: {} becomes trajectories first: give NAME.h5 or a folder, and convert that",
            args.out.display(),
            args.input.display()
        )
    })?;
    let stop = super::stop_flag()?;
    let single = args.out.extension().is_some_and(|e| e == "h5");
    let _folder = (!single).then(|| lock::folder(&args.out)).transpose()?;
    let options =
        import::Options { split: args.split, dt: args.dt, poisson: args.poisson, count: args.count };
    let mut done = |file: &Path, kept: bool| {
        println!("{} {}", if kept { "kept " } else { "wrote" }, file.display());
        match stop.load(Ordering::Relaxed) {
            0 => Ok(()),
            _ => Err(Error::Interrupted("stopped; the trajectories that are written are whole".into())),
        }
    };
    let n = import::import(&args.input, &args.out, &options, &mut done)?;
    println!("{n} {}", if n == 1 { "trajectory" } else { "trajectories" });
    Ok(())
}

/// Trajectories to files for others.
fn out(args: &Args) -> Result<()> {
    not_imported(args)?;
    let ending = args.out.extension().and_then(|e| e.to_str());
    let kind = match (args.kind, ending) {
        (Some(_), Some("npz" | "pvd")) => {
            return Err(Error::Input("--as: the name of --out says it: leave it out".into()));
        }
        (Some(kind @ (Kind::Npz | Kind::Vtu)), _) => kind,
        (Some(_), _) => return Err(Error::Input("--as: a trajectory is written as npz or vtu".into())),
        (None, Some("npz")) => Kind::Npz,
        (None, Some("pvd")) => Kind::Vtu,
        _ => {
            return Err(Error::Input(format!(
                "--out {}: expected a name that ends in .npz or .pvd, or a folder with --as npz or --as vtu",
                args.out.display()
            )));
        }
    };
    let files = list(&args.input)?;
    let single = args.kind.is_none();
    if single && files.len() > 1 {
        return Err(Error::Input(format!(
            "{} holds {} trajectories: give --out a folder, and --as npz or --as vtu",
            args.input.display(),
            files.len()
        )));
    }
    let _folder = (!single).then(|| lock::folder(&args.out)).transpose()?;
    let stop = super::stop_flag()?;
    for file in files.iter().take(args.count.unwrap_or(usize::MAX)) {
        let stem = file.file_stem().unwrap_or_default();
        let (write, end): (fn(&Trajectory, &Path) -> Result<()>, _) = match kind {
            Kind::Npz => (export::to_npz, "npz"),
            _ => (export::to_vtu, "pvd"),
        };
        // A name may have a dot of its own
        let mut name = stem.to_os_string();
        name.push(format!(".{end}"));
        let to = if single { args.out.clone() } else { args.out.join(name) };
        let _claimed = super::claim_outputs([Some(&*to)], [Some(&*args.input)])?;
        write(&Trajectory::open(file)?, &to)?;
        println!("wrote {}", to.display());
        if stop.load(Ordering::Relaxed) != 0 {
            return Err(Error::Interrupted("stopped; the files that are written are whole".into()));
        }
    }
    Ok(())
}
