//! Where the journal is named by a link, as by those who begin a new one every day, the latch lies beside the journal itself, and a
//! link to it beside the journal's. So it is found by either name; and where the journal's link leads elsewhere by now, the latch
//! of the run before is found behind this one, and taken over.

use std::io;
use std::os::unix::fs::symlink;
use std::path::Path;

use super::file::{Kept, Left};
use super::record::Record;
use crate::sys::place::{canonical, suffixed};

/// Looks behind the link, then has it lead to that file; `left`: what the file itself says. What was taken over is in the file
/// before the link leads away from where it was.
pub(super) fn follow(kept: &mut Kept, link: &Path, left: Left) -> Left {
    let is_here = canonical(link) == canonical(kept.path());
    let left = if is_here || left != Left::Free { left } else { take_over(kept, link) };
    let new = suffixed(link, ".new");
    let placed = || symlink(kept.path(), &new).and_then(|()| std::fs::rename(&new, link));
    if !is_here && kept.failure.is_none() {
        let _ = std::fs::remove_file(&new);
        placed().unwrap_or_else(|error| tracing::warn!("{}: {error}", link.display()));
    }
    left
}

fn take_over(kept: &mut Kept, link: &Path) -> Left {
    let left = match Kept::at(link, Record::default()).read() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Left::Free,
        Err(error) => Left::Unknown(error.to_string()),
        Ok(left) => left,
    };
    if let Left::Latched(record) = &left {
        kept.record = record.clone();
    }
    if left != Left::Free {
        // What fails is told by whoever asks for it.
        let _ = kept.say(true);
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    fn own(name: &str) -> Record {
        Record::new(name.into(), vec!["motors".into()])
    }

    #[test]
    fn what_lies_behind_a_link_is_taken_over_once() {
        let directory = tempfile::tempdir().unwrap();
        let [one, two, link] = ["one", "two", "link"].map(|name| directory.path().join(name));
        let (mut first, left) = Kept::open(&one, own("one"), false);
        assert_eq!(follow(&mut first, &link, left), Left::Free);
        assert_eq!(canonical(&link), canonical(&one));
        first.say(true).unwrap();
        assert_eq!(follow(&mut first, &link, Left::Free), Left::Free, "it is this file");
        let (mut second, left) = Kept::open(&two, own("two"), false);
        assert_eq!(follow(&mut second, &link, left), Left::Latched(own("one")));
        assert_eq!(canonical(&link), canonical(&two));
        assert_eq!(Kept::open(&two, own("two"), false).1, Left::Latched(own("one")));
    }

    #[test]
    fn a_file_in_its_place_is_taken_over_and_nothing_is_none() {
        let directory = tempfile::tempdir().unwrap();
        let [path, link] = ["latch", "link"].map(|name| directory.path().join(name));
        std::fs::write(&link, "not latched").unwrap();
        let (mut kept, left) = Kept::open(&path, own("one"), false);
        assert!(matches!(follow(&mut kept, &link, left), Left::Unknown(_)));
        assert_eq!(Kept::open(&path, own("two"), false).1, Left::Latched(own("one")));
        std::fs::remove_file(&path).unwrap();
        let (mut kept, left) = Kept::open(&directory.path().join("other"), own("one"), false);
        assert_eq!(follow(&mut kept, &link, left), Left::Free, "the link led nowhere");
    }
}
