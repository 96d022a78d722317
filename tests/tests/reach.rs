//! Clouds in folders of tiles and behind addresses, through the real program.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use tests::copc_lists::{self, in_pages};
use tests::server::{Habits, Server};
use tests::{Folder, test_data};

fn text(path: &Path) -> String {
    path.to_str().expect("a path that is text").to_owned()
}

/// Indirect light takes half of the time of a small picture. Points beyond the view count for it: each kind of reading is
/// compared with few lights once.
const FEW_LIGHTS: [&str; 2] = ["--set", "gi.vpls=16"];
const NO_LIGHTS: [&str; 2] = ["--set", "gi.bounces=0"];
/// A fifth of the points of the largest cloud: nodes of several levels, and others that are left out.
const FEW_POINTS: [&str; 2] = ["--set", "view.point_budget=100000"];

/// The picture of a cloud, and what the program said.
fn picture(folder: &Folder, name: &str, input: &str, more: &[&str]) -> (Vec<u8>, String) {
    let output = folder.path(name);
    let pages = ["--set", "stream.pages=always"];
    let mut arguments = [&["render", input, "--size", "200x150"][..], &pages, &["-o"]].concat();
    let shown = text(&output);
    arguments.push(&shown);
    arguments.extend(more);
    let outcome = folder.glint(arguments);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    (std::fs::read(output).expect("a picture"), outcome.messages)
}

#[test]
fn info_tells_what_an_ept_holds() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    for name in ["ept/lone-star-laszip", "ept/lone-star-laszip/ept.json"] {
        let outcome = folder.glint(["info", "--json", &text(&data.join(name))]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
        let told = &outcome.json()["inputs"][0];
        assert_eq!((&told["format"], &told["points"]), (&"ept".into(), &518_862.into()));
    }
    let outcome = folder.glint(["info", &text(&data.join("ept/bad-pointcount-laszip"))]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains("1065 points, the hierarchy says 1000"), "{outcome}");
}

#[test]
fn pictures_by_address_are_those_of_files_to_the_bit() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let server = Server::of_folder(&data, Habits { fails: 10, ..Habits::default() });
    for (name, light) in [
        ("copc/lone_star_las14_pf6.copc.laz", FEW_LIGHTS),
        ("ept/lone-star-laszip/ept.json", FEW_LIGHTS),
        ("ept/1.2-with-color/ept.json", NO_LIGHTS),
    ] {
        let more = [FEW_POINTS, light].concat();
        let (of_file, _) = picture(&folder, "file.png", &text(&data.join(name)), &more);
        let (of_address, messages) = picture(&folder, "address.png", &text(&server.path(name)), &more);
        assert!(of_file == of_address, "{name}: {messages}");
    }
}

/// More nodes than fit in the smallest memory, and than are read whole of an address.
const MANY_NODES: usize = 9000;
const LITTLE_MEMORY: [&str; 2] = ["--set", "stream.host_bytes=64MiB"];

#[test]
fn lists_of_nodes_that_are_read_page_by_page_give_the_picture_of_whole_ones_to_the_bit() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let clouds = folder.path("clouds");
    std::fs::create_dir(&clouds).expect("a folder");
    let file = std::fs::read(data.join("copc/lone_star_las14_pf6.copc.laz")).expect("a COPC file");
    std::fs::write(clouds.join("paged.copc.laz"), in_pages(&file, 1, MANY_NODES).bytes).expect("a copy");
    let server = Server::of_folder(&clouds, Habits { fails: 10, ..Habits::default() });
    let (path, address) = (text(&clouds.join("paged.copc.laz")), text(&server.path("paged.copc.laz")));
    let views: [&[&str]; 2] =
        [&NO_LIGHTS, &["--set", "view.point_budget=100000", "--set", "light.by=sun", "--set", "gi.vpls=16"]];
    for more in views {
        let (whole, _) = picture(&folder, "whole.png", &path, more);
        let (paged, messages) = picture(&folder, "paged.png", &path, &[more, &LITTLE_MEMORY].concat());
        assert!(whole == paged && messages.is_empty(), "{more:?}: {messages}");
        let (far, messages) = picture(&folder, "far.png", &address, more);
        assert!(whole == far && messages.is_empty(), "{more:?}: {messages}");
    }
    // A hierarchy that claims to be larger than it is.
    let (from, to) = (data.join("ept/lone-star-laszip"), folder.path("ept"));
    for part in ["", "ept-data", "ept-hierarchy"] {
        std::fs::create_dir(to.join(part)).expect("a folder");
        for entry in std::fs::read_dir(from.join(part)).expect("its files").flatten().filter(|own| own.path().is_file())
        {
            let bytes = std::fs::read(entry.path()).expect("a file");
            std::fs::write(to.join(part).join(entry.file_name()), bytes).expect("a copy");
        }
    }
    let told = std::fs::read_to_string(from.join("ept.json")).expect("text").replace("518862", "1000000000000");
    std::fs::write(to.join("ept.json"), told).expect("a copy");
    let more = [FEW_POINTS, NO_LIGHTS].concat();
    let (whole, _) = picture(&folder, "whole.png", &text(&from.join("ept.json")), &more);
    let (paged, messages) = picture(&folder, "paged.png", &text(&to.join("ept.json")), &more);
    assert!(whole == paged && messages.is_empty(), "{messages}");
}

#[test]
fn a_page_of_a_list_of_nodes_that_cannot_be_used_is_told_and_the_rest_is_shown() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let file = std::fs::read(data.join("copc/lone_star_las14_pf6.copc.laz")).expect("a COPC file");
    let mut listed = in_pages(&file, 1, MANY_NODES);
    let ((link, _), at) = listed.entries.iter().find(|((_, is_page), _)| *is_page).expect("a further page");
    let (link, at) = (*link, *at);
    let whole = folder.write("whole.copc.laz", &listed.bytes);
    // The page is said to lie where no page can.
    listed.bytes[at..at + 32].copy_from_slice(&copc_lists::entry(link, 375, 64, -1));
    let damaged = folder.write("damaged.copc.laz", &listed.bytes);
    let more = [LITTLE_MEMORY, FEW_POINTS, NO_LIGHTS].concat();
    let (of_whole, _) = picture(&folder, "whole.png", &text(&whole), &more);
    let output = text(&folder.path("damaged.png"));
    let arguments = ["render", &text(&damaged), "--size", "200x150", "--set", "stream.pages=always", "-o", &output];
    let outcome = folder.glint([&arguments[..], &more].concat());
    let told = &outcome.messages;
    assert!(told.contains("outside the record of pages") && told.contains("below that node are missing"), "{outcome}");
    let shown = std::fs::read(output).expect("what is there is shown");
    assert!(shown != of_whole);
}

#[test]
fn an_address_is_told_of_like_a_file() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let server = Server::of_folder(&data, Habits::default());
    for name in ["copc/ellipsoid_las14_pf7.copc.laz", "e57/bunny_double.e57", "ept/1.2-with-color/ept.json"] {
        let told = |input: &str| {
            let outcome = folder.glint(["info", "--json", "--scan", input]);
            assert_eq!(outcome.status, Some(0), "{outcome}");
            let mut told = outcome.json()["inputs"][0].clone();
            told["path"] = "".into();
            told
        };
        assert_eq!(told(&text(&server.path(name))), told(&text(&data.join(name))), "{name}");
    }
    let outcome = folder.glint(["info", &text(&server.path("nothing.laz"))]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains("no such file on the server (status 404)"), "{outcome}");
}

#[test]
fn a_server_that_fails_while_a_file_is_read_is_told_by_the_status() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let name = "lone_star_las14_pf6.copc.laz";
    let served = folder.path("served");
    std::fs::create_dir(&served).expect("a folder");
    let own = served.join(name);
    std::fs::copy(data.join("copc").join(name), &own).expect("a copy");
    // The head, the list of nodes and some points come before the file goes.
    let server = Server::of_folder_after(&served, Habits::default(), move |request| {
        if request.number > 5 {
            let _ = std::fs::remove_file(&own);
        }
    });
    let outcome = folder.glint(["info", "--scan", &text(&server.path(name))]);
    assert_eq!(outcome.status, Some(2), "{outcome}");
    assert!(outcome.messages.contains("points of the inputs cannot be read"), "{outcome}");
}

#[test]
fn a_scene_file_does_not_lead_to_a_private_server() {
    let folder = Folder::new();
    let server = Server::new(|_, stream| write!(stream, "HTTP/1.1 404 No\r\ncontent-length: 0\r\n\r\n"));
    let scene = folder.write("scene.toml", format!("clouds = [\"{}\"]\n", text(&server.path("a.laz"))));
    let outcome = folder.glint(["info", &text(&scene)]);
    assert_eq!((outcome.status, server.requests()), (Some(2), 0), "{outcome}");
    assert!(outcome.messages.contains("only asked where a person has typed its address"), "{outcome}");
    // Unless the person has named the server.
    let mut command = folder.command(["info", &text(&scene)]);
    let named = command.env("GLINT_SERVERS", format!("http://other.lan {}", text(&server.path(""))));
    let told = String::from_utf8_lossy(&named.output().expect("the program starts").stderr).into_owned();
    assert!(server.requests() > 0 && !told.contains("only asked where"), "{told}");
}

#[test]
fn a_plan_names_addresses_and_does_not_lead_to_a_private_server() {
    let folder = Folder::new();
    let server = Server::new(|_, stream| write!(stream, "HTTP/1.1 404 No\r\ncontent-length: 0\r\n\r\n"));
    let address = text(&server.path("a.laz"));
    folder.write("plan.toml", format!("title = \"a\"\n[[group]]\nscenes = [\"{address}\"]\n"));
    let told = |servers: &str| {
        let mut command = folder.command(["study", "plan.toml", "-o", "results"]);
        let outcome = command.env("GLINT_SERVERS", servers).output().expect("the program starts");
        String::from_utf8_lossy(&outcome.stderr).into_owned()
    };
    let own = told("http://other.lan");
    if own.contains("no adapter") {
        return;
    }
    assert!(own.contains(&format!("{address}: a server in a private network")) && server.requests() == 0, "{own}");
    let own = told(&server.address);
    assert!(own.contains(&format!("{address}: no such file on the server")), "{own}");
}

#[test]
fn what_a_server_limit_or_credential_must_be_is_said() {
    let folder = Folder::new();
    let mut command = folder.command(["scenes"]);
    let outcome = command.env("GLINT_FETCHED_BYTES", "many").output().expect("the program starts");
    let told = String::from_utf8_lossy(&outcome.stderr).into_owned();
    assert!(outcome.status.code() == Some(2) && told.contains("GLINT_FETCHED_BYTES: expected bytes"), "{told}");
    let mut command = folder.command(["scenes"]);
    let outcome = command.env("GLINT_SERVERS", "http://a.lan b.lan").output().expect("the program starts");
    let told = String::from_utf8_lossy(&outcome.stderr).into_owned();
    let expected = "GLINT_SERVERS: `b.lan`: expected addresses such as";
    assert!(outcome.status.code() == Some(2) && told.contains(expected), "{told}");
    let outcome = folder.glint(["scenes", "--authorization", "a\nb"]);
    assert!(outcome.status == Some(2) && outcome.messages.contains("--authorization: not a line"), "{outcome}");
}

/// What the open files of a process are, as far as they can be looked at.
#[cfg(target_os = "linux")]
fn open_files(process: u32) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().flatten();
    entries.filter_map(|entry| std::fs::read_link(entry.path()).ok()).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn no_socket_is_opened_without_an_address() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let server = Server::of_folder(&data, Habits { latency: Duration::from_millis(300), ..Habits::default() });
    let has_socket = |input: &str| {
        let mut command = folder.command(["info", "--scan", input]);
        let mut program = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts");
        let mut found = false;
        while program.try_wait().expect("its status").is_none() {
            found |= open_files(program.id()).iter().any(|file| text(file).starts_with("socket:"));
            std::thread::sleep(Duration::from_millis(1));
        }
        found
    };
    let name = "ept/lone-star-laszip/ept.json";
    assert!(has_socket(&text(&server.path(name))), "the test sees a socket where there is one");
    let asked = server.requests();
    for name in [name, "copc/ellipsoid_las14_pf7.copc.laz", "e57/bunny_double.e57"] {
        assert!(!has_socket(&text(&data.join(name))), "{name}");
    }
    assert_eq!(server.requests(), asked);
}

#[test]
fn a_catalogue_is_the_cloud_that_its_folder_is() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let tiles = folder.path("tiles");
    std::fs::create_dir(&tiles).expect("a folder");
    for name in ["0-0-0-0.laz", "1-0-0-0.laz", "1-1-1-1.laz"] {
        let tile = std::fs::read(data.join("ept/lone-star-laszip/ept-data").join(name)).expect("a tile");
        std::fs::write(tiles.join(name), tile).expect("a copy");
    }
    let catalogue = tiles.join("all.vpc");
    let outcome = folder.glint(["index", "--catalogue", &text(&tiles), "-o", &text(&catalogue)]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    let points = 41_998 + 22_108 + 48_879;
    let server = Server::of_folder(&tiles, Habits::default());
    let (of_folder, _) = picture(&folder, "folder.png", &text(&tiles), &NO_LIGHTS);
    for input in [text(&catalogue), text(&server.path("all.vpc"))] {
        let outcome = folder.glint(["info", "--json", &input]);
        assert_eq!((outcome.status, &outcome.json()["inputs"][0]["points"]), (Some(0), &points.into()), "{outcome}");
        let (of_catalogue, messages) = picture(&folder, "catalogue.png", &input, &NO_LIGHTS);
        assert!(of_catalogue == of_folder, "{input}: {messages}");
    }
    let again = folder.glint(["index", "--catalogue", &text(&tiles), "-o", &text(&catalogue)]);
    assert!(again.status != Some(0) && again.messages.contains("all.vpc"), "{again}");
    let named = folder.glint(["index", "--catalogue", &text(&tiles), "-o", &text(&folder.path("x.laz"))]);
    assert!(named.status == Some(2) && named.messages.contains("must end in .vpc"), "{named}");
}

#[test]
fn a_folder_or_a_catalogue_of_copc_files_is_one_cloud_with_the_points_of_its_files() {
    let Some(data) = test_data() else { return };
    let folder = Folder::new();
    let tiles = folder.path("tiles");
    std::fs::create_dir(&tiles).expect("a folder");
    let mut paths = Vec::new();
    for name in ["1-0-0-0", "1-1-1-1", "2-2-2-1"] {
        let input = data.join("ept/lone-star-laszip/ept-data").join(format!("{name}.laz"));
        paths.push(text(&tiles.join(format!("{name}.copc.laz"))));
        let outcome = folder.glint(["index", &text(&input), "-o", &paths[paths.len() - 1]]);
        assert_eq!(outcome.status, Some(0), "{outcome}");
    }
    let (of_folder, _) = picture(&folder, "folder.png", &text(&tiles), &FEW_LIGHTS);
    let catalogue = tiles.join("all.vpc");
    let outcome = folder.glint(["index", "--catalogue", &text(&tiles), "-o", &text(&catalogue)]);
    assert_eq!(outcome.status, Some(0), "{outcome}");
    // Ramps, the first camera and the extent of light are those of one cloud. Points, normals and radii are those of files.
    let view =
        "[camera]\neye = [515368.6, 4918318.2, 2360.0]\npivot = [515380.0, 4918345.0, 2330.0]\nup = [0.0, 0.0, 1.0]\n";
    let view = text(&folder.write("view.toml", view));
    let same = ["--camera", &view, "--set", "color.by=plain", "--set", "light.by=headlight"];
    let (of_files, _) = picture(&folder, "files.png", &paths[0], &[&[&*paths[1], &*paths[2]], &same[..]].concat());
    let (of_tiles, _) = picture(&folder, "tiles.png", &text(&tiles), &same);
    assert!(of_files == of_tiles);
    let server = Server::of_folder(&tiles, Habits { fails: 10, ..Habits::default() });
    for input in [text(&catalogue), text(&server.path("all.vpc"))] {
        let (of_catalogue, messages) = picture(&folder, "catalogue.png", &input, &FEW_LIGHTS);
        assert!(of_catalogue == of_folder, "{input}: {messages}");
    }
    // A tile that is missing is reported, and the others are shown.
    std::fs::remove_file(&paths[1]).expect("a tile");
    for pages in ["stream.pages=always", "stream.pages=never"] {
        let output = text(&folder.path(&format!("{pages}.png")));
        let arguments = ["render", &text(&catalogue), "-o", &output, "--size", "200x150", "--set", pages];
        let outcome = folder.glint(arguments.iter().chain(&NO_LIGHTS));
        let told = format!("glint: {}: a tile is missing: {}", text(&catalogue), paths[1]);
        assert!(outcome.status == Some(2) && outcome.messages.contains(&told), "{outcome}");
        assert!(std::fs::metadata(output).is_ok(), "the others are shown");
    }
}
