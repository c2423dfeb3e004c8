//! Brick maps against sums over all discs, through thin walls, with every cache, and damaged.

use super::brick::SIDE;
use super::*;
use crate::math::{Frame, Rgb};
use crate::sampling::{Rng, Stream, warp};
use glam::{DVec3, Vec3};
use std::fs;
use std::path::Path;

const OWNER: BrickOwner = BrickOwner([7; 32]);

fn built(discs: &[Disc], max_error: f32, folder: &Path) -> BuiltBricks {
    build_bricks(discs, &BrickParams { max_error, ..BrickParams::default() }, folder).unwrap()
}

fn write(built: &BuiltBricks, path: &Path) {
    let mut bytes = Vec::new();
    write_brick_file(&mut bytes, built, OWNER).unwrap();
    fs::write(path, bytes).unwrap();
}

/// An atlas of one map of these discs.
fn atlas_of(discs: &[Disc], max_error: f32, budget: u64) -> IrradianceAtlas {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bricks");
    write(&built(discs, max_error, folder.path()), &path);
    // The open file outlives the folder.
    IrradianceAtlas::new(vec![BrickMap::open(&path).unwrap()], [Some(0)], (budget, 2))
}

fn look(atlas: &IrradianceAtlas, position: Vec3, normal: Vec3, width: f32) -> Option<Rgb> {
    let (mut reader, mut counters) = (BrickReader::default(), BrickCounters::default());
    let found = atlas.look_up((&mut reader, &mut counters), 0, (position, normal), width);
    assert!(atlas.failure().is_none(), "{:?}", atlas.failure());
    found.map(|found| found.irradiance)
}

/// Discs on a ball of radius one, so that all normals occur; irradiance varies over it.
fn ball(count: usize, radius: f32, rng: &mut Rng) -> Vec<Disc> {
    (0..count)
        .map(|_| {
            let normal = warp::square_to_sphere(rng.next_2d());
            let irradiance = Rgb::new(1.0 + 0.5 * normal.x, 1.0 + 0.5 * (5.0 * normal.y).sin(), 0.3);
            Disc { position: normal, normal, radius, detail: radius, irradiance }
        })
        .collect()
}

/// A square of discs with sides along two axes.
fn wall(centre: Vec3, normal: Vec3, half: f32, irradiance: Rgb) -> Vec<Disc> {
    let frame = Frame::from_z(normal);
    let across = 40;
    (0..across * across)
        .map(|i| {
            let place = |i: i32| half * (2.0 * (i as f32 + 0.5) / across as f32 - 1.0);
            let position = centre + frame.x * place(i % across) + frame.y * place(i / across);
            let radius = 3.0 * half / across as f32;
            Disc { position, normal, radius, detail: radius, irradiance }
        })
        .collect()
}

/// Points of equal area on a disc.
fn points(disc: &Disc) -> impl Iterator<Item = DVec3> {
    const POINTS: usize = 300;
    let (frame, disc) = (Frame::from_z(disc.normal), *disc);
    (0..POINTS).map(move |i| {
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        let r = disc.radius * ((i as f32 + 0.5) / POINTS as f32).sqrt();
        (disc.position + r * (cos * frame.x + sin * frame.y)).as_dvec3()
    })
}

/// A look-up at one level against sums over all discs, of which each point counts by its voxel's weight.
#[test]
fn look_ups_agree_with_sums_over_all_discs() {
    for seed in 0..8 {
        let mut rng = Rng::new(seed, Stream::Measure, 0);
        let discs = ball(400, 0.12, &mut rng);
        let atlas = atlas_of(&discs, 0.0, 1 << 20);
        let map = &atlas.maps()[0];
        let (origin, size) = map.cube();
        let mut compared = 0;
        for _ in 0..12 {
            let normal = warp::square_to_sphere(rng.next_2d());
            // Off the surface too, within a voxel.
            let level = (rng.next_f32() * map.levels() as f32) as u32;
            let width = size / (SIDE as u32 * (1 << level)) as f32;
            let position = normal * (1.0 + 0.4 * width * (rng.next_f32() - 0.5));
            let place = |p: DVec3| (p - origin.as_dvec3()) / f64::from(width);
            let at = place(position.as_dvec3()) - 0.5;
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for disc in &discs {
                let share: f32 = (0..3)
                    .map(|axis| match disc.normal[axis] * normal[axis] > 0.0 {
                        true => disc.normal[axis].powi(2) * normal[axis].powi(2),
                        false => 0.0,
                    })
                    .sum();
                for point in points(disc) {
                    let near = (place(point).floor() - at).abs();
                    let tent = (DVec3::ONE - near).max(DVec3::ZERO);
                    let weight = tent.x * tent.y * tent.z * f64::from(share);
                    sum += weight * disc.irradiance.as_dvec3();
                    weights += weight;
                }
            }
            let found = look(&atlas, position, normal, width);
            if weights == 0.0 {
                continue;
            }
            let (found, want) = (found.unwrap(), (sum / weights).as_vec3());
            compared += 1;
            // Coverage is rounded to 3 %, values to 0.4 %, and the values that are mixed differ by up to 50 %.
            assert!((found - want).abs().max_element() < 0.03, "seed {seed}, level {level}: {found} {want}");
        }
        assert!(compared > 6, "{compared}");
    }
}

/// Between levels of detail, values change as smoothly as the filter does.
#[test]
fn levels_are_interpolated() {
    let discs = ball(3000, 0.05, &mut Rng::new(1, Stream::Measure, 0));
    let atlas = atlas_of(&discs, 0.0, 1 << 20);
    let mut last: Option<Rgb> = None;
    for i in 0..400 {
        let width = 0.01 * 1.012f32.powi(i);
        let found = look(&atlas, Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.6, 0.8, 0.0), width).unwrap();
        assert!(
            last.is_none_or(|last| (last - found).abs().max_element() < 0.02),
            "{width}: {last:?} {found}"
        );
        last = Some(found);
    }
}

/// No light comes through a wall, whatever the size of the filter against its thickness, and however the wall stands.
#[test]
fn nothing_leaks_through_a_thin_wall() {
    let mut rng = Rng::new(2, Stream::Measure, 0);
    let mut worst = 0f32;
    for round in 0..12 {
        let normal = match round {
            0..3 => Vec3::AXES[round],
            _ => warp::square_to_sphere(rng.next_2d()),
        };
        let thickness = 1e-4;
        let mut discs = wall(0.5 * thickness * normal, normal, 1.0, Rgb::ONE);
        discs.extend(wall(-0.5 * thickness * normal, -normal, 1.0, Rgb::splat(1e6)));
        let atlas = atlas_of(&discs, 0.03, 1 << 20);
        let frame = Frame::from_z(normal);
        for _ in 0..200 {
            let place = 1.8 * (rng.next_2d() - 0.5);
            let at = frame.x * place.x + frame.y * place.y;
            let width = 2f32.powf(1.0 - 10.0 * rng.next_f32());
            let dark = look(&atlas, at + 0.5 * thickness * normal, normal, width).unwrap();
            let lit = look(&atlas, at - 0.5 * thickness * normal, -normal, width).unwrap();
            worst = worst.max((dark - 1.0).abs().max_element());
            assert!((lit / 1e6 - 1.0).abs().max_element() < 0.01, "{lit}");
        }
    }
    println!("leak through a wall of 1/20000 of its width: {:.1e} of the lit side", worst / 1e6);
    assert!(worst < 0.01, "{worst}");
}

/// What is empty does not darken what is beside it, and the end of an octree shows no gap.
#[test]
fn borders_of_detail_show_no_gap() {
    let mut discs = Vec::new();
    // Fine discs on one half of a plane, coarse ones on the other, with a ramp of irradiance over both.
    for (low, high, step) in [(-1.0f32, 0.0, 0.02f32), (0.0, 1.0, 0.1)] {
        let count = ((high - low) / step).round() as i32;
        for i in 0..count {
            for j in 0..(2.0 / step).round() as i32 {
                let position = Vec3::new(low + (i as f32 + 0.5) * step, (j as f32 + 0.5) * step - 1.0, 0.0);
                let irradiance = Rgb::splat(2.0 + position.x);
                discs.push(Disc {
                    position,
                    normal: Vec3::Z,
                    radius: 1.3 * step,
                    detail: 1.3 * step,
                    irradiance,
                });
            }
        }
    }
    let atlas = atlas_of(&discs, 0.0, 1 << 20);
    assert!(atlas.maps()[0].levels() > 2, "{}", atlas.maps()[0].levels());
    for i in 0..600 {
        let x = -0.9 + 1.8 * i as f32 / 600.0;
        for width in [0.01f32, 0.05, 0.2] {
            let found = look(&atlas, Vec3::new(x, 0.123, 0.0), Vec3::Z, width).unwrap().x;
            let blur = 0.02 + 0.13 * f32::from(x > -0.2) + width;
            assert!((found - 2.0 - x).abs() < blur, "{x}, {width}: {found}");
        }
    }
    assert_eq!(look(&atlas, Vec3::new(0.1, 0.1, 0.0), -Vec3::Z, 0.05), None);
    assert_eq!(look(&atlas, Vec3::new(9.0, 0.1, 0.0), Vec3::Z, 0.05), None);
    assert_eq!(look(&atlas, Vec3::new(f32::NAN, 0.1, 0.0), Vec3::Z, 0.05), None);
}

/// Building keeps one brick for each level in memory, however many there are.
#[test]
fn few_bricks_are_open_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut counts = Vec::new();
    for (count, radius) in [(500, 0.1), (20_000, 0.02)] {
        let discs = ball(count, radius, &mut Rng::new(5, Stream::Measure, 0));
        let built = pool.install(|| built(&discs, 0.0, folder.path()));
        let levels = usize::from(built.spool.entries.last().unwrap().level) + 1;
        assert!(built.most_open <= levels, "{} open of {} levels", built.most_open, levels);
        counts.push(built.len());
    }
    assert!(counts[1] > 10 * counts[0], "{counts:?}");
    println!("bricks {counts:?}");
}

/// Elimination leaves out what the level above shows, within its bound, and nothing else.
#[test]
fn elimination_keeps_within_its_bound() {
    let folder = tempfile::tempdir().unwrap();
    let flat = wall(Vec3::ZERO, Vec3::Z, 1.0, Rgb::new(3.0, 2.0, 1.0));
    assert_eq!(built(&flat, 0.03, folder.path()).len(), 1);
    let mut rng = Rng::new(6, Stream::Measure, 0);
    let mut discs = ball(3000, 0.06, &mut rng);
    // Smooth on either side of a step.
    for disc in &mut discs {
        let step = if disc.normal.z > 0.3 { 1.0 } else { 0.4 };
        disc.irradiance = Rgb::splat(step * (1.0 + 0.2 * disc.normal.x));
    }
    let (all, few) = (built(&discs, 0.0, folder.path()), built(&discs, 0.05, folder.path()));
    assert!(few.eliminated > 0 && few.len() < all.len(), "{} of {}", few.len(), all.len());
    assert!(few.len() > 8, "{}", few.len());
    let (exact, eliminated) = (atlas_of(&discs, 0.0, 1 << 20), atlas_of(&discs, 0.05, 1 << 20));
    let mut sum = 0f64;
    for _ in 0..1000 {
        let normal = warp::square_to_sphere(rng.next_2d());
        let [a, b] = [&exact, &eliminated].map(|atlas| look(atlas, normal, normal, 0.01).unwrap());
        let error = (a - b).abs().max_element() / a.max_element();
        // Interpolation between coarser voxels adds half a step of the level above to the bound.
        assert!(error < 0.15, "{error}");
        sum += f64::from(error);
    }
    assert!(sum / 1000.0 < 0.05, "{}", sum / 1000.0);
}

/// Neither the cache nor the number of threads that build or read changes a bit.
#[test]
fn caches_and_threads_change_no_bit() {
    let folder = tempfile::tempdir().unwrap();
    let discs = ball(25_000, 0.02, &mut Rng::new(8, Stream::Measure, 0));
    let files: Vec<Vec<u8>> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let built = pool.install(|| built(&discs, 0.03, folder.path()));
            let mut bytes = Vec::new();
            write_brick_file(&mut bytes, &built, OWNER).unwrap();
            bytes
        })
        .collect();
    assert!(files[0] == files[1] && files[0] == files[2], "files differ");
    let path = folder.path().join("a.bricks");
    fs::write(&path, &files[0]).unwrap();
    let mut results = Vec::new();
    for budget in [0, 20_000, 1 << 20, 100 << 20] {
        let atlas = IrradianceAtlas::new(vec![BrickMap::open(&path).unwrap()], [Some(0)], (budget, 5));
        let read = |thread: u64| {
            let (mut reader, mut counters) = (BrickReader::default(), BrickCounters::default());
            let mut bits = Vec::new();
            for i in 0..4000 {
                // All threads ask for the same places, in different orders.
                let mut rng = Rng::new(9, Stream::Measure, (i * 7 + thread * 1000) % 4000);
                let normal = warp::square_to_sphere(rng.next_2d());
                let width = 0.5 * rng.next_f32();
                let found = atlas.look_up((&mut reader, &mut counters), 0, (normal, normal), width);
                bits.push((
                    (i * 7 + thread * 1000) % 4000,
                    found.map(|found| found.irradiance.to_array().map(f32::to_bits)),
                ));
            }
            bits.sort_unstable();
            (bits, counters)
        };
        let all: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..5).map(|thread| scope.spawn(move || read(thread))).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        let counts = atlas.counts();
        for (bits, counters) in all {
            let BrickCounters { looked_up, resident, last_used, cached, missed, .. } = counters;
            assert_eq!(looked_up, resident + last_used + cached + missed);
            assert!(budget > 0 || last_used + cached == 0);
            results.push(bits);
        }
        assert!(counts.cache_bytes <= budget, "{counts:?}");
        assert!(counts.touched > 100 && counts.touched <= counts.bricks, "{counts:?}");
        let evicts = counts.evicted > 0;
        assert!(if budget == 20_000 { evicts } else { budget == 1 << 20 || !evicts }, "{counts:?}");
    }
    assert!(results.iter().all(|bits| *bits == results[0]), "look-ups differ");
}

/// Every damage is an error that names the file, and nothing panics.
#[test]
fn damaged_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bricks");
    let discs = ball(300, 0.1, &mut Rng::new(10, Stream::Measure, 0));
    write(&built(&discs, 0.0, folder.path()), &path);
    let sound = fs::read(&path).unwrap();
    let problem = |bytes: &[u8]| -> Option<BrickFileProblem> {
        fs::write(&path, bytes).unwrap();
        let read = || {
            let map = BrickMap::open(&path)?;
            (0..map.bricks() as u32).try_for_each(|number| map.read(number).map(drop))
        };
        let error: BrickFileError = read().err()?;
        assert!(error.to_string().contains("a.bricks"), "{error}");
        Some(error.problem)
    };
    assert_eq!(problem(&sound), None);
    for sixteenth in 0..16 {
        let found = problem(&sound[..sound.len() * sixteenth / 16]);
        let is_named = matches!(found, Some(BrickFileProblem::Length { .. } | BrickFileProblem::Foreign));
        assert!(is_named, "{sixteenth}: {found:?}");
    }
    let longer = [&sound[..], b"more"].concat();
    assert!(matches!(problem(&longer), Some(BrickFileProblem::Length { .. })));
    let mut rng = Rng::new(11, Stream::Measure, 0);
    let mut bricks = 0;
    for i in 0..600 {
        let at = if i < 150 { i } else { (rng.next_f32() * sound.len() as f32) as usize % sound.len() };
        let mut damaged = sound.clone();
        damaged[at] ^= 1 << (rng.next_f32() * 8.0) as u32;
        let found = problem(&damaged);
        assert!(found.is_some(), "byte {at}");
        bricks += usize::from(matches!(found, Some(BrickFileProblem::DamagedBrick { .. })));
    }
    assert!(bricks > 200, "{bricks}");
    // With checksums that are right.
    let mut other = sound.clone();
    other[8] = 9;
    let sum = blake3::hash(&other[..88]);
    other[88..120].copy_from_slice(sum.as_bytes());
    assert_eq!(problem(&other), Some(BrickFileProblem::Version(9)));
    assert_eq!(problem(b"ply\n"), Some(BrickFileProblem::Foreign));
    assert!(matches!(BrickMap::open(folder.path()).unwrap_err().problem, BrickFileProblem::Io(_)));
}

/// An octree that another program wrote, with checksums that are right, is checked all the same.
#[test]
fn contradictions_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bricks");
    let discs = ball(300, 0.1, &mut Rng::new(12, Stream::Measure, 0));
    let built = built(&discs, 0.0, folder.path());
    write(&built, &path);
    let sound = fs::read(&path).unwrap();
    let mut rng = Rng::new(13, Stream::Measure, 0);
    let (start, nodes) = (120, built.len());
    let end = start + 11 * nodes;
    let mut refused = 0;
    for _ in 0..500 {
        let mut changed = sound.clone();
        for _ in 0..3 {
            // Anything but the magic number, and its length stays as it is.
            let at = 24 + (rng.next_f32() * (end - 24) as f32) as usize;
            changed[at.min(end - 1)] = (rng.next_f32() * 256.0) as u8;
        }
        let sum = blake3::hash(&changed[..88]);
        changed[88..120].copy_from_slice(sum.as_bytes());
        let sum = blake3::hash(&changed[start..end]);
        changed[end..end + 32].copy_from_slice(sum.as_bytes());
        fs::write(&path, &changed).unwrap();
        match BrickMap::open(&path) {
            Err(_) => refused += 1,
            Ok(map) => {
                let atlas = IrradianceAtlas::new(vec![map], [Some(0)], (1 << 20, 1));
                let (mut reader, mut counters) = (BrickReader::default(), BrickCounters::default());
                for _ in 0..20 {
                    let normal = warp::square_to_sphere(rng.next_2d());
                    atlas.look_up((&mut reader, &mut counters), 0, (normal, normal), rng.next_f32());
                }
            }
        }
    }
    assert!(refused > 300, "{refused}");
}

#[test]
fn discs_are_written_as_ply() {
    let discs = ball(3, 0.1, &mut Rng::new(14, Stream::Measure, 0));
    let mut bytes = Vec::new();
    write_discs_as_ply(&mut bytes, &discs, |p| 2.0 * p.as_dvec3(), (2.0, 10.0)).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    assert!(String::from_utf8_lossy(&bytes[..end]).contains("element vertex 3"));
    let numbers: Vec<f32> =
        bytes[end..].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    assert_eq!(numbers.len(), 30);
    assert_eq!(Vec3::from_slice(&numbers[10..13]), 2.0 * discs[1].position);
    assert_eq!((numbers[16], numbers[17]), (0.2, 10.0 * discs[1].irradiance.x));
}

/// Discs that are not sound, and maps of nothing.
#[test]
fn odd_discs() {
    let folder = tempfile::tempdir().unwrap();
    assert!(built(&[], 0.03, folder.path()).is_empty());
    let one = Disc { position: Vec3::ONE, normal: Vec3::X, radius: 0.1, detail: 0.1, irradiance: Rgb::ONE };
    let odd = [
        Disc { position: Vec3::splat(f32::NAN), ..one },
        Disc { radius: 0.0, ..one },
        Disc { radius: f32::INFINITY, ..one },
        Disc { normal: Vec3::ZERO, ..one },
        Disc { irradiance: Rgb::splat(f32::NAN), ..one },
        Disc { irradiance: -Rgb::ONE, ..one },
        one,
        one,
    ];
    let built = built(&odd, 0.03, folder.path());
    assert_eq!((built.discs, built.dropped), (2, 6));
    // Far from the origin and tiny; large; black; many at one place.
    for disc in [
        Disc { position: Vec3::splat(1e6), radius: 1e-6, detail: 1e-6, ..one },
        Disc { radius: 1e15, detail: 1e15, ..one },
        Disc { irradiance: Rgb::ZERO, ..one },
        Disc { irradiance: Rgb::splat(1e37), ..one },
    ] {
        let atlas = atlas_of(&vec![disc; 50], 0.03, 1 << 20);
        let found = look(&atlas, disc.position, disc.normal, disc.radius).unwrap();
        assert!((found - disc.irradiance).abs().max_element() <= 0.01 * disc.irradiance.x, "{found}");
    }
}
