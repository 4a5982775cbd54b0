//! The one error type: what was expected, what was found, where, and what to do.

use std::path::{Path, PathBuf};

/// Result of every fallible function of the project.
pub type Result<T> = std::result::Result<T, Error>;

/// Failures a user can meet. The variants are the status classes of the C ABI.
#[derive(Debug, Clone, thiserror::Error)]
pub enum Error {
    /// A value that the caller or a dictionary gave cannot be used.
    #[error("{0}")]
    Input(String),
    /// A file is missing, truncated, of another format, or cannot be written.
    #[error("{path}: {message}")]
    File {
        /// The file concerned.
        path: PathBuf,
        /// Expected, found, and what to do.
        message: String,
    },
    /// A model does not fit the case (fields, dimensions, node types, stride).
    #[error("{0}")]
    Model(String),
    /// A mesh or its patches cannot be turned into a graph.
    #[error("{0}")]
    Mesh(String),
    /// A numerical method did not arrive (eigenvalues, factorisation, non-finite values).
    #[error("{0}")]
    Numerical(String),
    /// The work was interrupted by the user after saving what there was.
    #[error("{0}")]
    Interrupted(String),
    /// Another rank failed; its own message was printed there.
    #[error("rank {rank}: {message}")]
    OtherRank {
        /// The lowest rank that failed.
        rank: i32,
        /// Its message.
        message: String,
    },
    /// A defect of this library: the object must not be used any more.
    #[error("internal error: {0}. Please report it with the case that shows it")]
    Internal(String),
}

impl Error {
    /// A file error with its path.
    pub fn file(path: impl AsRef<Path>, message: impl Into<String>) -> Self {
        Error::File { path: path.as_ref().to_path_buf(), message: message.into() }
    }

    /// Why a file cannot be `done`, for `map_err`: `PATH: cannot be read: WHY`.
    pub fn cannot<E: std::fmt::Display>(done: &str, path: impl AsRef<Path>) -> impl FnOnce(E) -> Self {
        move |e| Error::file(path, format!("cannot be {done}: {e}"))
    }

    /// Status code of the C ABI: positive, the object is still usable; negative, it is not.
    pub fn status(&self) -> i32 {
        match self {
            Error::Input(_) => 1,
            Error::File { .. } => 2,
            Error::Model(_) => 3,
            Error::Mesh(_) => 4,
            Error::Numerical(_) => 5,
            Error::Interrupted(_) => 6,
            Error::OtherRank { .. } => 7,
            Error::Internal(_) => -1,
        }
    }

    /// The error of a status and its message, as another library of this project reports it.
    pub fn from_status(status: i32, message: String) -> Self {
        match status {
            3 => Error::Model(message),
            4 => Error::Mesh(message),
            5 => Error::Numerical(message),
            6 => Error::Interrupted(message),
            7 => match message
                .strip_prefix("rank ")
                .and_then(|m| m.split_once(": "))
                .and_then(|(rank, m)| Some((rank.parse().ok()?, m.to_string())))
            {
                Some((rank, message)) => Error::OtherRank { rank, message },
                None => Error::Internal(message),
            },
            s if s < 0 => Error::Internal(message),
            // Of a file's error the message already begins with the path.
            _ => Error::Input(message),
        }
    }
}

/// Things in a line of a message: `a, b, c`.
pub fn listed<T: std::fmt::Display>(all: impl IntoIterator<Item = T>) -> String {
    let all: Vec<String> = all.into_iter().map(|one| one.to_string()).collect();
    all.join(", ")
}

/// An error of this kind where `wrong`: `refuse(n == 0, Error::Input, || "no cells")?`.
pub fn refuse<E, M: Into<String>>(
    wrong: bool,
    kind: impl FnOnce(String) -> E,
    message: impl FnOnce() -> M,
) -> std::result::Result<(), E> {
    if wrong { Err(kind(message().into())) } else { Ok(()) }
}

/// An error of this kind about what was `found`, if anything was.
pub fn refuse_any<T, E, M: Into<String>>(
    found: Option<T>,
    kind: impl FnOnce(String) -> E,
    message: impl FnOnce(T) -> M,
) -> std::result::Result<(), E> {
    found.map_or(Ok(()), |found| Err(kind(message(found).into())))
}
