//! Fields with `#[port]`: what each says about itself, and which handler serves it.

use proc_macro2::TokenStream;
use quote::{quote, quote_spanned};
use syn::spanned::Spanned;
use syn::{Error, Field, Ident, LitInt, Result, Type};

use crate::description;

const KNOWN: &str = "a port is a DataIn<T>, a DataOut<T>, a QueryClient<R, A>, a QueryServer<R, A>, a SendClient<C> or a \
                     SendServer<C>";

/// The kinds of ports, by the last part of their type's name.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    DataIn,
    DataOut,
    QueryClient,
    QueryServer,
    SendClient,
    SendServer,
}

impl Kind {
    fn of(name: &Ident) -> Option<Self> {
        Some(match name.to_string().as_str() {
            "DataIn" => Self::DataIn,
            "DataOut" => Self::DataOut,
            "QueryClient" => Self::QueryClient,
            "QueryServer" => Self::QueryServer,
            "SendClient" => Self::SendClient,
            "SendServer" => Self::SendServer,
            _ => return None,
        })
    }

    const fn objects(self) -> usize {
        match self {
            Self::DataIn | Self::DataOut | Self::SendClient | Self::SendServer => 1,
            Self::QueryClient | Self::QueryServer => 2,
        }
    }

    /// True where a method of the component may be called for what comes in.
    const fn takes_handler(self) -> bool {
        matches!(self, Self::QueryServer | Self::SendServer)
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
}

impl<'a> Port<'a> {
    pub(crate) fn read(ident: &'a Ident, field: &'a Field) -> Result<Self> {
        let (kind, objects) = port_type(&field.ty)?;
        let mut port = Self { ident, field, kind, objects, fifo: 0, handler: None, unlisted: false };
        port.options()?;
        Ok(port)
    }

    fn options(&mut self) -> Result<()> {
        for attr in self.field.attrs.iter().filter(|attr| attr.path().is_ident("port")) {
            if matches!(attr.meta, syn::Meta::Path(_)) {
                continue;
            }
            attr.parse_nested_meta(|meta| {
                if meta.path.is_ident("fifo") && self.kind == Kind::DataIn {
                    self.fifo = meta.value()?.parse::<LitInt>()?.base10_parse()?;
                } else if meta.path.is_ident("fifo") {
                    return Err(meta.error("`fifo` belongs to a DataIn: the others have no queue to read from"));
                } else if meta.path.is_ident("handler") && self.kind.takes_handler() {
                    self.handler = Some(meta.value()?.parse()?);
                } else if meta.path.is_ident("handler") {
                    return Err(meta.error("`handler` belongs to a server: nothing comes in here to be handled"));
                } else if meta.path.is_ident("unlisted") {
                    self.unlisted = true;
                } else {
                    return Err(meta.error("known here: fifo = 8 (DataIn), handler = on_query (a server), unlisted"));
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
            Kind::QueryClient => "query_client",
            Kind::QueryServer => "query_server",
            Kind::SendClient => "send_client",
            Kind::SendServer => "send_server",
        };
        Ident::new(name, self.field.ty.span())
    }

    pub(crate) fn decl(&self) -> TokenStream {
        let name = self.ident.to_string();
        let description = description(&self.field.attrs);
        let (pattern, direction) = match self.kind {
            Kind::DataIn => (quote!(Push), quote!(Input)),
            Kind::DataOut => (quote!(Push), quote!(Output)),
            Kind::QueryClient => (quote!(Query), quote!(Output)),
            Kind::QueryServer => (quote!(Query), quote!(Input)),
            Kind::SendClient => (quote!(Send), quote!(Output)),
            Kind::SendServer => (quote!(Send), quote!(Input)),
        };
        let described = |object: &Type| quote!(<#object as ::component_sdk::object::CommObject>::DESCRIPTOR);
        let object = described(self.objects[0]);
        let answer = self.objects.get(1).map_or_else(
            || quote!(::component_sdk::no_object()),
            |answer| {
                let answer = described(answer);
                quote!(::component_sdk::some_object(#answer))
            },
        );
        let (fifo, handler, listed) = (self.fifo, self.handler.is_some(), !self.unlisted);
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
                description: abi_name(#description),
            }
        }
    }

    /// What sets the component's gate at this port.
    pub(crate) fn gate(&self) -> Option<TokenStream> {
        let field = self.ident;
        (self.kind == Kind::QueryClient).then(|| quote!(self.#field.component_blocking(on);))
    }

    /// What enters its handler.
    pub(crate) fn dispatch(&self) -> Option<TokenStream> {
        let (field, handler) = (self.ident, self.handler.as_ref()?);
        // At the attribute: where the method is missing or takes something else, the compiler says so there.
        if self.kind == Kind::SendServer {
            return Some(quote_spanned! {handler.span()=>
                if let ::core::option::Option::Some(message) = incoming.message(&self.#field) {
                    return self.#handler(cx, &message);
                }
            });
        }
        Some(quote_spanned! {handler.span()=>
            if let ::core::option::Option::Some(query) = incoming.query(&self.#field) {
                return self.#handler(cx, query);
            }
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
    let syn::PathArguments::AngleBracketed(arguments) = &last.arguments else { return Err(unknown()) };
    let objects: Vec<&Type> = arguments
        .args
        .iter()
        .filter_map(|argument| match argument {
            syn::GenericArgument::Type(object) => Some(object),
            _ => None,
        })
        .collect();
    if objects.len() == kind.objects() { Ok((kind, objects)) } else { Err(unknown()) }
}
