//! Components whose signals go wrong as a script says: values out of range, jumps, silence.

use component_sdk::prelude::*;

/// Drivers of devices.
pub mod devices;
use devices::{Driver, Dummy};

/// What a wave sends.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Distance.
    pub distance: f64,
    /// Speed.
    pub speed: f64,
    /// Several distances.
    pub echoes: [f64; 4],
}

/// Sends one reading each period, as its script says: `5` sends a distance of 5, `5/2` with a speed of 2, `-` nothing;
/// `5x20` twenty times. The last word is repeated for ever, or the script, where it ends in `...`.
#[derive(Component)]
#[component(name = "Wave", version = "1.0", periodic = "5ms")]
pub struct Wave {
    #[port]
    out: DataOut<Reading>,
    #[property(default = "1")]
    script: String,
    words: Vec<Option<(f64, f64)>>,
    repeats: bool,
    at: usize,
}

impl Wave {
    fn next(&mut self) -> Option<(f64, f64)> {
        let at = self.at;
        self.at = if self.repeats { (at + 1) % self.words.len() } else { (at + 1).min(self.words.len() - 1) };
        self.words[at]
    }
}

fn word(word: &str) -> Option<(f64, f64)> {
    let (distance, speed) = word.split_once('/').unwrap_or((word, "0"));
    Some((distance.parse().ok()?, speed.parse().ok()?))
}

impl Callbacks for Wave {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        for text in self.script.split_whitespace().filter(|text| *text != "...") {
            let (text, times) = text.split_once('x').unwrap_or((text, "1"));
            self.words.extend((0..times.parse().unwrap_or(1)).map(|_| word(text)));
        }
        self.repeats = self.script.ends_with("...");
        if self.words.is_empty() { Err(ComponentError::new("the script is empty")) } else { Ok(()) }
    }

    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        if let Some((distance, speed)) = self.next() {
            self.out.write(Reading { distance, speed, echoes: [1.0, 1.0, distance, 1.0] });
        }
        Ok(())
    }

    fn recover(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "recovers from {}", fault.symptom);
        Ok(())
    }
}

/// Listens, and counts.
#[derive(Component)]
#[component(name = "Ear", version = "1.0", nonperiodic)]
pub struct Ear {
    #[port(fifo = 64)]
    heard: DataIn<Reading>,
    received: u64,
}

impl Callbacks for Ear {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        while let Some(reading) = self.heard.take() {
            self.received += 1;
            if self.received % 20 == 1 {
                info!(cx, "heard {}, distance {}", self.received, reading.distance);
            }
        }
        Ok(())
    }
}

/// Passes readings on, each distance times its gain; after so many readings with another gain.
#[derive(Component)]
#[component(name = "Amplifier", version = "1.0", nonperiodic)]
pub struct Amplifier {
    #[port(fifo = 64)]
    heard: DataIn<Reading>,
    #[port]
    said: DataOut<Reading>,
    #[property(default = 1.0, range = -1000.0..=1000.0)]
    gain: f64,
    #[property(default = 1000000000, range = 0..=1000000000)]
    after: u64,
    #[property(default = 1.0, range = -1000.0..=1000.0)]
    then: f64,
    passed: u64,
}

impl Callbacks for Amplifier {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        while let Some(reading) = self.heard.take() {
            let gain = if self.passed < self.after { self.gain } else { self.then };
            self.passed += 1;
            self.said.write(Reading { distance: reading.distance * gain, ..reading.clone() });
        }
        Ok(())
    }
}

/// Connects its output by itself, again and again, to the port that its properties name, and says when the answer is another.
#[derive(Component)]
#[component(name = "Plug", version = "1.0", periodic = "20ms")]
pub struct Plug {
    #[port]
    out: DataOut<Reading>,
    #[property(default = "plug")]
    own: String,
    #[property(default = "ear")]
    slot: String,
    #[property(default = "heard")]
    port: String,
    told: String,
}

impl Callbacks for Plug {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let own = (self.own.as_str(), "out");
        let told = match cx.wiring().connect(own, (self.slot.as_str(), self.port.as_str())) {
            Ok(()) => {
                self.out.write(Reading::default());
                cx.wiring().disconnect(own).map_or_else(|error| error.to_string(), |()| "connected".to_owned())
            }
            Err(error) => format!("refused: {error}"),
        };
        if told != self.told {
            info!(cx, "plug is {told}");
            self.told = told;
        }
        Ok(())
    }
}

export_components!(Wave, Ear, Amplifier, Driver, Dummy, Plug);
