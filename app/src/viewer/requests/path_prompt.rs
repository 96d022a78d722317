//! The prompt that opens a file by its typed path, for desktops without a file dialog and for people who prefer the
//! keyboard. Tab completes the path.

use std::path::{Path, PathBuf};

use egui::{Key, Modifiers, RichText};

use crate::shared::language::text;
use crate::viewer::look::theme;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathPrompt {
    text: String,
    /// The paths that the text can be completed to, and the text that they were listed for.
    candidates: Vec<String>,
    listed: Option<String>,
    /// The reason to show, if the prompt came up by itself.
    reason: Option<&'static str>,
    pub purpose: Purpose,
    is_shown: bool,
    /// The text that was refused, and why.
    refused: Option<(String, Refusal)>,
}

/// Why nothing is saved under a name yet.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Refusal {
    NoFolder,
    /// Points have the format that the ending of their name says.
    Ending,
    /// The next Enter replaces a scene; a file of points is not replaced.
    IsThere,
}

/// What happens with the file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Purpose {
    #[default]
    Open,
    /// The file is opened, and its points will be a mirror.
    MirrorPoints,
    /// The file is opened, and its faces will be a mirror.
    Mesh,
    /// The scene is saved under this name.
    SaveScene,
    /// The points that are shown are saved under this name.
    SavePoints,
}

/// How the prompt ended.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    Open(String),
    Close,
}

/// Whether files with this ending, in lower case, are listed.
fn is_offered(ending: &str) -> bool {
    codec::Format::all_endings().chain(["toml"]).any(|known| known == ending)
}

/// The most candidates listed. To find a file in a folder of thousands, the user types more of its name.
const LISTED: usize = 200;

impl PathPrompt {
    /// A prompt that comes up by itself and shows why.
    pub fn because(reason: &'static str) -> Self {
        Self { reason: Some(reason), ..Self::default() }
    }

    /// A prompt for a file whose points will be a mirror.
    pub fn for_mirror_points() -> Self {
        Self { purpose: Purpose::MirrorPoints, ..Self::because(text!("The points of this file will be a mirror.")) }
    }

    /// A prompt for a mesh that will be a mirror.
    pub fn for_mesh() -> Self {
        Self { purpose: Purpose::Mesh, ..Self::because(text!("The faces of this PLY file will be a mirror.")) }
    }

    /// A prompt for the name of a scene file, which proposes one.
    pub fn to_save_scene(proposed: &Path, reason: &'static str) -> Self {
        Self { purpose: Purpose::SaveScene, text: proposed.display().to_string(), ..Self::because(reason) }
    }

    /// A prompt for the name of a file of the points that are shown, which proposes one.
    pub fn to_save_points(proposed: &Path, reason: &'static str) -> Self {
        Self { purpose: Purpose::SavePoints, ..Self::to_save_scene(proposed, reason) }
    }

    fn saves(&self) -> bool {
        matches!(self.purpose, Purpose::SaveScene | Purpose::SavePoints)
    }

    /// Draws the prompt. Returns how it ended, if it has.
    pub fn show(&mut self, context: &egui::Context) -> Option<Outcome> {
        let mut outcome = None;
        let mut is_open = true;
        let (title, help) = match self.purpose {
            Purpose::SaveScene => (text!("Save the scene"), text!("Tab completes, Enter saves, Esc closes")),
            Purpose::SavePoints => (
                text!("Save the points that are shown"),
                text!(".laz, .las, .copc.laz, .e57, .ply or .csv; Enter saves, Esc closes"),
            ),
            Purpose::Open => (text!("Open a file or an address"), text!("Tab completes, Enter opens, Esc closes")),
            _ => (text!("Open a file"), text!("Tab completes, Enter opens, Esc closes")),
        };
        egui::Window::new(title)
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 80.0])
            .show(context, |ui| {
                ui.set_width(520.0);
                if let Some(reason) = self.reason {
                    ui.label(RichText::new(reason).color(theme::WEAK));
                }
                outcome = self.field(ui);
                self.candidate_list(ui);
                if let Some((_, refusal)) = self.refused.as_ref().filter(|(text, _)| *text == self.text) {
                    let text = match (refusal, self.purpose) {
                        (Refusal::NoFolder, _) => text!("There is no such folder."),
                        (Refusal::Ending, _) => {
                            text!("The name must end in .laz, .las, .copc.laz, .e57, .ply or .csv.")
                        }
                        (_, Purpose::SavePoints) => text!("A file of this name is there, and is not replaced."),
                        _ => text!("A file of this name is there. Enter again replaces it."),
                    };
                    ui.label(RichText::new(text).color(theme::WARNING));
                }
                ui.label(RichText::new(help).small().color(theme::WEAK));
            });
        if is_open { outcome } else { Some(Outcome::Close) }
    }

    fn field(&mut self, ui: &mut egui::Ui) -> Option<Outcome> {
        let mut outcome = None;
        ui.horizontal(|ui| {
            let label = ui.label(text!("Path"));
            let completes = ui.input_mut(|input| input.consume_key(Modifiers::NONE, Key::Tab));
            let id = ui.scope_id().with("path");
            let field = egui::TextEdit::singleline(&mut self.text)
                .id(id)
                .hint_text(match self.purpose {
                    Purpose::Open => text!("/folder/scan.laz or https://host/scan.copc.laz"),
                    _ => text!("/folder/scan.laz"),
                })
                .desired_width(400.0)
                .lock_focus(true);
            let response = ui.add(field).labelled_by(label.id);
            // The response is read before the focus is requested below: Tab and Enter may come in one frame.
            let entered = response.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            if !self.is_shown {
                self.is_shown = true;
                response.request_focus();
            }
            if completes {
                self.list();
                self.text = completed(&self.text, &self.candidates);
                move_cursor_to_end(ui.ctx(), id, &self.text);
                response.request_focus();
            }
            if ui.button(if self.saves() { text!("Save") } else { text!("Open") }).clicked() || entered {
                outcome = Some(Outcome::Open(self.text.trim().to_string()));
            }
        });
        if ui.input(|input| input.key_pressed(Key::Escape)) {
            outcome = Some(Outcome::Close);
        }
        match outcome {
            // A folder is not opened: the prompt lists its files.
            Some(Outcome::Open(text)) if expanded(&text).is_dir() || text.is_empty() => {
                if !text.is_empty() && !text.ends_with('/') {
                    self.text = text + "/";
                }
                self.is_shown = false;
                None
            }
            Some(Outcome::Open(text)) => {
                // If the path names nothing, the prompt stays for another try.
                self.is_shown = false;
                if let Some(refusal) = self.saves().then(|| self.refusal(&text)).flatten() {
                    self.refused = Some((self.text.clone(), refusal));
                    return None;
                }
                Some(Outcome::Open(self.target(&text).display().to_string()))
            }
            other => other,
        }
    }

    /// The file that a text names. Scenes have an ending.
    fn target(&self, text: &str) -> PathBuf {
        let path = expanded(text);
        let has_ending = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
        if self.purpose != Purpose::SaveScene || has_ending {
            return path;
        }
        PathBuf::from(format!("{}.toml", path.display()))
    }

    /// Why nothing is saved under this name yet.
    fn refusal(&self, text: &str) -> Option<Refusal> {
        let path = self.target(text);
        if self.purpose == Purpose::SavePoints && codec::ExportFormat::of(&path).is_none() {
            return Some(Refusal::Ending);
        }
        if !has_folder(&path) {
            return Some(Refusal::NoFolder);
        }
        let is_told = self.refused.as_ref() == Some(&(self.text.clone(), Refusal::IsThere));
        (path.exists() && (self.purpose == Purpose::SavePoints || !is_told)).then_some(Refusal::IsThere)
    }

    fn candidate_list(&mut self, ui: &mut egui::Ui) {
        self.list();
        let mut chosen = None;
        egui::ScrollArea::vertical().max_height(220.0).auto_shrink([false, true]).show(ui, |ui| {
            for candidate in &self.candidates {
                let name = candidate.trim_end_matches('/').rsplit('/').next().unwrap_or(candidate);
                let is_folder = candidate.ends_with('/');
                let text = if is_folder { RichText::new(format!("{name}/")) } else { RichText::new(name).strong() };
                if ui.selectable_label(false, text).clicked() {
                    chosen = Some(candidate.clone());
                }
            }
        });
        if let Some(chosen) = chosen {
            self.text = chosen;
            self.is_shown = false;
        }
    }

    /// Lists the candidates again if the text has changed.
    fn list(&mut self) {
        if self.listed.as_ref() != Some(&self.text) {
            self.candidates = candidates(&self.text);
            self.listed = Some(self.text.clone());
        }
    }
}

fn move_cursor_to_end(context: &egui::Context, id: egui::Id, text: &str) {
    if let Some(mut state) = egui::text_edit::TextEditState::load(context, id) {
        let end = egui::text::CCursor::new(text.chars().count());
        state.cursor.set_char_range(Some(egui::text::CCursorRange::one(end)));
        state.store(context, id);
    }
}

/// Replaces a leading `~` by the home folder, as a shell does.
fn expanded(text: &str) -> PathBuf {
    match (text.strip_prefix("~/"), std::env::var_os("HOME")) {
        (Some(rest), Some(home)) => Path::new(&home).join(rest),
        _ => PathBuf::from(text),
    }
}

/// Whether the folder is there in which the file is to be.
fn has_folder(path: &Path) -> bool {
    path.parent().is_none_or(|folder| folder.as_os_str().is_empty() || folder.is_dir())
}

/// Folders (with a `/` at the end) and files that the program opens whose path begins with `text`, sorted, folders
/// first.
fn candidates(text: &str) -> Vec<String> {
    let (folder, start) = match text.rfind('/') {
        Some(slash) => text.split_at(slash + 1),
        None => ("", text),
    };
    let listed = if folder.is_empty() { PathBuf::from(".") } else { expanded(folder) };
    let mut folders = Vec::new();
    let mut files = Vec::new();
    for entry in std::fs::read_dir(listed).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_hidden = name.starts_with('.') && !start.starts_with('.');
        if is_hidden || !name.to_lowercase().starts_with(&start.to_lowercase()) {
            continue;
        }
        let path = entry.path();
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        if path.is_dir() {
            folders.push(format!("{folder}{name}/"));
        } else if extension.is_some_and(|extension| is_offered(&extension)) {
            files.push(format!("{folder}{name}"));
        }
    }
    folders.sort();
    files.sort();
    folders.append(&mut files);
    folders.truncate(LISTED);
    folders
}

/// The longest beginning that all candidates share, or `text` itself if there are none.
fn completed(text: &str, candidates: &[String]) -> String {
    let Some((first, rest)) = candidates.split_first() else { return text.to_string() };
    let mut shared = first.as_str();
    for other in rest {
        let matching = shared.char_indices().zip(other.chars()).find(|((_, a), b)| a != b);
        let end = matching.map_or(shared.len().min(other.len()), |((index, _), _)| index);
        shared = &shared[..end];
    }
    if shared.len() >= text.len() { shared.to_string() } else { text.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in ["office_1.laz", "office_2.LAZ", "notes.pdf", ".hidden.laz"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("outdoor")).unwrap();
        folder
    }

    #[test]
    fn tab_completes_as_far_as_the_names_agree() {
        let folder = folder();
        let start = format!("{}/", folder.path().display());
        let all = candidates(&start);
        let names: Vec<&str> = all.iter().map(|path| &path[start.len()..]).collect();
        assert_eq!(names, ["outdoor/", "office_1.laz", "office_2.LAZ"]);
        assert_eq!(completed(&start, &all), format!("{start}o"));
        let offices = candidates(&format!("{start}of"));
        assert_eq!(completed(&format!("{start}of"), &offices), format!("{start}office_"));
        assert_eq!(completed("nothing", &[]), "nothing");
    }

    #[test]
    fn a_scene_is_replaced_by_a_second_enter_only_and_points_neither_replace_a_file_nor_lose_their_path() {
        use egui_kittest::kittest::Queryable as _;
        let folder = folder();
        let proposed = folder.path().join("office_1.laz");
        let place = folder.path().join("office.toml");
        std::fs::write(&place, "").unwrap();
        let replaced = Some(Outcome::Open(place.display().to_string()));
        let named = folder.path().join("office");
        let scene = (PathPrompt::to_save_scene(&named, "No dialog."), "Enter again replaces it", replaced);
        let points = (PathPrompt::to_save_points(&proposed, "No dialog."), "is not replaced", None);
        let lost = folder.path().join("missing/office_1.laz");
        let missing = (PathPrompt::to_save_points(&lost, "No dialog."), "no such folder", None);
        let other = folder.path().join("office.xyz");
        let ending = (PathPrompt::to_save_points(&other, "No dialog."), "must end in .laz", None);
        for (prompt, told, ended) in [scene, points, missing, ending] {
            let mut harness = egui_kittest::Harness::builder().with_size([800.0, 500.0]).build_ui_state(
                |ui, (prompt, outcome): &mut (PathPrompt, Option<Outcome>)| {
                    if let Some(ended) = prompt.show(ui.ctx()) {
                        *outcome = Some(ended);
                    }
                },
                (prompt, None),
            );
            harness.run();
            harness.key_press(Key::Enter);
            harness.run();
            assert_eq!(harness.state().1, None);
            assert!(harness.query_by_label_contains(told).is_some(), "{told}");
            harness.key_press(Key::Enter);
            harness.run();
            assert_eq!(harness.state().1, ended);
        }
    }

    #[test]
    fn typing_a_path_with_tab_and_enter_opens_it() {
        let folder = folder();
        let mut harness = egui_kittest::Harness::builder().with_size([800.0, 500.0]).build_ui_state(
            |ui, (prompt, outcome): &mut (PathPrompt, Option<Outcome>)| {
                if let Some(ended) = prompt.show(ui.ctx()) {
                    *outcome = Some(ended);
                }
            },
            (PathPrompt::default(), None),
        );
        harness.run();
        harness.event(egui::Event::Text(format!("{}/office_1", folder.path().display())));
        harness.run();
        harness.key_press(Key::Tab);
        harness.key_press(Key::Enter);
        harness.run();
        let expected = folder.path().join("office_1.laz").display().to_string();
        assert_eq!(harness.state().1, Some(Outcome::Open(expected)));
    }
}
