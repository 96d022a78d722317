//! AV1 in MP4: rav1e encodes the pictures, and a table in front of them lets players begin before they have the whole
//! file.

use std::io::{Seek, SeekFrom, Write};
use std::num::NonZeroU32;

use rav1e::prelude::{
    ChromaSamplePosition, ChromaSampling, ColorDescription, ColorPrimaries, Config, Context, EncoderConfig,
    EncoderStatus, FrameType, InvalidConfig, MatrixCoefficients, PixelRange, Rational, SceneDetectionSpeed,
    TransferCharacteristics,
};
use shiguredo_mp4::TrackKind;
use shiguredo_mp4::bitstream::av1::{
    Av1ObuParseContext, Av1ObuType, Av1SampleEntryConfig, build_av01_box_from_config_obus, parse_obus,
};
use shiguredo_mp4::boxes::SampleEntry;
use shiguredo_mp4::mux::{Mp4FileMuxer, Mp4FileMuxerOptions, Sample, estimate_maximum_moov_box_size};

use crate::yuv::Planes;
use crate::{Error, Result};

/// The encoder's preset, 0 (small files) to 10 (fast). Without assembler code a picture of 1280x720 takes a core 0.6 s at
/// 10, and several seconds at 9.
const SPEED: u8 = 10;
/// The quantizer, 0 (lossless) to 255; rav1e's own is 100. Points are small and sharp: in a film through the scan of an
/// office this one gives luma 35.8 dB, and 40.8 dB in its first picture.
const QUANTIZER: usize = 80;
/// The pixels of a tile. Tiles are encoded at the same time, and their number must not depend on the machine.
const TILE_PIXELS: usize = 230_400;
/// The longest time between two pictures that players can jump to, in seconds.
const SECONDS_TO_KEY: u32 = 2;
/// What begins each packet of an encoder, and is left out in MP4: a temporal delimiter.
const DELIMITER: [u8; 2] = [0x12, 0x00];

/// Checks that the encoder makes films of this size and rate.
///
/// # Errors
/// It does not.
pub fn check(size: [u32; 2], fps: u32) -> Result<()> {
    config(size, fps).validate().map_err(refused)
}

fn refused(reason: InvalidConfig) -> Error {
    Error::Encoder { reason: reason.to_string() }
}

/// The encoder's settings.
fn config([width, height]: [u32; 2], fps: u32) -> Config {
    let mut config = EncoderConfig::with_speed_preset(SPEED);
    (config.width, config.height) = (width as usize, height as usize);
    config.time_base = Rational::new(1, u64::from(fps));
    config.chroma_sampling = ChromaSampling::Cs420;
    config.chroma_sample_position = ChromaSamplePosition::Unknown;
    config.pixel_range = PixelRange::Limited;
    config.color_description = Some(ColorDescription {
        color_primaries: ColorPrimaries::BT709,
        transfer_characteristics: TransferCharacteristics::BT709,
        matrix_coefficients: MatrixCoefficients::BT709,
    });
    config.quantizer = QUANTIZER;
    (config.min_key_frame_interval, config.max_key_frame_interval) = (0, u64::from(fps * SECONDS_TO_KEY));
    config.tiles = (config.width * config.height / TILE_PIXELS).max(1);
    config.speed_settings.scene_detection_mode = SceneDetectionSpeed::None;
    Config::new().with_encoder_config(config)
}

/// A film that is being written.
pub struct Mp4<File> {
    file: File,
    encoder: Context<u8>,
    muxer: Mp4FileMuxer,
    fps: NonZeroU32,
    size: [usize; 2],
    /// Where the next packet goes in the file.
    end: u64,
    is_begun: bool,
}

impl<File: Write + Seek> Mp4<File> {
    /// Begins a film of `count` pictures.
    ///
    /// # Errors
    /// The encoder cannot make pictures of this size, or the file cannot be written.
    pub fn new(mut file: File, size: [u32; 2], fps: u32, count: usize) -> Result<Self> {
        let encoder = config(size, fps).new_context().map_err(refused)?;
        let options = Mp4FileMuxerOptions {
            reserved_moov_box_size: estimate_maximum_moov_box_size(&[count]),
            ..Mp4FileMuxerOptions::default()
        };
        let muxer = Mp4FileMuxer::with_options(options).map_err(Error::muxer)?;
        file.write_all(muxer.initial_boxes_bytes())?;
        let end = muxer.initial_boxes_bytes().len() as u64;
        let fps = NonZeroU32::new(fps).unwrap_or(NonZeroU32::MIN);
        let size = size.map(|side| side as usize);
        Ok(Self { file, encoder, muxer, fps, size, end, is_begun: false })
    }

    /// Adds a picture: rows of sRGB red, green and blue, the top row first.
    ///
    /// # Errors
    /// The encoder fails, or the file cannot be written.
    pub fn add(&mut self, rgb: &[u8]) -> Result<()> {
        let mut frame = self.encoder.new_frame();
        let planes = Planes::from_rgb(rgb, self.size);
        let (luma, chroma) = (self.size[0], self.size[0].div_ceil(2));
        for (plane, (values, width)) in
            frame.planes.iter_mut().zip([(&planes.y, luma), (&planes.u, chroma), (&planes.v, chroma)])
        {
            plane.copy_from_raw_u8(values, width, 1);
        }
        self.encoder.send_frame(frame).map_err(Error::encoder)?;
        self.take_packets()
    }

    /// Ends the film, and returns its file.
    ///
    /// # Errors
    /// The encoder fails, or the file cannot be written.
    pub fn end(mut self) -> Result<File> {
        self.encoder.flush();
        self.take_packets()?;
        let boxes = self.muxer.finalize().map_err(Error::muxer)?;
        for (offset, bytes) in boxes.offset_and_bytes_pairs() {
            self.file.seek(SeekFrom::Start(offset))?;
            self.file.write_all(bytes)?;
        }
        Ok(self.file)
    }

    /// Writes what the encoder has made.
    fn take_packets(&mut self) -> Result<()> {
        loop {
            let packet = match self.encoder.receive_packet() {
                Ok(packet) => packet,
                Err(EncoderStatus::Encoded) => continue,
                Err(EncoderStatus::NeedMoreData | EncoderStatus::LimitReached) => return Ok(()),
                Err(status) => return Err(Error::encoder(status)),
            };
            let data = packet.data.strip_prefix(&DELIMITER).unwrap_or(&packet.data);
            let sample_entry = if self.is_begun { None } else { Some(entry(data)?) };
            self.is_begun = true;
            self.file.write_all(data)?;
            let sample = Sample {
                track_kind: TrackKind::Video,
                sample_entry,
                keyframe: packet.frame_type == FrameType::KEY,
                timescale: self.fps,
                duration: 1,
                composition_time_offset: None,
                data_offset: self.end,
                data_size: data.len(),
            };
            self.muxer.append_sample(&sample).map_err(Error::muxer)?;
            self.end += data.len() as u64;
        }
    }
}

/// What tells players how to decode the packets, from the first of them.
fn entry(first: &[u8]) -> Result<SampleEntry> {
    let units = parse_obus(first, Av1ObuParseContext::Sample).map_err(Error::muxer)?;
    let header = units.iter().find(|unit| unit.obu_type == Av1ObuType::SequenceHeader);
    let header = header.ok_or_else(|| Error::Encoder { reason: "it made no sequence header".into() })?;
    // One byte holds the kind of the unit, and that its size follows.
    let mut bytes = vec![0x0a];
    let mut size = header.payload.len();
    while size >= 0x80 {
        bytes.push((size & 0x7f) as u8 | 0x80);
        size >>= 7;
    }
    bytes.push(size as u8);
    bytes.extend(header.payload);
    let config = Av1SampleEntryConfig { initial_presentation_delay_minus_one: None };
    build_av01_box_from_config_obus(&bytes, &config).map(SampleEntry::Av01).map_err(Error::muxer)
}
