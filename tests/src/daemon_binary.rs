//! The binary under test is the one that cargo built beside the test itself.
//!
//! Cargo tells integration tests only the binaries of their own package. Its artifact dependencies would say it, and are
//! not stable; a path from the environment would test whatever lies there.

use std::path::PathBuf;

/// Path of `framework-daemon` in the target directory of the running test.
///
/// # Panics
/// If it is not built.
#[must_use]
pub fn daemon_binary() -> PathBuf {
    let own = std::env::current_exe().expect("a running program has a path");
    let dirs = own.ancestors().skip(1).take(2).map(std::path::Path::to_path_buf);
    let found = dirs.map(|dir| dir.join("framework-daemon")).find(|path| path.is_file());
    found.unwrap_or_else(|| panic!("framework-daemon is not built beside {}: run `cargo build` first", own.display()))
}
