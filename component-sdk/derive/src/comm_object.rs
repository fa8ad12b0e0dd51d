//! `#[derive(CommObject)]`: the description of a struct's fields.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, Error, Result};

use crate::named_fields;

pub(crate) fn expand(input: &DeriveInput) -> Result<TokenStream> {
    if !input.generics.params.is_empty() {
        return Err(Error::new_spanned(
            &input.generics,
            "a communication object has no generics: its layout is contract",
        ));
    }
    if !is_repr_c(input) {
        return Err(Error::new_spanned(
            &input.ident,
            "add #[repr(C)]: the layout of a communication object is contract",
        ));
    }
    let fields = named_fields(input)?;
    let object = &input.ident;
    let name = object.to_string();
    let idents: Vec<_> = fields.iter().filter_map(|field| field.ident.as_ref()).collect();
    let names: Vec<_> = idents.iter().map(ToString::to_string).collect();
    let types: Vec<_> = fields.iter().map(|field| &field.ty).collect();
    Ok(quote! {
        const _: () = {
            use ::component_sdk::object::{CommObject, FieldDescriptor, TypeDescriptor};

            const FIELDS: &[FieldDescriptor] = &[#(FieldDescriptor {
                name: ::component_sdk::abi_name(#names),
                offset: ::core::mem::offset_of!(#object, #idents),
                object: <#types as CommObject>::DESCRIPTOR,
            }),*];

            #[allow(unsafe_code, reason = "offsets, sizes and types are the compiler's own")]
            // SAFETY: offsets, sizes and types are the compiler's own, and the struct is `repr(C)`.
            unsafe impl CommObject for #object {
                const DESCRIPTOR: &'static TypeDescriptor = &TypeDescriptor::of_fields(
                    #name,
                    ::core::mem::size_of::<#object>(),
                    ::core::mem::align_of::<#object>(),
                    &[#(#names),*],
                    FIELDS,
                );

                fn empty() -> Self {
                    Self { #(#idents: <#types as CommObject>::empty()),* }
                }
            }
        };
    })
}

fn is_repr_c(input: &DeriveInput) -> bool {
    let mut found = false;
    for attr in input.attrs.iter().filter(|attr| attr.path().is_ident("repr")) {
        // A malformed `repr` is the compiler's to complain about.
        let _ = attr.parse_nested_meta(|meta| {
            found |= meta.path.is_ident("C");
            Ok(())
        });
    }
    found
}
