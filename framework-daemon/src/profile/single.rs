//! One file alone: everything in it, and the names inside it; nothing about files that it refers to.

use std::path::Path;
use std::sync::Arc;

use super::diagnostic;
use super::document::Document;
use super::validate;

/// Reads and checks the file at `path`.
#[must_use]
pub fn check(path: &Path) -> Document {
    complete(Document::read(path))
}

/// Checks `bytes` as the content of `path`.
#[must_use]
pub fn check_bytes(path: &Path, bytes: &[u8]) -> Document {
    complete(Document::of_bytes(path, bytes))
}

fn complete(document: Document) -> Document {
    let document = Arc::new(document);
    let mut findings = document.findings.clone();
    findings.extend(document.missing_period().cloned());
    findings.extend(validate::names_alone(&document));
    diagnostic::tidy(&mut findings, |_| 0);
    Document { findings, ..Arc::unwrap_or_clone(document) }
}
