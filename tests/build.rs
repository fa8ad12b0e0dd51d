//! Compiles the raw limits that benchmarks are compared with.

fn main() {
    println!("cargo:rerun-if-changed=src/bench/limits.c");
    cc::Build::new().file("src/bench/limits.c").opt_level(2).compile("limits");
}
