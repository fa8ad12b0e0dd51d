//! Exports the symbols that plugins are to see as the daemon's own (`src/sys/shield.rs`, `src/sys/heap.rs`).

/// Each is defined in `src/sys/shield.rs` or `src/sys/heap.rs`.
const SHIELDED: &[&str] = &["abort", "exit", "_exit", "_Exit", "quick_exit", "free", "realloc"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for symbol in SHIELDED {
        println!("cargo:rustc-link-arg-bins=-Wl,--export-dynamic-symbol={symbol}");
    }
}
