//! Checks of the document that involve several objects: sizes, formats of attributes, and combinations that are not allowed.

use super::check::Report;
use super::data::{numbers_of, size_of};
use super::error::{Failure, fail};
use super::label;
use gltf::Semantic;
use gltf::accessor::DataType;
use serde_json::Value;

/// Largest deviation of a unit quaternion's length from 1 by rounding, as in the Khronos validator: half a step of a signed byte
/// in each of four numbers.
const UNIT_TOLERANCE: f64 = 1.0 / 127.0;

/// Largest cosine of the angle between the axes of a matrix at which they count as perpendicular: half of the digits of single
/// precision.
const SHEAR_TOLERANCE: f64 = 0.000_345;

/// Checks a document whose indices are all valid. `json` is the JSON that it was made from.
pub(super) fn check(document: &gltf::Document, json: &Value, report: &mut Report) -> Result<(), Failure> {
    for view in document.views() {
        let (end, length) = (view.offset().checked_add(view.length()), view.buffer().length());
        if end.is_none_or(|end| end > length) {
            let (offset, size) = (view.offset(), view.length());
            let problem =
                format!("{size} bytes from byte {offset}, and its buffer has {length}; the file is damaged");
            return fail(label("bufferViews", view.index(), view.name()), problem);
        }
    }
    document.accessors().try_for_each(|accessor| check_accessor(&accessor, report))?;
    for mesh in document.meshes() {
        let name = label("meshes", mesh.index(), mesh.name());
        for primitive in mesh.primitives() {
            check_primitive(&primitive, &format!("{name}, primitive {}", primitive.index()), json, report)?;
        }
        let mut targets = mesh.primitives().map(|primitive| primitive.morph_targets().len());
        let first = targets.next().unwrap_or(0);
        if targets.any(|count| count != first) {
            return fail(name, "its primitives have different numbers of morph targets; the file is damaged");
        }
        check_weights(mesh.weights(), first, &name)?;
    }
    document.nodes().try_for_each(|node| check_node(&node, report))?;
    check_cameras(document, report)?;
    check_images(document, report)?;
    check_lights(document, report);
    Ok(())
}

fn check_accessor(accessor: &gltf::Accessor<'_>, report: &mut Report) -> Result<(), Failure> {
    let name = || super::data::label(accessor);
    let size = size_of(accessor.data_type());
    let element = size * numbers_of(accessor.dimensions());
    if let Some(view) = accessor.view() {
        let stride = view.stride().unwrap_or(element);
        let last = (accessor.count().max(1) - 1).checked_mul(stride);
        let end = last.and_then(|last| last.checked_add(accessor.offset())?.checked_add(element));
        if stride < element || end.is_none_or(|end| end > view.length()) {
            let (count, offset, length) = (accessor.count(), accessor.offset(), view.length());
            let problem = format!(
                "{count} elements of {element} bytes, {stride} apart from byte {offset}, and its buffer view has {length} \
                 bytes; the file is damaged"
            );
            return fail(name(), problem);
        }
        let total = view.offset().wrapping_add(accessor.offset());
        if !accessor.offset().is_multiple_of(size) || !total.is_multiple_of(size) {
            report.warn("alignment", || {
                format!("{} does not begin at a multiple of {size} bytes, as glTF requires; it is read all the same", name())
            });
        }
    }
    if accessor.normalized() && matches!(accessor.data_type(), DataType::F32 | DataType::U32) {
        report.warn("normalized", || format!("{} is normalized, which its type cannot be", name()));
    }
    if let Some(sparse) = accessor.sparse().filter(|sparse| sparse.count() > accessor.count()) {
        let problem = format!(
            "its sparse part replaces {} elements of {}; the file is damaged",
            sparse.count(),
            accessor.count()
        );
        return fail(name(), problem);
    }
    Ok(())
}

/// Formats of an attribute: numbers per element, types of the numbers, and the types that only KHR_mesh_quantization allows.
/// `None` for unknown attributes.
type Formats = (&'static [usize], &'static [(DataType, Option<bool>)], &'static [DataType]);

fn formats_of(semantic: &Semantic, is_target: bool) -> Option<Formats> {
    use DataType::{F32, I8, I16, U8, U16};
    const FLOAT: &[(DataType, Option<bool>)] = &[(F32, None)];
    const SHARES: &[(DataType, Option<bool>)] = &[(F32, None), (U8, Some(true)), (U16, Some(true))];
    const WHOLE: &[(DataType, Option<bool>)] = &[(U8, Some(false)), (U16, Some(false))];
    Some(match semantic {
        Semantic::Positions if is_target => (&[3], FLOAT, &[I8, I16]),
        Semantic::Positions => (&[3], FLOAT, &[I8, U8, I16, U16]),
        Semantic::Normals => (&[3], FLOAT, &[I8, I16]),
        Semantic::Tangents if is_target => (&[3], FLOAT, &[I8, I16]),
        Semantic::Tangents => (&[4], FLOAT, &[I8, I16]),
        Semantic::TexCoords(_) => (&[2], SHARES, &[I8, U8, I16, U16]),
        Semantic::Colors(_) => (&[3, 4], SHARES, &[]),
        Semantic::Joints(_) => (&[4], WHOLE, &[]),
        Semantic::Weights(_) => (&[4], SHARES, &[]),
    })
}

fn check_format(
    (semantic, accessor): (&Semantic, &gltf::Accessor<'_>),
    is_target: bool,
    object: &str,
    (json, report): (&Value, &mut Report),
) -> Result<(), Failure> {
    let Some((counts, kinds, quantized)) = formats_of(semantic, is_target) else { return Ok(()) };
    let (count, kind) = (numbers_of(accessor.dimensions()), accessor.data_type());
    let name = semantic.to_string();
    if !counts.contains(&count) || matches!(accessor.dimensions(), gltf::accessor::Dimensions::Mat2) {
        let wanted: Vec<_> = counts.iter().map(usize::to_string).collect();
        let problem =
            format!("{name} has elements of {count} numbers, and {} belong there", wanted.join(" or "));
        return fail(object, format!("{problem}; the file is damaged, write it again"));
    }
    let normalized = accessor.normalized();
    if kinds.iter().any(|(known, is)| *known == kind && is.is_none_or(|is| is == normalized)) {
        return Ok(());
    }
    if !quantized.contains(&kind) {
        let problem =
            format!("{name} is of a type of numbers that glTF does not allow there; write the file again");
        return fail(object, problem);
    }
    let used = json.get("extensionsUsed").and_then(Value::as_array);
    if !used.into_iter().flatten().any(|name| name == "KHR_mesh_quantization") {
        report.warn("quantization", || {
            format!(
                "{object}: {name} is of integers, which needs KHR_mesh_quantization, and the file does not declare it; it is \
                 read as if it did"
            )
        });
    }
    Ok(())
}

fn check_primitive(
    primitive: &gltf::Primitive<'_>,
    object: &str,
    json: &Value,
    report: &mut Report,
) -> Result<(), Failure> {
    let mut count = None;
    for (semantic, accessor) in primitive.attributes() {
        check_format((&semantic, &accessor), false, object, (json, report))?;
        let first = *count.get_or_insert(accessor.count());
        if accessor.count() != first {
            let problem = format!(
                "{semantic:?} has {} elements, and another attribute {first}; the file is damaged",
                accessor.count()
            );
            return fail(object, problem);
        }
    }
    for target in primitive.morph_targets() {
        let parts = [
            (Semantic::Positions, target.positions()),
            (Semantic::Normals, target.normals()),
            (Semantic::Tangents, target.tangents()),
        ];
        for (semantic, accessor) in parts {
            let Some(accessor) = accessor else { continue };
            check_format((&semantic, &accessor), true, object, (json, report))?;
            if count.is_some_and(|count| accessor.count() != count) {
                let problem =
                    format!("a morph target has {} elements; the file is damaged", accessor.count());
                return fail(object, problem);
            }
        }
    }
    let sets = |wanted: fn(&Semantic) -> bool| {
        primitive.attributes().filter(|(semantic, _)| wanted(semantic)).count()
    };
    let joints = sets(|semantic| matches!(semantic, Semantic::Joints(_)));
    if joints != sets(|semantic| matches!(semantic, Semantic::Weights(_))) {
        return fail(object, "its sets of joints and of weights do not match; the file is damaged");
    }
    Ok(())
}

fn check_weights(weights: Option<&[f32]>, targets: usize, object: &str) -> Result<(), Failure> {
    match weights {
        Some(weights) if weights.len() != targets => {
            let problem =
                format!("{} weights for {targets} morph targets; the file is damaged", weights.len());
            fail(object, problem)
        }
        _ => Ok(()),
    }
}

fn check_node(node: &gltf::Node<'_>, report: &mut Report) -> Result<(), Failure> {
    let name = label("nodes", node.index(), node.name());
    if let gltf::scene::Transform::Decomposed { rotation, .. } = node.transform() {
        let length = rotation.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        if length == 0.0 {
            report.warn("zero rotation", || format!("{name}: its rotation is zero, and counts as none"));
        } else if (length - 1.0).abs() > UNIT_TOLERANCE {
            report.warn("rotation", || {
                format!(
                    "{name}: its rotation is of length {length:.4}, and must be of length 1; it is normalized"
                )
            });
        }
    }
    if let gltf::scene::Transform::Matrix { matrix } = node.transform() {
        let axis = |i: usize| glam::DVec3::from_array([0, 1, 2].map(|row| f64::from(matrix[i][row])));
        let [x, y, z] = [axis(0), axis(1), axis(2)];
        let is_sheared =
            |a: glam::DVec3, b: glam::DVec3| a.dot(b).abs() > SHEAR_TOLERANCE * a.length() * b.length();
        if is_sheared(x, y) || is_sheared(y, z) || is_sheared(z, x) {
            report.warn("shear", || {
                format!("{name}: its matrix shears, which glTF does not allow; it is shown so all the same")
            });
        }
    }
    match node.mesh() {
        None if node.skin().is_some() => {
            report.warn("skin", || format!("{name} has a skin, and no mesh; the skin is ignored"));
        }
        None if node.weights().is_some() => {
            report.warn("weights", || format!("{name} has morph weights, and no mesh; they are ignored"));
        }
        Some(mesh) => {
            let targets = mesh.primitives().next().map_or(0, |primitive| primitive.morph_targets().len());
            check_weights(node.weights(), targets, &name)?;
        }
        None => {}
    }
    Ok(())
}

fn check_cameras(document: &gltf::Document, report: &mut Report) -> Result<(), Failure> {
    use gltf::json::camera::Type;
    for (index, camera) in document.as_json().cameras.iter().enumerate() {
        let name = label("cameras", index, camera.name.as_deref());
        let is_perspective = camera.type_ == gltf::json::validation::Checked::Valid(Type::Perspective);
        let (own, other) = (camera.perspective.is_some(), camera.orthographic.is_some());
        let (own, other) = if is_perspective { (own, other) } else { (other, own) };
        if !own {
            return fail(
                name,
                "it lacks the projection that its type names; the file is damaged, write it again",
            );
        }
        if other {
            report.warn("projections", || format!("{name} has two projections; that of its type is used"));
        }
    }
    Ok(())
}

fn check_images(document: &gltf::Document, report: &mut Report) -> Result<(), Failure> {
    for (index, image) in document.as_json().images.iter().enumerate() {
        let name = label("images", index, image.name.as_deref());
        if image.uri.is_some() && image.buffer_view.is_some() {
            return fail(name, "a URI and a buffer view, and only one is allowed; write the file again");
        }
        if image.uri.is_none() && image.buffer_view.is_none() {
            report.warn("no picture", || format!("{name} has neither a URI nor a buffer view"));
        }
        if image.buffer_view.is_some() && image.mime_type.is_none() {
            report.warn("mimeType", || {
                format!("{name} lacks its `mimeType`, which glTF requires; its format is taken from its first bytes")
            });
        }
    }
    Ok(())
}

fn check_lights(document: &gltf::Document, report: &mut Report) {
    use gltf::khr_lights_punctual::Kind;
    for light in document.lights().into_iter().flatten() {
        if let Kind::Spot { inner_cone_angle, outer_cone_angle } = light.kind()
            && inner_cone_angle >= outer_cone_angle
        {
            report.warn("cone", || {
                let name = label("lights", light.index(), light.name());
                format!("{name}: its inner cone must be narrower than its outer one; it is made as wide")
            });
        }
    }
}
