//! Asks a server on this machine that falls silent.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests ask servers that answer")]
mod server;

use std::io::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use server::Server;

fn use_network() {
    codec::use_network(codec::Network { silence: Duration::from_secs(2), ..Default::default() }).unwrap();
}

/// The address of a file, as if a person had typed it.
fn typed(server: &Server, name: &str) -> PathBuf {
    use_network();
    let path = server.path(name);
    codec::trust_address(&path);
    path
}

#[test]
fn a_server_that_falls_silent_is_asked_twice_again_and_then_left_alone() {
    let server = Server::new(|request, stream| {
        let (first, last) = request.range().unwrap_or_default();
        let head = format!("content-range: bytes {first}-{last}/1000000\r\ncontent-length: {}", last + 1 - first);
        write!(stream, "HTTP/1.1 206 Part\r\n{head}\r\n\r\nply\n")?;
        stream.flush()?;
        std::thread::sleep(Duration::from_secs(10));
        Ok(())
    });
    let path = typed(&server, "a.ply");
    let message = || codec::open(&path).err().unwrap().to_string();
    let told = message();
    assert!(told.contains("the server is silent, or too slow (waited 2 times, 4 s in all)"), "{told}");
    let asked = server.requests();
    let told = message();
    // Each node of a cloud would wait as long.
    assert!(told.contains("silent a moment ago") && server.requests() == asked, "{told}");
}

#[test]
fn a_server_that_asks_to_wait_again_and_again_is_left_alone() {
    let server = Server::new(move |_, stream| {
        write!(stream, "HTTP/1.1 503 Busy\r\nretry-after: 3\r\ncontent-length: 0\r\n\r\n")
    });
    let path = typed(&server, "a.ply");
    let message = || codec::open(&path).err().unwrap().to_string();
    assert!(message().contains("asks to wait for 3 s"));
    let asked = server.requests();
    let told = message();
    assert!(told.contains("is not asked yet"), "{told}");
    assert_eq!((asked, server.requests()), (3, 3));
}

/// The first line of an answer with all of a file of this length.
const HEAD: &str = "HTTP/1.1 200 OK\r\nlast-modified: Mon, 30 Nov 2026 10:00:00 GMT\r\n";

#[test]
fn a_file_may_come_as_slowly_as_it_likes() {
    let points = 3300;
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    );
    let file: Vec<u8> = head.into_bytes().into_iter().chain(std::iter::repeat_n(0, 12 * points)).collect();
    let server = Server::new(move |_, stream| {
        write!(stream, "{HEAD}content-length: {}\r\n\r\n", file.len())?;
        for piece in file.chunks(600) {
            stream.write_all(piece)?;
            std::thread::sleep(Duration::from_millis(500));
        }
        Ok(())
    });
    let opened = codec::open(&typed(&server, "a.ply"));
    assert_eq!(opened.unwrap().info().points, points as u64);
    assert_eq!(server.requests(), 1);
}

/// A server that sends some bytes at once, and then one now and then.
fn slow_server(first: usize) -> Server {
    Server::new(move |_, stream| {
        write!(stream, "{HEAD}content-length: 1000000\r\n\r\n")?;
        stream.write_all(&vec![b'a'; first])?;
        loop {
            stream.write_all(b"a")?;
            std::thread::sleep(Duration::from_millis(500));
        }
    })
}

#[test]
fn a_server_that_sends_a_byte_now_and_then_is_too_slow() {
    let server = slow_server(0);
    let began = Instant::now();
    let told = codec::open(&typed(&server, "a.ply")).err().unwrap().to_string();
    assert!(told.contains("silent, or too slow") && began.elapsed().as_secs() < 25, "{told}, {:?}", began.elapsed());
}

#[test]
fn a_server_that_becomes_too_slow_is_not_excused_by_what_it_has_sent() {
    let server = slow_server(100_000);
    let began = Instant::now();
    // What is missing is asked for when it is read.
    codec::Bytes::open(&typed(&server, "a.ply")).unwrap();
    assert!(began.elapsed().as_secs() < 25, "{:?}", began.elapsed());
}

#[test]
fn an_answer_that_was_slow_is_not_asked_for_again_once_it_is_there() {
    const LENGTH: u64 = (16 << 10) + 40;
    let server = Server::new(|request, stream| {
        let (first, last) = request.range().unwrap();
        let (last, etag) = (last.min(LENGTH - 1), "etag: \"1\"");
        let count = last + 1 - first;
        let range = format!("content-range: bytes {first}-{last}/{LENGTH}");
        write!(stream, "HTTP/1.1 206 Part\r\n{etag}\r\n{range}\r\ncontent-length: {count}\r\n\r\n")?;
        if request.number == 1 {
            return stream.write_all(&vec![7; count as usize]);
        }
        // The last byte comes when the server has been slow for too long.
        stream.write_all(&vec![7; count as usize - 4])?;
        for _ in 0..4 {
            std::thread::sleep(Duration::from_millis(1600));
            stream.write_all(&[7])?;
        }
        Ok(())
    });
    let bytes = codec::Bytes::open(&typed(&server, "a.ply")).unwrap();
    let mut part = [0; 40];
    assert_eq!((bytes.read_at(16 << 10, &mut part).unwrap(), part), (40, [7; 40]));
    assert_eq!(server.requests(), 2);
}
