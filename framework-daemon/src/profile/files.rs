//! The files of a profile directory, each read once, and how a reference finds its file.
//!
//! OPRoS knows three layouts, all of them in use: everything beside the application, a directory named like the
//! application ("abalone"), a directory for each component ("brill", and the editor's workspace with `profile/` in it).

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::diagnostic::Diagnostic;
use super::document::Document;
use super::source::Word;
use super::suggest;
use crate::model::limits;

/// Documents by path.
#[derive(Debug, Default)]
pub struct Files {
    documents: Vec<Arc<Document>>,
    by_path: HashMap<PathBuf, usize>,
}

impl Files {
    /// The document at `path`, read on first use. `None` beyond the limit of files.
    pub fn open(&mut self, path: &Path) -> Option<(usize, Arc<Document>)> {
        // Two names of one file (links, `a/../b`) are one document, or a composite could hold itself unnoticed.
        let identity = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        if let Some(index) = self.by_path.get(&identity) {
            return Some((*index, Arc::clone(self.documents.get(*index)?)));
        }
        if self.documents.len() >= limits::PROFILE_FILES {
            return None;
        }
        let document = Arc::new(Document::read(path));
        let index = self.documents.len();
        self.documents.push(Arc::clone(&document));
        self.by_path.insert(identity, index);
        Some((index, document))
    }

    /// Every document, in the order of first use.
    #[must_use]
    pub fn documents(&self) -> &[Arc<Document>] {
        &self.documents
    }
}

/// The file that `reference` means in the file at `from`.
///
/// # Errors
/// A diagnostic at the reference, with the places that were tried.
pub fn resolve(from: &Path, application: &str, reference: &Word) -> Result<PathBuf, Box<Diagnostic>> {
    let places = candidates(from, application, &reference.text);
    if let Some(found) = places.iter().find(|place| place.is_file()) {
        return Ok(found.clone());
    }
    // What lies beside it is read with the rest of the directory: why it cannot be is told there.
    let is_listed = |place: &&PathBuf| {
        let is_xml = place.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
        is_xml && place.parent() == from.parent() && !place.is_dir() && place.symlink_metadata().is_ok()
    };
    if let Some(found) = places.iter().find(is_listed) {
        return Ok(found.clone());
    }
    let error = |message: String| reference.spot.diagnostic(super::diagnostic::Level::Error, message);
    if let Some(odd) = places.iter().find(|place| place.exists()) {
        return Err(Box::new(error(format!("{} is not a regular file", odd.display()))));
    }
    let base = from.parent().unwrap_or(Path::new(""));
    let shown = |place: &PathBuf| place.strip_prefix(base).unwrap_or(place).display().to_string();
    let tried: Vec<String> = places.iter().map(shown).collect();
    let hint = near_file(from, &reference.text).map_or_else(
        || format!("tried, beside this file: {}", tried.join(", ")),
        |near| format!("did you mean {near}?"),
    );
    Err(Box::new(error(format!("no file {} is found", reference.text)).with_hint(hint)))
}

fn candidates(from: &Path, application: &str, reference: &str) -> Vec<PathBuf> {
    let base = from.parent().unwrap_or(Path::new(""));
    // Profiles written on Windows.
    let reference = reference.replace('\\', "/");
    let stem = Path::new(&reference).file_stem().unwrap_or_default();
    let file_stem = from.file_stem().unwrap_or_default();
    let mut places = vec![base.join(&reference)];
    let mut add = |place: PathBuf| {
        if !places.contains(&place) {
            places.push(place);
        }
    };
    for name in [Path::new(application), Path::new(file_stem)] {
        // A name is one step: `..` or `/` in it must not lead anywhere.
        if name.components().count() == 1 && name.file_name().is_some() {
            add(base.join(name).join(&reference));
            add(base.join(name).join(stem).join(&reference));
        }
    }
    add(base.join(stem).join(&reference));
    add(base.join(stem).join("profile").join(&reference));
    places
}

fn near_file(from: &Path, reference: &str) -> Option<String> {
    let base = from.parent().filter(|base| !base.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let listed = std::fs::read_dir(base).ok()?.take(limits::PROFILE_FILES);
    let names: Vec<String> = listed.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    // Stems are compared: `.xml` alone would make any two short names alike.
    let stems = names.iter().filter_map(|name| name.strip_suffix(".xml").or_else(|| name.strip_suffix(".XML")));
    let near = suggest::nearest(reference.strip_suffix(".xml").unwrap_or(reference), stems)?;
    names.iter().find(|name| name.len() == near.len() + 4 && name.starts_with(near)).cloned()
}
