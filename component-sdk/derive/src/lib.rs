//! Derive macros of `component-sdk`; documented there.

mod comm_object;
mod component;
mod ports;
mod pushes;
mod service;

use proc_macro::TokenStream;
use syn::{DeriveInput, parse_macro_input};

/// Makes a `#[repr(C)]` struct of objects a communication object.
#[proc_macro_derive(CommObject)]
pub fn comm_object(input: TokenStream) -> TokenStream {
    expand(comm_object::expand(&parse_macro_input!(input as DeriveInput)))
}

/// Makes a struct a component: `#[component(name = "...", version = "...", periodic = "20ms")]`, or `nonperiodic`, or
/// `passive`; fields with `#[port]`, `#[port(fifo = 8)]`, `#[port(handler = on_query)]`, `#[port(on_activation = method)]`,
/// `#[port(handler = on_value, prescale = 3)]`, `#[port(timed = "100ms", started, handler = on_tick)]`,
/// `#[port(min_cycle = "10ms")]`,
/// `#[property(default = ..., unit = "...", range = a..=b)]`,
/// `#[critical]`; any other field starts as its `Default`.
#[proc_macro_derive(Component, attributes(component, port, property, critical))]
pub fn component(input: TokenStream) -> TokenStream {
    expand(component::expand(&parse_macro_input!(input as DeriveInput)))
}

/// Makes a trait the interface of a service port: `Required<dyn Motors>` at who calls, `Provided<dyn Motors>` at the
/// component that implements it. A method with `#[nonblocking]` is sent, any other one asked and waited for.
#[proc_macro_attribute]
pub fn service(attributes: TokenStream, input: TokenStream) -> TokenStream {
    expand(service::expand(&attributes.into(), parse_macro_input!(input as syn::ItemTrait)))
}

fn expand(result: syn::Result<proc_macro2::TokenStream>) -> TokenStream {
    result.unwrap_or_else(|error| error.to_compile_error()).into()
}

/// The named fields of a struct; an error at the type's name for anything else.
fn named_fields(input: &DeriveInput) -> syn::Result<&syn::punctuated::Punctuated<syn::Field, syn::Token![,]>> {
    match &input.data {
        syn::Data::Struct(syn::DataStruct { fields: syn::Fields::Named(fields), .. }) => Ok(&fields.named),
        _ => Err(syn::Error::new_spanned(&input.ident, "a struct with named fields is wanted here")),
    }
}

/// The first paragraph of the doc comment, in one line.
fn description(attrs: &[syn::Attribute]) -> String {
    let mut lines = Vec::new();
    for attr in attrs.iter().filter(|attr| attr.path().is_ident("doc")) {
        if let syn::Meta::NameValue(pair) = &attr.meta
            && let syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) = &pair.value
        {
            let text = text.value();
            if text.trim().is_empty() {
                break;
            }
            lines.push(text.trim().to_owned());
        }
    }
    lines.join(" ")
}
