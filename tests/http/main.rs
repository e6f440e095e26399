//! The HTTP contract: through the router, over real sockets where the traps are, and by the built binary.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panic")]

pub(crate) use gable::database::Database;
pub(crate) use gable::store::{Place, Store};

mod access;
mod audit;
mod bad_requests;
mod blocks;
mod cameras;
mod command_line;
mod contract;
mod control_points;
mod control_scenes;
mod crash;
mod database;
mod diagnosis;
mod exports;
mod film;
mod film_cameras;
mod idempotency;
mod images;
mod interior_orientations;
mod kill;
#[path = "../shared/labelled.rs"]
mod labelled;
mod orientations;
mod pictures;
mod rates;
mod removal;
mod reviews;
mod scene_commands;
#[path = "../shared/scratch.rs"]
mod scratch;
mod sessions;
mod sockets;
mod statistics;
mod support;
mod terrestrial;
mod tools;
mod uploads;
mod webhooks;
