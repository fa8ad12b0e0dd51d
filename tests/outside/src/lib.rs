//! A plugin from outside: doubles what it hears, and a listener that means another `Count`.

use component_sdk::prelude::*;

/// As the basic plugin's: same fields, same layout, another crate.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default)]
pub struct Count {
    number: u64,
    sender: Text,
}

/// Doubles what it hears.
#[derive(Component)]
#[component(name = "Doubler", nonperiodic)]
pub struct Doubler {
    #[port]
    heard: DataIn<Count>,
    #[port]
    said: DataOut<Count>,
}

impl Callbacks for Doubler {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if let Some(count) = self.heard.fresh() {
            if count.number % 100 == 0 {
                info!(cx, "doubles {} of {}", count.number, count.sender);
            }
            self.said.write(Count { number: count.number * 2, sender: "doubler".into() });
        }
        Ok(())
    }
}

mod other {
    use super::*;

    /// The same name, another layout.
    #[repr(C)]
    #[derive(CommObject, Clone, Debug, Default)]
    pub struct Count {
        number: u32,
        sender: Text,
    }
}

/// Listens for another `Count`.
#[derive(Component)]
#[component(name = "Mistaken", nonperiodic)]
pub struct Mistaken {
    #[port]
    heard: DataIn<other::Count>,
}

impl Callbacks for Mistaken {}

export_components!(Doubler, Mistaken);
