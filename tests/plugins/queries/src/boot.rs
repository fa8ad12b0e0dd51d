//! Who asks before its server is there.

use std::time::Duration;

use component_sdk::prelude::*;

use crate::{Ask, Told};

/// Asks in its first callback.
#[derive(Component)]
#[component(name = "Early", version = "1.0", periodic = "1ms")]
pub struct Early {
    #[port]
    tell: QueryClient<Ask, Told>,
    has_asked: bool,
}

impl Callbacks for Early {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if !std::mem::replace(&mut self.has_asked, true) {
            info!(cx, "asks early");
            let told = self.tell.query_within(Ask { todo: 0, number: 1 }, Duration::from_secs(60));
            info!(cx, "was told {:?}", told.map(|told| told.number));
        }
        Ok(())
    }
}

/// Takes its time to start.
#[derive(Component)]
#[component(name = "Late", version = "1.0", passive)]
pub struct Late {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
}

impl Callbacks for Late {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        std::thread::sleep(Duration::from_millis(300));
        info!(cx, "starts late");
        Ok(())
    }
}

impl Late {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let number = query.number + 1;
        query.answer(Told { number, handled: 0 })?;
        Ok(())
    }
}
