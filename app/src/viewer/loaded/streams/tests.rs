use cloud::{Attribute, Chunk, Column, ColumnType, Grid};
use glam::DVec3;
use scene::MirrorPoints;
use stream::{NodeId, Octree};
use world::{Event, Opened};

use super::*;
use crate::viewer::bench::devices;
use crate::viewer::objects::Marking;
use crate::viewer::objects::figures::Figures;
use crate::viewer::picture::messages::{Command, PickPurpose, PickedPoint, Report};
use crate::viewer::requests::outside::Effect;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::requests::work::Found;
use crate::viewer::session::Session;

const GRID: Option<Grid> = Some(Grid::new(DVec3::splat(0.01), DVec3::ZERO));

/// A root of two points with two children of three points each. The first child has no points of its own; its child
/// holds all three.
fn octree() -> Octree {
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(8.0) };
    let node = |level, points, total, first_point, parent: Option<u32>| stream::Node {
        level,
        bounds,
        points,
        is_exact: false,
        total,
        first_point,
        parent: parent.map(NodeId),
        children: [None; 8],
    };
    let mut nodes =
        vec![node(0, 2, 8, 0, None), node(1, 0, 3, 2, Some(0)), node(2, 3, 3, 2, Some(1)), node(1, 3, 3, 5, Some(0))];
    (nodes[0].children[0], nodes[0].children[7], nodes[1].children[0]) =
        (Some(NodeId(1)), Some(NodeId(3)), Some(NodeId(2)));
    Octree::new(DVec3::ZERO, 8.0, 1.0, nodes)
}

fn chunk(first_point: u64, places: &[f32]) -> Chunk {
    let mut chunk = Chunk::new(first_point, DVec3::ZERO, places.iter().map(|at| [*at; 3]).collect());
    chunk.columns = vec![Some(Arc::new(Column::U8(places.iter().map(|at| *at as u8).collect())))];
    chunk
}

fn put(session: &mut Session, node: u32, places: &[f32]) {
    let first_point = octree().nodes[node as usize].first_point;
    let chunk = chunk(first_point, places);
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Chunk { cloud: 0, part: Part::Node(NodeId(node)), chunk }, beside)
    });
}

fn drop_chunk(session: &mut Session, node: u32) {
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Dropped { cloud: 0, part: Part::Node(NodeId(node)) }, beside)
    });
}

fn opened(attributes: Vec<Attribute>) -> Event {
    let (name, input) = ("survey".into(), "survey".into());
    let opened = Opened { name, input, attributes, expected_points: 9, up: DVec3::Z, ..Opened::default() };
    Event::Opened { cloud: 0, opened }
}

/// A session with a streamed cloud of job 0, whose index exists, and the chunk of its root.
fn streamed() -> Session {
    let mut session = Session::new(Preferences::default());
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    let intensity = Attribute { name: "intensity".into(), column_type: ColumnType::U8 };
    session.with_loaded(|loaded, beside| loaded.on_loading(0, opened(vec![intensity.clone()]), beside));
    let pages = IndexState::Indexed {
        octree: Arc::new(octree()),
        attributes: vec![intensity],
        grid: GRID,
        was_built: false,
        has_surfels: true,
        entry: None,
    };
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Pages { cloud: 0, pages }, beside));
    put(&mut session, 0, &[1.0, 7.0]);
    session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
    session
}

/// Reports that all points for the last view are loaded.
fn settle(session: &mut Session) {
    session.with_loaded(Loaded::look_around);
    let stats = StreamStats { view_number: session.loaded.jobs[0].look, is_settled: true, ..StreamStats::default() };
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(stats), beside));
}

fn commands(session: &mut Session) -> Vec<Change> {
    let effects = std::mem::take(&mut session.outside.effects).into_iter();
    let change = |effect| if let Effect::Render(Command::Change(change)) = effect { Some(change) } else { None };
    effects.filter_map(change).collect()
}

#[test]
fn points_and_bounds_are_counted_right_while_chunks_come_change_and_go() {
    let mut session = Session::new(Preferences::default());
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    session.with_loaded(|loaded, beside| loaded.on_loading(0, opened(Vec::new()), beside));
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Pages { cloud: 0, pages: IndexState::Indexing }, beside)
    });
    put(&mut session, 0, &[1.0]);
    put(&mut session, 3, &[2.0, 6.0, 8.0]);
    put(&mut session, 0, &[1.0, 3.0]);
    let revision = session.frames.revision;
    assert_eq!(
        (session.loaded.clouds[0].points, session.loaded.points(), session.loaded.clouds[0].cloud.len()),
        (5, 5, 5)
    );
    assert_eq!(session.bounds().max, DVec3::splat(8.0));
    drop_chunk(&mut session, 3);
    assert_eq!((session.loaded.clouds[0].points, session.loaded.clouds[0].cloud.len()), (2, 2));
    assert_eq!((session.bounds().min, session.bounds().max), (DVec3::ONE, DVec3::splat(3.0)));
    assert!(session.frames.revision > revision && session.loaded.clouds[0].chunk_bounds().len() == 1);
    let removed = |command: &Change| matches!(command, Change::TakeOut { key } if key.part == Part::Node(NodeId(3)));
    assert_eq!(commands(&mut session).iter().filter(|command| removed(command)).count(), 1);
    let revision = session.frames.revision;
    drop_chunk(&mut session, 3);
    assert!(commands(&mut session).is_empty() && session.frames.revision == revision, "it has gone already");
}

#[test]
fn what_is_drawn_first_has_its_colours() {
    let mut session = streamed();
    let sent = commands(&mut session);
    let chunk = sent.iter().position(|command| matches!(command, Change::Put { .. }));
    let color = sent.iter().position(
        |command| matches!(command, Change::Color { plan, .. } if plan.source == render::ColorSource::Column(0)),
    );
    assert!(chunk.is_some() && color > chunk, "{chunk:?}, {color:?}");
    put(&mut session, 3, &[2.0, 3.0, 4.0]);
    assert!(!commands(&mut session).iter().any(|command| matches!(command, Change::Color { .. })));
}

#[test]
fn points_take_no_more_of_the_gpu_than_they_may() {
    let Some([_, gpu]) = devices() else { return };
    let mut settings = Settings::default();
    settings.stream.gpu_bytes.0 = 96 << 20;
    let points = most_points(&settings.view, &settings.stream);
    let mut store = render::PointStore::new(gpu);
    store.reserve(points);
    let cloud = store.add_cloud(render::Material::default());
    // Chunks of this size are as large as small nodes.
    let chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 10_001]);
    for _ in 0..points / chunk.len() as u64 {
        store.add_chunk(cloud, &chunk, None).unwrap();
    }
    // Without spare room a point takes 48 bytes. This store holds 24 of them, because it has no attribute and no
    // mirrors.
    let bytes = store.gpu_bytes() * 2;
    // Memory is allocated in units of this many points.
    let grain = 48 << 18;
    assert!(bytes <= settings.stream.gpu_bytes.0 + grain, "{bytes}");
    assert!(bytes > settings.stream.gpu_bytes.0 / 2, "{bytes}: much less than it may be");
}

#[test]
fn bounds_and_number_of_a_streamed_cloud_are_those_of_its_index() {
    let mut session = streamed();
    assert_eq!(session.bounds(), octree().nodes[0].bounds);
    put(&mut session, 3, &[2.0, 3.0, 4.0]);
    drop_chunk(&mut session, 0);
    assert_eq!(session.bounds(), octree().nodes[0].bounds);
    assert_eq!((session.loaded.points(), session.loaded.all_points(), session.loaded.clouds[0].total()), (3, 8, 8));
    assert_eq!(session.document.title(false, &session.loaded), "survey - 8 points - glint");
    let room = |session: &mut Session| {
        let commands = commands(session).into_iter();
        commands.filter_map(|command| if let Change::Expect { points } = command { Some(points) } else { None }).last()
    };
    assert_eq!(room(&mut session), Some(8), "no more room is made than all points take");
    session.scene.settings.view.point_budget = 4;
    session.with_loaded(Loaded::look_around);
    assert_eq!(room(&mut session), Some(4), "nor than may be there");
    session.with_loaded(Loaded::look_around);
    assert_eq!(room(&mut session), None);
}

#[test]
fn a_streamed_cloud_is_loaded_with_its_first_look_and_at_rest_with_its_last() {
    let mut session = streamed();
    assert!(session.loaded.is_loading() && session.loaded.points_come());
    settle(&mut session);
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Read { cloud: 0, summary: codec::Summary::default() }, beside)
    });
    assert!(!session.loaded.is_loading() && !session.loaded.points_come());
    assert!(session.loaded.soon_changes(), "the light is searched for");
    let asked = session.loaded.light_search.ask();
    session.loaded.light_search.answer(asked, Default::default());
    session.loaded.clouds.iter_mut().for_each(|entry| entry.figures_under_way = false);
    assert!(!session.loaded.soon_changes());
    assert!(session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::FindSurroundings { .. }))));
    session.scene.camera.eye += DVec3::ONE;
    session.with_loaded(Loaded::look_around);
    assert!(!session.loaded.is_loading() && session.loaded.points_come() && session.loaded.soon_changes());
    let late = StreamStats { view_number: session.loaded.jobs[0].look - 1, is_settled: true, ..StreamStats::default() };
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(late), beside));
    assert!(session.loaded.points_come(), "that is about an earlier look");
    settle(&mut session);
    assert!(!session.loaded.points_come() && !session.loaded.soon_changes());
    let rests = |session: &Session| session.loaded.clouds[0].streamed.as_ref().unwrap().rests;
    assert_eq!(rests(&session), 2);
    // What could not be read is asked for again, in vain and then not.
    let view_number = session.loaded.jobs[0].look;
    for (points_resident, expected) in [(0, 2), (7, 3)] {
        for is_settled in [false, true] {
            let stats = StreamStats { view_number, is_settled, points_resident, ..StreamStats::default() };
            session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(stats), beside));
        }
        assert_eq!(rests(&session), expected);
    }
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Finished, beside));
    assert!(session.loaded.jobs.is_empty() && session.loaded.clouds.len() == 1);
}

#[test]
fn ramp_and_camera_of_a_catalogue_are_those_of_its_first_look_and_not_of_the_tiles_that_come_first() {
    // Of two tiles, as many are open.
    let pages = |open: u32| {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(8.0) };
        let root = stream::Node { points: 0, total: 16, children: [None; 8], ..octree().nodes[0].clone() };
        let mut catalogue = Octree::new(DVec3::ZERO, 8.0, 1.0, vec![root]);
        catalogue.paged.tiles = (0..open).map(|tile| (tile, Arc::new(octree()))).collect();
        catalogue.paged.unread = (open..2).map(|tile| ((NodeId(tile), 0), bounds)).collect();
        let attributes = vec![Attribute { name: "intensity".into(), column_type: ColumnType::U8 }];
        let (octree, entry) = (Arc::new(catalogue), None);
        let pages = IndexState::Indexed { octree, attributes, grid: GRID, was_built: false, has_surfels: true, entry };
        Event::Pages { cloud: 0, pages }
    };
    let told = |session: &mut Session, event: Event| {
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, event, beside);
            loaded.look_around(beside);
        });
    };
    let mut session = Session::new(Preferences::default());
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    told(&mut session, opened(vec![Attribute { name: "intensity".into(), column_type: ColumnType::U8 }]));
    let put = |session: &mut Session, tile: u32, places: &[f32]| {
        let (part, chunk) = (Part::Tile(tile, NodeId(0)), chunk(u64::from(tile) * 8, places));
        told(session, Event::Chunk { cloud: 0, part, chunk });
    };
    let found = |session: &mut Session| {
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, kept }) = effect {
                let new = Figures::of(&cloud, &basis.color, &basis.test, up);
                let figures = kept.map_or(new, |kept| kept.recounted(&cloud, &basis.test, up));
                session.on_found(Found::Figures { key, basis, figures: Box::new(figures) });
            }
        }
        let figures = session.loaded.clouds[0].figures.as_ref().unwrap();
        (figures.bounds.max.x, figures.plan.full_range.1)
    };
    session.scene.settings.set_text("color.by", "height").unwrap();
    told(&mut session, pages(0));
    told(&mut session, pages(1));
    put(&mut session, 0, &[1.0, 2.0]);
    assert_eq!(found(&mut session), (2.0, 2.0));
    told(&mut session, pages(2));
    put(&mut session, 1, &[6.0, 7.0]);
    assert_eq!(session.loaded.jobs[0].look, 0, "no view is asked for before the first look is whole");
    told(&mut session, Event::Read { cloud: 0, summary: codec::Summary::default() });
    assert!(session.loaded.jobs[0].look > 0);
    assert_eq!(found(&mut session), (7.0, 7.0));
    // What a view shows changes them no more.
    put(&mut session, 0, &[1.0, 2.0, 8.0]);
    settle(&mut session);
    assert_eq!(found(&mut session), (7.0, 7.0));
    // Whoever moves the camera does not wait for it, and no later view does.
    let mut session = Session::new(Preferences::default());
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    told(&mut session, opened(Vec::new()));
    told(&mut session, pages(1));
    assert_eq!(session.loaded.jobs[0].look, 0);
    session.scene.navigation.camera_moved(session.outside.now);
    session.with_loaded(Loaded::look_around);
    let first = session.loaded.jobs[0].look;
    session.outside.now += std::time::Duration::from_secs(9);
    session.scene.camera.eye += DVec3::ONE;
    session.with_loaded(Loaded::look_around);
    assert!(first > 0 && session.loaded.jobs[0].look > first);
}

#[test]
fn a_streamed_point_is_picked_with_all_that_its_page_holds_and_no_record_is_looked_up() {
    let mut session = streamed();
    put(&mut session, 3, &[2.0, 3.251, 4.0]);
    commands(&mut session);
    let point = Some(PickedPoint { chunk: session.loaded.clouds[0].key.chunk(Part::Node(NodeId(3))), index: 1 });
    session.on_report(Report::Picked { pixel: [0, 0], purpose: PickPurpose::Select, point });
    let pick = session.tools.pick.as_ref().unwrap();
    assert_eq!((pick.world, pick.is_streamed), (DVec3::splat(3.25), true));
    assert_eq!(pick.record, Some(Ok(vec![("intensity".to_string(), "3".to_string())])));
    assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::ReadRecord { .. }))));
}

#[test]
fn a_ramp_stays_while_chunks_come_and_go_and_the_histogram_counts_what_is_there() {
    let mut session = streamed();
    session.scene.settings.color.by = scene::ColorBy::Height;
    let found = |session: &mut Session| {
        session.with_loaded(Loaded::renew_figures);
        let effects = std::mem::take(&mut session.outside.effects);
        let asked = effects.into_iter().find_map(|effect| match effect {
            Effect::Work(Work::FindFigures { key, cloud, basis, up, kept, .. }) => Some((key, cloud, basis, up, kept)),
            _ => None,
        });
        let Some((key, cloud, basis, up, kept)) = asked else { return false };
        let figures = match kept {
            Some(kept) => kept.recounted(&cloud, &basis.test, up),
            None => crate::viewer::objects::figures::Figures::of(&cloud, &basis.color, &basis.test, up),
        };
        session.on_found(Found::Figures { key, basis, figures: Box::new(figures) });
        true
    };
    assert!(found(&mut session));
    let counted = |session: &Session| session.loaded.clouds[0].figures.as_ref().unwrap().histogram.iter().sum::<u32>();
    let plan = session.loaded.clouds[0].figures.as_ref().unwrap().plan.clone();
    assert_eq!(counted(&session), 2);
    put(&mut session, 3, &[2.0, 3.0, 4.0]);
    drop_chunk(&mut session, 0);
    put(&mut session, 2, &[6.0]);
    settle(&mut session);
    commands(&mut session);
    assert!(found(&mut session), "what is there is counted when it is complete");
    assert_eq!(session.loaded.clouds[0].figures.as_ref().unwrap().plan, plan);
    assert_eq!(counted(&session), 4);
    assert!(!commands(&mut session).iter().any(|command| matches!(command, Change::Color { .. })));
    session.scene.settings.color.high = 0.5;
    assert!(found(&mut session) && session.loaded.clouds[0].figures.as_ref().unwrap().plan != plan);
}

#[test]
fn levels_are_shown_of_what_is_there_and_of_what_comes_and_end() {
    let mut session = streamed();
    session.scene.settings.stream.overlay = true;
    commands(&mut session);
    session.with_loaded(Loaded::sync_levels);
    put(&mut session, 2, &[6.0, 6.5, 7.0]);
    let tints: Vec<_> = commands(&mut session)
        .into_iter()
        .filter_map(|command| if let Change::Tint { tints } = command { Some(tints) } else { None })
        .flatten()
        .collect();
    assert_eq!(tints.iter().map(|(key, _)| key.part).collect::<Vec<_>>(), [0, 2].map(|node| Part::Node(NodeId(node))));
    assert!(tints[0].1.is_some() && tints[1].1.is_some() && tints[0].1 != tints[1].1, "{tints:?}");
    let boxes = session.loaded.clouds[0].shown_boxes();
    assert_eq!(boxes.len(), 2, "the node between them is not there, so the root is the last above");
    session.scene.settings.stream.overlay = false;
    session.with_loaded(Loaded::sync_levels);
    let ends = |command: &Change| matches!(command, Change::Tint { tints } if tints.len() == 2 && tints.iter().all(|(_, tint)| tint.is_none()));
    assert!(commands(&mut session).iter().any(ends));
}

#[test]
fn points_of_a_streamed_cloud_are_no_mirror_and_that_is_said() {
    let mut session = streamed();
    settle(&mut session);
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Read { cloud: 0, summary: codec::Summary::default() }, beside)
    });
    let key = session.loaded.clouds[0].key;
    session.scene.edit_objects(session.outside.now, |objects| {
        objects.markings.push(Marking { key, points: MirrorPoints::whole("survey".into()) })
    });
    session.with_loaded(Loaded::sync_objects);
    assert!(session.scene.objects.markings.is_empty());
    assert!(!session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::MarkPoints { .. }))));
    assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("stream.pages")));
}

#[test]
fn an_attribute_of_the_file_is_asked_for_when_colours_or_filters_need_it() {
    let mut session = Session::new(Preferences::default());
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    let time = Attribute { name: "gps_time".into(), column_type: ColumnType::U8 };
    let Event::Opened { cloud, mut opened } = opened(Vec::new()) else { panic!("it is opened") };
    opened.offered = vec![time.clone()];
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Opened { cloud, opened }, beside));
    let page = |session: &mut Session, attributes: Vec<Attribute>| {
        let entry = Some(world::IndexEntry { folder: "/cache/0123".into(), bytes: 1 });
        let (octree, grid) = (Arc::new(octree()), GRID);
        let pages = IndexState::Indexed { octree, attributes, grid, was_built: false, has_surfels: true, entry };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Pages { cloud: 0, pages }, beside));
    };
    page(&mut session, Vec::new());
    settle(&mut session);
    let said = |session: &Session| {
        let texts = session.outside.messages.all.iter().map(|message| message.text.as_str());
        texts.filter(|text| text.contains("made again, with gps_time")).count()
    };
    let look = session.loaded.jobs[0].look;
    assert_eq!((said(&session), session.loaded.clouds[0].awaited.len()), (0, 0));
    session.scene.settings.color.by = scene::ColorBy::GpsTime;
    settle(&mut session);
    session.scene.settings.color.low = 0.1;
    settle(&mut session);
    assert!(session.loaded.jobs[0].look > look, "a view that asks for more is another one");
    assert_eq!((said(&session), session.loaded.clouds[0].awaited.as_slice()), (1, &["gps_time".to_owned()][..]));
    let before = session.loaded.clouds[0].paged_columns();
    page(&mut session, vec![time]);
    put(&mut session, 0, &[1.0, 7.0]);
    settle(&mut session);
    assert!(session.loaded.clouds[0].awaited.is_empty());
    assert_eq!((before, session.loaded.clouds[0].paged_columns()), (0, 1), "then its colours are found");
}

#[test]
fn what_is_opened_later_gets_half_until_it_tells_what_it_needs() {
    let mut session = streamed();
    session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    session.loaded.jobs[1].has_streamed = true;
    settle(&mut session);
    assert_eq!([session.loaded.jobs[0].share, session.loaded.jobs[1].share], [0.5, 0.5]);
    for (job, demand) in [(0, 0.01), (1, 1.0)] {
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(job, Event::Stream(StreamStats { demand, ..StreamStats::default() }), beside)
        });
    }
    session.with_loaded(Loaded::look_around);
    assert!(session.loaded.jobs[0].share < 0.1 && session.loaded.jobs[1].share > 0.9);
}

#[test]
fn a_hidden_cloud_is_not_looked_at() {
    let mut session = streamed();
    settle(&mut session);
    let (key, look) = (session.loaded.clouds[0].key, session.loaded.jobs[0].look);
    session.with_loaded(|loaded, beside| loaded.set_visible(key, false, beside));
    session.with_loaded(Loaded::look_around);
    assert!(session.loaded.jobs[0].look > look, "that is another look");
    assert_eq!(session.loaded.hidden(&session.loaded.jobs[0]), BTreeSet::from([0]));
    session.with_loaded(|loaded, beside| loaded.set_visible(key, true, beside));
    session.with_loaded(Loaded::look_around);
    assert!(session.loaded.hidden(&session.loaded.jobs[0]).is_empty());
}
