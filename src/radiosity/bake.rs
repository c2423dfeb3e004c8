//! A solution as meshes with colours at their vertices, for programs that show them without computing light.

use super::domain::Domain;
use super::model::NONE;
use super::vertices::{Corner, corners_of};
use super::{PatchIrradiance, Radiosity};
use crate::math::Rgb;
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::f32::consts::FRAC_1_PI;
use std::io::{self, Write};

/// Patches of one surface with a colour at each vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakedMesh {
    /// Name of the surface.
    pub name: String,
    /// Positions in metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, on the side that is lit.
    pub normals: Vec<Vec3>,
    /// Radiance that leaves the surface, W/(m^2 sr).
    pub radiance: Vec<Rgb>,
    /// Triangles, counter-clockwise as seen from the lit side.
    pub triangles: Vec<[u32; 3]>,
}

/// Sides of surfaces whose mean radiosity is a smaller share than this of the mean of all are left out.
const DARK: f64 = 1e-3;

impl Radiosity {
    /// Meshes of all sides of surfaces that light reaches or leaves, one for each surface. Patches that meet smaller ones are divided along
    /// their edges, so that there are no cracks.
    pub fn baked(&self, scene: &Scene) -> Vec<BakedMesh> {
        let names = scene.surfaces().iter().map(|surface| surface.name.clone());
        let mut meshes: Vec<BakedMesh> =
            names.map(|name| BakedMesh { name, ..BakedMesh::default() }).collect();
        // The insides of closed bodies get nothing but what rounding lets through at their edges.
        let mut sides = vec![[(0.0, 0.0); 2]; meshes.len()];
        let (mut light, mut area) = (0.0, 0.0);
        let patches = self.model.elements.iter().enumerate().filter(|(_, element)| element.children == NONE);
        for (index, element) in patches.clone() {
            let sent = self.state.radiosity[index].max_element() * element.area;
            let side = &mut sides[element.surface as usize][usize::from(element.back)];
            *side = (side.0 + sent, side.1 + element.area);
            if sent > 0.0 {
                (light, area) = (light + sent, area + element.area);
            }
        }
        let least = DARK * light / f64::max(area, f64::MIN_POSITIVE);
        // Vertices by corner and colour of the surface; patches of one colour share them.
        let mut known: HashMap<(u32, u32, [u32; 6]), u32> = HashMap::new();
        for (index, element) in patches {
            let optics = self.state.optics[index];
            let side = sides[element.surface as usize][usize::from(element.back)];
            if side.0 <= least * side.1 {
                continue;
            }
            let mesh = &mut meshes[element.surface as usize];
            let bits = |rgb: Rgb| rgb.to_array().map(f32::to_bits);
            let [[a, b, c], [d, e, f]] = [bits(optics.reflectance), bits(optics.emission)];
            let colour = [a, b, c, d, e, f];
            let position = |corner: Corner| match (corner, element.domain) {
                (Corner::Space(p), _) => p,
                (Corner::Chart(at), Domain::Rectangle { chart, .. }) => {
                    self.model.charts[chart as usize].point(at)
                }
                (Corner::Chart(_), Domain::Triangle { .. }) => element.center,
            };
            let mut add = |place: DVec3, value: PatchIrradiance| {
                let number = mesh.positions.len() as u32;
                let radiance = optics.emission + optics.reflectance * value.total();
                mesh.positions.push(scene.space().world_position(place).as_vec3());
                mesh.normals.push(self.model.normal(element, place).as_vec3());
                mesh.radiance.push(radiance * (FRAC_1_PI / scene.space().power as f32));
                number
            };
            let outline = self.vertices.outline(&self.model, index as u32);
            let ring: Vec<u32> = outline
                .iter()
                .map(|&(corner, group)| {
                    let key = (element.surface, group, colour);
                    let value = self.vertices.value(group);
                    *known.entry(key).or_insert_with(|| add(position(corner), value))
                })
                .collect();
            let corners = corners_of(&element.domain).len();
            let mut triangles: Vec<[u32; 3]> = if ring.len() == corners {
                (2..ring.len()).map(|i| [ring[0], ring[i - 1], ring[i]]).collect()
            } else {
                let middle = add(element.center, self.vertices.middle(index as u32, corners));
                (0..ring.len()).map(|i| [middle, ring[i], ring[(i + 1) % ring.len()]]).collect()
            };
            // Corners go around the domain's own normal.
            if element.sign < 0.0 {
                triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            }
            let at = |vertex: u32| mesh.positions[vertex as usize];
            triangles.retain(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)) != Vec3::ZERO);
            mesh.triangles.extend(triangles);
        }
        meshes.retain(|mesh| !mesh.triangles.is_empty());
        meshes
    }
}

/// Writes meshes as a binary glTF 2.0 file. Colours are radiance times `scale`, cut at one, for a material that is shown as it is
/// (`KHR_materials_unlit`).
///
/// # Errors
/// Where `out` fails, or the file would exceed the four gigabytes of its format.
pub fn write_glb(out: &mut impl Write, meshes: &[BakedMesh], scale: f32) -> io::Result<()> {
    let mut bytes: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut nodes, mut all) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for mesh in meshes {
        let mut view = |bytes: &mut Vec<u8>, data: &[[u8; 4]], target: u32| {
            let start = bytes.len();
            bytes.extend(data.iter().flatten());
            views.push(json!({
                "buffer": 0, "byteOffset": start, "byteLength": bytes.len() - start, "target": target
            }));
            views.len() - 1
        };
        let words = |values: &[Vec3]| -> Vec<[u8; 4]> {
            values.iter().flat_map(|v| v.to_array().map(f32::to_le_bytes)).collect()
        };
        let colours: Vec<Vec3> =
            mesh.radiance.iter().map(|radiance| (*radiance * scale).clamp(Rgb::ZERO, Rgb::ONE)).collect();
        let low = mesh.positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = mesh.positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let mut attribute = |bytes: &mut Vec<u8>, values: &[Vec3], bounds: Option<(Vec3, Vec3)>| {
            let view = view(bytes, &words(values), 34962);
            let mut accessor =
                json!({ "bufferView": view, "componentType": 5126, "count": values.len(), "type": "VEC3" });
            if let (Some((low, high)), Value::Object(fields)) = (bounds, &mut accessor) {
                fields.insert("min".to_owned(), json!(low.to_array()));
                fields.insert("max".to_owned(), json!(high.to_array()));
            }
            accessors.push(accessor);
            accessors.len() - 1
        };
        let position = attribute(&mut bytes, &mesh.positions, Some((low, high)));
        let normal = attribute(&mut bytes, &mesh.normals, None);
        let colour = attribute(&mut bytes, &colours, None);
        let corners: Vec<[u8; 4]> =
            mesh.triangles.iter().flatten().map(|corner| corner.to_le_bytes()).collect();
        let indices = view(&mut bytes, &corners, 34963);
        accessors.push(json!({
            "bufferView": indices, "componentType": 5125, "count": corners.len(), "type": "SCALAR"
        }));
        nodes.push(json!({ "mesh": all.len(), "name": mesh.name }));
        all.push(json!({ "name": mesh.name, "primitives": [{
            "attributes": { "POSITION": position, "NORMAL": normal, "COLOR_0": colour },
            "indices": accessors.len() - 1, "material": 0
        }] }));
    }
    let document = json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("cardioid ", env!("CARGO_PKG_VERSION")),
            "extras": { "radianceScale": scale }
        },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": all,
        "materials": [{ "name": "baked light", "extensions": { "KHR_materials_unlit": {} } }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len() }]
    });
    let mut text = serde_json::to_vec(&document)?;
    // Chunks end at multiples of four bytes; all numbers in the second one have four.
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + 8 + bytes.len();
    let whole =
        u32::try_from(length).map_err(|_| io::Error::other("a binary glTF file holds at most 4 GB"))?;
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&whole.to_le_bytes())?;
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bytes)] {
        out.write_all(&(chunk.len() as u32).to_le_bytes())?;
        out.write_all(kind)?;
        out.write_all(chunk)?;
    }
    Ok(())
}
