//! Hashes of what the program wrote, to show that a change of the code changes no result: of each channel of pictures to the bit, and
//! of what statistics count. `benches/same_results.sh` compares two builds by them.
//!
//! ```sh
//! cargo run --release --example hashes -- picture.exr statistics.json
//! ```
//!
//! Prints a line each: file, channel, hash. Of statistics (`--stats`) times and bytes are left out.

use anyhow::Context;
use cardioid::image_io;
use serde_json::Value;
use std::path::Path;

/// Keys of statistics whose values differ from run to run.
const MEASURED: [&str; 5] = ["times", "memory", "wall", "cpu", "peak_memory"];

fn main() -> anyhow::Result<()> {
    for path in std::env::args_os().skip(1) {
        let path = Path::new(&path);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let failed = || format!("{} cannot be hashed", path.display());
        match &*extension {
            "exr" => {
                for (channel, hash) in channels(path).with_context(failed)? {
                    println!("{name} {channel} {hash}");
                }
            }
            "json" => {
                let text = std::fs::read_to_string(path).with_context(failed)?;
                let counted = without_measured(serde_json::from_str(&text).with_context(failed)?);
                println!("{name} counts {}", short(counted.to_string().as_bytes()));
            }
            _ => anyhow::bail!("{}: neither .exr nor .json", path.display()),
        }
    }
    Ok(())
}

/// Name and hash of each channel, by the bits of its values row by row.
fn channels(path: &Path) -> anyhow::Result<Vec<(String, String)>> {
    let image = image_io::read(path)?;
    let mut found = Vec::new();
    for layer in &image.layers {
        let count = layer.channels.len().max(1);
        for (index, channel) in layer.channels.iter().enumerate() {
            let values = layer.data.iter().skip(index).step_by(count);
            let bytes: Vec<u8> = values.flat_map(|value| value.to_bits().to_le_bytes()).collect();
            let name =
                if layer.name.is_empty() { channel.clone() } else { format!("{}.{channel}", layer.name) };
            found.push((name, short(&bytes)));
        }
    }
    Ok(found)
}

/// The value without times and bytes, at any depth.
fn without_measured(value: Value) -> Value {
    let is_counted =
        |key: &str| !(MEASURED.contains(&key) || key.starts_with("seconds") || key.contains("bytes"));
    match value {
        Value::Object(fields) => fields
            .into_iter()
            .filter(|(key, _)| is_counted(key))
            .map(|(key, value)| (key, without_measured(value)))
            .collect(),
        Value::Array(values) => values.into_iter().map(without_measured).collect(),
        other => other,
    }
}

/// The first 16 digits of a hash: enough to tell files apart.
fn short(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..16].to_owned()
}
