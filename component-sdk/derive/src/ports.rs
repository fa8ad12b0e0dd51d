//! Fields with `#[port]`: what each says about itself, and which handler serves it.

use proc_macro2::TokenStream;
use quote::{quote, quote_spanned};
use syn::spanned::Spanned;
use syn::{Error, Field, Ident, LitInt, Result, Type};

use crate::description;
use crate::pushes::PushOptions;

const KNOWN: &str = "a port is a DataIn<T>, a DataOut<T>, a PushClient<T>, a PushServer<T>, a PushTimedServer<T>, a \
                     QueryClient<R, A>, a QueryServer<R, A>, a SendClient<C>, a SendServer<C>, an EventClient<P, E>, an \
                     EventServer<P, E, S>, an EventIn<E>, an EventOut<E>, a Required<dyn I>, a Provided<dyn I>, \
                     a StateSlave or a StateMaster";

/// The kinds of ports, by the last part of their type's name.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    DataIn,
    DataOut,
    PushClient,
    PushServer,
    PushTimedServer,
    QueryClient,
    QueryServer,
    SendClient,
    SendServer,
    EventClient,
    EventServer,
    EventIn,
    EventOut,
    Required,
    Provided,
    StateSlave,
    StateMaster,
}

impl Kind {
    fn of(name: &Ident) -> Option<Self> {
        Some(match name.to_string().as_str() {
            "DataIn" => Self::DataIn,
            "DataOut" => Self::DataOut,
            "PushClient" => Self::PushClient,
            "PushServer" => Self::PushServer,
            "PushTimedServer" => Self::PushTimedServer,
            "QueryClient" => Self::QueryClient,
            "QueryServer" => Self::QueryServer,
            "SendClient" => Self::SendClient,
            "SendServer" => Self::SendServer,
            "EventClient" => Self::EventClient,
            "EventServer" => Self::EventServer,
            "EventIn" => Self::EventIn,
            "EventOut" => Self::EventOut,
            "Required" => Self::Required,
            "Provided" => Self::Provided,
            "StateSlave" => Self::StateSlave,
            "StateMaster" => Self::StateMaster,
            _ => return None,
        })
    }

    /// How many types it is written with.
    fn types(self) -> std::ops::RangeInclusive<usize> {
        match self {
            Self::DataIn
            | Self::DataOut
            | Self::PushClient
            | Self::PushServer
            | Self::PushTimedServer
            | Self::SendClient
            | Self::SendServer
            | Self::EventIn
            | Self::EventOut
            | Self::Required
            | Self::Provided => 1..=1,
            Self::QueryClient | Self::QueryServer | Self::EventClient => 2..=2,
            // What is tested is the event where it is not said.
            Self::EventServer => 2..=3,
            Self::StateSlave | Self::StateMaster => 0..=0,
        }
    }

    /// The option that names the method of the component for what comes in, where there may be one.
    const fn handler(self) -> Option<&'static str> {
        match self {
            Self::QueryServer
            | Self::SendServer
            | Self::EventClient
            | Self::EventIn
            | Self::PushClient
            | Self::PushTimedServer => Some("handler"),
            Self::EventServer => Some("on_activation"),
            _ => None,
        }
    }

    /// True for a bundle of ports, one for each method of an interface.
    const fn is_service(self) -> bool {
        matches!(self, Self::Required | Self::Provided)
    }

    /// True for either side of the state pattern, which is a query with objects of its own.
    const fn is_state(self) -> bool {
        matches!(self, Self::StateSlave | Self::StateMaster)
    }

    const fn has_queue(self) -> bool {
        matches!(self, Self::DataIn | Self::EventIn | Self::PushClient)
    }
}

/// One port of a class.
pub(crate) struct Port<'a> {
    ident: &'a Ident,
    field: &'a Field,
    kind: Kind,
    objects: Vec<&'a Type>,
    fifo: usize,
    handler: Option<Ident>,
    unlisted: bool,
    push: PushOptions,
}

impl<'a> Port<'a> {
    pub(crate) fn read(ident: &'a Ident, field: &'a Field) -> Result<Self> {
        let (kind, objects) = port_type(&field.ty)?;
        let push = PushOptions::default();
        let mut port = Self { ident, field, kind, objects, fifo: 0, handler: None, unlisted: false, push };
        port.options()?;
        port.push.check(kind, port.handler.is_some(), field)?;
        if kind == Kind::PushClient && port.fifo > 0 && port.handler.is_none() {
            return Err(Error::new_spanned(field, "a PushClient keeps one value; `fifo` belongs to its handler"));
        }
        Ok(port)
    }

    fn options(&mut self) -> Result<()> {
        for attr in self.field.attrs.iter().filter(|attr| attr.path().is_ident("port")) {
            if matches!(attr.meta, syn::Meta::Path(_)) {
                continue;
            }
            attr.parse_nested_meta(|meta| {
                if self.push.take(self.kind, &meta)? {
                    return Ok(());
                }
                let is = |name: &str| meta.path.is_ident(name);
                if is("fifo") && self.kind.has_queue() {
                    self.fifo = meta.value()?.parse::<LitInt>()?.base10_parse()?;
                } else if is("fifo") {
                    return Err(meta.error(
                        "`fifo` belongs to a DataIn, an EventIn or the handler of a PushClient: the others have no queue to read \
                         from",
                    ));
                } else if self.kind.handler().is_some_and(is) {
                    self.handler = Some(meta.value()?.parse()?);
                } else if is("unlisted") && self.kind.is_service() {
                    return Err(meta.error("the ports of a service are found by its name: there is no `unlisted` here"));
                } else if is("unlisted") {
                    self.unlisted = true;
                } else if is("handler") || is("on_activation") {
                    return Err(meta.error(
                        "`handler` belongs to a server, EventClient or EventIn, `on_activation` to an EventServer: nothing \
                         comes in here to be handled",
                    ));
                } else {
                    return Err(meta.error(
                        "known here: fifo = 8 (DataIn, EventIn), handler = on_query (a server, EventClient, EventIn), \
                         on_activation = method (EventServer); handler = on_value, prescale = 3, fifo = 8 (PushClient); \
                         min_cycle = \"10ms\" (PushServer); timed = \"100ms\", started, handler = on_tick (PushTimedServer); \
                         unlisted",
                    ));
                }
                Ok(())
            })?;
        }
        Ok(())
    }

    /// The builder's method that makes it.
    pub(crate) fn builder(&self) -> Ident {
        let name = match self.kind {
            Kind::DataIn => "data_in",
            Kind::DataOut => "data_out",
            Kind::PushClient => "push_client",
            Kind::PushServer => "push_server",
            Kind::PushTimedServer => "push_timed_server",
            Kind::QueryClient => "query_client",
            Kind::QueryServer => "query_server",
            Kind::SendClient => "send_client",
            Kind::SendServer => "send_server",
            Kind::EventClient => "event_client",
            Kind::EventServer => "event_server",
            Kind::EventIn => "event_in",
            Kind::EventOut => "event_out",
            Kind::Required => "required",
            Kind::Provided => "provided",
            Kind::StateSlave => "state_slave",
            Kind::StateMaster => "state_master",
        };
        Ident::new(name, self.field.ty.span())
    }

    /// Number of its ports.
    pub(crate) fn count(&self) -> TokenStream {
        if self.kind.is_service() {
            let interface = self.objects[0];
            quote!(<#interface as ::component_sdk::port::Service>::METHODS.len())
        } else {
            quote!(1)
        }
    }

    /// Its descriptions, as a slice.
    pub(crate) fn decls(&self) -> TokenStream {
        if self.kind.is_service() {
            let (name, interface, count) = (self.ident.to_string(), self.objects[0], self.count());
            let direction = if self.kind == Kind::Provided { quote!(Input) } else { quote!(Output) };
            return quote! {
                &::component_sdk::port::method_ports::<#interface, { #count }>(abi_name(#name), Direction::#direction)
            };
        }
        let decl = self.decl();
        quote!(&[#decl])
    }

    fn decl(&self) -> TokenStream {
        let name = self.ident.to_string();
        let description = description(&self.field.attrs);
        let (pattern, direction) = match self.kind {
            Kind::DataIn | Kind::PushClient => (quote!(Push), quote!(Input)),
            Kind::DataOut | Kind::PushServer | Kind::PushTimedServer => (quote!(Push), quote!(Output)),
            Kind::QueryClient | Kind::StateMaster => (quote!(Query), quote!(Output)),
            Kind::QueryServer | Kind::StateSlave => (quote!(Query), quote!(Input)),
            Kind::SendClient | Kind::Required => (quote!(Send), quote!(Output)),
            Kind::SendServer | Kind::Provided => (quote!(Send), quote!(Input)),
            Kind::EventClient => (quote!(Event), quote!(Input)),
            Kind::EventServer => (quote!(Event), quote!(Output)),
            Kind::EventIn => (quote!(EventPort), quote!(Input)),
            Kind::EventOut => (quote!(EventPort), quote!(Output)),
        };
        let described = |object: &Type| quote!(<#object as ::component_sdk::object::CommObject>::DESCRIPTOR);
        let state: [Type; 2] = [
            syn::parse_quote!(::component_sdk::port::StateRequest),
            syn::parse_quote!(::component_sdk::port::StateNames),
        ];
        // Of events the second one is what goes over the connection, the first one what it is asked for with.
        let (object, answer) = match (self.kind, self.objects.as_slice()) {
            (Kind::EventClient | Kind::EventServer, [parameter, event, ..]) => (*event, Some(*parameter)),
            (kind, _) if kind.is_state() => (&state[0], Some(&state[1])),
            (_, objects) => (objects[0], objects.get(1).copied()),
        };
        let object = described(object);
        let answer = answer.map_or_else(
            || quote!(::component_sdk::no_object()),
            |answer| {
                let answer = described(answer);
                quote!(::component_sdk::some_object(#answer))
            },
        );
        let (fifo, handler, listed) = (self.fifo, self.handler.is_some(), !self.unlisted);
        let push = self.push.decl(self.kind, handler);
        quote! {
            PortDecl {
                name: abi_name(#name),
                service: abi_name(""),
                method: abi_name(""),
                pattern: Pattern::#pattern,
                direction: Direction::#direction,
                object: #object,
                answer: #answer,
                handler: #handler,
                fifo: #fifo,
                listed: #listed,
                push: #push,
                description: abi_name(#description),
            }
        }
    }

    /// What sets the component's gate at this port.
    pub(crate) fn gate(&self) -> Option<TokenStream> {
        let field = self.ident;
        let has_gate = matches!(
            self.kind,
            Kind::QueryClient | Kind::PushClient | Kind::EventClient | Kind::Required | Kind::StateMaster
        );
        has_gate.then(|| quote!(self.#field.component_blocking(on);))
    }

    /// What is begun when the component starts.
    pub(crate) fn attend(&self) -> Option<TokenStream> {
        let field = self.ident;
        (self.kind == Kind::StateSlave).then(|| quote!(self.#field.attend(cx)?;))
    }

    /// What enters its handler.
    pub(crate) fn dispatch(&self) -> Option<TokenStream> {
        if self.kind == Kind::Provided {
            let (field, interface) = (self.ident, self.objects[0]);
            // At the interface: where the component does not implement it, the compiler says so there.
            return Some(quote_spanned! {interface.span()=>
                if let ::core::option::Option::Some(call) = self.#field.find(incoming) {
                    <#interface as ::component_sdk::port::Service>::enter(self, cx, call);
                    return ::core::result::Result::Ok(());
                }
            });
        }
        let (field, handler) = (self.ident, self.handler.as_ref()?);
        let (method, found, given) = match self.kind {
            Kind::EventClient => (quote!(firing), quote!((id, event)), quote!(id, event)),
            Kind::EventServer => (quote!(activation), quote!(parameter), quote!(parameter)),
            Kind::EventIn => (quote!(event), quote!(event), quote!(event)),
            Kind::PushClient => (quote!(value), quote!(value), quote!(value)),
            _ => (quote!(query), quote!(query), quote!(query)),
        };
        // At the attribute: where the method is missing or takes something else, the compiler says so there.
        Some(match self.kind {
            Kind::SendServer => quote_spanned! {handler.span()=>
                if let ::core::option::Option::Some(message) = incoming.message(&self.#field) {
                    return self.#handler(cx, &message);
                }
            },
            Kind::PushTimedServer => quote_spanned! {handler.span()=>
                if incoming.tick(&self.#field).is_some() {
                    return self.#handler(cx);
                }
            },
            _ => quote_spanned! {handler.span()=>
                if let ::core::option::Option::Some(#found) = incoming.#method(&self.#field) {
                    return self.#handler(cx, #given);
                }
            },
        })
    }
}

/// The method that calls the handlers; nothing where there are none.
pub(crate) fn serve(handlers: &[TokenStream]) -> TokenStream {
    if handlers.is_empty() {
        return TokenStream::new();
    }
    quote! {
        fn serve(
            &mut self,
            cx: &mut ::component_sdk::context::Context<'_>,
            incoming: &::component_sdk::abi::calls::Incoming<'_>,
        ) -> ::component_sdk::component::Outcome {
            #(#handlers)*
            ::core::result::Result::Ok(())
        }
    }
}

/// The method that is called after `start`; nothing where nothing is to be begun.
pub(crate) fn attend(begun: &[TokenStream]) -> TokenStream {
    if begun.is_empty() {
        return TokenStream::new();
    }
    quote! {
        fn attend(&mut self, cx: &mut ::component_sdk::context::Context<'_>) -> ::component_sdk::component::Outcome {
            #(#begun)*
            ::core::result::Result::Ok(())
        }
    }
}

/// The method that sets the gates of all clients; nothing where there are none.
pub(crate) fn blocking(gates: &[TokenStream]) -> TokenStream {
    if gates.is_empty() {
        return TokenStream::new();
    }
    quote! {
        fn blocking(&mut self, on: bool) {
            #(#gates)*
        }
    }
}

/// The kind of a port, and the objects that it carries.
fn port_type(ty: &Type) -> Result<(Kind, Vec<&Type>)> {
    let unknown = || Error::new_spanned(ty, KNOWN);
    let Type::Path(path) = ty else { return Err(unknown()) };
    let last = path.path.segments.last().ok_or_else(unknown)?;
    let kind = Kind::of(&last.ident).ok_or_else(unknown)?;
    let arguments = match &last.arguments {
        syn::PathArguments::AngleBracketed(arguments) => Some(&arguments.args),
        syn::PathArguments::None => None,
        syn::PathArguments::Parenthesized(_) => return Err(unknown()),
    };
    let objects: Vec<&Type> = arguments
        .into_iter()
        .flatten()
        .filter_map(|argument| match argument {
            syn::GenericArgument::Type(object) => Some(object),
            _ => None,
        })
        .collect();
    if kind.types().contains(&objects.len()) { Ok((kind, objects)) } else { Err(unknown()) }
}
