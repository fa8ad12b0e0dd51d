//! Builds the plugin of `tests/outside` as a stranger would: outside the repository, against the SDK alone.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::profiles::plugin_dir;

/// Builds it with these further arguments of cargo; returns the library.
///
/// # Panics
/// When it does not build.
#[must_use]
pub fn build(name: &str, arguments: &[&str]) -> PathBuf {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the repository is there");
    // Kept between runs: building the SDK's dependencies takes a minute.
    let project = plugin_dir().join("outside").join(name);
    std::fs::create_dir_all(project.join("src")).expect("the target directory is writable");
    let source = repository.join("tests/outside");
    let manifest = std::fs::read_to_string(source.join("Cargo.toml.in")).expect("the manifest is there");
    let sdk = repository.join("component-sdk");
    write_if_changed(&project.join("Cargo.toml"), &manifest.replace("@SDK@", &sdk.display().to_string()));
    let code = std::fs::read_to_string(source.join("src/lib.rs")).expect("the source is there");
    write_if_changed(&project.join("src/lib.rs"), &code);
    // The versions that are downloaded already.
    if !project.join("Cargo.lock").exists() {
        std::fs::copy(repository.join("Cargo.lock"), project.join("Cargo.lock")).expect("the lock file is there");
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["build", "--offline"])
        .args(arguments)
        .current_dir(&project)
        .env("CARGO_TARGET_DIR", project.join("target"))
        .env_remove("RUSTFLAGS")
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    project.join("target/debug/liboutside.so")
}

fn write_if_changed(path: &Path, text: &str) {
    if std::fs::read_to_string(path).ok().as_deref() != Some(text) {
        std::fs::write(path, text).expect("the target directory is writable");
    }
}
