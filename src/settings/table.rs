//! The table of settings: one row each. What the columns mean is at [`Setting`] and in `declare.rs`.

use super::choices::{
    Choices, Estimator, GuideKind, IntegratorKind, Kernel, MapKind, Quality, SearchRegion, ShadowMode, Show,
    Wavelengths,
};
use super::declare::{asked_type, given_or, name_of, resolved, settings};
use super::kind::{Kind, Parameter};
use super::row::{Group, Knob, Maps, Part, Setting, Shortcut, Turn};
use super::text::{Field, FromAsked};

/// The largest of most counts: `f32` has every whole number up to it.
const MANY: u64 = 1 << 24;

/// From one to [`MANY`].
const COUNT: Kind = Kind::Count { least: 1, most: MANY };

/// Photons of a map.
const PHOTONS: Kind = Kind::Count { least: 0, most: 1 << 40 };

/// A share of something.
const SHARE: Kind = Kind::Number { noun: "share", least: 0.0, most: 1.0, example: "0.02" };

/// One of several names.
const fn choice<T: Choices>() -> Kind {
    Kind::Choice { names: T::NAMES, parameter: None }
}

/// The filter constant of the cone, given beside the kernel.
const CONE_K: Parameter = Parameter {
    name: "cone-k",
    of: "cone",
    least: 1.0,
    most: 1000.0,
    default: 1.0,
    example: "1.1",
    help: "Filter constant of the cone kernel, at least 1: the larger, the flatter. Alone it means the cone.",
};

settings! {
    /// Preset that all other settings start from. Each takes several times as long as the one before.
    quality: Quality {
        kind: choice::<Quality>(),
        group: First,
        presets: [Quality::Draft, Quality::Preview, Quality::Final, Quality::Reference],
        maps: Nothing,
    }

    /// How the picture is computed.
    integrator: IntegratorKind {
        kind: choice::<IntegratorKind>(),
        group: First,
        presets: [IntegratorKind::PhotonMap; 4],
        maps: Nothing,
    }

    /// Map that `--integrator photons` shows.
    map: MapKind {
        kind: choice::<MapKind>(),
        group: Photons,
        presets: [MapKind::Global; 4],
        maps: Nothing,
    }

    /// Seed of all random numbers: the same seed gives the same bits.
    seed: u64 {
        kind: Kind::Count { least: 0, most: u64::MAX },
        group: First,
        presets: [0; 4],
        maps: Photons,
    }

    /// Camera samples per pixel. Time in proportion; noise falls with the root.
    spp: u32 {
        kind: COUNT,
        unit: "samples",
        group: First,
        presets: [4, 16, 64, 1024],
        in_rounds: [4; 4],
        maps: Nothing,
        knob: Picture by Turn::Factor(2),
    }

    /// Photons to store in the global map alone. 21 bytes each; time in proportion.
    global_photons: u64 {
        kind: PHOTONS,
        unit: "photons",
        group: Photons,
        presets: [50_000, 200_000, 500_000, 4_000_000],
        in_rounds: [50_000; 4],
        maps: Counts,
        knob: GlobalMap by Turn::Factor(4),
    }

    /// Photons to store in the caustic map. 21 bytes each; time in proportion.
    caustic_photons: u64 {
        kind: PHOTONS,
        unit: "photons",
        group: Photons,
        presets: [100_000, 500_000, 5_000_000, 20_000_000],
        in_rounds: [200_000; 4],
        maps: Counts,
        knob: CausticMap by Turn::Factor(4),
    }

    /// Photon beams to store in media that scatter, for caustics. About 150 bytes each; time in proportion.
    volume_beams: u64 {
        kind: Kind::Count { least: 0, most: 200_000_000 },
        unit: "beams",
        group: Photons,
        presets: [6_000, 20_000, 60_000, 200_000],
        in_rounds: [10_000; 4],
        maps: Nothing,
    }

    /// Photons to store in media for light that was scattered before. 22 bytes each; time in proportion.
    volume_photons: u64 {
        kind: Kind::Count { least: 0, most: 1 << 31 },
        unit: "photons",
        group: Photons,
        presets: [30_000, 100_000, 300_000, 1_000_000],
        in_rounds: [50_000; 4],
        maps: Nothing,
    }

    /// Wavelengths of paths that meet a medium whose index of refraction depends on the wavelength.
    wavelengths: Wavelengths {
        kind: choice::<Wavelengths>(),
        group: First,
        presets: [Wavelengths::Continuous; 4],
        maps: Photons,
    }

    /// Whether photons are aimed by projection maps, rather than emitted in all directions: changes noise, not light.
    aim_photons: bool {
        kind: Kind::Flag,
        group: Photons,
        presets: [true; 4],
        maps: Photons,
    }

    /// As many photons as fit into this memory, for example 2GB; the maps keep their ratio.
    photons_memory: Option<u64> {
        kind: Kind::Memory,
        unit: "bytes",
        group: First,
        presets: [None; 4],
        maps: Counts,
        in_place_of: [global_photons, caustic_photons],
        not_in_scene_files: "the memory of a machine is no part of a scene",
    }

    /// Photons in an estimate from the global map. More: smoother, blurred wider, slower.
    global_nearest: u32 {
        kind: COUNT,
        unit: "photons",
        group: Estimates,
        presets: [80; 4],
        maps: Irradiance,
    }

    /// Photons in an estimate from the caustic map. More: smoother, blurred wider, slower.
    caustic_nearest: u32 {
        kind: COUNT,
        unit: "photons",
        group: First,
        presets: [50, 120, 80, 100],
        in_rounds: [60; 4],
        maps: Nothing,
        knob: CausticMap by Turn::Factor(2),
    }

    /// Radius of estimates from the global map: all photons within it, instead of the nearest.
    global_radius: Option<f64> {
        kind: Kind::Length,
        unit: "m",
        group: Estimates,
        presets: [None; 4],
        maps: Irradiance,
        in_place_of: [global_nearest],
    }

    /// Radius of estimates from the caustic map: all photons within it, instead of the nearest.
    caustic_radius: Option<f64> {
        kind: Kind::Length,
        unit: "m",
        group: Estimates,
        presets: [None; 4],
        maps: Nothing,
        in_place_of: [caustic_nearest],
    }

    /// Kernel of caustic estimates.
    kernel: Kernel {
        kind: Kind::Choice { names: Kernel::NAMES, parameter: Some(CONE_K) },
        group: Estimates,
        presets: [Kernel::Cone { k: CONE_K.default as f32 }; 4],
        maps: Nothing,
        knob: CausticMap by Turn::Others(1.2),
    }

    /// Free of the known bias of density estimates, or as the formulas are printed.
    estimator: Estimator {
        kind: choice::<Estimator>(),
        group: Estimates,
        presets: [Estimator::Corrected; 4],
        maps: Irradiance,
        knob: AnyMap by Turn::Others(1.2),
    }

    /// Region in which photons are searched.
    search: SearchRegion {
        kind: choice::<SearchRegion>(),
        group: Estimates,
        presets: [SearchRegion::Disc; 4],
        maps: Irradiance,
    }

    /// Whether estimates shrink where more photons change them in one direction only, as at the edge of a caustic.
    ///
    /// Differential checking of Jensen & Christensen 1995.
    differential_check: bool {
        kind: Kind::Flag,
        group: Estimates,
        presets: [false; 4],
        maps: Irradiance,
    }

    /// Final gather rays per camera sample: less noise in indirect light, and most of the time of many scenes.
    gather_samples: u32 {
        kind: COUNT,
        unit: "rays",
        group: First,
        presets: [4, 8, 8, 8],
        in_rounds: [4; 4],
        maps: Nothing,
        knob: Gathering by Turn::Factor(2),
    }

    /// Distribution rays at the first highly glossy surface of a camera sample; deeper ones get fewer.
    ///
    /// So does one whose lobe reflects less than a quarter.
    glossy_samples: u32 {
        kind: COUNT,
        unit: "rays",
        group: Sampling,
        presets: [6; 4],
        maps: Nothing,
    }

    /// What guides the sampling of gather rays and paths: pays where indirect light comes from few directions.
    ///
    /// It changes noise, not the mean.
    guide: GuideKind {
        kind: choice::<GuideKind>(),
        group: Sampling,
        presets: [GuideKind::None; 4],
        maps: Nothing,
        knob: Gathering by Turn::Others(2.0),
    }

    /// Whether gather rays read irradiance precomputed at the photons: much faster than an estimate for each of them.
    ///
    /// Christensen 1999.
    precomputed_irradiance: bool {
        kind: Kind::Flag,
        group: Sampling,
        presets: [true; 4],
        maps: Nothing,
        knob: Gathering by Turn::Others(5.0),
    }

    /// Shadow rays per light source and camera sample: less noise in soft shadows.
    light_samples: u32 {
        kind: COUNT,
        unit: "rays",
        group: Sampling,
        presets: [1; 4],
        maps: Nothing,
        knob: LightSampling by Turn::Factor(4),
    }

    /// Whether estimates leave out the part of their disc that is not visible from its centre (not by default with
    /// `as-printed`).
    visible_kernel: bool {
        kind: Kind::Flag,
        group: Estimates,
        presets: [true; 4],
        maps: Irradiance,
        knob: AnyMap by Turn::Others(2.0),
    }

    /// Camera samples of a pixel that are nearer to one another than this share of the radius of a caustic estimate share it; 0 for
    /// none.
    ///
    /// On Lambertian surfaces alone.
    caustic_reuse: f32 {
        kind: SHARE,
        group: Estimates,
        presets: [0.2, 0.2, 0.2, 0.0],
        maps: Nothing,
    }

    /// Where shadow rays are traced: everywhere, or only where shadow photons leave open whether a light source is visible. Without a name:
    /// bounded.
    ///
    /// By default they are off: what they save is less than they cost at one shadow ray per light (docs/shadow-photons.md).
    shadow_photons: ShadowMode {
        kind: choice::<ShadowMode>(),
        group: Photons,
        presets: [ShadowMode::Off; 4],
        maps: Nothing,
        bare: "bounded",
        knob: ShadowPhotons by Turn::Others(1.5),
    }

    /// Rays that place shadow photons, of all light sources together.
    shadow_photon_rays: u64 {
        kind: Kind::Count { least: 0, most: 1 << 30 },
        unit: "rays",
        group: Photons,
        presets: [200_000; 4],
        maps: Nothing,
    }

    /// What `--integrator photons` shows.
    show: Show {
        kind: choice::<Show>(),
        group: Photons,
        presets: [Show::Radiance; 4],
        maps: Nothing,
    }

    /// Longest path, in surfaces; what is cut off is counted, and reported where it matters.
    ///
    /// The default is reached with probability 1e-4 where everything reflects 99.9 %.
    max_depth: u32 {
        kind: COUNT,
        unit: "surfaces",
        group: Sampling,
        presets: [10_000; 4],
        maps: Photons,
    }

    /// Whether indirect light of Lambertian surfaces is interpolated between few points.
    ///
    /// Ward & Heckbert 1992. In progressive rendering it is off: more rounds would not reduce its error.
    irradiance_cache: bool {
        kind: Kind::Flag,
        group: Cache,
        presets: [true, true, true, false],
        in_rounds: [false; 4],
        maps: Nothing,
        knob: Cache by Turn::Others(4.0),
    }

    /// Largest error of that interpolation, the `a` of Ward, Rubinstein & Clear 1988: smaller is better and slower.
    cache_error: f32 {
        kind: Kind::Number { noun: "number", least: 0.01, most: 1.0, example: "0.2" },
        group: Cache,
        presets: [0.4, 0.25, 0.2, 0.2],
        maps: Nothing,
        knob: Cache by Turn::Scaled(&[(1.5, 1.0), (1.0 / 1.5, 2.5)]),
    }

    /// Gather rays for each record of the irradiance cache.
    ///
    /// Half and a quarter as many, but at least 64, where records lie about four and two pixels apart.
    cache_samples: u32 {
        kind: Kind::Count { least: 4, most: MANY },
        unit: "rays",
        group: Cache,
        presets: [256, 512, 1024, 1024],
        maps: Nothing,
        knob: Cache by Turn::Factor(2),
    }

    /// With --atlas, side of the voxels that a gather ray reads over the width of its cone: smaller shows more and reads more bricks.
    ///
    /// The cone has the solid angle that one ray of a hemisphere stands for (docs/irradiance-atlas.md).
    atlas_footprint: f32 {
        kind: Kind::Number { noun: "number", least: 0.01, most: 16.0, example: "0.5" },
        group: Sampling,
        presets: [0.5; 4],
        maps: Nothing,
    }

    /// Whether shapes with `illumination-map` in the scene have one; otherwise photon maps serve everywhere.
    illumination_maps: bool {
        kind: Kind::Flag,
        group: Photons,
        presets: [true; 4],
        maps: Nothing,
    }

    /// Whether the variance around a pixel decides its number of camera samples, --spp on average: less noise where there is most.
    /// The EXR then has a layer with the counts.
    adaptive: bool {
        kind: Kind::Flag,
        group: Sampling,
        presets: [false; 4],
        maps: Nothing,
        bare: "true",
    }

    /// Behind a diffuse reflection, surfaces nearer than this share of the scene's radius are computed accurately; 0 for none.
    accurate_distance: f32 {
        kind: SHARE,
        group: Sampling,
        presets: [0.02; 4],
        maps: Nothing,
    }

    /// Paths that carry less than this share of the light are evaluated from the maps alone; 0 for none.
    approximate_weight: f32 {
        kind: SHARE,
        group: Sampling,
        presets: [0.01; 4],
        maps: Nothing,
        knob: Gathering by Turn::Values(&["0", "0.05"], 2.0),
    }

    /// Whether small emitters in glass and mirrors are searched for before the picture is rendered: where their image is smaller
    /// than a pixel, samples meet it only by chance, as white dots.
    ///
    /// What is met more rarely still is dimmed by how rare it is, and behind a glossy reflection such images are blurred, except with
    /// `--integrator path` (docs/light-paths.md).
    glints: bool {
        kind: Kind::Flag,
        group: Sampling,
        presets: [true; 4],
        maps: Nothing,
        bare: "true",
    }

    /// Rounds of `--integrator progressive`; samples and photons are those of each round. As many as there is time for where only
    /// --time-limit or --target-error is given.
    rounds: Option<u64> {
        kind: Kind::Count { least: 1, most: 1 << 40 },
        unit: "rounds",
        group: First,
        presets: [None; 4],
        in_rounds: [Some(4), Some(16), Some(128), Some(2048)],
        maps: Nothing,
        knob: Rounds by Turn::Factor(2),
    }

    /// Stop when the relative error is estimated to be down to this, for example 0.02 for 2 %; without --integrator it means
    /// `--integrator progressive`.
    target_error: Option<f64> {
        kind: Kind::Number { noun: "number", least: 1e-6, most: 10.0, example: "0.02" },
        group: First,
        presets: [None; 4],
        maps: Nothing,
    }
}

/// Options of the command line that stand for other settings.
pub static SHORTCUTS: &[Shortcut] = &[
    Shortcut {
        name: "photons",
        kind: Some(PHOTONS),
        conflicts: &["photons-memory"],
        about: "Photons in the global map; the caustic map keeps its ratio to it. 21 bytes each; time in proportion.\n\n\
                Counts may be written 500000, 500_000, 500k, 0.5M or 5e5, here and in all other options.",
    },
    Shortcut {
        name: "no-caustics",
        kind: None,
        conflicts: &["caustic-photons"],
        about: "No caustic map: surfaces get no light that arrives over specular surfaces alone.",
    },
];
