//! Which file serves which `library_name`. OPRoS took the name literally; real profiles say `Foo.dll` on every system,
//! so that the stem counts here.

use std::path::{Path, PathBuf};

/// The file that serves `library`: the first that exists of, in each directory, the name itself, `lib<stem>.so` and
/// `<stem>.so`.
#[must_use]
pub fn find(library: &str, directories: &[PathBuf]) -> Option<PathBuf> {
    let names = candidates(library);
    directories.iter().flat_map(|directory| names.iter().map(|name| directory.join(name))).find(|path| path.is_file())
}

/// The file names tried for `library`, in order.
#[must_use]
pub fn candidates(library: &str) -> Vec<String> {
    let name = Path::new(library).file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let lower = name.to_ascii_lowercase();
    let stem = [".so", ".dll", ".dylib"]
        .iter()
        .find(|ending| lower.ends_with(*ending))
        .map_or(name.as_str(), |ending| &name[..name.len() - ending.len()]);
    let bare = stem.strip_prefix("lib").unwrap_or(stem);
    let mut names = vec![name.clone()];
    for candidate in [format!("lib{bare}.so"), format!("{bare}.so")] {
        if !names.contains(&candidate) {
            names.push(candidate);
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_from_another_system_finds_its_library() {
        assert_eq!(candidates("Hello.dll"), ["Hello.dll", "libHello.so", "Hello.so"]);
        assert_eq!(candidates("libhello.so"), ["libhello.so", "hello.so"]);
        assert_eq!(candidates("hello"), ["hello", "libhello.so", "hello.so"]);
    }

    #[test]
    fn the_first_directory_wins() {
        let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        std::fs::write(second.path().join("libx.so"), "").unwrap();
        let directories = [first.path().to_owned(), second.path().to_owned()];
        assert_eq!(find("x.dll", &directories), Some(second.path().join("libx.so")));
        std::fs::write(first.path().join("x.so"), "").unwrap();
        assert_eq!(find("x.dll", &directories), Some(first.path().join("x.so")));
    }
}
