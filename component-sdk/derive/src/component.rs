//! `#[derive(Component)]`: the class's description, and how an instance is built.

use proc_macro2::TokenStream;
use quote::{quote, quote_spanned};
use syn::spanned::Spanned;
use syn::{DeriveInput, Error, Expr, Field, Ident, Lit, LitStr, Result, Type};

use crate::ports::{Port, attend, blocking, serve};
use crate::{description, named_fields};

pub(crate) fn expand(input: &DeriveInput) -> Result<TokenStream> {
    if !input.generics.params.is_empty() {
        return Err(Error::new_spanned(
            &input.generics,
            "a component class has no generics: a plugin exports it by name",
        ));
    }
    let class = ClassAttr::read(input)?;
    let mut parts = Parts::default();
    for field in named_fields(input)? {
        parts.add(&input.ident, field)?;
    }
    Ok(class.output(input, &parts))
}

/// What `#[component(...)]` says.
struct ClassAttr {
    name: String,
    version: TokenStream,
    trigger: TokenStream,
}

impl ClassAttr {
    fn read(input: &DeriveInput) -> Result<Self> {
        let mut class = Self {
            name: input.ident.to_string(),
            version: quote!(env!("CARGO_PKG_VERSION")),
            trigger: quote!(Nonperiodic),
        };
        for attr in input.attrs.iter().filter(|attr| attr.path().is_ident("component")) {
            attr.parse_nested_meta(|meta| {
                if meta.path.is_ident("name") {
                    class.name = meta.value()?.parse::<LitStr>()?.value();
                } else if meta.path.is_ident("version") {
                    let version = meta.value()?.parse::<LitStr>()?;
                    class.version = quote!(#version);
                } else if meta.path.is_ident("periodic") {
                    let period = nanoseconds(&meta.value()?.parse()?)?;
                    class.trigger = quote!(Periodic { period_ns: #period });
                } else if meta.path.is_ident("nonperiodic") {
                    class.trigger = quote!(Nonperiodic);
                } else if meta.path.is_ident("passive") {
                    class.trigger = quote!(Passive);
                } else {
                    return Err(meta.error("known here: name, version, periodic = \"20ms\", nonperiodic, passive"));
                }
                Ok(())
            })?;
        }
        Ok(class)
    }

    fn output(&self, input: &DeriveInput, parts: &Parts) -> TokenStream {
        let Self { name, version, trigger } = self;
        let Parts { ports, counts: _, properties, criticals, builders, handlers, gates, begun } = parts;
        let ident = &input.ident;
        let description = description(&input.attrs);
        let (serve, blocking, attend) = (serve(handlers), blocking(gates), attend(begun));
        quote! {
            const _: () = {
                use ::component_sdk::abi::class::{
                    ClassDecl, CriticalDecl, Direction, Pattern, PortDecl, PropertyDecl, TriggerDecl,
                };
                use ::component_sdk::abi::push::{PushDecl, PushEnd};
                use ::component_sdk::{abi_name, abi_slice};

                const PARTS: &[&[PortDecl]] = &[#(#ports),*];
                const PORTS: [PortDecl; ::component_sdk::port::port_count(PARTS)] =
                    ::component_sdk::port::all_ports(PARTS);

                impl ::component_sdk::component::Component for #ident {
                    const DECL: ClassDecl = ClassDecl {
                        name: abi_name(#name),
                        version: abi_name(#version),
                        description: abi_name(#description),
                        trigger: TriggerDecl::#trigger,
                        ports: abi_slice(&PORTS),
                        properties: abi_slice(&[#(#properties),*]),
                        criticals: abi_slice(&[#(#criticals),*]),
                        size: ::core::mem::size_of::<Self>(),
                    };

                    fn build(
                        builder: &mut ::component_sdk::property::Builder<'_>,
                    ) -> ::core::result::Result<Self, ::component_sdk::component::ComponentError> {
                        Ok(Self { #(#builders),* })
                    }

                    #serve

                    #blocking

                    #attend
                }
            };
        }
    }
}

/// What the fields give.
#[derive(Default)]
struct Parts {
    ports: Vec<TokenStream>,
    /// How many ports each of them is.
    counts: Vec<TokenStream>,
    properties: Vec<TokenStream>,
    criticals: Vec<TokenStream>,
    builders: Vec<TokenStream>,
    handlers: Vec<TokenStream>,
    gates: Vec<TokenStream>,
    begun: Vec<TokenStream>,
}

impl Parts {
    fn add(&mut self, class: &Ident, field: &Field) -> Result<()> {
        let ident = field.ident.as_ref().ok_or_else(|| Error::new_spanned(field, "a named field is wanted here"))?;
        let is = |name: &str| field.attrs.iter().any(|attr| attr.path().is_ident(name));
        if is("critical") {
            self.critical(class, ident, &field.ty);
        }
        let builder = if is("port") {
            self.port(ident, field)?
        } else if is("property") {
            self.property(ident, field)?
        } else {
            quote!(::core::default::Default::default())
        };
        self.builders.push(quote!(#ident: #builder));
        Ok(())
    }

    fn critical(&mut self, class: &Ident, ident: &Ident, ty: &Type) {
        let name = ident.to_string();
        let size = quote_spanned!(ty.span()=> ::component_sdk::critical_size::<#ty>());
        self.criticals.push(quote! {
            CriticalDecl { name: abi_name(#name), offset: ::core::mem::offset_of!(#class, #ident), size: #size }
        });
    }

    fn port(&mut self, ident: &Ident, field: &Field) -> Result<TokenStream> {
        let port = Port::read(ident, field)?;
        let before = &self.counts;
        let index = quote!(0 #(+ #before)*);
        self.counts.push(port.count());
        self.ports.push(port.decls());
        self.handlers.extend(port.dispatch());
        self.gates.extend(port.gate());
        self.begun.extend(port.attend());
        let method = port.builder();
        Ok(quote!(builder.#method(#index)))
    }

    fn property(&mut self, ident: &Ident, field: &Field) -> Result<TokenStream> {
        let attr = PropertyAttr::read(field)?;
        let PropertyAttr { default, unit, min, max } = attr;
        let index = self.properties.len();
        let name = ident.to_string();
        let description = description(&field.attrs);
        let ty = &field.ty;
        self.properties.push(quote! {
            PropertyDecl {
                name: abi_name(#name),
                kind: <#ty as ::component_sdk::property::PropertyValue>::KIND,
                default: abi_name(#default),
                unit: abi_name(#unit),
                min: #min,
                max: #max,
                description: abi_name(#description),
            }
        });
        Ok(quote!(builder.property(#index)?))
    }
}

struct PropertyAttr {
    default: String,
    unit: String,
    min: TokenStream,
    max: TokenStream,
}

impl PropertyAttr {
    fn read(field: &Field) -> Result<Self> {
        let mut read = Self {
            default: String::new(),
            unit: String::new(),
            min: quote!(f64::NEG_INFINITY),
            max: quote!(f64::INFINITY),
        };
        let mut has_default = false;
        for attr in field.attrs.iter().filter(|attr| attr.path().is_ident("property")) {
            attr.parse_nested_meta(|meta| {
                if meta.path.is_ident("default") {
                    read.default = literal_text(&meta.value()?.parse()?)?;
                    has_default = true;
                } else if meta.path.is_ident("unit") {
                    read.unit = meta.value()?.parse::<LitStr>()?.value();
                } else if meta.path.is_ident("range") {
                    (read.min, read.max) = bounds(&meta.value()?.parse()?)?;
                } else {
                    return Err(meta.error("known here: default, unit = \"m\", range = 0.0..=1.0"));
                }
                Ok(())
            })?;
        }
        if has_default { Ok(read) } else { Err(Error::new_spanned(field, "a property needs a default")) }
    }
}

fn literal_text(expr: &Expr) -> Result<String> {
    match expr {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Str(text) => Ok(text.value()),
            Lit::Int(number) => Ok(number.base10_digits().to_owned()),
            Lit::Float(number) => Ok(number.base10_digits().to_owned()),
            Lit::Bool(truth) => Ok(truth.value.to_string()),
            other => Err(Error::new_spanned(other, "a default is a number, a bool or a text")),
        },
        Expr::Unary(syn::ExprUnary { op: syn::UnOp::Neg(_), expr, .. }) => Ok(format!("-{}", literal_text(expr)?)),
        other => Err(Error::new_spanned(other, "a default is a literal: it is shown in profiles")),
    }
}

fn bounds(expr: &Expr) -> Result<(TokenStream, TokenStream)> {
    let Expr::Range(range) = expr else {
        return Err(Error::new_spanned(expr, "a range is written 0.05..=2.0"));
    };
    if matches!(range.limits, syn::RangeLimits::HalfOpen(_)) && range.end.is_some() {
        return Err(Error::new_spanned(expr, "bounds are inclusive: write ..= instead of .."));
    }
    let bound = |end: &Option<Box<Expr>>, open: TokenStream| end.as_ref().map_or(open, |end| quote!((#end) as f64));
    Ok((bound(&range.start, quote!(f64::NEG_INFINITY)), bound(&range.end, quote!(f64::INFINITY))))
}

/// `20ms`, `500us`, `1s`, or a bare number of milliseconds, as in profiles.
pub(crate) fn nanoseconds(text: &LitStr) -> Result<u64> {
    let value = text.value();
    let value = value.trim();
    let digits = value.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match &value[digits.len()..] {
        "us" => 1e3,
        "" | "ms" => 1e6,
        "s" => 1e9,
        _ => return Err(Error::new_spanned(text, "a period is written 500us, 20ms or 1s")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok((number * factor) as u64),
        _ => Err(Error::new_spanned(text, "a period is a number above zero: 500us, 20ms or 1s")),
    }
}
