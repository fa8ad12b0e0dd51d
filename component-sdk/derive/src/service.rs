//! `#[service]`: a trait as the interface of service ports, with the client's and the server's side of each method.

use proc_macro2::{Span, TokenStream};
use quote::{format_ident, quote};
use syn::{
    Error, FnArg, GenericArgument, Ident, ItemTrait, Pat, PathArguments, Result, ReturnType, TraitItem, TraitItemFn,
    Type,
};

use crate::description;

pub(crate) fn expand(attributes: &TokenStream, mut interface: ItemTrait) -> Result<TokenStream> {
    if !attributes.is_empty() {
        return Err(Error::new_spanned(attributes, "#[service] has no arguments"));
    }
    if !interface.generics.params.is_empty() || !interface.supertraits.is_empty() {
        return Err(Error::new_spanned(&interface.ident, "an interface has neither generics nor supertraits"));
    }
    let name = interface.ident.clone();
    let methods = interface.items.iter().map(|item| Method::read(&name, item)).collect::<Result<Vec<_>>>()?;
    for item in &mut interface.items {
        if let TraitItem::Fn(function) = item {
            function.attrs.retain(|attr| !attr.path().is_ident("nonblocking"));
        }
    }
    if methods.is_empty() {
        return Err(Error::new_spanned(&interface.ident, "an interface has a method at least"));
    }
    let output = Interface { item: &interface, methods: &methods };
    let (parameters, client, server, service) =
        (output.parameters(), output.client(), output.server(), output.service());
    Ok(quote!(#interface #parameters #client #server #service))
}

/// How the component returns a result.
enum Returns {
    Nothing,
    Value(Box<Type>),
    /// Or a status, which the client gets instead.
    Fallible(Box<Type>),
}

struct Parameter {
    name: Ident,
    object: Type,
    by_reference: bool,
}

struct Method {
    name: Ident,
    /// `MotorsDrive` of `Motors::drive`: its parameters, and its call.
    object: Ident,
    variant: Ident,
    parameters: Vec<Parameter>,
    takes_context: bool,
    blocking: bool,
    returns: Returns,
    description: String,
}

impl Method {
    fn read(interface: &Ident, item: &TraitItem) -> Result<Self> {
        let TraitItem::Fn(function) = item else {
            return Err(Error::new_spanned(item, "an interface has methods only"));
        };
        let signature = &function.sig;
        if !signature.generics.params.is_empty() || signature.asyncness.is_some() {
            return Err(Error::new_spanned(signature, "a method of an interface is neither generic nor async"));
        }
        let mut inputs = signature.inputs.iter();
        match inputs.next() {
            Some(FnArg::Receiver(this)) if this.reference.is_some() && this.mutability.is_some() => {}
            _ => return Err(Error::new_spanned(signature, "a method of an interface takes `&mut self`")),
        }
        let mut arguments: Vec<&FnArg> = inputs.collect();
        let takes_context = arguments.first().is_some_and(|argument| is_context(argument));
        if takes_context {
            arguments.remove(0);
        }
        let blocking = !function.attrs.iter().any(|attr| attr.path().is_ident("nonblocking"));
        let returns = returns(function)?;
        if !blocking && !matches!(returns, Returns::Nothing) {
            return Err(Error::new_spanned(
                &signature.output,
                "nobody waits for the result of a #[nonblocking] method",
            ));
        }
        let variant = format_ident!("{}", pascal(&signature.ident.to_string()));
        Ok(Self {
            name: signature.ident.clone(),
            object: format_ident!("{interface}{variant}"),
            variant,
            parameters: arguments.into_iter().map(parameter).collect::<Result<_>>()?,
            takes_context,
            blocking,
            returns,
            description: description(&function.attrs),
        })
    }

    /// The object that carries the parameters.
    fn request(&self) -> TokenStream {
        let object = &self.object;
        if self.parameters.is_empty() { quote!(()) } else { quote!(#object) }
    }

    fn answer(&self) -> TokenStream {
        match &self.returns {
            Returns::Nothing => quote!(()),
            Returns::Value(object) | Returns::Fallible(object) => quote!(#object),
        }
    }

    /// The parameters as the client passes them.
    fn arguments(&self) -> Vec<TokenStream> {
        let argument = |Parameter { name, object, by_reference }: &Parameter| {
            if *by_reference { quote!(#name: &#object) } else { quote!(#name: #object) }
        };
        self.parameters.iter().map(argument).collect()
    }

    /// Writes the parameters into the request on loan.
    fn filling(&self) -> Vec<TokenStream> {
        let fill = |Parameter { name, by_reference, .. }: &Parameter| {
            if *by_reference {
                quote!(::core::clone::Clone::clone_from(&mut call.#name, #name);)
            } else {
                quote!(call.#name = #name;)
            }
        };
        self.parameters.iter().map(fill).collect()
    }

    /// The parameters as the component gets them.
    fn passing(&self) -> Vec<TokenStream> {
        let context = self.takes_context.then(|| quote!(cx));
        let pass = |Parameter { name, by_reference, .. }: &Parameter| {
            if *by_reference { quote!(&call.#name) } else { quote!(::core::clone::Clone::clone(&call.#name)) }
        };
        context.into_iter().chain(self.parameters.iter().map(pass)).collect()
    }

    fn client_port(&self) -> TokenStream {
        let (request, answer) = (self.request(), self.answer());
        if self.blocking {
            quote!(::component_sdk::port::QueryClient<#request, #answer>)
        } else {
            quote!(::component_sdk::port::SendClient<#request>)
        }
    }

    fn client_methods(&self) -> TokenStream {
        let (name, answer, arguments, filling) = (&self.name, self.answer(), self.arguments(), self.filling());
        let mutable = (!filling.is_empty()).then(|| quote!(mut));
        let doc = if self.description.is_empty() { format!("Calls `{name}`.") } else { self.description.clone() };
        if !self.blocking {
            return quote! {
                #[doc = #doc]
                ///
                /// # Errors
                /// As [`SendClient::send`](::component_sdk::port::SendClient::send).
                pub fn #name(&mut self, #(#arguments),*) -> ::core::result::Result<(), ::component_sdk::status::Status> {
                    let #mutable call = self.#name.loan()?;
                    #(#filling)*
                    call.send()
                }
            };
        }
        let request = format_ident!("{name}_request");
        let request_doc = format!("Calls `{name}`, and returns at once; the field `{name}` gives the result out.");
        quote! {
            #[doc = #doc]
            ///
            /// # Errors
            /// As [`QueryClient::query`](::component_sdk::port::QueryClient::query).
            pub fn #name(
                &mut self, #(#arguments),*
            ) -> ::core::result::Result<::component_sdk::port::Reply<'_, #answer>, ::component_sdk::status::Status> {
                let #mutable call = self.#name.loan()?;
                #(#filling)*
                call.query()
            }

            #[doc = #request_doc]
            ///
            /// # Errors
            /// As [`QueryClient::request`](::component_sdk::port::QueryClient::request).
            pub fn #request(
                &mut self, #(#arguments),*
            ) -> ::core::result::Result<::component_sdk::port::QueryId<#answer>, ::component_sdk::status::Status> {
                let #mutable call = self.#name.loan()?;
                #(#filling)*
                call.request()
            }
        }
    }

    fn decl(&self) -> TokenStream {
        let (name, request, answer, description) =
            (self.name.to_string(), self.request(), self.answer(), &self.description);
        let object = |object: &TokenStream| quote!(<#object as ::component_sdk::object::CommObject>::DESCRIPTOR);
        let parameters = object(&request);
        let result = object(&answer);
        let (pattern, result) = if self.blocking {
            (quote!(Query), quote!(::component_sdk::some_object(#result)))
        } else {
            (quote!(Send), quote!(::component_sdk::no_object()))
        };
        quote! {
            ::component_sdk::port::MethodDecl {
                name: ::component_sdk::abi_name(#name),
                pattern: ::component_sdk::abi::class::Pattern::#pattern,
                parameters: #parameters,
                result: #result,
                description: ::component_sdk::abi_name(#description),
            }
        }
    }

    fn entry(&self, calls: &Ident) -> TokenStream {
        let (name, variant, passing) = (&self.name, &self.variant, self.passing());
        let call = quote!(self.#name(#(#passing),*));
        let body = match &self.returns {
            // A client that has left is nobody's mistake.
            _ if !self.blocking => quote!(#call),
            Returns::Nothing => quote! {
                #call;
                let _ = call.answer(());
            },
            Returns::Value(_) => quote! {
                let result = #call;
                let _ = call.answer(result);
            },
            Returns::Fallible(_) => quote! {
                let _ = match #call {
                    ::core::result::Result::Ok(result) => call.answer(result),
                    ::core::result::Result::Err(status) => call.refuse(status),
                };
            },
        };
        quote!(#calls::#variant(call) => { #body })
    }
}

/// A trait with its methods.
struct Interface<'a> {
    item: &'a ItemTrait,
    methods: &'a [Method],
}

impl Interface<'_> {
    fn ident(&self, part: &str) -> Ident {
        format_ident!("{}{part}", self.item.ident)
    }

    fn parameters(&self) -> TokenStream {
        let vis = &self.item.vis;
        let objects = self.methods.iter().filter(|method| !method.parameters.is_empty()).map(|method| {
            let (object, names) = (&method.object, method.parameters.iter().map(|parameter| &parameter.name));
            let types = method.parameters.iter().map(|parameter| &parameter.object);
            let doc = format!("Parameters of `{}::{}`.", self.item.ident, method.name);
            quote! {
                #[doc = #doc]
                #[allow(missing_docs, reason = "they are documented at the method")]
                #[repr(C)]
                #[derive(::component_sdk::CommObject)]
                #vis struct #object { #(pub #names: #types),* }
            }
        });
        quote!(#(#objects)*)
    }

    fn client(&self) -> TokenStream {
        let (vis, client) = (&self.item.vis, self.ident("Client"));
        let names = self.methods.iter().map(|method| &method.name);
        let ports = self.methods.iter().map(Method::client_port);
        let calls = self.methods.iter().map(Method::client_methods);
        let doc = format!("The client's side of `{}`: what a `Required<dyn {0}>` can do.", self.item.ident);
        quote! {
            #[doc = #doc]
            #[allow(missing_docs, reason = "they are documented at the methods")]
            #vis struct #client { #(pub #names: #ports),* }

            #[allow(clippy::too_many_arguments, reason = "as many as the interface has")]
            impl #client { #(#calls)* }
        }
    }

    fn server(&self) -> TokenStream {
        let (vis, server, calls) = (&self.item.vis, self.ident("Server"), self.ident("Call"));
        let parts = self.methods.iter().map(|method| {
            let (name, variant, request, answer) = (&method.name, &method.variant, method.request(), method.answer());
            if method.blocking {
                (
                    quote!(#name: ::component_sdk::port::QueryServer<#request, #answer>),
                    quote!(#variant(::component_sdk::port::Query<'a, #request, #answer>)),
                )
            } else {
                (
                    quote!(#name: ::component_sdk::port::SendServer<#request>),
                    quote!(#variant(::component_sdk::port::Message<'a, #request>)),
                )
            }
        });
        let (fields, variants): (Vec<_>, Vec<_>) = parts.unzip();
        quote! {
            #[doc(hidden)]
            #vis struct #server { #(#fields),* }

            #[doc(hidden)]
            #vis enum #calls<'a> { #(#variants),* }
        }
    }

    fn service(&self) -> TokenStream {
        let (name, methods) = (&self.item.ident, self.methods);
        let (client, server, calls) = (self.ident("Client"), self.ident("Server"), self.ident("Call"));
        let text = name.to_string();
        let decls = methods.iter().map(Method::decl);
        let build = |side: &str| {
            let fields = methods.iter().enumerate().map(|(index, method)| {
                let kind = if method.blocking { "query" } else { "send" };
                let (name, port) = (&method.name, format_ident!("{kind}_{side}"));
                quote!(#name: builder.#port(first + #index))
            });
            quote!(#(#fields),*)
        };
        let (clients, servers) = (build("client"), build("server"));
        let gates = methods.iter().filter(|method| method.blocking).map(|method| &method.name);
        let gates: Vec<_> = gates.collect();
        let found = methods.iter().map(|method| {
            let (name, variant) = (&method.name, &method.variant);
            let kind = Ident::new(if method.blocking { "query" } else { "message" }, Span::call_site());
            quote! {
                if let ::core::option::Option::Some(call) = incoming.#kind(&server.#name) {
                    return ::core::option::Option::Some(#calls::#variant(call));
                }
            }
        });
        let entries = methods.iter().map(|method| method.entry(&calls));
        quote! {
            impl ::component_sdk::port::Service for dyn #name {
                const NAME: &'static str = #text;
                const METHODS: &'static [::component_sdk::port::MethodDecl] = &[#(#decls),*];
                type Client = #client;
                type Server = #server;
                type Call<'a> = #calls<'a>;

                fn client(builder: &::component_sdk::property::Builder<'_>, first: usize) -> #client {
                    #client { #clients }
                }

                fn server(builder: &::component_sdk::property::Builder<'_>, first: usize) -> #server {
                    #server { #servers }
                }

                #[allow(unused_variables, reason = "messages wait for nothing")]
                fn blocking(
                    client: &mut #client,
                    on: bool,
                ) -> ::core::result::Result<(), ::component_sdk::status::Status> {
                    #(client.#gates.blocking(on)?;)*
                    ::core::result::Result::Ok(())
                }

                #[allow(unused_variables, reason = "as above")]
                fn component_blocking(client: &mut #client, on: bool) {
                    #(client.#gates.component_blocking(on);)*
                }

                fn find<'a>(
                    server: &#server,
                    incoming: &::component_sdk::abi::calls::Incoming<'a>,
                ) -> ::core::option::Option<#calls<'a>> {
                    #(#found)*
                    ::core::option::Option::None
                }

                #[allow(unused_variables, reason = "not every method looks at the context, or has parameters")]
                fn enter(&mut self, cx: &mut ::component_sdk::context::Context<'_>, call: #calls<'_>) {
                    match call { #(#entries)* }
                }
            }
        }
    }
}

fn is_context(argument: &FnArg) -> bool {
    let FnArg::Typed(typed) = argument else { return false };
    let Type::Reference(reference) = &*typed.ty else { return false };
    matches!(&*reference.elem, Type::Path(path)
        if path.path.segments.last().is_some_and(|last| last.ident == "Context"))
}

fn parameter(argument: &FnArg) -> Result<Parameter> {
    let FnArg::Typed(typed) = argument else { return Err(Error::new_spanned(argument, "a parameter is wanted here")) };
    let Pat::Ident(name) = &*typed.pat else {
        return Err(Error::new_spanned(&typed.pat, "a parameter of an interface has a name"));
    };
    let (object, by_reference) = match &*typed.ty {
        Type::Reference(reference) if reference.mutability.is_none() => ((*reference.elem).clone(), true),
        Type::Reference(_) => {
            return Err(Error::new_spanned(&typed.ty, "what is passed cannot be changed: answer with a result"));
        }
        object => (object.clone(), false),
    };
    Ok(Parameter { name: name.ident.clone(), object, by_reference })
}

fn returns(function: &TraitItemFn) -> Result<Returns> {
    let ReturnType::Type(_, object) = &function.sig.output else { return Ok(Returns::Nothing) };
    match &**object {
        Type::Tuple(tuple) if tuple.elems.is_empty() => return Ok(Returns::Nothing),
        Type::Reference(_) => return Err(Error::new_spanned(object, "a result is an object, not a reference")),
        Type::Path(path) => {
            if let Some(last) = path.path.segments.last()
                && last.ident == "Result"
                && let PathArguments::AngleBracketed(arguments) = &last.arguments
                && let Some(GenericArgument::Type(value)) = arguments.args.first()
            {
                return Ok(Returns::Fallible(Box::new(value.clone())));
            }
        }
        _ => {}
    }
    Ok(Returns::Value(object.clone()))
}

/// `set_speed` as `SetSpeed`.
fn pascal(name: &str) -> String {
    name.trim_start_matches("r#")
        .split('_')
        .map(|word| {
            let mut letters = word.chars();
            letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
        })
        .collect()
}
