//! What a session is made with: the settings of a case dictionary, of a host program and of `m4gn validate`.

use m4gn_base::settings;
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_domain::Domain;
use m4gn_engine::{EngineOptions, Isa, Precision, PrecisionChoice};
use m4gn_model::{Resolution, SegmentEntries, SegmentSpec, Solid};
use serde::{Deserialize, Serialize};

/// Most threads a rank may be given: a larger number is a slip of the pen.
const MAX_THREADS: usize = 1024;

/// What runs the network.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Backend {
    /// This library's own engine.
    #[default]
    Native,
    /// libtorch on this device ("cpu", "cuda:0"), or on one of its choice.
    Torch(Option<String>),
}

impl Backend {
    /// From a dictionary's word: `native`, `torch`, `torch:cpu`, `torch:cuda:0`.
    ///
    /// # Errors
    /// [`Error::Input`] for any other word.
    pub fn parse(word: &str) -> Result<Self> {
        match word.split_once(':') {
            None if word == "native" => Ok(Backend::Native),
            None if word == "torch" => Ok(Backend::Torch(None)),
            Some(("torch", device)) if !device.is_empty() => Ok(Backend::Torch(Some(device.into()))),
            _ => Err(Error::Input(format!("backend '{word}': expected native, torch or torch:DEVICE"))),
        }
    }
}

impl TryFrom<String> for Backend {
    type Error = Error;

    fn try_from(word: String) -> Result<Self> {
        Backend::parse(&word)
    }
}

impl From<Backend> for String {
    fn from(backend: Backend) -> String {
        match backend {
            Backend::Native => "native".into(),
            Backend::Torch(None) => "torch".into(),
            Backend::Torch(Some(device)) => format!("torch:{device}"),
        }
    }
}

settings! {
    /// What a session is made with, by the names that these entries have in a case dictionary and in JSON.
    pub struct SessionOptions in "session" {
        /// What runs the network: `native`; `torch`, libtorch on a device of its choice; or `torch:DEVICE`, such as `torch:cuda:0`.
        pub backend: Backend = Backend::default();
        /// Precision of the native backend's products: `fp32`, `bf16`, `auto` (the faster one on the processors of all ranks), or
        /// `model` (`auto` for a model of fields at cells that was trained in bf16, else `fp32`).
        pub precision: PrecisionChoice = PrecisionChoice::default();
        /// Mean distance of the network's nodes: `auto`, what the model was trained on; `off`, a node a cell; or a length, m, to which
        /// the cells of finer meshes are agglomerated.
        pub resolution: Resolution = Resolution::default();
        /// Threads of each rank.
        pub n_threads: usize = 1;
        /// How the mesh is cut (dictionary): what differs from the segmentation that the model was trained with.
        pub segments: SegmentEntries = SegmentEntries::default(), "as the model was trained";
        /// What the solver says of a solid at cells, compared with what the model was trained on (dictionary): lowest and highest `E`,
        /// `nu`, `rho` and `traction`, lists `laws` and `schemes`, each optional.
        pub solid: Option<Solid> = None, "what the case says";
    }
    beside {
        /// Segment of each cell, computed before; none: segments are computed.
        pub cell_segment: Option<Vec<i32>>;
        /// Instruction set of the native engine; none: the widest that the processor has.
        pub isa: Option<Isa>;
    }
}

impl SessionOptions {
    /// From the text of a JSON object, checked.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was expected and what was found.
    pub fn parse(text: &str) -> Result<Self> {
        let options: Self = settings::parse("session", text, &[])?;
        options.check()?;
        Ok(options)
    }

    /// Checks what needs neither a model nor a mesh.
    ///
    /// # Errors
    /// As [`SessionOptions::parse`].
    pub fn check(&self) -> Result<()> {
        refuse(!(1..=MAX_THREADS).contains(&self.n_threads), Error::Input, || {
            format!("n_threads: expected 1 to {MAX_THREADS}, found {}", self.n_threads)
        })?;
        self.segments.over(&SegmentSpec::default())?;
        refuse_any(self.solid.as_ref().and_then(Solid::fault), Error::Input, |fault| format!("solid.{fault}"))
    }

    /// What all ranks must be given alike, a line for each entry: not the threads of a rank or its device.
    ///
    /// # Errors
    /// [`Error::Internal`] if they cannot be written as JSON.
    pub fn shared(&self) -> Result<String> {
        let mut alike = self.clone();
        alike.n_threads = 1;
        if let Backend::Torch(device) = &mut alike.backend {
            *device = None;
        }
        settings::lines(&alike)
    }

    /// What the native engine is made with.
    pub(super) fn engine(&self, precision: Precision, domain: &dyn Domain) -> EngineOptions {
        EngineOptions {
            n_threads: self.n_threads,
            precision,
            isa: self.isa,
            edges_move: domain.moves(),
            ..EngineOptions::default()
        }
    }

    /// The model's segmentation with what the case sets differently.
    ///
    /// # Errors
    /// As [`SessionOptions::check`].
    pub(super) fn segment_spec(&self, model: &SegmentSpec) -> Result<SegmentSpec> {
        self.check()?;
        self.segments.over(model)
    }
}
