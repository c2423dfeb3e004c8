/// Surfaces after which a chain of specular ones may end: total internal reflection inside a smooth mesh need not end by
/// itself, and loses nothing on the way.
const ROULETTE_DEPTH: u32 = 64;

/// Share of the chains that go on at each surface after that.
const ROULETTE_SURVIVAL: f32 = 0.98;

/// Factor on what a specular chain carries beyond the surface number `depth`; `None` where it ends.
pub fn chain_roulette(depth: u32, u: impl FnOnce() -> f32) -> Option<f32> {
    if depth < ROULETTE_DEPTH {
        return Some(1.0);
    }
    (u() < ROULETTE_SURVIVAL).then_some(1.0 / ROULETTE_SURVIVAL)
}
