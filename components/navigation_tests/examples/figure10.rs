//! Draws the paper's figure 10 from a run: `cargo run --release -p navigation_tests --example figure10 -- [FILE] [SEED]`, by
//! default `target/figure10.svg`.

use navigation_tests::figure10::draw;
use navigation_tests::power_off::{POWER_OFF, experiment};

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_else(|| "target/figure10.svg".to_owned());
    let seed = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1);
    let experiment = experiment(seed);
    for window in &experiment.windows {
        match window.detected {
            Some(at) => println!(
                "window {} ms: found {:.0} ms after the power failed",
                window.window_ms,
                (at - POWER_OFF) * 1e3
            ),
            None => println!("window {} ms: not found", window.window_ms),
        }
    }
    if let Some(folder) = std::path::Path::new(&file).parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::write(&file, draw(&experiment))?;
    println!("{file}");
    Ok(())
}
