//! Tables of the JSON that glTF 2.0 allows: the schemas of appendix A of the specification, and of the extensions that are read.
//! Every object may have `extensions`, `extras` and `name`.

use std::f64::consts::FRAC_PI_2;

/// The allowed content of an object.
pub(super) struct Shape {
    pub rules: &'static [Rule],
    pub extensions: &'static [(&'static str, &'static Shape)],
}

/// The allowed value of a key.
pub(super) struct Rule {
    pub key: &'static str,
    pub kind: Kind,
    pub required: bool,
}

/// Types of values.
pub(super) enum Kind {
    /// Not checked here: either checked where it is read, or not read.
    Any,
    Flag,
    Text,
    Whole {
        least: u64,
        most: u64,
        step: u64,
    },
    /// An index into the list with that name.
    Index(&'static str),
    /// A list of indices without duplicates.
    Indices(&'static str),
    Number(Range),
    /// A list of `count` numbers, or of at least one.
    Numbers {
        count: Option<usize>,
        range: Range,
    },
    Choice(&'static [&'static str], Beyond),
    Code(&'static [u64], Beyond),
    Object(&'static Shape),
    Objects(&'static Shape),
    /// An object that maps names to accessors.
    Attributes,
    /// A list of `Attributes`.
    Targets,
    /// A list of strings.
    Names,
}

/// Treatment of a value that is not allowed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Beyond {
    /// The file is refused.
    Refuse,
    /// The nearest allowed value is used, with a warning.
    Cut,
    /// The value is kept, with a warning.
    Keep,
    /// The value is ignored, with a warning.
    Drop,
}

/// A range of allowed numbers.
pub(super) struct Range {
    pub least: f64,
    pub most: f64,
    /// Whether `least` itself is excluded.
    pub is_open: bool,
    /// One more allowed number.
    pub also: Option<f64>,
    pub below: Beyond,
    pub above: Beyond,
}

use Beyond::{Cut, Drop, Keep, Refuse};

const ANY: Range = range(f64::NEG_INFINITY, f64::INFINITY, Refuse, Refuse);
const SHARE: Range = range(0.0, 1.0, Cut, Cut);
const FROM_ZERO: Range = range(0.0, f64::INFINITY, Refuse, Refuse);
const ABOVE_ZERO: Range = Range { is_open: true, ..FROM_ZERO };
/// Light colours, which some programs write brighter than 1.
const LIGHT: Range = range(0.0, 1.0, Refuse, Keep);
const ANGLE: Range = range(0.0, FRAC_PI_2, Refuse, Refuse);

const fn range(least: f64, most: f64, below: Beyond, above: Beyond) -> Range {
    Range { least, most, is_open: false, also: None, below, above }
}

const fn may(key: &'static str, kind: Kind) -> Rule {
    Rule { key, kind, required: false }
}

const fn must(key: &'static str, kind: Kind) -> Rule {
    Rule { key, kind, required: true }
}

const fn count_of(least: u64) -> Kind {
    Kind::Whole { least, most: u64::MAX, step: 1 }
}

const fn shape(rules: &'static [Rule]) -> Shape {
    Shape { rules, extensions: &[] }
}

const fn numbers(count: usize, range: Range) -> Kind {
    Kind::Numbers { count: Some(count), range }
}

pub(super) static ROOT: Shape = Shape {
    rules: &[
        must("asset", Kind::Object(&ASSET)),
        may("accessors", Kind::Objects(&ACCESSOR)),
        may("animations", Kind::Any),
        may("buffers", Kind::Objects(&BUFFER)),
        may("bufferViews", Kind::Objects(&VIEW)),
        may("cameras", Kind::Objects(&CAMERA)),
        may("extensionsRequired", Kind::Names),
        may("extensionsUsed", Kind::Names),
        may("images", Kind::Objects(&IMAGE)),
        may("materials", Kind::Objects(&MATERIAL)),
        may("meshes", Kind::Objects(&MESH)),
        may("nodes", Kind::Objects(&NODE)),
        may("samplers", Kind::Objects(&SAMPLER)),
        may("scene", Kind::Index("scenes")),
        may("scenes", Kind::Objects(&SCENE)),
        may("skins", Kind::Objects(&SKIN)),
        may("textures", Kind::Objects(&TEXTURE)),
    ],
    extensions: &[("KHR_lights_punctual", &LIGHTS), ("KHR_materials_variants", &VARIANTS)],
};

static ASSET: Shape = shape(&[
    may("copyright", Kind::Text),
    may("generator", Kind::Text),
    may("minVersion", Kind::Text),
    must("version", Kind::Text),
]);

static ACCESSOR: Shape = shape(&[
    may("bufferView", Kind::Index("bufferViews")),
    may("byteOffset", count_of(0)),
    must("componentType", Kind::Code(&[5120, 5121, 5122, 5123, 5125, 5126], Refuse)),
    must("count", count_of(1)),
    // Bounds are not used.
    may("max", Kind::Any),
    may("min", Kind::Any),
    may("normalized", Kind::Flag),
    may("sparse", Kind::Object(&SPARSE)),
    must("type", Kind::Choice(&["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"], Refuse)),
]);

static SPARSE: Shape = shape(&[
    must("count", count_of(1)),
    must("indices", Kind::Object(&SPARSE_INDICES)),
    must("values", Kind::Object(&SPARSE_VALUES)),
]);

static SPARSE_INDICES: Shape = shape(&[
    must("bufferView", Kind::Index("bufferViews")),
    may("byteOffset", count_of(0)),
    must("componentType", Kind::Code(&[5121, 5123, 5125], Refuse)),
]);

static SPARSE_VALUES: Shape =
    shape(&[must("bufferView", Kind::Index("bufferViews")), may("byteOffset", count_of(0))]);

static BUFFER: Shape = shape(&[must("byteLength", count_of(1)), may("uri", Kind::Text)]);

static VIEW: Shape = shape(&[
    must("buffer", Kind::Index("buffers")),
    must("byteLength", count_of(1)),
    may("byteOffset", count_of(0)),
    may("byteStride", Kind::Whole { least: 4, most: 252, step: 4 }),
    may("target", Kind::Code(&[34962, 34963], Drop)),
]);

static CAMERA: Shape = shape(&[
    may("orthographic", Kind::Object(&ORTHOGRAPHIC)),
    may("perspective", Kind::Object(&PERSPECTIVE)),
    must("type", Kind::Choice(&["perspective", "orthographic"], Refuse)),
]);

static ORTHOGRAPHIC: Shape = shape(&[
    must("xmag", Kind::Number(ANY)),
    must("ymag", Kind::Number(ANY)),
    must("zfar", Kind::Number(ABOVE_ZERO)),
    must("znear", Kind::Number(FROM_ZERO)),
]);

static PERSPECTIVE: Shape = shape(&[
    may("aspectRatio", Kind::Number(ABOVE_ZERO)),
    must("yfov", Kind::Number(ABOVE_ZERO)),
    may("zfar", Kind::Number(ABOVE_ZERO)),
    must("znear", Kind::Number(ABOVE_ZERO)),
]);

static IMAGE: Shape = shape(&[
    may("bufferView", Kind::Index("bufferViews")),
    may("mimeType", Kind::Text),
    may("uri", Kind::Text),
]);

static TEXTURE: Shape = Shape {
    rules: &[may("sampler", Kind::Index("samplers")), may("source", Kind::Index("images"))],
    extensions: &[("EXT_texture_webp", &WEBP)],
};

static WEBP: Shape = shape(&[may("source", Kind::Index("images"))]);

static SAMPLER: Shape = shape(&[
    may("magFilter", Kind::Code(&[9728, 9729], Drop)),
    may("minFilter", Kind::Code(&[9728, 9729, 9984, 9985, 9986, 9987], Drop)),
    may("wrapS", Kind::Code(&[33071, 33648, 10497], Drop)),
    may("wrapT", Kind::Code(&[33071, 33648, 10497], Drop)),
]);

static MATERIAL: Shape = Shape {
    rules: &[
        may("alphaCutoff", Kind::Number(FROM_ZERO)),
        may("alphaMode", Kind::Choice(&["OPAQUE", "MASK", "BLEND"], Drop)),
        may("doubleSided", Kind::Flag),
        may("emissiveFactor", numbers(3, LIGHT)),
        may("emissiveTexture", Kind::Object(&SLOT)),
        may("normalTexture", Kind::Object(&NORMAL_SLOT)),
        may("occlusionTexture", Kind::Object(&OCCLUSION_SLOT)),
        may("pbrMetallicRoughness", Kind::Object(&METALLIC_ROUGHNESS)),
    ],
    extensions: &[
        ("KHR_materials_anisotropy", &ANISOTROPY),
        ("KHR_materials_clearcoat", &CLEARCOAT),
        ("KHR_materials_dispersion", &DISPERSION),
        ("KHR_materials_emissive_strength", &EMISSIVE_STRENGTH),
        ("KHR_materials_ior", &IOR),
        ("KHR_materials_pbrSpecularGlossiness", &SPECULAR_GLOSSINESS),
        ("KHR_materials_specular", &SPECULAR),
        ("KHR_materials_transmission", &TRANSMISSION),
        ("KHR_materials_unlit", &UNLIT),
        ("KHR_materials_volume", &VOLUME),
    ],
};

static SLOT: Shape = Shape {
    rules: &[must("index", Kind::Index("textures")), may("texCoord", count_of(0))],
    extensions: &[("KHR_texture_transform", &TRANSFORM)],
};

static NORMAL_SLOT: Shape = Shape {
    rules: &[
        must("index", Kind::Index("textures")),
        may("texCoord", count_of(0)),
        may("scale", Kind::Number(ANY)),
    ],
    ..SLOT
};

static OCCLUSION_SLOT: Shape = Shape {
    rules: &[
        must("index", Kind::Index("textures")),
        may("texCoord", count_of(0)),
        may("strength", Kind::Number(SHARE)),
    ],
    ..SLOT
};

static TRANSFORM: Shape = shape(&[
    may("offset", numbers(2, ANY)),
    may("rotation", Kind::Number(ANY)),
    may("scale", numbers(2, ANY)),
    may("texCoord", count_of(0)),
]);

static METALLIC_ROUGHNESS: Shape = shape(&[
    may("baseColorFactor", numbers(4, SHARE)),
    may("baseColorTexture", Kind::Object(&SLOT)),
    may("metallicFactor", Kind::Number(SHARE)),
    may("metallicRoughnessTexture", Kind::Object(&SLOT)),
    may("roughnessFactor", Kind::Number(SHARE)),
]);

static SPECULAR_GLOSSINESS: Shape = shape(&[
    may("diffuseFactor", numbers(4, SHARE)),
    may("diffuseTexture", Kind::Object(&SLOT)),
    may("glossinessFactor", Kind::Number(SHARE)),
    may("specularFactor", numbers(3, SHARE)),
    may("specularGlossinessTexture", Kind::Object(&SLOT)),
]);

static ANISOTROPY: Shape = shape(&[
    may("anisotropyRotation", Kind::Number(ANY)),
    may("anisotropyStrength", Kind::Number(SHARE)),
    may("anisotropyTexture", Kind::Object(&SLOT)),
]);

static CLEARCOAT: Shape = shape(&[
    may("clearcoatFactor", Kind::Number(SHARE)),
    may("clearcoatNormalTexture", Kind::Object(&NORMAL_SLOT)),
    may("clearcoatRoughnessFactor", Kind::Number(SHARE)),
    may("clearcoatRoughnessTexture", Kind::Object(&SLOT)),
    may("clearcoatTexture", Kind::Object(&SLOT)),
]);

static EMISSIVE_STRENGTH: Shape = shape(&[may("emissiveStrength", Kind::Number(FROM_ZERO))]);

/// An index of 0 makes facets reflect all light; converters from specular-glossiness materials use it.
static DISPERSION: Shape = shape(&[may("dispersion", Kind::Number(FROM_ZERO))]);

static IOR: Shape = shape(&[may(
    "ior",
    Kind::Number(Range { also: Some(0.0), ..range(1.0, f64::INFINITY, Refuse, Refuse) }),
)]);

static SPECULAR: Shape = shape(&[
    may("specularColorFactor", numbers(3, FROM_ZERO)),
    may("specularColorTexture", Kind::Object(&SLOT)),
    may("specularFactor", Kind::Number(SHARE)),
    may("specularTexture", Kind::Object(&SLOT)),
]);

static TRANSMISSION: Shape =
    shape(&[may("transmissionFactor", Kind::Number(SHARE)), may("transmissionTexture", Kind::Object(&SLOT))]);

static UNLIT: Shape = shape(&[]);

static VOLUME: Shape = shape(&[
    may("attenuationColor", numbers(3, SHARE)),
    may("attenuationDistance", Kind::Number(ABOVE_ZERO)),
    may("thicknessFactor", Kind::Number(FROM_ZERO)),
    may("thicknessTexture", Kind::Object(&SLOT)),
]);

static MESH: Shape = shape(&[
    must("primitives", Kind::Objects(&PRIMITIVE)),
    may("weights", Kind::Numbers { count: None, range: ANY }),
]);

static PRIMITIVE: Shape = Shape {
    rules: &[
        must("attributes", Kind::Attributes),
        may("indices", Kind::Index("accessors")),
        may("material", Kind::Index("materials")),
        may("mode", Kind::Code(&[0, 1, 2, 3, 4, 5, 6], Refuse)),
        may("targets", Kind::Targets),
    ],
    extensions: &[("KHR_materials_variants", &MAPPINGS)],
};

static MAPPINGS: Shape = shape(&[must("mappings", Kind::Objects(&MAPPING))]);

static MAPPING: Shape =
    shape(&[must("material", Kind::Index("materials")), must("variants", Kind::Indices("variants"))]);

static VARIANTS: Shape = shape(&[must("variants", Kind::Objects(&VARIANT))]);

static VARIANT: Shape = shape(&[]);

static NODE: Shape = Shape {
    rules: &[
        may("camera", Kind::Index("cameras")),
        may("children", Kind::Indices("nodes")),
        may("matrix", numbers(16, ANY)),
        may("mesh", Kind::Index("meshes")),
        may("rotation", numbers(4, range(-1.0, 1.0, Keep, Keep))),
        may("scale", numbers(3, ANY)),
        may("skin", Kind::Index("skins")),
        may("translation", numbers(3, ANY)),
        may("weights", Kind::Numbers { count: None, range: ANY }),
    ],
    extensions: &[("EXT_mesh_gpu_instancing", &INSTANCING), ("KHR_lights_punctual", &NODE_LIGHT)],
};

static INSTANCING: Shape = shape(&[must("attributes", Kind::Attributes)]);

static NODE_LIGHT: Shape = shape(&[must("light", Kind::Index("lights"))]);

static LIGHTS: Shape = shape(&[must("lights", Kind::Objects(&PUNCTUAL))]);

static PUNCTUAL: Shape = shape(&[
    may("color", numbers(3, LIGHT)),
    may("intensity", Kind::Number(FROM_ZERO)),
    may("range", Kind::Number(ABOVE_ZERO)),
    may("spot", Kind::Object(&SPOT)),
    must("type", Kind::Choice(&["directional", "point", "spot"], Refuse)),
]);

static SPOT: Shape = shape(&[
    may("innerConeAngle", Kind::Number(ANGLE)),
    may("outerConeAngle", Kind::Number(Range { is_open: true, ..ANGLE })),
]);

static SCENE: Shape = shape(&[may("nodes", Kind::Indices("nodes"))]);

static SKIN: Shape = shape(&[
    may("inverseBindMatrices", Kind::Index("accessors")),
    must("joints", Kind::Indices("nodes")),
    may("skeleton", Kind::Index("nodes")),
]);
