//! The HTTP contract: through the router, over real sockets where the traps are, and by the built binary.

mod access;
mod bad_requests;
mod cameras;
mod command_line;
mod contract;
mod idempotency;
mod images;
mod sockets;
mod support;
