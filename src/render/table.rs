//! Statistics as a table for people; `--stats` writes the same as JSON.

use super::stats::{MapStatistics, Statistics};
use crate::integrators::Counters;
use crate::memory::{Resident, megabytes};
use crate::scene::MapKind;
use std::fmt::{self, Write};

impl Statistics {
    /// A table of time and memory by step, rays by kind, photons by map and light, cache hits, and warnings.
    pub fn to_table(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_table(&mut text);
        text
    }

    fn write_table(&self, out: &mut String) -> fmt::Result {
        writeln!(out, "{}: {} samples per pixel on {} threads", self.scene, self.samples, self.threads)?;
        self.write_steps(out)?;
        self.write_rays(out)?;
        for map in &self.maps {
            write_map(out, map)?;
        }
        if let Some(media) = &self.media {
            writeln!(
                out,
                "\nphotons in media: {} beams, {} points, {} emitted, {}, {:.2} s",
                media.beams,
                media.points,
                media.emitted,
                megabytes(media.bytes),
                media.seconds
            )?;
        }
        for light in &self.shadows {
            writeln!(
                out,
                "\nshadow photons of light {}: {} direct, {} shadow of {} rays, {}; saved {} of {} shadow rays ({:.1} %)",
                light.light,
                light.direct_photons,
                light.shadow_photons,
                light.rays,
                megabytes(light.bytes),
                light.decisions.rays_saved,
                light.decisions.rays_saved + light.decisions.rays_traced,
                light.rays_saved_percent
            )?;
        }
        if let Some(cache) = &self.cache {
            let Counters { cache_hits, cache_misses, .. } = self.counters;
            let all = (cache_hits + cache_misses).max(1);
            writeln!(
                out,
                "\nirradiance cache: {} records; {cache_hits} of {all} evaluations interpolated ({:.2} %), {cache_misses} gathered",
                cache.records,
                100.0 * cache_hits as f64 / all as f64
            )?;
        }
        if !self.warnings.is_empty() {
            writeln!(out, "\nwarnings")?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(out, "  {warning}"))
    }

    fn write_steps(&self, out: &mut String) -> fmt::Result {
        let Self { times, memory, .. } = self;
        writeln!(out, "\n{:28} {:>10} {:>12} {:>12}", "step", "seconds", "in memory", "at most")?;
        let mut step = |name: &str, seconds: f64, memory: Option<Resident>| {
            let bytes = |bytes: Option<u64>| bytes.map_or_else(String::new, megabytes);
            let (now, peak) = (memory.map(|memory| memory.resident), memory.map(|memory| memory.peak));
            writeln!(out, "{name:28} {seconds:>10.3} {:>12} {:>12}", bytes(now), bytes(peak))
        };
        step("reading and building", times.scene, memory.scene)?;
        if let Some(file) = &self.photon_map_file {
            step("reading photon maps", file.seconds_reading, None)?;
        }
        step("photons", times.photons, memory.photons)?;
        for map in &self.maps {
            let name = name_of(map.map);
            step(&format!("  tracing {name} photons"), map.seconds_tracing, None)?;
            step(&format!("  building the {name} map"), map.seconds_building, None)?;
        }
        if self.irradiance_bytes > 0 {
            step("  precomputing irradiance", self.seconds_irradiance, None)?;
        }
        if !self.shadows.is_empty() {
            step("  shadow photons", self.seconds_shadows, None)?;
        }
        if self.cache.is_some() {
            step("irradiance cache", times.cache, memory.cache)?;
        }
        step("pixels", times.pixels, memory.pixels)?;
        let parts = [
            ("meshes", memory.meshes),
            ("Embree's hierarchy", memory.hierarchy.unwrap_or(0)),
            ("photon maps", self.maps.iter().map(|map| map.bytes).sum()),
            ("precomputed irradiance", self.irradiance_bytes),
            ("guide", self.guide_bytes),
        ];
        let parts = parts.iter().filter(|(_, bytes)| *bytes > 0);
        let parts: Vec<String> = parts.map(|(name, bytes)| format!("{name} {}", megabytes(*bytes))).collect();
        writeln!(out, "of that: {}", parts.join(", "))
    }

    fn write_rays(&self, out: &mut String) -> fmt::Result {
        let filling = self.cache.map(|cache| cache.counters).unwrap_or_default();
        writeln!(out, "\n{:28} {:>16} {:>16}", "rays", "pixels", "filling a cache")?;
        let kinds = |c: &Counters| {
            [
                ("camera", c.camera_rays),
                ("specular", c.specular_rays),
                ("glossy", c.glossy_rays),
                ("shadow", c.shadow_rays),
                ("gather", c.gather_rays),
                ("gathering goes on", c.approximate_rays),
                ("paths", c.path_rays),
                ("feelers", c.feelers),
            ]
        };
        let mut all = 0;
        for ((name, pixels), (_, cache)) in kinds(&self.counters).into_iter().zip(kinds(&filling)) {
            all += pixels + cache;
            if pixels + cache > 0 {
                writeln!(out, "{name:28} {pixels:>16} {cache:>16}")?;
            }
        }
        let photons: u64 = self
            .maps
            .iter()
            .filter(|map| !map.from_file)
            .flat_map(|map| &map.lights)
            .map(|light| light.bounces + light.missed)
            .sum();
        writeln!(out, "{:28} {photons:>16}", "photons")?;
        writeln!(out, "{:28} {:>16}", "all", all + photons)
    }
}

fn name_of(kind: MapKind) -> &'static str {
    match kind {
        MapKind::Global => "global",
        MapKind::Caustic => "caustic",
    }
}

fn write_map(out: &mut String, map: &MapStatistics) -> fmt::Result {
    let origin = if map.from_file { ", read from a file" } else { "" };
    writeln!(
        out,
        "\n{} map: {} photons of {} asked for, {} emitted, {}{origin}",
        name_of(map.map),
        map.photons,
        map.asked,
        map.emitted,
        megabytes(map.bytes)
    )?;
    writeln!(
        out,
        "{:>7} {:>14} {:>14} {:>14} {:>14} {:>12} {:>12} {:>12}",
        "light", "emitted", "stored", "bounces", "missed", "W emitted", "W absorbed", "W escaped"
    )?;
    for light in &map.lights {
        // Luminance (Rec. 709).
        let watts = |flux: [f64; 3]| 0.2126 * flux[0] + 0.7152 * flux[1] + 0.0722 * flux[2];
        writeln!(
            out,
            "{:>7} {:>14} {:>14} {:>14} {:>14} {:>12.5} {:>12.5} {:>12.5}",
            light.light,
            light.emitted,
            light.stored,
            light.bounces,
            light.missed,
            watts(light.flux_emitted),
            watts(light.flux_absorbed),
            watts(light.flux_escaped)
        )?;
    }
    Ok(())
}
