use std::path::Path;

use cloud::{Chunk, Progress};

use crate::{Info, Result, Selection, Summary};

pub struct PlySource {
    info: Info,
}

impl PlySource {
    pub fn open(_path: &Path) -> Result<Self> {
        todo!()
    }

    pub fn info(&self) -> &Info {
        &self.info
    }

    pub fn read(
        &self,
        _selection: &Selection,
        _progress: &Progress,
        _emit: &(dyn Fn(Chunk) + Sync),
    ) -> Result<Summary> {
        todo!()
    }

    pub fn record(&self, _point: u64) -> Result<Vec<(String, String)>> {
        todo!()
    }

    pub fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        todo!()
    }
}
