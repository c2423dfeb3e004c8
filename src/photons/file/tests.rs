//! Tests of photon map files: round trips and damaged files.

use super::*;
use crate::math::Rgb;
use crate::photons::{EstimateParams, Estimator, Kernel, PhotonClass, Query};
use crate::sampling::{Rng, Stream, warp};
use glam::Vec3;
use proptest::prelude::*;

fn map(count: usize, seed: u64) -> PhotonMap {
    let mut rng = Rng::new(seed, Stream::Measure, 0);
    let photon = |_| {
        let position = rng.next_2d().extend(rng.next_f32());
        let (wi, normal) = (warp::square_to_sphere(rng.next_2d()), warp::square_to_sphere(rng.next_2d()));
        let class =
            [PhotonClass::Direct, PhotonClass::Indirect, PhotonClass::Caustic][rng.next_u64() as usize % 3];
        Photon::new(position, Rgb::splat(rng.next_f32()), wi, normal, class, rng.next_f32())
    };
    PhotonMap::build((0..count).map(photon).collect(), 3 * count as u64)
}

fn irradiance(map: &PhotonMap) -> IrradianceMap {
    let params = EstimateParams { kernel: Kernel::Constant, estimator: Estimator::Corrected };
    map.precompute_irradiance(&Query::nearest(Vec3::ZERO, Vec3::Y, 20), &params, 4)
}

fn written(global: &PhotonMap, caustic: &PhotonMap, irradiance: Option<&IrradianceMap>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let maps = [(MapKind::Global, global), (MapKind::Caustic, caustic)];
    write_photon_file(&mut bytes, "{\"what\": 1}", &maps, irradiance).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<PhotonFile, PhotonFileProblem> {
    read_photon_maps(&mut &bytes[..], bytes.len() as u64)
}

/// A small file with every kind of section.
fn small() -> Vec<u8> {
    let global = map(13, 1);
    written(&global, &map(5, 2), Some(&irradiance(&global)))
}

#[test]
fn what_is_written_is_read_and_gives_the_same_map_to_the_bit() {
    for count in [0, 1, 13, 5000, 9000] {
        let (global, caustic) = (map(count, 1), map(count / 2, 2));
        let irradiance = irradiance(&global);
        let file = read(&written(&global, &caustic, Some(&irradiance))).unwrap();
        assert_eq!(file.text, "{\"what\": 1}");
        for (saved, original) in file.maps.iter().zip([&global, &caustic]) {
            assert_eq!((saved.emitted, saved.dropped), (original.emitted(), original.dropped()));
            let mut photons = saved.photons.clone();
            // The photons may come in any order.
            photons.reverse();
            let again = PhotonMap::build(photons, saved.emitted);
            assert!(again.photons().eq(original.photons()));
        }
        let again = file.irradiance.unwrap();
        assert_eq!(again.len(), irradiance.len());
        assert!((0..again.len()).all(|i| again.record(i) == irradiance.record(i)));
    }
    let file = read(&written(&map(3, 0), &map(0, 0), None)).unwrap();
    assert!(file.irradiance.is_none() && file.maps.len() == 2);
}

#[test]
fn cut_at_any_byte_or_longer_is_refused() {
    let bytes = small();
    for length in 0..bytes.len() {
        let problem = read(&bytes[..length]).unwrap_err();
        let is_right = match length {
            0 => matches!(problem, Problem::Foreign),
            _ => matches!(problem, Problem::Length { found, .. } if found == length as u64),
        };
        assert!(is_right, "{length}: {problem}");
        // A file of the original length, with zeros from here on.
        let mut holed = bytes.clone();
        holed[length..].fill(0);
        assert!(holed == bytes || read(&holed).is_err(), "{length}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(matches!(read(&longer), Err(Problem::Length { .. })));
}

#[test]
fn every_flipped_bit_is_refused() {
    let bytes = small();
    assert!(read(&bytes).is_ok());
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << bit;
            let problem = read(&damaged).err();
            assert!(problem.is_some(), "bit {bit} of byte {at}");
        }
    }
}

#[test]
fn messages_say_what_it_is_and_what_to_do() {
    let bytes = small();
    let mut other = bytes.clone();
    other[8] = 1;
    let sum = blake3::hash(&other[..HEAD]);
    other[HEAD..HEAD + SUM].copy_from_slice(sum.as_bytes());
    let text = HEAD + SUM;
    let mut in_global = bytes.clone();
    in_global[text + SECTION_HEAD + 11 + SUM + SECTION_HEAD + MAP_HEAD + 3] ^= 1;
    for (bytes, parts) in [
        (
            b"ply\nformat ascii 1.0\n".to_vec(),
            ["is not a file of photon maps", "`cardioid photons SCENE -o FILE`"],
        ),
        (vec![b'x'; 500], ["is not a file of photon maps", "make one"]),
        (bytes[..bytes.len() / 2].to_vec(), ["incomplete", "copy it again"]),
        (other, ["is of version 1", "reads version 3"]),
        (in_global, ["its global map", "make it again"]),
    ] {
        let message = read(&bytes).unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    let folder = tempfile::tempdir().unwrap();
    let missing = read_photon_file(&folder.path().join("none")).unwrap_err().to_string();
    assert!(missing.contains("none: cannot be read"), "{missing}");
    let is_folder = read_photon_file(folder.path()).unwrap_err().to_string();
    assert!(is_folder.contains("not a regular file"), "{is_folder}");
}

#[test]
fn what_a_file_declares_takes_no_memory() {
    // A section of 16 GB, and more photons than bytes, with valid checksums.
    let bytes = small();
    let global = HEAD + SUM + SECTION_HEAD + 11 + SUM;
    for (at, value) in
        [(global + 8, 1u64 << 34), (global + SECTION_HEAD + 16, 1 << 40), (16, 1 << 34), (24, u64::MAX)]
    {
        let mut bytes = bytes.clone();
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        let sum = blake3::hash(&bytes[..HEAD]);
        bytes[HEAD..HEAD + SUM].copy_from_slice(sum.as_bytes());
        assert!(read(&bytes).is_err(), "{at}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Random bytes, and files with several bytes changed, removed or doubled, are refused without a panic.
    #[test]
    fn anything_else_is_refused(
        noise in prop::collection::vec(any::<u8>(), 0..400),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3u8), 1..6),
    ) {
        prop_assert!(read(&noise).is_err());
        let original = small();
        let mut bytes = original.clone();
        for (at, value, kind) in changes {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = value,
                1 => drop(bytes.remove(at)),
                _ => bytes.insert(at, value),
            }
        }
        prop_assert!(bytes == original || read(&bytes).is_err());
    }
}
