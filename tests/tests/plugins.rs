//! Plugins from outside: found after SIGHUP, refused with both values and the way out.

use std::path::{Path, PathBuf};
use std::process::Command;

use component_sdk::abi::ABI_VERSION;
use component_sdk::abi::header::MAGIC;
use tempfile::TempDir;
use tests::daemon_binary::daemon_binary;
use tests::outside;
use tests::profiles::{Profiles, application, connection, plugin_dir, slot};
use tests::running::Running;

#[test]
fn a_plugin_from_outside_runs_after_a_reload_and_a_wrong_connection_is_refused() {
    let library = outside::build("plain", &[]);
    let plugins = TempDir::new().unwrap();
    let profiles = Profiles::new(&application(
        &[slot("ticker", "Ticker", ""), slot("listener", "Listener", "")],
        &["ticker.out -> listener.heard"],
    ));
    let directory = plugins.path().display().to_string();
    let mut daemon = Running::start(profiles.path(), &["--plugins", &directory]);
    daemon.wait_for("heard 101");

    std::fs::copy(&library, plugins.path().join("liboutside.so")).unwrap();
    profiles.describe(&plugins.path().join("liboutside.so"));
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("doubler", "Doubler", "")));
    let wires =
        [connection("ticker.out -> doubler.heard", ""), connection("doubler.said -> listener.heard", "")].concat();
    profiles.replace("app.xml", "</port_connections>", &format!("{wires}</port_connections>"));
    daemon.signal("HUP");
    daemon.wait_for("doubler: doubles ");
    daemon.wait_for("from doubler");
    assert_eq!(daemon.journal("reload", 1)[0]["kept"], 2);

    let mistaken = format!("{}</subcomponents>", slot("mistaken", "Mistaken", ""));
    profiles.replace("app.xml", "</subcomponents>", &mistaken);
    let wrong = format!("{}</port_connections>", connection("ticker.out -> mistaken.heard", ""));
    profiles.replace("app.xml", "</port_connections>", &wrong);
    daemon.signal("HUP");
    let refused = daemon.journal("reload", 2).remove(1);
    assert_eq!(refused["accepted"], false);
    let reason = refused["reasons"][0].as_str().unwrap();
    assert!(reason.contains("layouts differ: field `number`"), "{reason}");

    profiles.replace("app.xml", &slot("mistaken", "Mistaken", ""), "");
    profiles.replace("app.xml", &connection("ticker.out -> mistaken.heard", ""), "");
    std::fs::copy(&library, plugins.path().join("liboutside.so")).unwrap();
    daemon.signal("HUP");
    let rebuilt = daemon.journal("reload", 3).remove(2);
    assert_eq!((&rebuilt["changed"], rebuilt["kept"].as_u64()), (&serde_json::json!(["doubler"]), Some(2)));

    let slots = daemon.stop();
    assert_eq!(daemon.lines("ticker: starts").len(), 1);
    assert_eq!(slots.len(), 3);
    assert!(slots.iter().all(|slot| slot["faults"] == 0 && slot["state"] == "active"));
}

/// `describe` on a file: exit code and what it said.
fn describe(plugin: &Path) -> (Option<i32>, String) {
    let output = Command::new(daemon_binary()).arg("describe").arg(plugin).output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_plugin_that_would_abort_on_panic_is_refused() {
    let library = outside::build("abort", &["--config", "profile.dev.panic=\"abort\""]);
    let (code, said) = describe(&library);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("panic = \"abort\"") && said.contains("the daemon needs"), "{said}");
}

/// The basic plugin with other bytes at an offset behind the magic number of its header.
fn patched(name: &str, offset: usize, bytes: &[u8]) -> (TempDir, PathBuf) {
    let mut library = std::fs::read(plugin_dir().join("libbasic.so")).unwrap();
    let magic = library.windows(MAGIC.len()).position(|window| window == MAGIC).unwrap();
    library[magic + offset..magic + offset + bytes.len()].copy_from_slice(bytes);
    let directory = TempDir::new().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, library).unwrap();
    (directory, path)
}

#[test]
fn another_abi_is_refused_with_both_values() {
    let (_directory, path) = patched("libabi.so", 8, &77u32.to_le_bytes());
    let (code, said) = describe(&path);
    assert_eq!(code, Some(4));
    let versions = format!("ABI version: the daemon has {ABI_VERSION}, the plugin 77");
    assert!(said.contains(&versions) && said.contains("component-sdk"), "{said}");
}

#[test]
fn another_size_of_a_table_is_refused_with_both_values() {
    let (_directory, path) = patched("libsize.so", 20, &8u32.to_le_bytes());
    let (code, said) = describe(&path);
    assert_eq!(code, Some(4));
    assert!(said.contains("size of the host table: the daemon has"), "{said}");
}

#[test]
fn what_is_no_plugin_is_refused() {
    let directory = TempDir::new().unwrap();
    let text = directory.path().join("libtext.so");
    std::fs::write(&text, "hello").unwrap();
    assert!(describe(&text).1.contains("no shared library"));

    let source = directory.path().join("empty.rs");
    std::fs::write(&source, "#[unsafe(no_mangle)] pub extern \"C\" fn getComponent() {}").unwrap();
    let library = directory.path().join("libempty.so");
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let built = Command::new(rustc).args(["--crate-type", "cdylib", "-o"]).arg(&library).arg(&source).status().unwrap();
    assert!(built.success());
    let (code, said) = describe(&library);
    assert_eq!(code, Some(4));
    assert!(said.contains("exports no symbol `component_plugin_...`") && said.contains("export_components!"), "{said}");
    assert!(describe(&directory.path().join("absent.so")).1.contains("cannot be read"));
}
