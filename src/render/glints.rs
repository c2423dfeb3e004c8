//! Search for glints over the whole picture, before it is rendered. Glints are images of emitters in glass and mirrors.

use super::pixels::RenderRequest;
use crate::camera::{Camera, FilmPlace};
use crate::film::PixelRect;
use crate::integrators::{ChanceMeetings, FARTHEST_GLINT, Glint, GlintFinder, GlintMap, Scratch};
use crate::observer::Observer;
use crate::sampling::{SampleStream, Stream, mix};
use crate::scene::{CameraMedia, IntegratorKind, RenderPlan, Scene};
use glam::Vec2;
use rayon::prelude::*;
use std::time::Instant;

/// Approximate number of search samples in a picture.
const PLACES: usize = 5_000_000;
/// Fewest and most search samples per pixel. A small picture gets more per pixel, as its pixels cover more of the scene.
const IN_PIXEL: (u32, u32) = (2, 32);

/// Glints of a picture, and the means to find more.
pub(super) struct Glints<'a> {
    /// The glints by place on the picture.
    pub(super) map: GlintMap,
    /// The finder that found them.
    pub(super) hunter: GlintFinder<'a>,
    /// How often paths hit emitters by chance.
    pub(super) meetings: ChanceMeetings,
}

/// Result of the glint search.
pub(super) enum GlintSearch<'a> {
    /// The search is complete.
    Done(Box<Glints<'a>>),
    /// The plan does not include a search.
    Unplanned,
    /// The time did not suffice for the whole picture, so no glints are used.
    Late,
}

impl GlintSearch<'_> {
    /// Warning text for [`GlintSearch::Late`].
    pub(super) const LATE: &'static str = "there was no time to look for lamps in glass and mirrors: where they are smaller than a \
        pixel, samples meet them by chance, as white dots; give it more time";
}

/// The glint search takes at most this share of the remaining time.
const TIME_SHARE: f64 = 0.15;

/// Searches for glints in the window of the request. The glints of a pixel do not depend on the window.
pub(super) fn find_glints<'a>(
    scene: &'a Scene,
    camera: &Camera,
    request: &RenderRequest,
    plan: &RenderPlan,
    observer: &dyn Observer,
) -> GlintSearch<'a> {
    if !plan.glints.build {
        return GlintSearch::Unplanned;
    }
    let start = Instant::now();
    let end = observer.deadline().map(|end| start + end.saturating_duration_since(start).mul_f64(TIME_SHARE));
    let is_late = || end.is_some_and(|end| Instant::now() >= end);
    let RenderRequest { width, height, crop, ref filter, ref settings, .. } = *request;
    let whole = PixelRect::whole(width, height);
    let margin = (FARTHEST_GLINT + filter.radius()).ceil() as u32 + 2;
    // Adaptive sample counts depend on the whole picture, so the search then covers all of it.
    let near = crop.filter(|_| !settings.adaptive).map_or(whole, |crop| PixelRect {
        x0: crop.x0.saturating_sub(margin),
        y0: crop.y0.saturating_sub(margin),
        x1: crop.x1.saturating_add(margin),
        y1: crop.y1.saturating_add(margin),
    });
    // The window is extended to whole blocks, so that the result for a block does not depend on the window.
    let block = ChanceMeetings::BLOCK;
    let near = PixelRect {
        x0: near.x0 / block * block,
        y0: near.y0 / block * block,
        x1: near.x1.div_ceil(block) * block,
        y1: near.y1.div_ceil(block) * block,
    };
    let rows = near.intersection(&whole);
    // The search should cost less than the render.
    let most = match settings.integrator {
        IntegratorKind::Progressive => IN_PIXEL.1,
        IntegratorKind::PhotonMap | IntegratorKind::Photons | IntegratorKind::Path => {
            settings.spp.clamp(IN_PIXEL.0, IN_PIXEL.1)
        }
    };
    let count = u32::try_from(PLACES / whole.area().max(1)).unwrap_or(u32::MAX).clamp(IN_PIXEL.0, most);
    observer.begin("looking for lamps in glass and mirrors", u64::from(rows.y1.saturating_sub(rows.y0)));
    let hunter = GlintFinder::new(scene, CameraMedia::of(scene, camera), settings.max_depth);
    let size = Vec2::new(width as f32, height as f32);
    let seed = mix(settings.seed ^ Stream::GlintSearch as u64);
    let found: Vec<(Vec<Glint>, Vec<f32>)> = (rows.y0..rows.y1)
        .into_par_iter()
        .with_max_len(1)
        .map_init(Scratch::default, |scratch, y| {
            let (mut found, mut met) = (Vec::new(), Vec::new());
            for x in rows.x0..rows.x1 {
                if observer.is_cancelled() || is_late() {
                    break;
                }
                let pixel = u64::from(y) * u64::from(width) + u64::from(x);
                let center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let mut of_pixel = 0.0;
                for index in 0..count {
                    let mut samples = SampleStream::new(seed, pixel, index);
                    let offset = samples.next_2d() - 0.5;
                    let place = FilmPlace { size, center, offset };
                    let (mut glints, meetings) =
                        hunter.look((camera, place), settings.spp as f32, &mut samples, scratch);
                    found.append(&mut glints);
                    of_pixel += meetings / count as f32;
                }
                met.push(of_pixel);
            }
            (found, met)
        })
        .collect();
    if is_late() {
        return GlintSearch::Late;
    }
    observer.advance(found.len() as u64);
    let (found, met): (Vec<Vec<Glint>>, Vec<Vec<f32>>) = found.into_iter().unzip();
    let rows_met = (rows.y0..).zip(met);
    let met = rows_met.flat_map(|(y, row)| (rows.x0..).zip(row).map(move |(x, value)| ((x, y), value)));
    let meetings = ChanceMeetings::new((width, height), met);
    GlintSearch::Done(Box::new(Glints { map: GlintMap::new(found.concat()), hunter, meetings }))
}
