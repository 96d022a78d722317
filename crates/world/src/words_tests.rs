//! Tests of the words that name inputs.

use super::*;
use crate::event::Event;
use crate::job::start;

const THREE_POINTS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
    property float z\nproperty uchar intensity\nend_header\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

fn message(word: &str) -> String {
    resolve(&words(&[word])).check().unwrap_err().to_string()
}

#[test]
fn words_name_files_scenes_and_built_in_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("cloud.ply");
    let scene = folder.path().join("scene.toml");
    std::fs::write(&cloud, THREE_POINTS).unwrap();
    std::fs::write(
        &scene,
        "clouds = [\"cloud.ply\", \"five-mirrors/torus\"]\n[parameters]\n\"splat.size\" = 2.0\n\"splat.nope\" = 1\n",
    )
    .unwrap();
    let request = resolve(&words(&[scene.to_str().unwrap()]));
    let torus = Input::BuiltIn { variant: five_mirrors::Variant::Torus, without: Vec::new() };
    assert_eq!(request.inputs, [Input::File(cloud), torus.clone()]);
    let view = request.view.unwrap();
    assert_eq!((view.settings.splat.size, view.camera), (2.0, None));
    assert!(request.warnings.len() == 1 && request.warnings[0].contains("splat.nope"), "{:?}", request.warnings);

    let alone = resolve(&words(&["five-mirrors/torus"]));
    assert_eq!(alone.inputs, [torus]);
    assert_eq!(alone.view.unwrap().camera, Some(five_mirrors::camera()));
    let nothing = resolve::<&str>(&[]);
    assert!(nothing.inputs.is_empty() && nothing.check().is_ok());
}

#[test]
fn a_folder_names_the_clouds_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        std::fs::write(folder.path().join(name), THREE_POINTS).unwrap();
        folder.path().join(name)
    };
    let word = words(&[folder.path().to_str().unwrap()]);
    write("notes.txt");
    let last = write("b.LAZ");
    assert_eq!(resolve(&word).inputs, [Input::File(last.clone())]);
    let first = write("a.ply");
    std::fs::create_dir(folder.path().join("c.las")).unwrap();
    let tiles = Input::Tiles { folder: folder.path().to_owned(), files: vec![first, last] };
    assert_eq!(resolve(&word).inputs, [tiles]);
}

#[test]
fn a_view_of_a_scene_brings_none_of_its_objects_twice() {
    let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                 inner_degrees = 20\nouter_degrees = 30\n";
    let mirror = |line: &str| format!("[[mirrors]]\nshape = \"sphere\"\nposition = [0, 0, 0]\nsize = 0.2\n{line}\n");
    let points = "[[mirror_points]]\ncloud = \"a.laz\"\n";
    let text = |line: &str| format!("{light}{}{}{points}", mirror(""), mirror(line));
    let mut request = Request::default();
    request.furnish(&SceneFile::parse(&text("name = \"ball\"")).unwrap());
    let view = SceneFile::parse(&text("name = \"ball\"\nas_points = true")).unwrap();
    request.refurnish(&view);
    assert_eq!((request.lights.len(), request.mirror_points.len()), (1, 1));
    assert_eq!(request.mirrors, view.mirrors);
    request.refurnish(&SceneFile::default());
    assert_eq!(request.lights.len(), 1, "a view without lights leaves those that are there");
}

#[test]
fn scene_files_hide_classes_together_and_a_view_hides_its_own() {
    let hiding = |classes: &str| SceneFile::parse(&format!("[visibility]\nhidden_classes = {classes}\n")).unwrap();
    let mut request = Request::default();
    request.furnish(&hiding("[7, 18]"));
    request.furnish(&hiding("[2]"));
    assert_eq!(request.visibility.hidden_classes, [2, 7, 18].into());
    request.refurnish(&hiding("[]"));
    assert_eq!(request.visibility.hidden_classes, [2, 7, 18].into());
    request.refurnish(&hiding("[6]"));
    assert_eq!(request.visibility.hidden_classes, [6].into());
}

#[test]
fn mirrors_and_lights_of_a_scene_file_take_the_place_of_a_built_in_scenes_own() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let text = "clouds = [\"five-mirrors/all\"]\n[[mirrors]]\nname = \"torus\"\nshape = \"sphere\"\n\
                position = [0, 0, 0]\nsize = 0.2\n";
    std::fs::write(&scene, text).unwrap();
    let request = resolve(&words(&[scene.to_str().unwrap()]));
    assert_eq!((request.mirrors.len(), request.lights.len()), (1, 0));
    assert_eq!(request.built_in_light(), Some(five_mirrors::light()));
    let light = "[[lights]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nintensity = [1, 1, 1]\n\
                 inner_degrees = 20\nouter_degrees = 30\n";
    std::fs::write(&scene, format!("{text}{light}")).unwrap();
    let lit = resolve(&words(&[scene.to_str().unwrap()]));
    assert_eq!((lit.lights.len(), lit.built_in_light()), (1, None));
    let mut settings = scene::Settings::default();
    settings.scene.points = 10_000;
    let job = start(request.inputs, &settings, Default::default());
    let brought = job.events.iter().filter_map(|event| match event {
        Event::Mirror { mirror, .. } => Some(mirror.name),
        _ => None,
    });
    assert_eq!(brought.collect::<Vec<_>>(), ["sphere", "parabolic", "blob", "coral"]);
}

#[test]
fn a_word_that_names_nothing_leaves_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, "clouds = [\"gone.ply\", \"five-mirrors/torus\"]\n").unwrap();
    let request = resolve(&words(&["no_such.laz", scene.to_str().unwrap(), "no_such.toml"]));
    assert!(request.check().is_ok());
    let unknown = request.inputs.iter().map(|input| matches!(input, Input::Unknown { .. }));
    assert_eq!(unknown.collect::<Vec<_>>(), [true, true, false, true]);
    let beside = folder.path().join("scenes.toml");
    let missing = resolve(&words(&[beside.to_str().unwrap()])).check().unwrap_err().to_string();
    assert!(missing.contains("no such file or built-in scene; did you mean") && missing.contains("scene.toml"));
    let both = resolve(&words(&["no_such.laz", "no_such.ply"])).check().unwrap_err().to_string();
    assert!(both.contains("no_such.laz") && both.contains("no_such.ply"), "{both}");
}

#[test]
fn the_columns_of_a_table_are_named_as_the_scene_says() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.xyz", "b.xyz", "c.xyz"] {
        std::fs::write(folder.path().join(name), "1 2 3 4\n5 6 7 8\n").unwrap();
    }
    let scene = folder.path().join("scene.toml");
    let own = |name: &str, columns: &str| format!("[[cloud_settings]]\ncloud = \"{name}\"\ncolumns = \"{columns}\"\n");
    let (a, b) = (own("a.xyz", "intensity, x,y,z"), own("b.xyz", "x,y,intensity"));
    std::fs::write(&scene, format!("clouds = [\"a.xyz\", \"b.xyz\"]\n{a}{b}")).unwrap();
    let request = resolve(&[&scene]);
    let columns = |file: &str| {
        let source = codec::open(&folder.path().join(file)).unwrap();
        source.info().properties.iter().map(|property| property.name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(columns("a.xyz"), ["intensity", "x", "y", "z"]);
    assert_eq!(columns("b.xyz"), columns("c.xyz"), "names without a place are left out");
    assert_eq!(request.warnings.len(), 1);
    assert!(request.warnings[0].contains("b.xyz: columns are not those of the scene: no column z"));
}

#[test]
fn files_are_moved_as_the_scene_says_of_their_path_or_their_name() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ply", "b.ply", "c.ply"] {
        std::fs::write(folder.path().join(name), THREE_POINTS).unwrap();
    }
    let scene = folder.path().join("scene.toml");
    let own = |name: &str, x: u32| format!("[[cloud_settings]]\ncloud = \"{name}\"\nmove = [{x}, 0, 0]\n");
    let (a, b) = (own("a.ply", 1), own("b.ply", 2));
    std::fs::write(&scene, format!("clouds = [\"a.ply\", \"b.ply\", \"c.ply\"]\n{a}{b}")).unwrap();
    let mut request = resolve(&[&scene]);
    let moved = |request: &Request| -> Vec<Option<f64>> {
        let scans = request.files().into_iter().flat_map(|(input, file)| request.open(&input, &file, 1 << 30).unwrap());
        scans.map(|scan| Some(scan.info().placement?.point(glam::DVec3::ZERO).x)).collect()
    };
    assert_eq!(moved(&request), [Some(1.0), Some(2.0), None]);
    // Files of a folder whose places are unknown are clouds of their own.
    let tiles = |files: [&str; 2]| Input::Tiles {
        folder: folder.path().to_owned(),
        files: files.map(|name| folder.path().join(name)).into(),
    };
    request.inputs = vec![tiles(["b.ply", "c.ply"])];
    request.cloud_settings = vec![CloudSettings { shift: glam::DVec3::X, ..CloudSettings::of("c.ply".into()) }];
    assert_eq!(moved(&request), [None, Some(1.0)]);
    // Tiles beside one another are one cloud, unless nothing is streamed: then their names tell them apart.
    for name in ["b", "c"] {
        let source = Arc::new(codec::open(&folder.path().join(format!("{name}.ply"))).unwrap());
        let (path, progress) = (folder.path().join(format!("{name}.las")), cloud::Progress::default());
        codec::export(&[source], &Default::default(), &[], &path, 1 << 30, &progress).unwrap().unwrap();
    }
    request.inputs = vec![tiles(["b.las", "c.las"])];
    request.cloud_settings[0].cloud = "c.las".into();
    assert_eq!(moved(&request), [None, None]);
    assert_eq!(request.settings_without_cloud(1 << 30), ["cloud settings: no cloud is called `c.las`"]);
    let mut view = View { camera: None, settings: scene::Settings::default(), warnings: Vec::new() };
    view.settings.stream.pages = Paging::Never;
    request.view = Some(view);
    assert_eq!(moved(&request), [None, Some(1.0)]);
    assert!(request.settings_without_cloud(1 << 30).is_empty());
    request.view = None;
    for whole in [shown(folder.path()), file_name(folder.path())] {
        request.cloud_settings[0].cloud = whole;
        assert_eq!(moved(&request), [Some(1.0), Some(1.0)]);
        assert!(request.settings_without_cloud(1 << 30).is_empty());
    }
}

#[test]
fn clouds_of_a_folder_that_lie_apart_have_the_names_that_pictures_give_them() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    std::fs::create_dir(&tiles).unwrap();
    for (name, x) in [("a.las", 0), ("b.las", 1), ("c.las", 9000)] {
        let table = folder.path().join(format!("{name}.csv"));
        std::fs::write(&table, format!("x,y,z\n{x},0,0\n{},1,0\n{},2,1\n", x + 1, x + 2)).unwrap();
        let source = Arc::new(codec::open(&table).unwrap());
        let progress = cloud::Progress::default();
        codec::export(&[source], &Default::default(), &[], &tiles.join(name), 1 << 30, &progress).unwrap().unwrap();
    }
    let mut request = resolve(&[&tiles]);
    let job = start(request.inputs.clone(), &scene::Settings::default(), BTreeSet::new());
    let named = |event| if let Event::Opened { opened, .. } = event { Some(opened.name) } else { None };
    let names: Vec<String> = job.events.iter().filter_map(named).take(2).collect();
    drop(job);
    assert_eq!(names, ["tiles: a.las and 1 more", "c.las"]);
    let moved = |request: &Request| -> Vec<Option<f64>> {
        let scans = request.files().into_iter().flat_map(|(input, file)| request.open(&input, &file, 1 << 30).unwrap());
        scans.map(|scan| Some(scan.info().placement?.point(glam::DVec3::ZERO).x)).collect()
    };
    let own = |name: &str, x: f64| CloudSettings { shift: DVec3::X * x, ..CloudSettings::of(name.to_owned()) };
    request.cloud_settings = vec![own(&names[0], 1.0), own(&names[1], 2.0)];
    assert_eq!(moved(&request), [Some(1.0), Some(1.0), Some(2.0)]);
    assert!(request.settings_without_cloud(1 << 30).is_empty());
    // A cloud of a single file that is switched off by its name is left out, and only that.
    request.cloud_settings[1].on = false;
    request.leave_out_hidden(1 << 30).unwrap();
    assert_eq!(moved(&request), [Some(1.0), Some(1.0)]);
    request.cloud_settings.push(own("a.las", 3.0));
    assert_eq!(request.settings_without_cloud(1 << 30), ["cloud settings: no cloud is called `a.las`"]);
    // The group has the name of the folder, too, and is left out without the lone tile.
    let off = |name: &str| CloudSettings { on: false, ..CloudSettings::of(name.to_owned()) };
    let left = |of: &Request| {
        let mut request = of.clone();
        request.leave_out_hidden(1 << 30).map(|()| moved(&request).len())
    };
    request.cloud_settings = vec![off(&shown(&tiles))];
    assert_eq!(left(&request).unwrap(), 1);
    request.cloud_settings.push(off("c.las"));
    let error = left(&request).unwrap_err().to_string();
    assert!(error.ends_with("tiles: the scene hides all of its clouds"), "{error}");
    // Without streaming each tile is a cloud, and none is called as the folder.
    let mut view = View { camera: None, settings: scene::Settings::default(), warnings: Vec::new() };
    view.settings.stream.pages = Paging::Never;
    request.view = Some(view);
    assert_eq!(left(&request).unwrap(), 2);
    request.cloud_settings = ["a.las", "b.las", "c.las"].map(off).to_vec();
    assert!(left(&request).is_err());
    // The lone tile is a cloud of the folder, in whatever order both are named.
    for words in [[tiles.clone(), tiles.join("c.las")], [tiles.join("c.las"), tiles.clone()]] {
        let both = resolve(&words);
        assert!(matches!(&both.inputs[..], [Input::Tiles { .. }]), "{:?}", both.inputs);
        assert!(both.warnings[0].ends_with("c.las: named more than once, and opened once"));
    }
}

#[test]
fn folders_are_opened_for_their_names_only_if_settings_can_be_of_their_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    std::fs::create_dir(&tiles).unwrap();
    std::fs::write(folder.path().join("cloud.ply"), THREE_POINTS).unwrap();
    let source = Arc::new(codec::open(&folder.path().join("cloud.ply")).unwrap());
    let export = |name: &str, sources: &[Arc<codec::Source>]| {
        let progress = cloud::Progress::default();
        let path = folder.path().join(name);
        codec::export(sources, &Default::default(), &[], &path, 1 << 30, &progress).unwrap().unwrap();
    };
    for name in ["tiles/a.copc.laz", "tiles/b.copc.laz"] {
        export(name, std::slice::from_ref(&source));
    }
    let own = |name: &str, on: bool| CloudSettings { on, shift: DVec3::X, ..CloudSettings::of(name.to_owned()) };
    let mut request = resolve(&[tiles.clone(), folder.path().join("cloud.ply")]);
    let is_moved = |request: &Request| -> Vec<bool> {
        let scans = request.files().into_iter().flat_map(|(input, file)| request.open(&input, &file, 1 << 30).unwrap());
        scans.map(|scan| scan.info().placement.is_some()).collect()
    };
    request.cloud_settings = vec![own("cloud.ply", true), own("elsewhere", false)];
    assert_eq!(is_moved(&request), [false, false, true]);
    request.settings_without_cloud(1 << 30);
    request.leave_out_hidden(1 << 30).unwrap();
    let known = |request: &Request| -> Vec<(String, usize)> {
        let known = request.names.0.lock().unwrap();
        known.iter().map(|((input, ..), names)| (input.clone(), names.of_scans.len())).collect()
    };
    assert_eq!(known(&request), [(shown(folder.path().join("cloud.ply")), 1)]);
    // COPC files that are streamed as tiles are one cloud, which is called as the folder.
    request.cloud_settings = vec![own("tiles", true), own("a.copc.laz", true)];
    assert_eq!(is_moved(&request), [true, true, false]);
    assert_eq!(request.settings_without_cloud(1 << 30), ["cloud settings: no cloud is called `a.copc.laz`"]);
    assert!(known(&request).contains(&(shown(&tiles), 0)));
    // Scans of a file have names of their own, and the name of a file with several is none of a cloud.
    std::fs::write(folder.path().join("other.ply"), THREE_POINTS).unwrap();
    let other = Arc::new(codec::open(&folder.path().join("other.ply")).unwrap());
    export("two.e57", &[source, other]);
    let scans = open_file(&folder.path().join("two.e57"), 1 << 30).unwrap();
    let names: Vec<String> = scans.iter().map(|scan| scan.info().name()).collect();
    let mut request = resolve(&[folder.path().join("two.e57")]);
    request.cloud_settings = vec![own("two.e57", false)];
    request.leave_out_hidden(1 << 30).unwrap();
    assert_eq!(is_moved(&request), [false, false]);
    assert_eq!(request.settings_without_cloud(1 << 30), ["cloud settings: no cloud is called `two.e57`"]);
    request.cloud_settings = names.iter().map(|name| own(name, false)).collect();
    assert!(request.leave_out_hidden(1 << 30).is_err());
    request.cloud_settings[1].on = true;
    request.leave_out_hidden(1 << 30).unwrap();
    assert_eq!(is_moved(&request), [true]);
}

#[test]
fn settings_of_a_cloud_that_a_folder_stands_for_are_those_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("one")).unwrap();
    std::fs::write(folder.path().join("one/a.ply"), THREE_POINTS).unwrap();
    let scene = folder.path().join("scene.toml");
    let own = |name: &str| format!("[[cloud_settings]]\ncloud = \"{name}\"\nmove = [1, 0, 0]\n");
    let points = "[[mirror_points]]\ncloud = \"one\"\n";
    let (one, gone) = (own("one"), own("two"));
    std::fs::write(&scene, format!("clouds = [\"one\"]\n{one}{gone}on = false\n{points}")).unwrap();
    let request = resolve(&[&scene]);
    let file = shown(folder.path().join("one").join("a.ply"));
    assert_eq!([&request.cloud_settings[0].cloud, &request.mirror_points[0].cloud], [&file; 2]);
    let [(input, path)] = &request.files()[..] else { panic!("one file") };
    let scans = request.open(input, path, 1 << 30).unwrap();
    assert_eq!(scans[0].info().placement.unwrap().point(DVec3::ZERO), DVec3::X);
    // One that is no cloud's is told, also where it switches the cloud off.
    assert_eq!(request.settings_without_cloud(1 << 30), ["cloud settings: no cloud is called `two`"]);
    std::fs::write(&scene, format!("clouds = [\"one\", \"five-mirrors/none\"]\n{one}on = false\n")).unwrap();
    let mut hidden = resolve(&[&scene]);
    hidden.leave_out_hidden(1 << 30).unwrap();
    assert!(hidden.inputs.len() == 1 && hidden.settings_without_cloud(1 << 30).is_empty());
}

#[test]
fn what_is_named_again_is_opened_once() {
    let folder = tempfile::tempdir().unwrap();
    let (cloud, scene) = (folder.path().join("cloud.ply"), folder.path().join("scene.toml"));
    std::fs::write(&cloud, THREE_POINTS).unwrap();
    let many = "\"cloud.ply\", \"five-mirrors/torus\", ".repeat(450);
    std::fs::write(&scene, format!("clouds = [{many}]")).unwrap();
    let request = resolve(&[scene.as_os_str(), cloud.as_os_str()]);
    let torus = Input::BuiltIn { variant: five_mirrors::Variant::Torus, without: Vec::new() };
    assert_eq!(request.inputs, [Input::File(cloud), torus]);
    assert_eq!(request.warnings.len(), 2, "{:?}", request.warnings);
    assert!(request.warnings[0].ends_with("cloud.ply: named more than once, and opened once"));
}

#[test]
fn many_words_that_name_nothing_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let missing: String = (0..900).map(|index| format!("\"gone-{index}.laz\", ")).collect();
    std::fs::write(&scene, format!("clouds = [{missing}]")).unwrap();
    let request = resolve(&[&scene]);
    assert_eq!(request.inputs.len(), 900);
    let message = request.check().unwrap_err().to_string();
    assert!(message.contains("gone-0.laz") && message.contains("and 897 more that name nothing"), "{message}");
    assert!(message.len() < 1000, "{message}");
}

#[cfg(unix)]
#[test]
fn names_that_are_no_text_are_opened() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join(OsStr::from_bytes(b"sc\xe4ns"));
    std::fs::create_dir(&place).unwrap();
    let (cloud, scene) = (place.join(OsStr::from_bytes(b"w\xe4ld.ply")), place.join("scene.toml"));
    std::fs::write(&cloud, THREE_POINTS).unwrap();
    std::fs::write(place.join("plain.ply"), THREE_POINTS).unwrap();
    std::fs::write(&scene, "clouds = [\"plain.ply\"]").unwrap();
    assert_eq!(resolve(&[&cloud]).inputs, [Input::File(cloud)]);
    assert_eq!(resolve(&[&scene]).inputs, [Input::File(place.join("plain.ply"))]);
}

#[test]
fn words_that_name_nothing_are_refused_with_the_nearest_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("office.laz"), "").unwrap();
    let typo = folder.path().join("ofice.laz").display().to_string();
    assert!(message(&typo).contains("office.laz`?"), "{}", message(&typo));
    assert!(message("ftp://a/b.laz").ends_with("not an address of http or https"));
    assert!(message("five-mirrors/sphre").contains("did you mean `five-mirrors/sphere`?"));
    assert!(message("sphere").contains("did you mean `five-mirrors/sphere`?"));
    assert!(message("five-mirrors/teapot").contains("glint scenes"));
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    let empty = message(folder.path().join("empty").to_str().unwrap());
    assert!(empty.contains("empty: a folder without files of points ("), "{empty}");
    assert!(message("no_such_scene.toml").contains("no_such_scene.toml"));
}
