//! Exports the symbols that plugins are to see as the daemon's own (`src/sys/shield.rs`).

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for symbol in ["abort"] {
        println!("cargo:rustc-link-arg-bins=-Wl,--export-dynamic-symbol={symbol}");
    }
}
