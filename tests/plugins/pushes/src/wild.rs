//! Somebody whose values cannot be read.

use component_sdk::prelude::*;

/// Sends a text that leads to where nothing is.
#[derive(Component)]
#[component(name = "Wild", version = "1.0", periodic = "5ms")]
pub struct Wild {
    #[port]
    out: DataOut<Text>,
}

impl Callbacks for Wild {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let mut text = self.out.loan();
        lead_astray(&mut text);
        text.send();
        Ok(())
    }
}

#[allow(unsafe_code, reason = "the text is to be wrong, which is its purpose")]
fn lead_astray(text: &mut Text) {
    // SAFETY: none for whoever reads it. It begins with address and length; its capacity stays 0, so that nobody frees it.
    unsafe { std::ptr::from_mut(text).cast::<[usize; 2]>().write([8, 3]) };
}
