// Group 0 of every pass: camera and parameters. Filled by crates/render/src/inputs.rs.
#import frame
#import params

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> settings: Settings;
