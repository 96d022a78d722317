//! Asks a server on this machine that falls silent.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests ask servers that answer")]
mod server;

use std::io::Write as _;
use std::time::Duration;

use server::Server;

#[test]
fn a_server_that_falls_silent_is_asked_twice_again_and_then_left_alone() {
    let silence = Duration::from_secs(2);
    codec::use_network(codec::Network { silence, ..Default::default() }).unwrap();
    let server = Server::new(|request, stream| {
        let (first, last) = request.range().unwrap_or_default();
        let head = format!("content-range: bytes {first}-{last}/1000000\r\ncontent-length: {}", last + 1 - first);
        write!(stream, "HTTP/1.1 206 Part\r\n{head}\r\n\r\nply\n")?;
        stream.flush()?;
        std::thread::sleep(Duration::from_secs(10));
        Ok(())
    });
    let path = server.path("a.ply");
    codec::trust_address(&path);
    let message = || codec::open(&path).err().unwrap().to_string();
    let told = message();
    assert!(told.contains("the server is silent, or too slow (waited 2 times for 2 s)"), "{told}");
    let asked = server.requests();
    let told = message();
    // Each node of a cloud would wait as long.
    assert!(told.contains("silent a moment ago") && server.requests() == asked, "{told}");
}
