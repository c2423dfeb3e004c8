//! Shapes with generated meshes: `type = "lathe"`, `type = "teapot"`, `type = "city"`.

use crate::scene_file::description::GeometryDescription;
use crate::scene_file::generate::{City, CityPart, Curve, Generator, Lathe, MOST_TRIANGLES, Teapot};
use crate::scene_file::reader::{NON_NEGATIVE, NUMBER, Table, Value};
use glam::DVec2;

const PROFILE: &str = "[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]";

pub(super) fn read_lathe(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let profile = table.required("profile", PROFILE, read_profile);
    let curve = table.or("curve", false, |value| value.choice(&[("straight", false), ("smooth", true)]));
    let steps = table.or("steps", 8, |value| value.integer(1..=10_000));
    let segments = table.or("segments", 64, |value| value.integer(3..=1_000_000));
    let curve = if curve? { Curve::Smooth { steps: steps? as u32 } } else { Curve::Straight };
    let normals = [("smooth", false), ("flat", true)];
    let is_flat = table.or("normals", false, |value| value.choice(&normals));
    let lathe = Lathe { profile: profile?, curve, segments: segments? as u32, is_flat: is_flat? };
    limited(table, lathe.most_triangles())?;
    Some(GeometryDescription::Generated(Generator::Lathe(lathe)))
}

pub(super) fn read_teapot(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let divisions = table.or("divisions", 16, |value| value.integer(1..=10_000));
    let teapot = Teapot { divisions: divisions? as u32 };
    limited(table, teapot.most_triangles())?;
    Some(GeometryDescription::Generated(Generator::Teapot(teapot)))
}

const CITY_PARTS: &[(&str, CityPart)] = &[
    ("streets", CityPart::Streets),
    ("buildings", CityPart::Buildings),
    ("cars", CityPart::Cars),
    ("trees", CityPart::Trees),
];

pub(super) fn read_city(table: &mut Table<'_>) -> Option<GeometryDescription> {
    let part = table.required("part", "\"buildings\"", |value| value.choice(CITY_PARTS));
    let number = table.or("number", 0, |value| value.integer(0..=4096));
    let blocks = table.or("blocks", 8, |value| value.integer(1..=64));
    let detail = table.or("detail", 1, |value| value.integer(1..=256));
    let seed = table.or("seed", 0, |value| value.integer(0..=u64::MAX));
    let (part, number, blocks) = (part?, number? as u32, blocks? as u32);
    if number >= part.count(blocks) {
        let message =
            format!("{} is part {number} of {}, which begin with 0", table.title(), part.count(blocks));
        return table.refuse(message, "ask for a smaller `number`, or for more `blocks`");
    }
    let city = City { part, number, blocks, detail: detail? as u32, seed: seed? };
    limited(table, city.most_triangles())?;
    Some(GeometryDescription::Generated(Generator::City(city)))
}

fn limited(table: &Table<'_>, triangles: u64) -> Option<()> {
    if triangles <= MOST_TRIANGLES {
        return Some(());
    }
    let message = format!("{} would have {triangles} triangles", table.title());
    table.refuse(message, format!("ask for fewer pieces: at most {MOST_TRIANGLES} triangles can be made"))
}

fn read_profile(value: Value<'_>) -> Option<Vec<DVec2>> {
    let remedy = format!("write for example `profile = {PROFILE}`: distances from the y axis, and heights");
    let points = value.list("a list of points [distance from the axis, height]", PROFILE)?;
    if points.len() < 2 {
        return value.refuse("at least 2 points", remedy);
    }
    let points: Option<Vec<DVec2>> = points
        .map(|point| {
            let numbers: Vec<_> = point.list("a point [distance, height]", "[1.0, 0.0]")?.collect();
            let [distance, height] = numbers.as_slice() else {
                return point
                    .refuse("two numbers, a distance and a height", "write for example `[1.0, 0.0]`");
            };
            let (distance, height) = (distance.number(&NON_NEGATIVE), height.number(&NUMBER));
            Some(DVec2::new(distance?, height?))
        })
        .collect();
    let points = points?;
    if points.windows(2).all(|pair| pair[0] == pair[1]) || points.iter().all(|point| point.x == 0.0) {
        return value.refuse("a profile that sweeps an area", remedy);
    }
    Some(points)
}
