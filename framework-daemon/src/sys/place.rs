//! Where the files of a run lie: beside each other, whether they still do, and whose that place is.

use std::ffi::OsStr;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};

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

/// Links that are followed at most, as the kernel has it.
const LINKS: usize = 40;

/// The one name of that file, by whatever links it is called; there need be none yet.
#[must_use]
pub fn canonical(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        if let Ok(whole) = std::fs::canonicalize(&path) {
            return whole;
        }
        let Some(name) = path.file_name().map(OsStr::to_owned) else { return path };
        let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let Ok(target) = std::fs::read_link(&path) else {
            // It is not there; where its directory is not either, that is to be made.
            let above = if directory.exists() { std::fs::canonicalize(directory) } else { Ok(canonical(directory)) };
            return above.map_or_else(|_| path.clone(), |above| above.join(name));
        };
        path = directory.join(target);
    }
    path
}

/// Takes a file for this process alone, as long as that lives and closes no descriptor of it; `Ok(Some)`: that process has it.
/// A lock of the process, and not of the open file, which a child that a component forked would go on to hold when this process
/// is gone.
///
/// # Errors
/// Where files have no such locks.
pub fn lock(file: &File) -> io::Result<Option<i32>> {
    let whole = libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    };
    match fcntl(file, FcntlArg::F_SETLK(&whole)) {
        Ok(_) => Ok(None),
        Err(Errno::EACCES | Errno::EAGAIN) => {
            let mut holder = whole;
            let _ = fcntl(file, FcntlArg::F_GETLK(&mut holder));
            Ok(Some(holder.l_pid))
        }
        Err(error) => Err(error.into()),
    }
}

/// A place that is this process's alone: an empty file there that is locked. It is never removed: who waits for the lock of a
/// file that is gone would get it beside one who made a new one.
#[derive(Debug)]
pub struct Claim {
    path: PathBuf,
    file: File,
}

impl Claim {
    /// Takes a place; `Ok(Err)`: that process has it.
    ///
    /// # Errors
    /// When nothing can be locked there.
    pub fn take(path: &Path) -> io::Result<Result<Self, i32>> {
        let mut options = OpenOptions::new();
        let options = options.create(true).truncate(false).write(true);
        let file = options.custom_flags(libc::O_NONBLOCK | libc::O_NOFOLLOW).open(path)?;
        let taken = lock(&file)?.map_or(Ok(()), Err);
        Ok(taken.map(|()| Self { path: path.to_owned(), file }))
    }

    /// Takes it again where somebody moved or removed its file; `Ok(Some)`: that process was faster.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn renew(&mut self) -> io::Result<Option<i32>> {
        if holds(&self.path, &self.file) {
            return Ok(None);
        }
        match Self::take(&self.path)? {
            Ok(new) => *self = new,
            Err(holder) => return Ok(Some(holder)),
        }
        Ok(None)
    }
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

    #[test]
    fn a_file_has_one_name_whether_or_not_it_is_there() {
        let directory = tempfile::tempdir().unwrap();
        let root = std::fs::canonicalize(directory.path()).unwrap();
        let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, root.join(name)).unwrap();
        let is = |name: &str, one: &str| assert_eq!(canonical(&root.join(name)), root.join(one), "{name}");
        link("deep/er", "way");
        link("way/journal", "link");
        link("link", "second");
        is("new", "new");
        is("deep/er/journal", "deep/er/journal");
        std::fs::create_dir_all(root.join("deep/er")).unwrap();
        for made in [false, true] {
            if made {
                File::create(root.join("deep/er/journal")).unwrap();
            }
            let names = ["way/journal", "link", "second", "deep/../deep/er/journal"];
            names.iter().for_each(|name| is(name, "deep/er/journal"));
        }
        link("round", "round");
        let _ = canonical(&root.join("round"));
        let _ = canonical(Path::new("/"));
        assert!(canonical(Path::new("nowhere-at-all")).is_absolute());
    }

    #[test]
    fn a_claim_is_renewed_where_its_file_is_gone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("lock");
        let mut claim = Claim::take(&path).unwrap().unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(claim.renew().unwrap(), None);
        assert!(holds(&path, &claim.file));
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(claim.renew().is_err());
    }
}
