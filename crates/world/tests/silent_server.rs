//! Opens files while a server is silent.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::PathBuf;
use std::time::Duration;

use scene::Settings;
use world::{Event, Input};

#[test]
fn a_file_is_shown_while_a_server_named_before_it_is_silent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.ply");
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    std::fs::write(&path, format!("{head}end_header\n0 0 0\n1 0 0\n0 1 0\n")).unwrap();
    // Connections are made, and nobody answers.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = PathBuf::from(format!("http://{}/a.laz", silent.local_addr().unwrap()));
    codec::trust_address(&address);
    let job = world::start(vec![Input::File(address), Input::File(path)], &Settings::default(), BTreeSet::new());
    let mut points = 0;
    while points == 0 {
        match job.events.recv_timeout(Duration::from_secs(15)).unwrap() {
            Event::Read { summary, .. } => points = summary.points,
            Event::Failed { error, .. } => panic!("{error}"),
            _ => {}
        }
    }
    assert_eq!((points, job.progress.done(), job.progress.total()), (3, 3, 3));
}
