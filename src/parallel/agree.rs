//! Agreement: what one rank found, all ranks know before the next collective call.

use super::{Comm, MpiComm};
use m4gn_base::{Error, Result};
use std::hash::{DefaultHasher, Hash, Hasher};

impl Comm {
    /// Ranks agree: Ok only if all are. A rank that failed keeps its own error, the others get
    /// [`Error::OtherRank`] with the lowest failing rank's message. An [`Error::Internal`] of one rank is one on all:
    /// what they share can then only be freed. Collective.
    pub fn agree<T>(&self, result: Result<T>) -> Result<T> {
        let Comm::Mpi(m) = self else {
            return result;
        };
        self.decide(m, result, 0).map(|(value, _)| value)
    }

    /// As [`Comm::agree`], and all ranks give the same `options`, a line for each; otherwise it is an
    /// [`Error::Input`] on all ranks that names the first that differs. A line is the entry's name, a space and its value. Collective.
    pub fn agree_with<T>(&self, result: Result<T>, options: &str) -> Result<T> {
        let Comm::Mpi(m) = self else {
            return result;
        };
        let mut hasher = DefaultHasher::new();
        options.hash(&mut hasher);
        // Without the sign's bit, so that the negative exists.
        let digest = (hasher.finish() >> 1) as i64;
        let (value, same) = self.decide(m, result, digest)?;
        if same {
            return Ok(value);
        }
        let mut of_root = options.as_bytes().to_vec();
        self.broadcast_from(m, 0, &mut of_root);
        let compared = compare(options, &String::from_utf8_lossy(&of_root));
        match self.decide(m, compared.map(|()| value), 0) {
            Ok((value, _)) => Ok(value),
            // It is everybody's input.
            Err(Error::OtherRank { rank, message }) => Err(Error::Input(format!("rank {rank}: {message}"))),
            Err(e) => Err(e),
        }
    }

    /// The value of ranks that all succeeded, and whether their digests are equal.
    fn decide<T>(&self, m: &MpiComm, result: Result<T>, digest: i64) -> Result<(T, bool)> {
        let (rank, size) = (i64::from(m.rank), i64::from(m.size));
        let broken = matches!(result, Err(Error::Internal(_)));
        let mine = |failed: bool| if failed { rank } else { size };
        let mut least = [mine(broken), mine(result.is_err()), digest, -digest];
        self.min_i64(&mut least);
        let [first_broken, first_failed, low, high] = least;
        if first_failed == size {
            return result.map(|value| (value, low == -high));
        }
        let broken = first_broken < size;
        let speaker = if broken { first_broken } else { first_failed } as i32;
        let mut message = match &result {
            Err(e) if m.rank == speaker => inner(e).into_bytes(),
            _ => Vec::new(),
        };
        self.broadcast_from(m, speaker, &mut message);
        m.agreed.set(true);
        let message = String::from_utf8_lossy(&message).into_owned();
        match result {
            Err(e) if !broken || matches!(e, Error::Internal(_)) => Err(e),
            _ if broken => Err(broken_elsewhere(speaker, &message)),
            _ => Err(Error::OtherRank { rank: speaker, message }),
        }
    }
}

/// The message alone; [`Error::Internal`] frames its own when it is shown.
pub(super) fn inner(e: &Error) -> String {
    match e {
        Error::Internal(message) => message.clone(),
        other => other.to_string(),
    }
}

/// What a rank returns when another one broke.
pub(super) fn broken_elsewhere(rank: i32, message: &str) -> Error {
    Error::Internal(format!("rank {rank}: {message}; the call was ended on all ranks"))
}

fn compare(own: &str, of_root: &str) -> Result<()> {
    if own == of_root {
        return Ok(());
    }
    let first = |text: &str, other: &str| {
        let mut lines = text.lines().filter(|line| other.lines().all(|o| o != *line));
        lines.next().map(str::to_owned)
    };
    // The line of the same entry, or none.
    let same_entry = |line: &str, text: &str| {
        let entry = line.split(' ').next();
        let found = text.lines().find(|l| l.split(' ').next() == entry);
        found.unwrap_or("nothing").to_owned()
    };
    let (here, there) = match (first(own, of_root), first(of_root, own)) {
        (Some(here), _) => (here.clone(), same_entry(&here, of_root)),
        (None, Some(there)) => ("nothing".into(), there),
        (None, None) => ("entries in another order".into(), "these".into()),
    };
    Err(Error::Input(format!(
        "the ranks were called with different options: found '{here}' on this rank and '{there}' on rank 0; expected the \
         same on all: give every rank the same options"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_option_that_differs_is_named() {
        let message = compare("a 1\nb 2\nc 3", "a 1\nb 3\nc 4").unwrap_err().to_string();
        assert!(message.contains("'b 2' on this rank and 'b 3' on rank 0"), "{message}");
        let message = compare("a 1", "a 1\nb 2").unwrap_err().to_string();
        assert!(message.contains("'nothing' on this rank and 'b 2' on rank 0"), "{message}");
        let message = compare("a 1\nb 2", "a 1").unwrap_err().to_string();
        assert!(message.contains("'b 2' on this rank and 'nothing' on rank 0"), "{message}");
        assert!(compare("a 1", "a 1").is_ok());
    }

    #[test]
    fn one_rank_has_nobody_to_differ_from() {
        assert_eq!(Comm::Serial.agree_with(Ok(3), "anything").unwrap(), 3);
    }
}
