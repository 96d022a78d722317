//! Where a frame's time goes: every pass, the counts and the memory.

use egui::{Align, Layout, RichText, Ui};
use render::Clock;

use super::state::State;
use super::theme::{self, bytes, grouped};

pub fn show(ui: &mut Ui, state: &State) {
    let Some(shown) = &state.shown else {
        ui.label(RichText::new("No frame yet.").color(theme::WEAK));
        return;
    };
    let stats = &shown.stats;
    let clock = match stats.clock {
        Clock::Gpu => "GPU clock",
        Clock::Host => "host clock (this adapter's own is not to be trusted)",
    };
    let longest = stats.passes.iter().map(|pass| pass.milliseconds).fold(f64::MIN_POSITIVE, f64::max);
    for pass in &stats.passes {
        row(ui, pass.name, &format!("{:.2} ms", pass.milliseconds), Some((pass.milliseconds / longest) as f32));
    }
    ui.separator();
    row(ui, "Frame", &format!("{:.1} ms", stats.frame_milliseconds), None);
    row(ui, "With transfer", &format!("{:.1} ms", shown.total_milliseconds), None);
    let [width, height] = shown.request.size;
    row(ui, "Picture", &format!("{width} × {height}"), None);
    ui.label(RichText::new(clock).small().color(theme::WEAK));
    if shown.request.hurried {
        ui.label(RichText::new("Nearest point while moving, refined at rest").small().color(theme::ACCENT));
    }
    ui.separator();
    let loaded: u64 = state.clouds.iter().map(|entry| entry.points).sum();
    let total: u64 = state.clouds.iter().map(|entry| entry.expected_points.max(entry.points)).sum();
    row(ui, "Points drawn", &grouped(stats.points_drawn), None);
    row(ui, "On the GPU", &grouped(stats.points_resident), None);
    row(ui, "Loaded", &grouped(loaded), None);
    row(ui, "In the files", &grouped(total), None);
    ui.separator();
    let points: usize = state.clouds.iter().map(|entry| entry.cloud.size_in_bytes()).sum();
    row(ui, "GPU memory", &bytes(stats.gpu_bytes), None);
    row(ui, "Points in memory", &bytes(points as u64), None);
    if let Some(resident) = host_memory() {
        row(ui, "Program", &bytes(resident), None);
    }
    if let Some(adapter) = &state.adapter {
        ui.label(RichText::new(adapter).small().color(theme::WEAK));
    }
}

/// Name left, figure right; a bar behind them for a share of the longest.
fn row(ui: &mut Ui, name: &str, figure: &str, share: Option<f32>) {
    let (rect, _) = ui.allocate_exact_size(egui::vec2(ui.available_width(), 17.0), egui::Sense::hover());
    if let Some(share) = share {
        let bar = egui::Rect::from_min_size(rect.min, egui::vec2(rect.width() * share.clamp(0.0, 1.0), rect.height()));
        ui.painter().rect_filled(bar, 2.0, theme::ACCENT.gamma_multiply(0.16));
    }
    let mut child = ui.new_child(egui::UiBuilder::new().max_rect(rect.shrink2(egui::vec2(4.0, 0.0))));
    child.with_layout(Layout::left_to_right(Align::Center), |ui| {
        ui.label(RichText::new(name).size(12.0));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.label(RichText::new(figure).monospace().size(11.5));
        });
    });
}

/// Resident memory of this process, bytes; `None` where the system does not tell as Linux does.
fn host_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes * 1024)
}
