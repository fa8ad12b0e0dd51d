//! Where the files of a run lie: beside each other, and whether they still do.

use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// That name with something behind it.
#[must_use]
pub fn suffixed(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// True where an open file is what lies there; false once somebody moved or removed it.
#[must_use]
pub fn holds(path: &Path, file: &File) -> bool {
    let both = std::fs::metadata(path).and_then(|there| Ok((there, file.metadata()?)));
    both.is_ok_and(|(there, here)| (there.dev(), there.ino()) == (here.dev(), here.ino()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_holds_a_file_until_somebody_moves_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("journal");
        let file = File::create(&path).unwrap();
        assert!(holds(&path, &file));
        std::fs::rename(&path, suffixed(&path, ".1")).unwrap();
        assert!(!holds(&path, &file) && holds(&suffixed(&path, ".1"), &file));
        File::create(&path).unwrap();
        assert!(!holds(&path, &file));
    }
}
