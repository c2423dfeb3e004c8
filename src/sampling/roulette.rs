//! Russian roulette for long specular chains.

/// Number of surfaces after which a specular chain may be terminated. Total internal reflection inside a smooth mesh need not end by
/// itself, and loses no energy.
const ROULETTE_DEPTH: u32 = 64;

/// Probability that a chain survives at each surface after that.
const ROULETTE_SURVIVAL: f32 = 0.98;

/// Factor on the throughput of a specular chain at surface number `depth`; `None` where the chain ends.
pub fn chain_roulette(depth: u32, u: impl FnOnce() -> f32) -> Option<f32> {
    if depth < ROULETTE_DEPTH {
        return Some(1.0);
    }
    (u() < ROULETTE_SURVIVAL).then_some(1.0 / ROULETTE_SURVIVAL)
}
