//! What `#[port]` says at push ports: cycles, least times, prescales.

use proc_macro2::TokenStream;
use quote::quote;
use syn::meta::ParseNestedMeta;
use syn::{Error, Field, LitInt, Result};

use crate::component::nanoseconds;
use crate::ports::Kind;

/// Options of push ports.
#[derive(Default)]
pub(crate) struct PushOptions {
    period_ns: Option<u64>,
    started: bool,
    min_cycle_ns: u64,
    prescale: Option<u32>,
}

impl PushOptions {
    /// Takes an option, if it is one of a port of this kind.
    pub(crate) fn take(&mut self, kind: Kind, meta: &ParseNestedMeta<'_>) -> Result<bool> {
        let is = |name: &str| meta.path.is_ident(name);
        let serves = matches!(kind, Kind::PushServer | Kind::PushTimedServer);
        if is("timed") && kind == Kind::PushTimedServer {
            self.period_ns = Some(nanoseconds(&meta.value()?.parse()?)?);
        } else if is("started") && kind == Kind::PushTimedServer {
            self.started = true;
        } else if is("min_cycle") && serves {
            self.min_cycle_ns = nanoseconds(&meta.value()?.parse()?)?;
        } else if is("prescale") && kind == Kind::PushClient {
            let number: LitInt = meta.value()?.parse()?;
            let prescale = number.base10_parse()?;
            if prescale == 0 {
                return Err(Error::new_spanned(number, "a prescale is 1 or more"));
            }
            self.prescale = Some(prescale);
        } else {
            return Ok(false);
        }
        Ok(true)
    }

    /// What is missing, or has no effect.
    pub(crate) fn check(&self, kind: Kind, has_handler: bool, field: &Field) -> Result<()> {
        if kind == Kind::PushTimedServer && (self.period_ns.is_none() || !has_handler) {
            return Err(Error::new_spanned(
                field,
                "a PushTimedServer needs its cycle and the method that is called in each: \
                 #[port(timed = \"100ms\", handler = on_tick)]",
            ));
        }
        if self.prescale.is_some() && !has_handler {
            return Err(Error::new_spanned(
                field,
                "`prescale` belongs to a handler; values are prescaled by `subscribe`",
            ));
        }
        Ok(())
    }

    pub(crate) fn decl(&self, kind: Kind, has_handler: bool) -> TokenStream {
        let end = match kind {
            Kind::PushClient | Kind::PushServer => quote!(Push),
            Kind::PushTimedServer => quote!(Timed),
            _ => return quote!(PushDecl::DATA),
        };
        let (period_ns, started, min_cycle_ns) = (self.period_ns.unwrap_or(0), self.started, self.min_cycle_ns);
        let prescale = if kind == Kind::PushClient && has_handler { self.prescale.unwrap_or(1) } else { 0 };
        quote! {
            PushDecl {
                end: PushEnd::#end,
                period_ns: #period_ns,
                started: #started,
                min_cycle_ns: #min_cycle_ns,
                prescale: #prescale,
            }
        }
    }
}
