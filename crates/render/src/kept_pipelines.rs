//! The passes as the driver has compiled them, kept on disk from run to run where the adapter can hand them over. Most
//! drivers of desktops keep them on their own; the others compile for seconds at each start without this file. What is
//! read is not trusted: a checksum finds damage, and wgpu begins anew where adapter or driver are others.

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// No file of this program is larger; a larger one is not read.
const MOST_BYTES: u64 = 64 << 20;

pub(crate) struct KeptPipelines {
    pub cache: wgpu::PipelineCache,
    file: PathBuf,
    /// The checksum of what the file holds.
    saved: AtomicU32,
}

impl KeptPipelines {
    /// Opens what the folder holds for an adapter; `None` where the adapter hands nothing over.
    pub fn open(device: &wgpu::Device, info: &wgpu::AdapterInfo, folder: &Path) -> Option<Self> {
        if !device.features().contains(wgpu::Features::PIPELINE_CACHE) {
            return None;
        }
        let file = folder.join(wgpu::util::pipeline_cache_key(info)?);
        let kept = read(&file);
        let saved = AtomicU32::new(kept.as_ref().map_or(0, |data| crc32fast::hash(data)));
        Some(Self { cache: create(device, kept.as_deref()), file, saved })
    }

    /// Writes the file if something was compiled since. A file that cannot be written is no reason to stop.
    pub fn save(&self) {
        let Some(data) = self.cache.get_data() else { return };
        let checksum = crc32fast::hash(&data);
        if self.saved.swap(checksum, Ordering::Relaxed) != checksum
            && let Err(error) = write(&self.file, checksum, &data)
        {
            tracing::warn!("{}: {error}", self.file.display());
        }
    }
}

impl Drop for KeptPipelines {
    fn drop(&mut self) {
        self.save();
    }
}

#[expect(unsafe_code, reason = "wgpu leaves it to the caller that the data are those of an earlier cache")]
fn create(device: &wgpu::Device, data: Option<&[u8]>) -> wgpu::PipelineCache {
    let descriptor = wgpu::PipelineCacheDescriptor { label: Some("passes"), data, fallback: true };
    // SAFETY: the data come from a file with the right checksum in the program's own folder, and `save` writes only
    // what
    // `get_data` returned.
    unsafe { device.create_pipeline_cache(&descriptor) }
}

/// Reads what `write` has written; `None` if there is no such file or it is damaged.
fn read(file: &Path) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    std::fs::File::open(file).ok()?.take(MOST_BYTES).read_to_end(&mut bytes).ok()?;
    let (checksum, data) = bytes.split_first_chunk()?;
    (u32::from_le_bytes(*checksum) == crc32fast::hash(data)).then(|| data.to_vec())
}

/// Writes a file that is whole or as it was.
fn write(file: &Path, checksum: u32, data: &[u8]) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut temporary = tempfile::NamedTempFile::new_in(folder)?;
    temporary.write_all(&checksum.to_le_bytes())?;
    temporary.write_all(data)?;
    temporary.persist(file)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Gpu;

    #[test]
    fn what_is_kept_is_read_and_damage_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new/passes");
        assert_eq!(read(&file), None);
        write(&file, crc32fast::hash(b"compiled"), b"compiled").unwrap();
        assert_eq!(read(&file).as_deref(), Some(&b"compiled"[..]));
        let mut bytes = std::fs::read(&file).unwrap();
        for place in 0..bytes.len() {
            bytes[place] ^= 4;
            std::fs::write(&file, &bytes).unwrap();
            assert_eq!(read(&file), None, "byte {place}");
            bytes[place] ^= 4;
        }
        std::fs::write(&file, [7; 3]).unwrap();
        assert_eq!(read(&file), None);
    }

    #[test]
    fn data_of_another_program_are_not_used() {
        let Some(gpu) = Gpu::for_test() else { return };
        let folder = tempfile::tempdir().unwrap();
        let open = |gpu: &Gpu| KeptPipelines::open(&gpu.device, &gpu.info, folder.path());
        let Some(first) = open(&gpu) else { return println!("skipped: no pipeline cache") };
        let file = first.file.clone();
        drop(first);
        let written = read(&file).unwrap();
        assert!(!written.is_empty(), "wgpu's own header at least");
        // Another program's data with a right checksum.
        write(&file, crc32fast::hash(b"nonsense"), b"nonsense").unwrap();
        drop(open(&gpu).unwrap());
        let anew = read(&file).unwrap();
        assert!(anew != b"nonsense" && anew.len() >= written.len(), "it begins anew");
    }
}
