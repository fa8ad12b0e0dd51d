//! One test for each line of the tables of the communication patterns, on each transport there is: near (both sides on
//! one executor) and far (each on its own). A test's name is its line's.

mod allocation;
mod check;
mod component;
mod event;
mod lines;
mod links;
mod paper;
mod patterns;
mod push;
mod query;
mod requestor;
mod rig;
mod send;
mod service;
mod state;
mod status;
mod threads;
mod wiring;
