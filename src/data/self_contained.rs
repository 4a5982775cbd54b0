//! Whether all that a file holds lies in the file: HDF5 would follow links to other files, read arrays from them, and wait
//! for a pipe among them for ever.

use super::source::Source;
use hdf5::filters::Filter;
use hdf5::plist::dataset_create::Layout;
use hdf5::{Dataset, Group, LinkInfo, LinkType};
use m4gn_base::{Error, Result};

/// Deepest group that a trajectory has is `/fields/NAME`.
const DEEPEST: usize = 4;

/// Most objects of a trajectory: a file whose groups contain one another would have no end.
const MOST: usize = 10_000;

impl Source<'_> {
    /// Refuses links that are no hard links, arrays that are stored elsewhere, and, where there are to be checksums, arrays without.
    pub(super) fn check_self_contained(&self, root: &Group, checksums: bool) -> Result<()> {
        let mut left = MOST;
        self.check_group(root, "", DEEPEST, (&mut left, checksums))
    }

    fn check_group(
        &self,
        group: &Group,
        path: &str,
        depth: usize,
        (left, checksums): (&mut usize, bool),
    ) -> Result<()> {
        let mut links: Vec<(String, LinkType)> = Vec::new();
        let room = *left;
        group
            .iter_visit_default(|name: &str, info: LinkInfo| {
                if links.len() > room {
                    return Err("too many objects".into());
                }
                links.push((name.to_string(), info.link_type));
                Ok(())
            })
            .map_err(|e| self.damaged(format!("group {path}/ cannot be read ({e})")))?;
        for (name, kind) in links {
            let path = format!("{path}/{name}");
            *left = left.checked_sub(1).ok_or_else(|| self.damaged("it has too many objects".into()))?;
            if kind != LinkType::Hard {
                return Err(self
                    .damaged(format!("{path} is a link to another place, expected an object of this file")));
            }
            if let Ok(inner) = group.group(&name) {
                if depth == 0 {
                    return Err(self.damaged(format!("{path} is a group too deep for a trajectory")));
                }
                self.check_group(&inner, &path, depth - 1, (&mut *left, checksums))?;
            } else if let Ok(dataset) = group.dataset(&name) {
                self.check_stored_here(&dataset, &path, checksums)?;
            }
        }
        Ok(())
    }

    /// Refuses an array whose values lie in other files, or that has no checksum.
    fn check_stored_here(&self, dataset: &Dataset, path: &str, checksums: bool) -> Result<()> {
        let created = dataset
            .create_plist()
            .map_err(|e| self.damaged(format!("dataset {path} cannot be opened ({e})")))?;
        let here = matches!(created.layout(), Layout::Compact | Layout::Contiguous | Layout::Chunked);
        if !here || !created.external().is_empty() {
            return Err(self.damaged(format!(
                "the values of {path} are stored in other files, expected them in this one"
            )));
        }
        // HDF5 has no checksums for arrays without values.
        match !checksums || dataset.size() == 0 || created.filters().contains(&Filter::Fletcher32) {
            true => Ok(()),
            false => Err(Error::file(
                self.path,
                format!(
                    "the values of {path} have no checksum, expected one (HDF5's fletcher32): write the file anew with it"
                ),
            )),
        }
    }
}
